#include "surface/lit_surfaces.h"

#include "lpvbake/error.h"
#include "mix_word.h"
#include "scene/names.h"
#include "scene/photometry.h"
#include "scene/sky.h"
#include "surface/emitter_sampling.h"
#include "surface/flux.h"
#include "surface/halton.h"
#include "surface/shared_rays.h"
#include "text.h"
#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::surface {
namespace {

constexpr uint32_t black = ~0u;     ///< what a ray meets that reflects nothing
constexpr int longest_sum = 20'000; ///< reflections, where their number is not bounded

/// Van der Corput's sequences of Halton's first four bases.
struct HaltonTable {
    static constexpr std::array<uint32_t, 4> base{2, 3, 5, 7};
    static constexpr uint32_t length = 2048; ///< groups of points that share rays take as many
    std::array<std::array<double, length>, base.size()> of_base;

    HaltonTable() {
        for (size_t n = 0; n < of_base.size(); ++n)
            for (uint32_t i = 0; i < length; ++i)
                of_base[n][i] = radical_inverse(i, base[n]);
    }
};
const HaltonTable halton_table;

/// Low-discrepancy points of one side: Halton's sequence, shifted by numbers of the side's own.
class HaltonPoints {
public:
    HaltonPoints(uint32_t side, uint32_t purpose) {
        const uint32_t key = mix_word(side * 8 + purpose);
        for (uint32_t n = 0; n < 4; ++n)
            shift_[n] = double(mix_word(key + n) >> 8) * 0x1p-24;
    }
    /// Point `i` of dimension pair `d` in [0, 1)^2.
    glm::vec2 operator()(uint32_t i, uint32_t d) const {
        return {coordinate(i, 2 * d), coordinate(i, 2 * d + 1)};
    }

private:
    float coordinate(uint32_t i, uint32_t n) const {
        const double plain = i < HaltonTable::length ? halton_table.of_base[n][i]
                                                     : radical_inverse(i, HaltonTable::base[n]);
        const double shifted = plain + shift_[n];
        return float(std::min(shifted - std::floor(shifted), 1.0 - 0x1p-24));
    }

    std::array<double, 4> shift_;
};

/// Uniform over a triangle: weights of its second and third corner.
glm::vec2 on_triangle(glm::vec2 u) {
    const float root = std::sqrt(u.x);
    return {root * (1.0f - u.y), root * u.y};
}

/// With density cos / pi around n (Malley's method).
glm::vec3 sample_cosine(glm::vec3 n, glm::vec2 u) {
    const float radius = std::sqrt(u.x), angle = 2.0f * glm::pi<float>() * u.y;
    const auto [x, y] = visibility::tangents_of(n);
    return radius * std::cos(angle) * x + radius * std::sin(angle) * y
           + std::sqrt(std::max(0.0f, 1.0f - u.x)) * n;
}

/// A side of a patch from which light is reflected.
struct Side {
    const Patch& patch;
    uint32_t index; ///< 2 * patch + side
    glm::vec3 normal;
    uint32_t first_ray = 0; ///< sides of one index take different rays of one sequence

    /// A patch that something crosses is as light as at its centroid: see LitSurfaces::side.
    glm::vec3 point(glm::vec2 weights) const {
        const glm::vec3 p = patch.crossed ? patch.position : patch.at(weights);
        return p + ray_offset(p) * normal;
    }
};

/// A sun of the sky.
struct Sun {
    glm::vec3 lux; ///< across its rays
    glm::vec3 towards;
};

std::vector<Sun> suns_of(const Sky& sky) {
    std::vector<Sun> suns;
    for (const Light& light : scene::sky_suns(sky))
        suns.push_back({light.color * float(light.intensity), glm::vec3(-light.direction)});
    return suns;
}

/// Illuminance of a side's centroid by the suns.
glm::vec3 sunlight(const Side& side, const std::vector<Sun>& suns,
                   const visibility::Visibility& visibility) {
    const float across = 2.0f * glm::length(visibility.hi() - visibility.lo()) + 1.0f; // and out
    const glm::vec3 from = side.point(glm::vec2(1.0f / 3.0f));
    glm::vec3 sum{0.0f};
    for (const Sun& sun : suns)
        if (const float cosine = glm::dot(side.normal, sun.towards); cosine > 0.0f)
            sum += sun.lux * cosine * visibility.filter({from, across * sun.towards});
    return sum;
}

/// Illuminance by emitters, by rays aimed at them.
glm::vec3 aimed(const Side& side, const EmitterSampling& emitters, int aimed_rays, int rays,
                const visibility::Visibility& visibility) {
    glm::vec3 sum{0.0f};
    const HaltonPoints points(side.index, 1);
    for (uint32_t n = 0; n < uint32_t(aimed_rays); ++n) {
        const uint32_t i = side.first_ray * uint32_t(aimed_rays) / uint32_t(rays) + n;
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
        const float end = std::max(0.0f, 1.0f - 2.0f * ray_offset(to.point) / distance);
        sum += to.luminance * (cosine / density) * visibility.filter({from, way, 0.0f, end});
    }
    return sum;
}

float greatest(glm::vec3 v) {
    return std::max({v.x, v.y, v.z});
}

/// Luminance that every side sends by itself, nits.
std::vector<glm::vec3> emission_of(const std::vector<Patch>& patches) {
    std::vector<glm::vec3> emission(2 * patches.size(), glm::vec3(0.0f));
    for (size_t i = 0; i < patches.size(); ++i) {
        emission[2 * i] = patches[i].sent();
        if (patches[i].double_sided)
            emission[2 * i + 1] = emission[2 * i];
    }
    return emission;
}

/// The sides that reflect: light between surfaces is computed for them alone.
struct Reflectors {
    std::vector<uint32_t> sides;    ///< 2 * patch + side
    std::vector<uint32_t> ordinals; ///< a side: its place in `sides`, or `black`

    explicit Reflectors(const std::vector<Patch>& patches) : ordinals(2 * patches.size(), black) {
        for (size_t side = 0; side < ordinals.size(); ++side) {
            const Patch& patch = patches[side / 2];
            if (patch.albedo == glm::vec3(0.0f) || (side % 2 != 0 && !patch.double_sided))
                continue;
            ordinals[side] = uint32_t(sides.size());
            sides.push_back(uint32_t(side));
        }
    }
};

/// What lights a side without another reflection: suns, emitters and sky.
struct DirectLight {
    const LitSurfaces& lit;
    const visibility::Visibility& visibility;
    const Sky& sky;
    const std::vector<glm::vec3>& emission; ///< a side, nits; empty without emitters
    std::vector<Sun> suns;                  ///< where they are not lit by maps
    EmitterSampling aim;
    int rays;       ///< into the half-space of a side
    int aimed_rays; ///< towards emitters

    /// Illuminance by the rays of a side, lux; `met` takes the sides that they hit, and `tints`
    /// what they passed on the way, unless these are empty.
    glm::vec3 by_rays(const Side& side, std::span<uint32_t> met, std::span<glm::vec3> tints) const {
        glm::vec3 around{0.0f};
        const glm::vec3 direct = emitted(side, [&](uint32_t i, const visibility::Ray& ray,
                                                   const visibility::Hit& hit, uint32_t there) {
            if (hit.instance == visibility::no_hit)
                around += hit.tint * scene::sky_rest(sky, ray.direction);
            if (!tints.empty())
                tints[i] = hit.tint;
            if (!met.empty() && there != LitSurfaces::no_side)
                met[i] = there;
        });
        return rays > 0 ? direct + around * (glm::pi<float>() / float(rays)) : direct;
    }

    /// Illuminance by the emitters that the rays of a side hit, lux. meet(i, ray, hit, side) takes
    /// each ray.
    template <class Meet>
    glm::vec3 emitted(const Side& side, const Meet& meet) const {
        const HaltonPoints points(side.index, 2);
        glm::vec3 seen{0.0f};
        for (uint32_t i = 0; i < uint32_t(rays); ++i) {
            const glm::vec3 from = side.point(on_triangle(points(side.first_ray + i, 1)));
            const glm::vec3 direction = sample_cosine(side.normal, points(side.first_ray + i, 0));
            const visibility::Ray ray{from, direction, 0.0f, HUGE_VALF};
            const visibility::Hit hit = visibility.closest(ray);
            const uint32_t there = hit.instance == visibility::no_hit ? LitSurfaces::no_side
                                                                      : lit.side(hit, direction);
            meet(i, ray, hit, there);
            if (there == LitSurfaces::no_side)
                continue;
            if (!aim.empty() && emission[there] != glm::vec3(0.0f)) {
                const float cosine = glm::dot(direction, side.normal) / glm::pi<float>();
                const float slant = std::abs(glm::dot(direction, hit.normal));
                const float aimed_density =
                    aim.density(lit.patches[there / 2]) * hit.t * hit.t / slant;
                seen += hit.tint * emission[there]
                        * (float(rays) * cosine
                           / (float(aimed_rays) * aimed_density + float(rays) * cosine));
            }
        }
        return rays > 0 ? seen * (glm::pi<float>() / float(rays)) : seen;
    }
};

/// How fast the orders of a series fall off.
class Orders {
public:
    /// Power of one more; none may be 0.
    void add(double power) {
        last_.insert(last_.begin(), power);
        last_.resize(std::min<size_t>(last_.size(), several + 1));
    }
    /// Of an order to the one before it: of the last two, or on the mean of several if that is
    /// more.
    double ratio() const {
        if (last_.size() < 2)
            return 1.0;
        const double orders = double(last_.size() - 1);
        return std::min(
            1.0, std::max(last_[0] / last_[1], std::pow(last_[0] / last_.back(), 1.0 / orders)));
    }

private:
    static constexpr size_t several = 16;
    std::vector<double> last_; ///< the latest first
};

/// R = D + rho K R by its series, D + rho K D + ...: each order is added to the others, not taken
/// as a difference of sums, so that it falls off to any number of digits. `reflected` comes as D
/// and becomes R, a reflector; `hits` are their rays' ends, and `tints`, if there are any, what
/// they passed. No row of K sums to more than 1: where the largest albedo is below 1 the series
/// ends.
void reflect_between(const Scene& scene, const scene::Frame& frame, const Reflectors& reflectors,
                     const std::vector<uint32_t>& hits, const std::vector<glm::vec3>& tints,
                     const LightingSettings& settings, std::vector<glm::vec3>& reflected,
                     LitSurfaces& lit, Progress& progress) {
    std::vector<glm::dvec3> sums(reflected.begin(), reflected.end());
    std::vector<glm::vec3> order = std::move(reflected), next(order.size());
    const size_t rays = hits.size() / std::max<size_t>(order.size(), 1);
    const auto patch_of = [&](size_t i) -> const Patch& {
        return lit.patches[reflectors.sides[i] / 2];
    };
    const auto power_of = [&](size_t i, glm::dvec3 luminance) {
        const double most = std::max({luminance.x, luminance.y, luminance.z});
        return double(patch_of(i).area) * double(patch_of(i).alpha) * most;
    };
    // Who has the largest albedo, and sends most of those that have it.
    const auto keeps = [&](size_t i) { return greatest(patch_of(i).albedo) >= 1.0f; };
    bool ends = true;
    for (size_t i = 0; i < order.size(); ++i)
        ends = ends && !keeps(i);
    Orders orders;
    const int most = settings.bounces.value_or(longest_sum);
    progress.begin("bounces", 0);
    while (lit.bounces < most) {
        progress.advance(0);
        tbb::parallel_for(size_t(0), order.size(), [&](size_t i) {
            glm::dvec3 sum{0.0};
            for (size_t ray = i * rays; ray < (i + 1) * rays; ++ray)
                if (hits[ray] != black)
                    sum += tints.empty() ? glm::dvec3(order[hits[ray]])
                                         : glm::dvec3(tints[ray] * order[hits[ray]]);
            next[i] = glm::vec3(glm::dvec3(patch_of(i).albedo) * sum / double(rays));
            sums[i] += glm::dvec3(next[i]);
        });
        std::swap(order, next);
        ++lit.bounces;
        double last = 0.0, all = 0.0;
        for (size_t i = 0; i < order.size(); ++i) {
            last += power_of(i, order[i]);
            all += power_of(i, sums[i]);
        }
        if (!(last > 0.0)) {
            lit.residual = 0.0;
            break;
        }
        orders.add(last);
        const double ratio = orders.ratio();
        if (!settings.bounces && !ends && lit.bounces > 100 && ratio > 0.9999) {
            size_t worst = 0;
            for (size_t i = 0; i < order.size(); ++i)
                if (!keeps(worst)
                    || (keeps(i) && power_of(i, order[i]) > power_of(worst, order[worst])))
                    worst = i;
            const Patch& patch = patch_of(worst);
            const glm::dvec3 at = frame.to_world(glm::dvec3(patch.position));
            throw Error(ErrorKind::invalid,
                        scene::endless_reflection(scene, patch.instance,
                                                  format(" at %.4g,%.4g,%.4g", at.x, at.y, at.z)));
        }
        lit.residual = ratio < 1.0 ? last * ratio / (1.0 - ratio) / all : 1.0;
        if (!settings.bounces && lit.residual <= double(settings.tolerance))
            break;
    }
    if (settings.bounces)
        lit.residual = 0.0;
    reflected.assign(sums.begin(), sums.end());
}

} // namespace

LitSurfaces light_surfaces(const Scene& scene, const visibility::Visibility& visibility,
                           const scene::Frame& frame, const LightingSettings& settings,
                           Progress& progress) {
    LitSurfaces lit;
    lit.visibility = &visibility;
    {
        PatchCover cover = cover_surfaces(scene, frame, visibility, 1.0f);
        lit.patches = std::move(cover.patches);
        lit.tree = std::move(cover.tree);
    }
    const std::vector<Patch>& patches = lit.patches;
    lit.luminance.assign(2 * patches.size(), glm::vec3(0.0f));
    const bool emitters = settings.emitters && scene::has_emitters(scene);
    const std::vector<glm::vec3> emission =
        emitters ? emission_of(patches) : std::vector<glm::vec3>{};
    if (settings.bounces != 0) {
        const Reflectors reflectors(patches);
        const size_t count = reflectors.sides.size();
        const bool between = settings.bounces != 1;
        const int rays = emitters || scene::has_sky(scene) || between
                             ? std::clamp(int(settings.rays / std::max<size_t>(count, 1)), 16, 256)
                             : 0;
        const DirectLight light{
            lit,      visibility, scene.sky,
            emission, {},         EmitterSampling(emitters ? patches : std::vector<Patch>{}),
            rays,     rays / 8};
        std::vector<glm::vec3> reflected(count); // luminance
        std::vector<glm::vec3> mapped(settings.maps ? count : 0);
        std::vector<uint32_t> hits(between ? count * size_t(rays) : 0, black);
        std::vector<glm::vec3> tints(visibility.is_tinted() ? hits.size() : 0);
        progress.begin("lighting", count);
        const PunctualLight lamps = illuminate(scene, scene.lights, lit, frame, 0, progress);
        const PunctualLight suns = illuminate(scene, scene::sky_suns(scene.sky), lit, frame,
                                              uint32_t(scene.lights.size()), progress);
        if (const double landed = lamps.landed + suns.landed; landed > 0.0) {
            lit.narrow = (lamps.narrow + suns.narrow) / landed;
            lit.lost = (lamps.lost + suns.lost) / landed;
        }
        constexpr size_t block = 8192;
        for (size_t first = 0; first < count; first += block) {
            progress.advance(first);
            tbb::parallel_for(first, std::min(count, first + block), [&](size_t i) {
                const uint32_t index = reflectors.sides[i];
                const Patch& patch = patches[index / 2];
                const Side side{patch, index, index % 2 != 0 ? -patch.normal : patch.normal};
                const glm::vec3 share = patch.albedo / glm::pi<float>();
                glm::vec3 lux = lamps.of(index);
                if (settings.maps)
                    mapped[i] = share * lux;
                lux += suns.of(index);
                if (!light.aim.empty())
                    lux += aimed(side, light.aim, light.aimed_rays, rays, visibility);
                const size_t first_ray = between ? i * size_t(rays) : 0;
                const std::span<uint32_t> met =
                    std::span(hits).subspan(first_ray, between ? size_t(rays) : 0);
                const std::span<glm::vec3> through =
                    tints.empty() ? std::span<glm::vec3>{}
                                  : std::span(tints).subspan(first_ray, size_t(rays));
                reflected[i] = share * (lux + light.by_rays(side, met, through));
                for (uint32_t& there : met)
                    if (there != black)
                        there = reflectors.ordinals[there];
            });
        }
        lit.bounces = 1;
        if (between)
            reflect_between(scene, frame, reflectors, hits, tints, settings, reflected, lit,
                            progress);
        for (size_t i = 0; i < count; ++i)
            lit.luminance[reflectors.sides[i]] =
                settings.maps ? glm::max(reflected[i] - mapped[i], 0.0f) : reflected[i];
    }
    for (size_t i = 0; i < emission.size(); ++i)
        lit.luminance[i] += emission[i];
    return lit;
}

std::vector<glm::vec3> irradiance_at(const Scene& scene, const LitSurfaces& lit,
                                     std::span<const SidePoint> points, bool emitters, int rays,
                                     uint32_t seed, Progress& progress) {
    const visibility::Visibility& visibility = *lit.visibility;
    const bool aims = emitters && scene::has_emitters(scene);
    const std::vector<glm::vec3> emission =
        aims ? emission_of(lit.patches) : std::vector<glm::vec3>{};
    const DirectLight light{lit,
                            visibility,
                            scene.sky,
                            emission,
                            suns_of(scene.sky),
                            EmitterSampling(aims ? lit.patches : std::vector<Patch>{}),
                            rays,
                            rays / 8};
    std::vector<glm::vec3> result(points.size());
    constexpr size_t block = 8192;
    for (size_t first = 0; first < points.size(); first += block) {
        progress.advance(first);
        tbb::parallel_for(first, std::min(points.size(), first + block), [&](size_t i) {
            Patch point; // without extent
            point.position = points[i].position;
            point.edge_u = point.edge_v = glm::vec3(0.0f);
            const Side side{point, mix_word(seed) + uint32_t(i), points[i].normal};
            std::vector<uint32_t> met(size_t(rays), black);
            std::vector<glm::vec3> through(met.size());
            glm::vec3 lux =
                sunlight(side, light.suns, visibility) + light.by_rays(side, met, through);
            if (aims)
                lux += aimed(side, light.aim, light.aimed_rays, rays, visibility);
            glm::vec3 reflected{0.0f};
            for (size_t k = 0; k < met.size(); ++k)
                if (const uint32_t there = met[k]; there != black)
                    reflected +=
                        through[k]
                        * (aims ? lit.luminance[there] - emission[there] : lit.luminance[there]);
            result[i] = lux + reflected * (glm::pi<float>() / float(rays));
        });
    }
    return result;
}

std::vector<SideLight> shared_irradiance_at(const Scene& scene, const LitSurfaces& lit,
                                            std::span<const SidePoint> points, bool emitters,
                                            int rays, uint32_t seed, Progress& progress) {
    constexpr size_t most = 64; // points of a group
    const visibility::Visibility& visibility = *lit.visibility;
    const bool aims = emitters && scene::has_emitters(scene);
    const std::vector<glm::vec3> emission =
        aims ? emission_of(lit.patches) : std::vector<glm::vec3>{};
    const EmitterSampling aim(aims ? lit.patches : std::vector<Patch>{});
    const std::vector<Sun> suns = suns_of(scene.sky);
    const PointGroups groups = group_points(visibility, points, most);
    std::vector<SideLight> result(points.size());
    const size_t count = groups.first.size() - 1;
    constexpr size_t block = 1024;
    for (size_t begin = 0; begin < count; begin += block) {
        progress.advance(groups.first[begin]);
        tbb::parallel_for(begin, std::min(count, begin + block), [&](size_t g) {
            const std::span<const uint32_t> group =
                std::span(groups.order)
                    .subspan(groups.first[g], groups.first[g + 1] - groups.first[g]);
            // Few that share have more rays of their own.
            const int own = std::min(256, std::max(rays, 16 * rays / int(group.size())));
            const DirectLight light{lit,  visibility, scene.sky, emission,
                                    suns, aim,        own,       std::max(8, own / 2)};
            std::vector<SidePoint> kept;
            std::vector<SharedRay> shared;
            std::vector<OwnLight> alone;
            std::vector<uint32_t> places;
            for (uint32_t k = 0; k < group.size(); ++k) {
                SideLight& at = result[group[k]];
                Patch point; // without extent
                point.position = points[group[k]].position;
                point.edge_u = point.edge_v = glm::vec3(0.0f);
                const Side side{point, mix_word(seed) + uint32_t(g), points[group[k]].normal,
                                k * uint32_t(own)};
                const size_t before = shared.size();
                int backs = 0, open = 0;
                at.irradiance =
                    sunlight(side, light.suns, visibility)
                    + light.emitted(side, [&](uint32_t, const visibility::Ray& ray,
                                              const visibility::Hit& hit, uint32_t there) {
                          const bool none = hit.instance == visibility::no_hit;
                          open += none || hit.t >= 1.0f;
                          backs += !none && hit.facing == visibility::Facing::back;
                          glm::vec3 luminance{0.0f};
                          if (none)
                              luminance = scene::sky_rest(scene.sky, ray.direction);
                          else if (there != LitSurfaces::no_side)
                              luminance = aims ? lit.luminance[there] - emission[there]
                                               : lit.luminance[there];
                          luminance *= hit.tint;
                          if (luminance != glm::vec3(0.0f))
                              shared.push_back(
                                  {none ? ray.direction : ray.origin + hit.t * ray.direction,
                                   none ? glm::vec3(0.0f) : hit.normal, luminance});
                      });
                if (aims)
                    at.irradiance += aimed(side, aim, light.aimed_rays, own, visibility);
                at.open = 2 * backs > own ? 0.0f : float(open) / float(own);
                if (2 * backs > own) {
                    shared.resize(before);
                    continue;
                }
                kept.push_back(points[group[k]]);
                alone.push_back(light_alone(std::span(shared).subspan(before), own));
                places.push_back(group[k]);
            }
            std::vector<glm::vec3> reflected(kept.size(), glm::vec3(0.0f));
            add_shared(kept, shared, own, reflected);
            tell_apart(kept, alone, reflected);
            for (size_t k = 0; k < kept.size(); ++k)
                result[places[k]].irradiance += reflected[k];
        });
    }
    return result;
}

uint32_t LitSurfaces::side(const visibility::Hit& hit, glm::vec3 direction) const {
    if (hit.facing == visibility::Facing::back)
        return no_side;
    glm::vec2 weights;
    const PatchTree::Node* node = tree.leaf(hit, weights);
    if (!node || node->patch == PatchTree::none)
        return no_side;
    const uint32_t found = node->patch;
    const bool back = glm::dot(hit.normal, direction) > 0.0f;
    if (node->crossed) {
        const Patch& patch = patches[found];
        const glm::vec3 point = patch.at(weights);
        const glm::vec3 lift = (back ? -ray_offset(point) : ray_offset(point)) * patch.normal;
        if (visibility->transmittance({point + lift, patch.position - point}) < 0.5f)
            return no_side;
    }
    return 2 * found + (back ? 1 : 0);
}

glm::vec3 LitSurfaces::leaving(const visibility::Hit& hit, glm::vec3 direction) const {
    const uint32_t seen = side(hit, direction);
    return seen == no_side ? glm::vec3(0.0f) : luminance[seen];
}

} // namespace lpvbake::surface
