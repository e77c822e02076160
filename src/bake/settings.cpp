#include "bake/bake.h"

namespace lpvbake {

const char* name_of(Solver solver) {
    switch (solver) {
    case Solver::lpv:
        return "lpv";
    case Solver::sn:
        return "sn";
    case Solver::gather:
        return "gather";
    }
    return "";
}

std::optional<int> default_bounces(Solver solver) {
    return solver == Solver::lpv ? std::optional(1) : std::nullopt;
}

void set_quality(Quality quality, BakeSettings& settings) {
    switch (quality) {
    case Quality::fast:
        settings.lighting_rays = 1 << 19;
        settings.sn.directions = 144;
        settings.gather.vpls = 96;
        settings.gather.tolerance = 0.5f;
        break;
    case Quality::balanced:
        settings.lighting_rays = BakeSettings().lighting_rays;
        settings.sn.directions = SnSettings().directions;
        settings.gather.vpls = GatherSettings().vpls;
        settings.gather.tolerance = GatherSettings().tolerance;
        break;
    case Quality::accurate:
        settings.lighting_rays = 1 << 23;
        settings.sn.directions = 384;
        settings.gather.vpls = 768;
        settings.gather.tolerance = 0.1f;
        break;
    }
}

} // namespace lpvbake
