#include "bake/direct.h"

#include "text.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <optional>

namespace lpvbake::bake {
namespace {

/// Sums coefficients onto grids.
void add_light(const std::vector<std::vector<glm::vec3>>& sh, const GridKind& kind,
               Volume& volume) {
    const std::vector<volume::GridView> grids = volume::grids_of(volume, kind);
    tbb::parallel_for(std::size_t(0), grids.size(), [&](std::size_t k) {
        const std::span<float> values = grids[k].values();
        for (std::size_t cell = 0; cell < sh[k].size(); ++cell)
            for (int channel = 0; channel < 3; ++channel)
                values[3 * cell + std::size_t(channel)] += sh[k][cell][channel];
    });
}

/// Four grids, each of lights that reach no cell in common.
class ShadowChannels {
public:
    explicit ShadowChannels(Volume& volume)
        : names_(4, nlohmann::json::array()),
          taken_(volume.grid.size()) {
        volume::set_grids(volume, kind_, 4);
        grids_ = volume::grids_of(volume, kind_);
    }

    /// Into the first channel whose lights reach other cells. False where there is none.
    bool add(const Light& source, const medium::DirectLight& light) {
        unsigned taken = 0;
        for (std::size_t cell = 0; cell < taken_.size(); ++cell)
            taken |= light.reached[cell] * taken_[cell];
        const int channel = std::countr_one(taken);
        if (channel >= 4)
            return false;
        const std::span<float> values = grids_[std::size_t(channel)].values();
        for (std::size_t cell = 0; cell < taken_.size(); ++cell)
            if (light.reached[cell]) {
                taken_[cell] = uint8_t(taken_[cell] | 1u << channel);
                values[cell] = light.visibility[cell];
            }
        names_[std::size_t(channel)].push_back(source.name);
        return true;
    }
    std::string names() const {
        return nlohmann::json(names_).dump(-1, ' ', false,
                                           nlohmann::json::error_handler_t::replace);
    }

private:
    const GridKind& kind_ = volume::kind_named("shadow");
    std::vector<nlohmann::json> names_; ///< of a channel
    std::vector<uint8_t> taken_;        ///< channels of a cell, bits
    std::vector<volume::GridView> grids_;
};

/// Adds what of a light comes through holes, where it is the largest share yet.
void add_shaft(const Light& source, const medium::DirectLight& light,
               const visibility::Visibility& visibility, const scene::Frame& frame,
               const DirectSettings& settings, Volume& volume) {
    const bool is_sized = source.type == LightType::directional
                              ? settings.sun_angle > 0
                              : medium::radius_of(source, settings.lamp_radii) > 0;
    const std::vector<float> share = medium::shaft_share(
        source, visibility, frame, volume.walls, settings.beams, settings.shaft_closing,
        is_sized ? std::vector<float>() : light.visibility);
    const std::span<float> largest =
        volume::grids_of(volume, volume::kind_named("shaft"))[0].values();
    for (std::size_t cell = 0; cell < share.size(); ++cell)
        largest[cell] = std::max(largest[cell], share[cell]);
}

/// Tells of spheres that surfaces stand in.
void warn_of_spheres(const Scene& scene, const DirectSettings& settings,
                     const visibility::Visibility& visibility, const scene::Frame& frame,
                     solver::Stages& stages) {
    for (const Light& light : scene.lights) {
        const double radius = medium::radius_of(light, settings.lamp_radii);
        if (radius > 0
            && visibility.nearest_point(glm::vec3(frame.from_world(light.position)),
                                        float(radius / frame.unit), {}, 1.0f))
            stages.warn(
                format("surfaces stand inside of the light \"%s\", a sphere of %.4g m: they "
                       "hide nothing of it, and where it reaches through a wall it lights "
                       "both of its sides",
                       light.name.c_str(), radius));
    }
}

} // namespace

medium::BeamSettings beam_settings(const DirectSettings& settings) {
    medium::BeamSettings beams;
    beams.per_cell = settings.beams;
    beams.sun_angle = settings.sun_angle;
    beams.lamp_radii = settings.lamp_radii;
    return beams;
}

uint64_t beamed_lights(std::span<const Light> lights, const DirectSettings& settings) {
    return uint64_t(std::ranges::count_if(
        lights, [&](const Light& light) { return settings.any() || light.is_static; }));
}

void add_direct(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
                const scene::Frame& frame, solver::Stages& stages, Volume& volume) {
    const DirectSettings& settings = plan.settings.direct;
    const uint64_t count = beamed_lights(scene.lights, settings);
    if (count > 0 || plan.settings.medium)
        warn_of_spheres(scene, settings, visibility, frame, stages);
    if (count == 0)
        return;
    stages.begin("beams", count);
    medium::BeamSettings beams = beam_settings(settings);
    if (settings.sh)
        volume::set_grids(volume, volume::direct_kind(), volume::sh_count(volume.sh_order));
    if (settings.visibility)
        volume::set_grids(volume, volume::visibility_kind(), int(scene.lights.size()));
    if (settings.shaft)
        volume::set_grids(volume, volume::kind_named("shaft"), 1);
    std::optional<ShadowChannels> channels;
    if (settings.channels)
        channels.emplace(volume);
    nlohmann::json names = nlohmann::json::array();
    uint64_t sent = 0;
    for (std::size_t i = 0; i < scene.lights.size(); ++i) {
        const Light& source = scene.lights[i];
        if (!settings.any() && !source.is_static)
            continue;
        beams.order = settings.sh || source.is_static ? volume.sh_order : 0;
        const medium::DirectLight light =
            medium::direct_light(source, visibility, frame, volume.walls, beams);
        sent += light.beams;
        names.push_back(source.name);
        if (source.is_static)
            add_light(light.sh, volume::light_kind(), volume);
        else if (settings.sh)
            add_light(light.sh, volume::direct_kind(), volume);
        if (settings.visibility)
            std::ranges::copy(
                light.visibility,
                volume::grids_of(volume, volume::visibility_kind())[i].values().begin());
        if (channels && !source.is_static && !channels->add(source, light))
            stages.warn("the light \"" + source.name
                        + "\" has no channel: it reaches cells that lights of all four reach; give "
                          "lights a range, or make it `static`");
        if (settings.shaft)
            add_shaft(source, light, visibility, frame, settings, volume);
        stages.progress().advance(1);
    }
    if (channels)
        volume.metadata["shadow_channels"] = channels->names();
    if (settings.shaft)
        volume.metadata["shaft_closing"] = format("%.6g", settings.shaft_closing);
    if (settings.visibility)
        volume.metadata["visibility"] =
            names.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    stages.end(counted(count, "light") + ", " + counted(sent, "beam"));
}

} // namespace lpvbake::bake
