#include "surface/side_points.h"

#include "mix_word.h"
#include "surface/halton.h"
#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

/// Element i of Van der Corput's sequence, moved around the unit interval.
double van_der_corput(uint64_t i, uint32_t base, uint32_t key) {
    const double moved = radical_inverse(i, base) + double(mix_word(key)) * 0x1p-32;
    return moved - std::floor(moved);
}

/// What lies before a side of a surface.
struct View {
    uint32_t open = 0;
    uint32_t backs = 0;
};

View look_around(const visibility::Visibility& visibility, const SidePoint& point, uint32_t looks,
                 uint32_t key) {
    const auto [u, v] = visibility::tangents_of(point.normal);
    const glm::vec3 from = point.position + ray_offset(point.position) * point.normal;
    View view;
    for (uint32_t i = 0; i < looks; ++i) {
        const double square = van_der_corput(i, 2, key), turn = van_der_corput(i, 3, key + 1);
        const float radius = float(std::sqrt(square)), angle = glm::two_pi<float>() * float(turn);
        const glm::vec3 way = radius * (std::cos(angle) * u + std::sin(angle) * v)
                              + float(std::sqrt(1.0 - square)) * point.normal;
        const visibility::Hit hit = visibility.closest({from, way, 0.0f, HUGE_VALF});
        view.open += hit.instance == visibility::no_hit || hit.t >= 1.0f;
        view.backs += hit.instance != visibility::no_hit && hit.facing == visibility::Facing::back;
    }
    return view;
}

} // namespace

SidePoints draw_side_points(const LitSurfaces& lit, glm::vec3 extent,
                            const SidePointSettings& settings) {
    // Sides of patches near the box, by their area up to each.
    std::vector<uint32_t> sides;
    std::vector<double> up_to;
    double whole = 0;
    const size_t met = lit.patches.size();
    const auto patch_at = [&](size_t i) -> const Patch& {
        return i < met ? lit.patches[i] : lit.receivers[i - met];
    };
    for (size_t i = 0; i < met + lit.receivers.size(); ++i) {
        const Patch& patch = patch_at(i);
        if (!(patch.area > 0.0f && patch.asked))
            continue;
        const glm::vec3 a = patch.at({0, 0}), b = patch.at({1, 0}), c = patch.at({0, 1});
        if (glm::any(glm::lessThan(glm::max(a, glm::max(b, c)), glm::vec3(0.0f)))
            || glm::any(glm::greaterThan(glm::min(a, glm::min(b, c)), extent)))
            continue;
        for (uint32_t side = 0; side < (patch.double_sided ? 2u : 1u); ++side) {
            whole += double(patch.area);
            sides.push_back(uint32_t(2 * i + side));
            up_to.push_back(whole);
        }
    }
    const uint64_t count =
        std::min(settings.most_points, uint64_t(std::ceil(settings.density * whole)));
    std::vector<SidePoint> drawn(count);
    std::vector<float> area(count), open(count);
    const double shift = double(mix_word(settings.seed)) * 0x1p-32;
    tbb::parallel_for(uint64_t(0), count, [&](uint64_t i) {
        const double wanted = (double(i) + shift) / double(count) * whole;
        const auto place = std::min<std::ptrdiff_t>(
            std::ranges::upper_bound(up_to, wanted) - up_to.begin(), std::ssize(up_to) - 1);
        const uint32_t side = sides[size_t(place)];
        const Patch& patch = patch_at(side / 2);
        const double root = std::sqrt(van_der_corput(i, 2, 3 * settings.seed));
        const double along = van_der_corput(i, 3, 3 * settings.seed + 1);
        const glm::vec3 at = patch.at({float(root * (1 - along)), float(root * along)});
        if (at != glm::clamp(at, glm::vec3(0.0f), extent))
            return;
        drawn[i] = {at, normal_of(patch, side)};
        const View view = look_around(*lit.visibility, drawn[i], settings.looks,
                                      mix_word(uint32_t(i)) + settings.seed);
        if (2 * view.backs > settings.looks)
            return;
        area[i] = float(whole / double(count)) * patch.alpha;
        open[i] = settings.looks > 0 ? float(view.open) / float(settings.looks) : 1.0f;
    });
    SidePoints result;
    for (size_t i = 0; i < count; ++i)
        if (area[i] > 0.0f) {
            result.points.push_back(drawn[i]);
            result.area.push_back(area[i]);
            result.open.push_back(open[i]);
        }
    return result;
}

} // namespace lpvbake::surface
