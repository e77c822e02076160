// Light from beyond the scene.
#pragma once

#include "scene/scene.h"

#include <span>

namespace lpvbake {

/// A picture of all directions. Texel (column, row) of a picture of w x h spans columns / w of the
/// turn around +Y and rows / h of the angle from +Y down to -Y; luminance is constant over it. The
/// middle of the picture stands at +X, its left end at -X, and -Z halfway between them: what
/// Blender, and three.js's equirectangular mapping, make of the same file.
struct SkyMap {
    int width = 0;
    int height = 0;
    double turn = 0.0;             ///< radians around +Y by which the picture is turned
    std::vector<glm::vec3> texels; ///< nits, row-major from the top left
    /// What is so small and so bright that few rays would meet it, as directional lights (lux), at
    /// most 64, and what is left without it.
    std::vector<Light> suns;
    std::vector<glm::vec3> rest;
    /// [(width + 1) * row + column]: integral over the texels above and to the left, nits sr.
    std::vector<glm::dvec3> integral;
    /// Share of the power up to and with a texel, by luminance; empty for a black sky.
    std::vector<double> cumulative;
};

} // namespace lpvbake

namespace lpvbake::scene {

/// A sky of a picture of width x height texels (nits, finite, not negative), turned by `turn`
/// radians around +Y, counter-clockwise from above. A picture above 1024 x 512 is brought down to
/// that by means over the solid angle, so that no power is lost.
Sky make_sky(int width, int height, std::vector<glm::vec3> texels, double turn);

/// Luminance (nits) that arrives from `towards` (unit, world axes) where nothing is in the way.
glm::vec3 sky_luminance(const Sky& sky, glm::vec3 towards);

/// The same without what sky_suns gives.
glm::vec3 sky_rest(const Sky& sky, glm::vec3 towards);

/// Directional lights that stand for the bright spots of the sky; none of a uniform one.
std::span<const Light> sky_suns(const Sky& sky);

/// Exact mean luminance over the directions whose height (y) lies between `low` and `high`, and
/// whose azimuth (radians from +Z towards +X) between `from` and `to`.
glm::dvec3 sky_mean(const Sky& sky, double low, double high, double from, double to);

/// The sky as a sum over `directions` (unit, spread about evenly) can see it: around each of them
/// the mean over all that is nearer to it than to any other, times what makes the mean over the
/// directions that over the sky.
Sky averaged_sky(const Sky& sky, std::span<const glm::vec3> directions);

/// The sky of a scene that is turned by the rotation. Exact about +Y; about other axes the texels
/// of a map are means of nine looks at its own, suns alone are exact.
Sky turned_sky(const Sky& sky, const glm::dmat3& rotation);

/// A direction drawn from the unit square by the luminance of a sky with a map that is not black.
glm::dvec3 sample_sky(const SkyMap& map, glm::dvec2 u);
/// The density of that, per solid angle.
double sky_density(const SkyMap& map, glm::vec3 towards);

} // namespace lpvbake::scene
