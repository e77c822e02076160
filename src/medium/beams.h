// The light that punctual lights send straight to the cells of a grid, by beams.
#pragma once

#include "lpvbake/volume.h"
#include "medium/lamp_radius.h"
#include "visibility/visibility.h"

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::medium {

class ClosedMap;
struct Medium;

struct BeamSettings {
    int per_cell = 4;     ///< beams along an edge of a cell, at least
    double sun_angle = 0; ///< across the disc of a directional light, radians (the sun: 0.0093)
    int order = 2;        ///< of DirectLight::sh
    /// Not null: light is attenuated on its way, and counts where there is something to scatter it:
    /// DirectLight::sh is multiplied by the medium's density over its peak, before means are taken,
    /// and `visibility` means nothing. What is behind walls does not count, as without it.
    const Medium* medium = nullptr;
    std::vector<LampRadius> lamp_radii = {}; ///< of point and spot lights
    const ClosedMap* closed = nullptr;       ///< not null: light goes no farther than that says
};

/// Of one light, by Grid::index.
struct DirectLight {
    /// Share of the light that arrives, 0 to 1, a mean over the cell; where surfaces or the air
    /// between colour it that of its luminance (Rec. 709). 0 more than two cells beside a spot's
    /// cone and beyond a light's range.
    std::vector<float> visibility;
    /// sh[k][cell]: incident luminance as Volume::sh has it, nits; a mean over the cell.
    std::vector<std::vector<glm::vec3>> sh;
    std::vector<uint8_t> reached; ///< 1 where it would arrive if nothing stood in its way
    uint64_t beams = 0;
    uint64_t steps = 0; ///< cells that beams went through
};

/// Sends beams from a light through the box [0, extent] of the frame, whose unit is a cell, and
/// sums the lengths of their ways through each cell: those that light has come, and all. A beam
/// carries as much to all points on its way, whatever it spreads to, so that the sum of power times
/// length over a cell's volume is the mean illuminance. How dense beams happen to lie in a cell
/// makes no difference to the ratio of the two sums: where nothing stands in the way it is 1 and
/// the illuminance what the light has without a scene (directional: its own; point and spot:
/// I / r^2, averaged over the cell, from two cells of the light on by 2^3 Gauss points, nearer by
/// the beams themselves). A cell counts as far as its `walls` (Volume::walls, or none) go.
///
/// A light with a radius R is a sphere of one luminance, I / (pi R^2): beams of a direction begin
/// evenly on a disc across it, and what stands inside of the sphere hides nothing of it. A surface
/// that faces it gets I / r^2, and a cell, into which it shines from all of the cap that it is seen
/// as, 2 I / R^2 (1 - sqrt(1 - R^2 / r^2)), and inside of the sphere as much as on its surface. The
/// sun's disc keeps that sum, over all directions, at the light's lux instead.
///
/// Sums are of whole numbers: the same bits for any number of threads.
DirectLight direct_light(const Light& light, const visibility::Visibility& visibility,
                         const scene::Frame& frame, std::span<const std::vector<glm::vec3>> walls,
                         const BeamSettings& settings);

/// The share of a light that arrives through holes of what stands in its way that are narrower than
/// 2 `closing` metres (ClosedMap), 0 to 1, a mean over the cell, by Grid::index; of its middle,
/// without a medium. `open`: DirectLight::visibility by the same settings without either, or empty.
std::vector<float> shaft_share(const Light& light, const visibility::Visibility& visibility,
                               const scene::Frame& frame,
                               std::span<const std::vector<glm::vec3>> walls, int per_cell,
                               double closing, std::vector<float> open = {});

/// Illuminance (lux, RGB) of the static lights among these on a surface at `point` (frame units, a
/// hair off it) with unit normal n, shadows included: that of the lights' middles times the share
/// of their discs that is seen, by 64 rays. Of the settings the lights' sizes count.
glm::vec3 static_illuminance(std::span<const Light> lights,
                             const visibility::Visibility& visibility, const scene::Frame& frame,
                             glm::vec3 point, glm::vec3 n, const BeamSettings& settings = {});

} // namespace lpvbake::medium
