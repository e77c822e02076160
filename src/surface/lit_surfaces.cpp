#include "surface/lit_surfaces.h"

#include "error.h"
#include "mix_word.h"
#include "rsm/view.h"
#include "scene/sky.h"
#include "surface/emitter_sampling.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

constexpr uint32_t black = ~0u; ///< what a ray meets that reflects nothing
constexpr int shadow_samples = 4;
constexpr int longest_sum = 20'000; ///< reflections, where their number is not bounded

/// Low-discrepancy points of one side: Halton's sequence, shifted by numbers of the side's own.
class Points {
public:
    Points(uint32_t side, uint32_t purpose) : key_(mix_word(side * 8 + purpose)) {}
    /// Point `i` of dimension pair `d` in [0, 1)^2.
    glm::vec2 operator()(uint32_t i, uint32_t d) const {
        static constexpr uint32_t base[] = {2, 3, 5, 7};
        const auto coordinate = [&](uint32_t n) {
            double inverse = 0.0, scale = 1.0;
            for (uint32_t k = i; k > 0; k /= base[n]) {
                scale /= base[n];
                inverse += scale * (k % base[n]);
            }
            const double shifted = inverse + double(mix_word(key_ + n) >> 8) * 0x1p-24;
            return float(std::min(shifted - std::floor(shifted), 1.0 - 0x1p-24));
        };
        return {coordinate(2 * d), coordinate(2 * d + 1)};
    }

private:
    uint32_t key_;
};

/// Uniform over a triangle: weights of its second and third corner.
glm::vec2 on_triangle(glm::vec2 u) {
    const float root = std::sqrt(u.x);
    return {root * (1.0f - u.y), root * u.y};
}

/// With density cos / pi around n (Malley's method; basis: Duff et al. 2017).
glm::vec3 around(glm::vec3 n, glm::vec2 u) {
    const float radius = std::sqrt(u.x), angle = 2.0f * glm::pi<float>() * u.y;
    const float s = std::copysign(1.0f, n.z), a = -1.0f / (s + n.z), b = n.x * n.y * a;
    const glm::vec3 x{1.0f + s * n.x * n.x * a, s * b, -s * n.x}, y{b, s + n.y * n.y * a, -n.y};
    return radius * std::cos(angle) * x + radius * std::sin(angle) * y
           + std::sqrt(std::max(0.0f, 1.0f - u.x)) * n;
}

/// A side of a patch from which light is reflected.
struct Side {
    const Patch& patch;
    uint32_t index; ///< 2 * patch + side
    glm::vec3 normal;

    /// A patch that something crosses is as light as at its centroid: see LitSurfaces::side.
    glm::vec3 point(glm::vec2 weights) const {
        const glm::vec3 p = patch.crossed ? patch.position : patch.at(weights);
        return p + lift_of(p) * normal;
    }
};

/// A punctual light in the frame.
struct Source {
    const Light& light;
    glm::vec3 color; ///< times intensity
    glm::dvec3 position;
    Cone cone;
    double unit;
    float across; ///< longer than the way out of the scene

    /// Illuminance (lux) without shadows at `point`, and the ray that looks for them.
    glm::vec3 illuminance(glm::vec3 point, glm::vec3 normal, Ray& shadow) const {
        if (light.type == LightType::directional) {
            const glm::vec3 towards(-light.direction);
            shadow = {point, towards * across};
            return color * std::max(0.0f, glm::dot(normal, towards));
        }
        const glm::dvec3 to = position - glm::dvec3(point);
        const double distance = glm::length(to);
        // A surface that the light lies on does not hide it.
        const double end = 1.0 - double(lift_of(glm::vec3(position))) / distance;
        shadow = {point, glm::vec3(to), 0.0f, float(std::max(0.0, end))};
        const double cosine = glm::dot(glm::dvec3(normal), to) / distance;
        if (!(distance > 0.0 && cosine > 0.0))
            return glm::vec3(0.0f);
        const double metres = distance * unit;
        double factor = cosine / (metres * metres);
        if (light.type == LightType::spot)
            factor *= cone(-to / distance);
        if (light.range > 0.0)
            factor *= std::clamp(1.0 - std::pow(metres / light.range, 4.0), 0.0, 1.0);
        return color * float(factor);
    }
};

std::vector<Source> sources_of(const Scene& scene, const Visibility& visibility,
                               const Frame& frame) {
    const float across = 2.0f * glm::length(visibility.hi() - visibility.lo()) + 1.0f;
    std::vector<Source> sources;
    for (const Light& light : scene.lights)
        sources.push_back({light, light.color * float(light.intensity),
                           frame.from_world(light.position), Cone(light), frame.unit, across});
    return sources;
}

/// Mean illuminance of a side by the punctual lights.
glm::vec3 punctual(const Side& side, const std::vector<Source>& sources,
                   const Visibility& visibility) {
    // One point in each of the four halves of the halves.
    static constexpr glm::vec2 corner[shadow_samples] = {
        {0.0f, 0.0f}, {0.5f, 0.0f}, {0.0f, 0.5f}, {0.5f, 0.5f}};
    glm::vec3 sum{0.0f};
    const Points points(side.index, 0);
    for (const Source& source : sources)
        for (uint32_t i = 0; i < shadow_samples; ++i) {
            const float half = i < 3 ? 0.5f : -0.5f;
            Ray shadow;
            const glm::vec3 lux =
                source.illuminance(side.point(corner[i] + half / 3.0f), side.normal, shadow);
            if (lux == glm::vec3(0.0f))
                continue;
            // Where a shadow ends is not where midpoints lie.
            const glm::vec3 point = side.point(corner[i] + half * on_triangle(points(i, 0)));
            if (source.illuminance(point, side.normal, shadow) != glm::vec3(0.0f))
                sum += lux * visibility.transmittance(shadow);
        }
    return sum / float(shadow_samples);
}

/// Illuminance by emitters, by rays aimed at them.
glm::vec3 aimed(const Side& side, const EmitterSampling& emitters, int aimed_rays, int rays,
                const Visibility& visibility) {
    glm::vec3 sum{0.0f};
    const Points points(side.index, 1);
    for (uint32_t i = 0; i < uint32_t(aimed_rays); ++i) {
        const glm::vec3 from = side.point(on_triangle(points(i, 0)));
        const glm::vec2 pick = points(i, 1);
        const EmitterSampling::Sample to = emitters.sample(pick.x, on_triangle(points(i + 256, 1)));
        const glm::vec3 way = to.point - from;
        const float square = glm::dot(way, way), distance = std::sqrt(square);
        const float cosine = glm::dot(way, side.normal) / distance;
        const float facing = -glm::dot(way, to.normal) / distance;
        const float there = to.double_sided ? std::abs(facing) : facing;
        if (!(distance > 0.0f && cosine > 0.0f && there > 0.0f))
            continue;
        const float aim = to.density * square / there; // per solid angle
        const float density = float(aimed_rays) * aim + float(rays) * cosine / glm::pi<float>();
        const float end = std::max(0.0f, 1.0f - 2.0f * lift_of(to.point) / distance);
        sum += to.luminance * (cosine / density) * visibility.transmittance({from, way, 0.0f, end});
    }
    return sum;
}

float greatest(glm::vec3 v) {
    return std::max({v.x, v.y, v.z});
}

} // namespace

LitSurfaces light_surfaces(const Scene& scene, const Visibility& visibility, const Frame& frame,
                           const LightingSettings& settings, Progress& progress) {
    LitSurfaces lit;
    lit.visibility = &visibility;
    {
        PatchCover cover = cover_surfaces(scene, frame, visibility, 1.0f);
        lit.patches = std::move(cover.patches);
        lit.tree = std::move(cover.tree);
    }
    const std::vector<Patch>& patches = lit.patches;
    const size_t sides = 2 * patches.size();
    lit.luminance.assign(sides, glm::vec3(0.0f));
    const bool no_reflection = settings.bounces == 0;
    const bool emitters = settings.emitters && has_emitters(scene);
    const bool sky = has_sky(scene);
    const bool between = settings.bounces != 0 && settings.bounces != 1;

    std::vector<glm::vec3> emission(emitters ? sides : 0, glm::vec3(0.0f));
    if (emitters)
        for (size_t i = 0; i < patches.size(); ++i) {
            emission[2 * i] = patches[i].emission / patches[i].alpha;
            if (patches[i].double_sided)
                emission[2 * i + 1] = emission[2 * i];
        }
    if (no_reflection) {
        if (emitters)
            lit.luminance = std::move(emission);
        return lit;
    }

    // Direct light, and the rays that carry light between the patches.
    const std::vector<Source> sources = sources_of(scene, visibility, frame);
    const EmitterSampling aim(emitters ? patches : std::vector<Patch>{});
    size_t reflecting = 0;
    for (const Patch& patch : patches)
        if (patch.albedo != glm::vec3(0.0f))
            reflecting += patch.double_sided ? 2 : 1;
    const int rays = emitters || sky || between
                         ? std::clamp(int(settings.rays / std::max<size_t>(reflecting, 1)), 16, 256)
                         : 0;
    const int aimed_rays = rays / 8; // of as many that are not, if there are emitters
    std::vector<glm::vec3> direct(sides, glm::vec3(0.0f)); // luminance reflected once
    std::vector<glm::vec3> mapped(settings.maps ? sides : 0, glm::vec3(0.0f));
    std::vector<uint32_t> hits(between ? sides * size_t(rays) : 0, black);
    progress.begin("lighting", patches.size());
    constexpr size_t block = 4096;
    for (size_t first = 0; first < patches.size(); first += block) {
        progress.advance(first);
        const size_t end = std::min(patches.size(), first + block);
        tbb::parallel_for(2 * first, 2 * end, [&](size_t index) {
            const Patch& patch = patches[index / 2];
            const bool back = index % 2;
            if ((back && !patch.double_sided) || patch.albedo == glm::vec3(0.0f))
                return;
            const Side side{patch, uint32_t(index), back ? -patch.normal : patch.normal};
            glm::vec3 lux = punctual(side, sources, visibility);
            if (settings.maps)
                mapped[index] = patch.albedo * lux / glm::pi<float>();
            if (!aim.empty())
                lux += aimed(side, aim, aimed_rays, rays, visibility);
            const Points points(side.index, 2);
            glm::vec3 seen{0.0f};
            for (uint32_t i = 0; i < uint32_t(rays); ++i) {
                const glm::vec3 from = side.point(on_triangle(points(i, 1)));
                const glm::vec3 direction = around(side.normal, points(i, 0));
                const Hit hit = visibility.closest({from, direction, 0.0f, HUGE_VALF});
                if (hit.instance == no_hit) {
                    seen += sky_luminance(scene.sky, direction);
                    continue;
                }
                const uint32_t met = lit.side(hit, direction);
                if (met == LitSurfaces::no_side)
                    continue;
                if (between)
                    hits[index * size_t(rays) + i] = met;
                if (!aim.empty() && emission[met] != glm::vec3(0.0f)) {
                    const float cosine = glm::dot(direction, side.normal) / glm::pi<float>();
                    const float there = std::abs(glm::dot(direction, hit.normal));
                    const float aimed_density =
                        aim.density(patches[met / 2]) * hit.t * hit.t / there;
                    seen += emission[met]
                            * (float(rays) * cosine
                               / (float(aimed_rays) * aimed_density + float(rays) * cosine));
                }
            }
            if (rays > 0)
                lux += seen * (glm::pi<float>() / float(rays));
            direct[index] = patch.albedo * lux / glm::pi<float>();
        });
    }

    // R = D + rho K R.
    std::vector<glm::vec3> reflected = direct, next(between ? sides : 0);
    lit.bounces = 1;
    double previous = 0.0;
    const int most = settings.bounces.value_or(longest_sum);
    if (between)
        progress.begin("bounces", 0);
    while (lit.bounces < most) {
        progress.advance(0);
        tbb::parallel_for(size_t(0), sides, [&](size_t index) {
            glm::vec3 sum{0.0f};
            if (patches[index / 2].albedo != glm::vec3(0.0f)) {
                const uint32_t* hit = &hits[index * size_t(rays)];
                for (int i = 0; i < rays; ++i)
                    if (hit[i] != black)
                        sum += reflected[hit[i]];
            }
            next[index] = direct[index] + patches[index / 2].albedo * sum / float(rays);
        });
        // The light of one more reflection, and all; both by power.
        double change = 0.0, all = 0.0;
        for (size_t i = 0; i < sides; ++i) {
            const double area = double(patches[i / 2].area) * double(patches[i / 2].alpha);
            change += area * double(greatest(next[i] - reflected[i]));
            all += area * double(greatest(next[i]));
        }
        std::swap(reflected, next);
        ++lit.bounces;
        if (!(change > 0.0))
            break;
        // What is missing is a geometric series.
        const double ratio = previous > 0.0 ? std::min(change / previous, 1.0) : 1.0;
        previous = change;
        if (!settings.bounces && lit.bounces > 100 && ratio > 0.9999)
            throw Error(ExitCode::invalid,
                        scene.path
                            + ": light in a closed part of the scene is reflected without end, "
                              "its albedo is 1; set --max-albedo below 1 or a number of --bounces");
        lit.residual = ratio < 1.0 ? change * ratio / (1.0 - ratio) / all : 1.0;
        if (!settings.bounces && lit.residual <= double(settings.tolerance))
            break;
    }
    if (settings.bounces)
        lit.residual = 0.0;

    lit.luminance = std::move(reflected);
    for (size_t i = 0; i < mapped.size(); ++i)
        lit.luminance[i] = glm::max(lit.luminance[i] - mapped[i], 0.0f);
    if (emitters)
        for (size_t i = 0; i < sides; ++i)
            lit.luminance[i] += emission[i];
    return lit;
}

uint32_t LitSurfaces::side(const Hit& hit, glm::vec3 direction) const {
    if (hit.facing == Facing::back)
        return no_side;
    glm::vec2 weights;
    const uint32_t found = tree.find(hit, weights);
    if (found == PatchTree::none)
        return no_side;
    const bool back = glm::dot(hit.normal, direction) > 0.0f;
    const Patch& patch = patches[found];
    if (patch.crossed) {
        const glm::vec3 point = patch.at(weights);
        const glm::vec3 lift = (back ? -lift_of(point) : lift_of(point)) * patch.normal;
        if (visibility->transmittance({point + lift, patch.position - point}) < 0.5f)
            return no_side;
    }
    return 2 * found + (back ? 1 : 0);
}

glm::vec3 LitSurfaces::leaving(const Hit& hit, glm::vec3 direction) const {
    const uint32_t seen = side(hit, direction);
    return seen == no_side ? glm::vec3(0.0f) : luminance[seen];
}

} // namespace lpvbake
