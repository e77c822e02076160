#include "bake/local_transfer.h"

#include "scene/scene_hash.h"
#include "text.h"
#include "transfer/local.h"

namespace lpvbake::bake {

double LocalTransferSettings::radius_of(double cell) const {
    return radius > 0 ? radius : transfer::hop_length * cell;
}

void add_local_transfer(const Scene& scene, const BakePlan& plan,
                        const visibility::Visibility& visibility, const scene::Frame& frame,
                        solver::Stages& stages, Volume& volume) {
    const LocalTransferSettings& settings = plan.settings.local_transfer;
    if (!settings.wanted)
        return;
    stages.begin("local transfer");
    const double radius = settings.radius_of(frame.unit);
    transfer::add_local_transfer(scene, visibility, float(radius / frame.unit), volume);
    stages.end(format("%d rays of %.4g m from each cell", transfer::local_rays, radius));
}

void describe_local_transfer(const Scene& scene, const BakePlan& plan, Volume& volume) {
    const LocalTransferSettings& settings = plan.settings.local_transfer;
    if (!settings.wanted)
        return;
    volume.metadata["local_transfer"] = settings.object ? "object" : "cells";
    volume.metadata["local_radius"] = format("%.9g", settings.radius_of(volume.grid.cell));
    volume.metadata["local_surfaces"] = scene::surfaces_hash(scene);
}

Bounds object_box(const Bounds& object, double radius, double cell) {
    return {cell * glm::floor((object.lo - radius) / cell),
            cell * glm::ceil((object.hi + radius) / cell)};
}

} // namespace lpvbake::bake
