#include "surface/spots.h"

#include "mix_word.h"
#include "scene/sky.h"
#include "surface/elements.h"
#include "surface/halton.h"
#include "surface/hemisphere.h"
#include "surface/together.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

constexpr double bright = 64.0; ///< over the mean of what is seen
constexpr double least = 0.01;  ///< of what is reflected around
constexpr uint32_t looks = 64;  ///< rays that look around

/// What can be seen from a side.
struct Around {
    double luminance = 0.0; ///< mean, nits
    double area = 0.0;      ///< of surfaces, about: of a sphere as far away as they are
    double met = 0.0;       ///< share of directions that meet any
};

Around look_around(const Scene& scene, const std::vector<glm::vec3>& emission,
                   const LitSurfaces& lit, uint32_t side) {
    const Patch& patch = lit.patches[side / 2];
    const glm::vec3 normal = normal_of(patch, side),
                    from = patch.position + ray_offset(patch.position) * normal;
    const double turn = double(mix_word(side)) * 0x1p-32;
    Around around;
    double squares = 0.0;
    for (uint32_t i = 0; i < looks; ++i) {
        const double u = (double(i) + 0.5) / double(looks), v = radical_inverse(i, 2) + turn;
        const glm::vec3 direction = sample_cosine(normal, glm::vec2(u, v - std::floor(v)));
        const visibility::Hit hit = lit.visibility->closest({from, direction, 0.0f, HUGE_VALF});
        if (hit.instance == visibility::no_hit) {
            around.luminance += double(greatest(scene::sky_rest(scene.sky, direction)));
            continue;
        }
        const uint32_t there = lit.side(hit, direction);
        if (there == LitSurfaces::no_side)
            continue;
        around.met += 1.0;
        squares += double(hit.t) * double(hit.t);
        around.luminance += double(greatest(lit.luminance[there]));
        if (!emission.empty())
            around.luminance += double(greatest(emission[there]));
    }
    if (around.met > 0.0)
        around.area = 4.0 * glm::pi<double>() * squares / around.met;
    around.luminance /= double(looks);
    around.met /= double(looks);
    return around;
}

using Group = std::span<const Placed>; // Placed::index is the side

/// What of a group is a spot.
struct Found {
    std::vector<uint32_t> sides;
    double power = 0.0; ///< their light
    double aims = 0.0;  ///< rays to aim at them, in those at other groups
};

Found look_for(const Scene& scene, const std::vector<glm::vec3>& emission, const LitSurfaces& lit,
               Group group) {
    const auto light_of = [&](const Placed& of) {
        return double(greatest(lit.luminance[of.index]));
    };
    const auto power_of = [&](const Placed& of) {
        return light_of(of) * covered_area(lit.patches[of.index / 2]);
    };
    const Placed& strongest = *std::ranges::max_element(group, {}, power_of);
    const Around around = look_around(scene, emission, lit, strongest.index);
    double all = around.luminance * around.area;
    for (const Placed& of : group)
        all += power_of(of);
    Found found;
    for (const Placed& of : group)
        if (light_of(of) * around.area > bright * all) {
            found.sides.push_back(of.index);
            found.power += power_of(of);
        }
    if (!(found.power > least * all))
        return {};
    found.aims = around.met;
    return found;
}

/// Sides that lamps light, in order.
std::vector<Placed> lit_sides(const LitSurfaces& lit, const Boxes& boxes) {
    std::vector<Placed> sides;
    for (uint32_t side = 0; side < lit.luminance.size(); ++side) {
        const Patch& patch = lit.patches[side / 2];
        if (patch.area > 0.0f && greatest(lit.luminance[side]) > 0.0f)
            sides.push_back({together(patch, side, boxes), side});
    }
    tbb::parallel_sort(sides);
    return sides;
}

} // namespace

Spots::Spots(const Scene& scene, const scene::Frame& frame, const std::vector<glm::vec3>& emission,
             const LitSurfaces& lit) {
    const std::vector<Placed> lit_by_lamps = lit_sides(lit, frame);
    const std::vector<Group> groups = groups_of(lit_by_lamps);
    std::vector<Found> found(groups.size());
    tbb::parallel_for(size_t(0), groups.size(),
                      [&](size_t i) { found[i] = look_for(scene, emission, lit, groups[i]); });
    std::vector<Patch> patches;
    std::vector<double> favours;
    for (const Found& group : found)
        for (const uint32_t side : group.sides) {
            sides.push_back(side);
            Patch& patch = patches.emplace_back(lit.patches[side / 2]);
            patch.emission = lit.luminance[side] * patch.alpha;
            patch.double_sided = false;
            patch.normal = normal_of(patch, side);
            favours.push_back(group.aims / group.power);
        }
    if (sides.empty())
        return;
    aim = EmitterSampling(patches, favours);
    luminance.assign(lit.luminance.size(), glm::vec3(0.0f));
    density_.assign(luminance.size(), 0.0f);
    for (size_t i = 0; i < sides.size(); ++i) {
        luminance[sides[i]] = lit.luminance[sides[i]];
        density_[sides[i]] = aim.density(patches[i], favours[i]);
    }
}

} // namespace lpvbake::surface
