#include "surface/lit_surfaces.h"

#include "lpvbake/error.h"
#include "mix_word.h"
#include "scene/names.h"
#include "scene/photometry.h"
#include "scene/sky.h"
#include "surface/elements.h"
#include "surface/emitter_sampling.h"
#include "surface/flux.h"
#include "surface/halton.h"
#include "surface/hemisphere.h"
#include "surface/kept.h"
#include "surface/kept_cover.h"
#include "surface/layered_elements.h"
#include "surface/lit_part.h"
#include "surface/reflections.h"
#include "surface/shared_rays.h"
#include "surface/spots.h"
#include "text.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>
#include <tbb/parallel_for_each.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

constexpr int least_rays = 32; ///< of an element

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

/// Where a ray starts.
struct Start {
    glm::vec3 point;
    glm::vec3 normal;
};

/// A side of a patch from which light is reflected.
struct Side {
    const Patch& patch;
    uint32_t index; ///< 2 * patch + side
    glm::vec3 normal;
    uint32_t first_ray = 0; ///< sides of one index take different rays of one sequence

    Side(const Patch& of, uint32_t side, glm::vec3 out, uint32_t first = 0)
        : patch(of),
          index(side),
          normal(out),
          first_ray(first) {}
    Side(const std::vector<Patch>& patches, uint32_t side)
        : Side(patches[side / 2], side, normal_of(patches[side / 2], side)) {}

    /// Uniform over the patch by u in [0, 1)^2.
    Start start(glm::vec2 u) const { return {point(on_triangle(u)), normal}; }

    /// A patch that something crosses is as light as at its centroid: see LitSurfaces::side.
    glm::vec3 point(glm::vec2 weights) const {
        const glm::vec3 p = patch.crossed ? patch.position : patch.at(weights);
        return p + ray_offset(p) * normal;
    }
};

/// An element from which light is reflected.
struct ElementSide {
    const std::vector<Patch>& patches;
    const Elements& elements;
    size_t element;
    uint32_t index = elements.members[elements.first[element]];
    uint32_t first_ray = 0;

    /// Uniform over its members.
    Start start(glm::vec2 u) const {
        const Elements::Pick pick = elements.pick(element, u.x);
        return Side(patches, pick.side).start({pick.rest, u.y});
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

/// Illuminance by emitters, by rays aimed at them. meet(sample, share) takes each: what the
/// sample's luminance counts.
template <class From, class Meet>
glm::vec3 aimed(const From& side, const EmitterSampling& emitters, int aimed_rays, int rays,
                const visibility::Visibility& visibility, uint32_t purpose, const Meet& meet) {
    glm::vec3 sum{0.0f};
    const HaltonPoints points(side.index, purpose);
    for (uint32_t n = 0; n < uint32_t(aimed_rays); ++n) {
        const uint32_t i = side.first_ray * uint32_t(aimed_rays) / uint32_t(rays) + n;
        const auto [from, normal] = side.start(points(i, 0));
        const glm::vec2 pick = points(i, 1);
        const EmitterSampling::Sample to = emitters.sample(pick.x, on_triangle(points(i + 256, 1)));
        const glm::vec3 way = to.point - from;
        const float square = glm::dot(way, way), distance = std::sqrt(square);
        const float cosine = glm::dot(way, normal) / distance;
        const float facing = -glm::dot(way, to.normal) / distance;
        const float there = to.double_sided ? std::abs(facing) : facing;
        if (!(distance > 0.0f && cosine > 0.0f && there > 0.0f))
            continue;
        const float aim = to.density * square / there; // per solid angle
        const float by_chance = to.met ? float(rays) * cosine / glm::pi<float>() : 0.0f;
        const float density = float(aimed_rays) * aim + by_chance;
        const float end = std::max(0.0f, 1.0f - 2.0f * ray_offset(to.point) / distance);
        const glm::vec3 passes = visibility.filter({from, way, 0.0f, end});
        sum += to.luminance * (cosine / density) * passes;
        meet(to, (cosine / density) * passes);
    }
    return sum;
}

template <class From>
glm::vec3 aimed(const From& side, const EmitterSampling& emitters, int aimed_rays, int rays,
                const visibility::Visibility& visibility) {
    return aimed(side, emitters, aimed_rays, rays, visibility, 1,
                 [](const EmitterSampling::Sample&, glm::vec3) {});
}

/// Luminance that every side sends by itself, nits.
class Emission {
public:
    Emission() = default; ///< without emitters
    explicit Emission(const std::vector<Patch>& patches)
        : of_side_(emission_of(patches)),
          glows_(of_side_.size()) {
        for (size_t side = 0; side < of_side_.size(); ++side)
            glows_[side] = of_side_[side] != glm::vec3(0.0f);
    }

    bool empty() const { return of_side_.empty(); }
    size_t size() const { return of_side_.size(); }
    glm::vec3 operator[](size_t side) const { return of_side_[side]; }
    /// Whether it sends any: a bit, since most of what rays meet is dark.
    bool glows(size_t side) const { return glows_[side]; }
    const std::vector<glm::vec3>& of_sides() const { return of_side_; }

private:
    std::vector<glm::vec3> of_side_;
    std::vector<bool> glows_;
};

/// A cosine-distributed ray of a side, and what it meets.
struct Meeting {
    uint32_t ray;
    glm::vec3 from, direction;
    float cosine; ///< to the side's normal
    const visibility::Hit& hit;
    uint32_t there; ///< the side that is met, or no_side

    bool none() const { return hit.instance == visibility::no_hit; }
};

struct StartedRay {
    visibility::Ray ray;
    float cosine; ///< to the normal of its side
};

/// Rays that are traced together, and then told of in their order.
struct TracedRays {
    std::vector<visibility::Ray> rays;
    std::vector<float> cosines;
    std::vector<visibility::Hit> hits;
    std::vector<uint32_t> there; ///< sides
    size_t told = 0;

    void clear() {
        rays.clear();
        cosines.clear();
        told = 0;
    }
    void add(const StartedRay& start) {
        rays.push_back(start.ray);
        cosines.push_back(start.cosine);
    }
    void trace(const LitSurfaces& lit, const visibility::Visibility& visibility, bool many) {
        hits.resize(rays.size());
        there.resize(rays.size());
        if (many)
            visibility.closest_of_many(rays, hits);
        else
            visibility.closest_of_eights(rays, visibility::Bundle::loose, hits);
        lit.sides(hits, rays, there);
    }
    /// Of the next one, which is a side's `ray`.
    Meeting tell(uint32_t ray) {
        const size_t i = told++;
        return {ray, rays[i].origin, rays[i].direction, cosines[i], hits[i], there[i]};
    }
};

/// No ray is kept.
struct AllAnew {
    static uint32_t there(uint32_t) { return KeptRays::anew; }
    static glm::vec3 tint(uint32_t) { return glm::vec3(1.0f); }
};

/// Those of an element that are kept, but for what meets a spot: how far away it is matters.
struct KeptOfElement {
    const KeptRays& rays;
    size_t element;
    const std::vector<glm::vec3>& spots; ///< Spots::luminance

    uint32_t there(uint32_t ray) const {
        const uint32_t side = rays.there(element, ray);
        return side < KeptRays::anew && !spots.empty() && spots[side] != glm::vec3(0.0f)
                   ? KeptRays::anew
                   : side;
    }
    glm::vec3 tint(uint32_t ray) const { return rays.tint(element, ray); }
};

/// Air that sends light, which then is all there is; null: none.
const visibility::Air* lit_air(const visibility::Visibility& visibility) {
    const visibility::Air* const air = visibility.air();
    return air && air->is_lit() ? air : nullptr;
}

/// What lights a side without another reflection: suns, emitters and sky, or air.
struct DirectLight {
    const LitSurfaces& lit;
    const visibility::Visibility& visibility;
    const Sky& sky;
    const Emission& emission; ///< empty without emitters
    std::vector<Sun> suns;    ///< where they are not lit by maps
    EmitterSampling aim;
    int rays;       ///< into the half-space of a side
    int aimed_rays; ///< towards emitters

    /// Illuminance by the rays of a side, lux. meet(Meeting) takes each ray. `traced` may have them
    /// already, as ask() has added them.
    template <class From, class Meet, class Kept = AllAnew>
    glm::vec3 by_rays(const From& side, const Meet& meet, const Kept& kept = {},
                      TracedRays* traced = nullptr) const {
        glm::vec3 around{0.0f};
        const visibility::Air* const air = lit_air(visibility);
        const glm::vec3 direct = emitted(
            side,
            [&](const Meeting& meeting) {
                if (air)
                    around += air->sent(meeting.from, meeting.direction, 0.0f,
                                        meeting.none() ? HUGE_VALF : meeting.hit.t);
                else if (meeting.none())
                    around += meeting.hit.tint * scene::sky_rest(sky, meeting.direction);
                meet(meeting);
            },
            kept, traced);
        return rays > 0 ? direct + around * (glm::pi<float>() / float(rays)) : direct;
    }

    /// Illuminance by the emitters that the rays of a side hit, lux. What is kept of a ray is all
    /// that is told of it, where it meets no emitter.
    template <class From, class Meet, class Kept = AllAnew>
    glm::vec3 emitted(const From& side, const Meet& meet, const Kept& kept = {},
                      TracedRays* traced = nullptr) const {
        glm::vec3 seen{0.0f};
        if (traced) {
            tell(side, 0, uint32_t(rays), meet, kept, *traced, seen);
        } else {
            constexpr uint32_t most = 64;
            thread_local TracedRays some;
            for (uint32_t first = 0; first < uint32_t(rays); first += most) {
                const uint32_t end = std::min(first + most, uint32_t(rays));
                some.clear();
                ask(side, first, end, kept, some);
                some.trace(lit, visibility, false);
                tell(side, first, end, meet, kept, some, seen);
            }
        }
        return rays > 0 ? seen * (glm::pi<float>() / float(rays)) : seen;
    }

    /// Adds those of the rays [first, end) of a side that have to be traced.
    template <class From, class Kept>
    void ask(const From& side, uint32_t first, uint32_t end, const Kept& kept,
             TracedRays& traced) const {
        const HaltonPoints points(side.index, 2);
        for (uint32_t i = first; i < end; ++i)
            if (const uint32_t known = kept.there(i); !is_told(known) && known != KeptRays::sky)
                traced.add(ray_of(side, points, i));
    }

    /// Tells of the same rays. Adds to `seen` what emitters send them.
    template <class From, class Meet, class Kept>
    void tell(const From& side, uint32_t first, uint32_t end, const Meet& meet, const Kept& kept,
              TracedRays& traced, glm::vec3& seen) const {
        const HaltonPoints points(side.index, 2);
        for (uint32_t i = first; i < end; ++i) {
            const uint32_t known = kept.there(i);
            if (is_told(known)) {
                const visibility::Hit hit{.instance = 0, .tint = kept.tint(i)};
                meet(Meeting{i, glm::vec3(0.0f), glm::vec3(0.0f), 0.0f, hit, known});
            } else if (known == KeptRays::sky) {
                const StartedRay start = ray_of(side, points, i);
                const visibility::Hit hit{.tint = kept.tint(i)};
                meet(Meeting{i, start.ray.origin, start.ray.direction, start.cosine, hit,
                             LitSurfaces::no_side});
            } else {
                const Meeting meeting = traced.tell(i);
                meet(meeting);
                seen += by_chance(meeting);
            }
        }
    }

    template <class From>
    static StartedRay ray_of(const From& side, const HaltonPoints& points, uint32_t i) {
        const auto [from, normal] = side.start(points(side.first_ray + i, 1));
        const glm::vec3 direction = sample_cosine(normal, points(side.first_ray + i, 0));
        return {{from, direction, 0.0f, HUGE_VALF}, glm::dot(direction, normal)};
    }

    /// What is kept of a ray is all that is told of it.
    bool is_told(uint32_t known) const {
        return known == LitSurfaces::no_side
               || (known < KeptRays::anew && (aim.empty() || !emission.glows(known)));
    }

    /// What a ray counts for the emitter that it meets, if any.
    glm::vec3 by_chance(const Meeting& meeting) const {
        if (meeting.there == LitSurfaces::no_side || aim.empty() || !emission.glows(meeting.there))
            return glm::vec3(0.0f);
        return by_chance(meeting, emission[meeting.there],
                         aim.density(lit.patches[meeting.there / 2]));
    }

    /// What a ray counts that meets an emitter, at which others are aimed with this density.
    glm::vec3 by_chance(const Meeting& meeting, glm::vec3 luminance, float density) const {
        const visibility::Hit& hit = meeting.hit;
        const float cosine = meeting.cosine / glm::pi<float>();
        const float slant = std::abs(glm::dot(meeting.direction, hit.normal));
        const float aimed_density = density * hit.t * hit.t / slant;
        return hit.tint * luminance
               * (float(rays) * cosine
                  / (float(aimed_rays) * aimed_density + float(rays) * cosine));
    }
};

/// What a ray of an element meets counts for layers, too.
void find_layered(const DirectLight& light, const Spots& spots, const Meeting& meeting,
                  LayeredElements::Found& found) {
    if (meeting.none())
        found.sky(meeting.hit.tint, meeting.direction);
    if (meeting.there == LitSurfaces::no_side)
        return;
    if (!light.aim.empty())
        if (light.emission.glows(meeting.there))
            found.emitter(meeting.there, light.by_chance(meeting));
    if (!spots.aim.empty() && spots.luminance[meeting.there] != glm::vec3(0.0f))
        found.spot(meeting.there,
                   light.by_chance(meeting, glm::vec3(1.0f), spots.density(meeting.there)));
}

/// Finds the light of an element's rays, without that of other elements, and which sides they meet.
/// `traced` may have them already.
void look_around(const DirectLight& light, const Spots& spots, const Elements& elements, size_t i,
                 ElementRays& rays, LayeredElements* layered, KeptRays& kept, TracedRays* traced) {
    const ElementSide element{light.lit.patches, elements, i};
    const auto count = size_t(light.rays);
    const size_t own = i - rays.first;
    const std::span<uint32_t> met = rays.hits.empty()
                                        ? std::span<uint32_t>{}
                                        : std::span(rays.hits).subspan(own * count, count);
    const bool spotted = !spots.aim.empty();
    glm::vec3 by_spots{0.0f};
    std::optional<LayeredElements::Found> found;
    if (layered)
        found.emplace(*layered);
    const auto take = [&](const Meeting& meeting) {
        kept.add(i, meeting.ray, meeting.none() ? KeptRays::sky : meeting.there, meeting.hit.tint);
        if (found)
            find_layered(light, spots, meeting, *found);
        if (!rays.tints.empty())
            rays.tints[own * count + meeting.ray] = meeting.hit.tint;
        if (met.empty() || meeting.there == LitSurfaces::no_side)
            return;
        met[meeting.ray] = meeting.there;
        if (spotted && spots.luminance[meeting.there] != glm::vec3(0.0f))
            by_spots += light.by_chance(meeting, spots.luminance[meeting.there],
                                        spots.density(meeting.there));
    };
    glm::vec3& lux = rays.lux[own];
    lux = light.by_rays(element, take, KeptOfElement{kept, i, spots.luminance}, traced);
    const auto aim = [&](const EmitterSampling& at, uint32_t purpose, const auto& meet) {
        return aimed(element, at, light.aimed_rays, light.rays, light.visibility, purpose,
                     [&](const EmitterSampling::Sample& to, glm::vec3 share) {
                         if (found)
                             meet(to, share);
                     });
    };
    if (!light.aim.empty())
        lux += aim(light.aim, 1, [&](const EmitterSampling::Sample& to, glm::vec3 share) {
            found->aimed_emitter(to.patch, share * to.luminance);
        });
    if (spotted)
        rays.spots[own] =
            by_spots / float(count)
            + aim(spots.aim, 3, [&](const EmitterSampling::Sample& to, glm::vec3 share) {
                  found->aimed_spot(to.patch, share);
              }) / glm::pi<float>();
    for (uint32_t& there : met)
        if (there != ElementRays::black && elements.of_side[there] == Elements::none)
            there = ElementRays::black;
    if (found)
        layered->take(i, *found, light.rays);
}

/// The light of emitters, sky and other surfaces that is found by rays of elements [first, end).
ElementRays find_around(const Scene& scene, const LightingSettings& settings,
                        const Elements& elements, const Spots& spots, const Emission& emission,
                        size_t first, size_t end, const Keeper& keeper, LayeredElements* layered,
                        const LitSurfaces& lit, Progress& progress) {
    const visibility::Visibility& visibility = *lit.visibility;
    const int count =
        std::clamp(int(settings.rays / std::max<size_t>(elements.size(), 1)), least_rays, 256);
    const DirectLight light{
        lit,       visibility,
        scene.sky, emission,
        {},        EmitterSampling(emission.empty() ? std::vector<Patch>{} : lit.patches),
        count,     count / 4};
    ElementRays rays(first, end, settings.bounces == 1 ? 0 : size_t(count), visibility.is_tinted());
    KeptRays kept(keeper, elements, size_t(count), visibility.is_tinted());
    progress.begin("lighting", end - first);
    // As many as are best traced together are looked around at a time.
    const size_t together = visibility.batch() / size_t(count);
    const auto look = [&](size_t from, size_t to) {
        std::optional<TracedRays> traced;
        if (together > 0) {
            traced.emplace();
            for (size_t i = from; i < to; ++i)
                light.ask(ElementSide{lit.patches, elements, i}, 0, uint32_t(count),
                          KeptOfElement{kept, i, spots.luminance}, *traced);
            traced->trace(lit, visibility, true);
        }
        for (size_t i = from; i < to; ++i)
            look_around(light, spots, elements, i, rays, layered, kept,
                        traced ? &*traced : nullptr);
    };
    const size_t step = std::max<size_t>(together, 1),
                 block = std::max<size_t>(8192, 64 * together);
    for (size_t begin = first; begin < end; begin += block) {
        progress.advance(begin - first);
        const size_t to = std::min(end, begin + block);
        tbb::parallel_for(size_t(0), (to - begin + step - 1) / step, [&](size_t k) {
            look(begin + k * step, std::min(to, begin + (k + 1) * step));
        });
    }
    kept.keep();
    return rays;
}

/// Direct light of lamps and of suns of the sky.
struct Direct {
    PunctualLight lamps, suns;
};

Direct light_directly(const Scene& scene, const scene::Frame& frame,
                      std::span<const scene::LightLayer> layers, Keeper& keeper, LitSurfaces& lit,
                      Progress& progress) {
    const std::span<const Light> sky_suns = scene::sky_suns(scene.sky);
    std::vector<std::vector<glm::vec3>> of_lamps, of_suns;
    for (const scene::LightLayer& layer : layers) {
        of_lamps.push_back(layer.lights);
        of_suns.emplace_back(sky_suns.size(), layer.sky);
    }
    Direct direct{illuminate(scene, scene.lights, lit, frame, 0, progress, of_lamps, &keeper), {}};
    auto& [lamps, suns] = direct;
    suns = illuminate(scene, sky_suns, lit, frame, uint32_t(scene.lights.size()), progress, of_suns,
                      &keeper);
    lamps.follow(lit);
    if (const double landed = lamps.landed + suns.landed; landed > 0.0) {
        lit.narrow = (lamps.narrow + suns.narrow) / landed;
        lit.lost = (lamps.lost + suns.lost) / landed;
    }
    return direct;
}

template <class Set>
void each_side(const LitSurfaces& lit, const Set& set) {
    tbb::parallel_for(size_t(0), lit.luminance.size(), [&](size_t side) {
        const Patch& patch = lit.patches[side / 2];
        if (side % 2 == 0 || patch.double_sided)
            set(uint32_t(side), patch.albedo / glm::pi<float>());
    });
}

/// Surfaces that lamps light, and nothing else yet.
struct Begun {
    LitSurfaces lit; ///< the light that they reflect
    Keeper keeper;
    Direct direct;
    Emission emission;

    Begun(const Scene& scene, const visibility::Visibility& visibility, const scene::Frame& frame,
          const LightingSettings& settings, std::span<const scene::LightLayer> layers,
          Progress& progress);
    /// Whether elements look for light.
    bool looks_around(const Scene& scene, const LightingSettings& settings) const {
        return settings.bounces != 0
               && (!emission.empty() || scene::has_sky(scene) || settings.bounces != 1
                   || lit_air(*lit.visibility));
    }
    Spots spots(const Scene& scene, const scene::Frame& frame,
                const LightingSettings& settings) const {
        return settings.bounces != 1 ? Spots(scene, frame, emission.of_sides(), lit) : Spots{};
    }
};

Begun::Begun(const Scene& scene, const visibility::Visibility& visibility,
             const scene::Frame& frame, const LightingSettings& settings,
             std::span<const scene::LightLayer> layers, Progress& progress) {
    lit.visibility = &visibility;
    lit.layer_count = layers.size();
    PatchCover cover = cover_surfaces(scene, frame, visibility, 1.0f, settings.cache);
    lit.patches = std::move(cover.patches);
    lit.tree = std::move(cover.tree);
    lit.receivers = std::move(cover.receivers);
    keeper = Keeper(settings.cache, lit);
    const bool dark = lit_air(visibility) != nullptr; // but for the air
    if (settings.bounces != 0 && !dark)
        direct = light_directly(scene, frame, layers, keeper, lit, progress);
    keeper.settle(lit);
    lit.luminance.assign(2 * lit.patches.size(), glm::vec3(0.0f));
    lit.layers.assign(layers.size() * lit.luminance.size(), glm::vec3(0.0f));
    if (settings.emitters && !dark && scene::has_emitters(scene))
        emission = Emission(lit.patches);
    if (settings.bounces == 0)
        return;
    each_side(lit, [&](uint32_t side, glm::vec3 share) {
        lit.luminance[side] = share * (direct.lamps.of(side) + direct.suns.of(side));
        for (size_t layer = 0; layer < layers.size(); ++layer)
            lit.layers[layers.size() * side + layer] =
                share * (direct.lamps.of(side, layer) + direct.suns.of(side, layer));
    });
    lit.bounces = 1;
}

/// Maps bring what lamps give.
void take_out(const PunctualLight& lamps, LitSurfaces& lit) {
    each_side(lit, [&](uint32_t side, glm::vec3 share) {
        glm::vec3& luminance = lit.luminance[side];
        luminance = glm::max(luminance - share * lamps.of(side), 0.0f);
        for (size_t layer = 0; layer < lit.layer_count; ++layer)
            lit.layers[lit.layer_count * side + layer] -= share * lamps.of(side, layer);
    });
}

} // namespace

LitSurfaces light_surfaces(const Scene& scene, const visibility::Visibility& visibility,
                           const scene::Frame& frame, const LightingSettings& settings,
                           Progress& progress, std::span<const scene::LightLayer> layers) {
    Begun begun(scene, visibility, frame, settings, layers, progress);
    LitSurfaces& lit = begun.lit;
    if (begun.looks_around(scene, settings)) {
        const Elements elements = group_sides(lit.patches, visibility, frame, begun.keeper);
        const Spots spots = begun.spots(scene, frame, settings);
        std::optional<LayeredElements> own;
        if (!layers.empty())
            own.emplace(scene, layers, elements, spots, lit);
        LayeredElements* const layered = own ? &*own : nullptr;
        ElementRays rays = find_around(scene, settings, elements, spots, begun.emission, 0,
                                       elements.size(), begun.keeper, layered, lit, progress);
        const auto endless = [&](const Patch& patch) {
            const glm::dvec3 at = frame.to_world(glm::dvec3(patch.position));
            return Error(ErrorKind::invalid,
                         scene::endless_reflection(scene, patch.instance,
                                                   format(" at %.4g,%.4g,%.4g", at.x, at.y, at.z)));
        };
        reflect_found(std::move(rays), elements, spots.luminance,
                      {settings.bounces, settings.tolerance, endless}, layered, lit, progress);
    }
    if (settings.maps && settings.bounces != 0)
        take_out(begun.direct.lamps, lit);
    add_emission(begun.emission.of_sides(), lit);
    add_layered_emission(scene, layers, begun.emission.of_sides(), lit);
    lit.share();
    return std::move(begun.lit);
}

LitPart light_part(const Scene& scene, const visibility::Visibility& visibility,
                   const scene::Frame& frame, const LightingSettings& settings, int index,
                   int count, Progress& progress) {
    Begun begun(scene, visibility, frame, settings, {}, progress);
    LitPart part;
    part.index = index;
    part.count = count;
    part.reflections = {settings.bounces, settings.tolerance, {}};
    if (begun.looks_around(scene, settings)) {
        part.elements = group_sides(begun.lit.patches, visibility, frame, begun.keeper);
        Spots spots = begun.spots(scene, frame, settings);
        const auto end_of = [&](int i) {
            return size_t(uint64_t(part.elements.size()) * uint64_t(i) / uint64_t(count));
        };
        part.rays =
            find_around(scene, settings, part.elements, spots, begun.emission, end_of(index - 1),
                        end_of(index), Keeper(), nullptr, begun.lit, progress);
        part.spots = std::move(spots.luminance);
    }
    part.emitters = !begun.emission.empty();
    part.lit = std::move(begun.lit);
    return part;
}

std::vector<glm::vec3> irradiance_at(const Scene& scene, const LitSurfaces& lit,
                                     std::span<const SidePoint> points, bool emitters, int rays,
                                     uint32_t seed, Progress& progress) {
    const visibility::Visibility& visibility = *lit.visibility;
    const bool aims = emitters && scene::has_emitters(scene);
    const Emission emission = aims ? Emission(lit.patches) : Emission{};
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
            std::vector<uint32_t> met(size_t(rays), ElementRays::black);
            std::vector<glm::vec3> through(met.size());
            glm::vec3 lux = sunlight(side, light.suns, visibility)
                            + light.by_rays(side, [&](const Meeting& meeting) {
                                  through[meeting.ray] = meeting.hit.tint;
                                  if (meeting.there != LitSurfaces::no_side)
                                      met[meeting.ray] = meeting.there;
                              });
            if (aims)
                lux += aimed(side, light.aim, light.aimed_rays, rays, visibility);
            glm::vec3 reflected{0.0f};
            for (size_t k = 0; k < met.size(); ++k)
                if (const uint32_t there = met[k]; there != ElementRays::black)
                    reflected += through[k]
                                 * (aims ? lit.to_few(there) - emission[there] : lit.to_few(there));
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
    const Emission emission = aims ? Emission(lit.patches) : Emission{};
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
                    + light.emitted(side, [&](const Meeting& meeting) {
                          const visibility::Hit& hit = meeting.hit;
                          const uint32_t there = meeting.there;
                          const bool none = meeting.none();
                          open += none || hit.t >= 1.0f;
                          backs += !none && hit.facing == visibility::Facing::back;
                          glm::vec3 luminance{0.0f};
                          if (none)
                              luminance = scene::sky_rest(scene.sky, meeting.direction);
                          else if (there != LitSurfaces::no_side)
                              luminance =
                                  aims ? lit.to_few(there) - emission[there] : lit.to_few(there);
                          luminance *= hit.tint;
                          if (luminance != glm::vec3(0.0f))
                              shared.push_back({none ? meeting.direction
                                                     : meeting.from + hit.t * meeting.direction,
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

namespace {

/// Whether a point of a patch, which lies `lift` off it, is lit as the patch's centroid is.
bool is_lit_as(const Patch& patch, const PatchTree::Node& node, bool back, glm::vec3 point,
               glm::vec3 lift, const visibility::Visibility& visibility) {
    if (!node.crossed)
        return true;
    if (visibility.transmittance({point + lift, patch.position - point}) < 0.5f)
        return false;
    return (node.cover >> back & 1) == 0
           || is_covered(visibility, point, back ? -patch.normal : patch.normal)
                  == ((node.cover >> back & 4) != 0);
}

} // namespace

void LitSurfaces::share() {
    if (cut_from.empty())
        return;
    const size_t uncut = patches.size() - cut_from.size();
    std::vector<uint32_t> whole(cut_from.size()); // what was cut first
    for (size_t i = 0; i < whole.size(); ++i)
        whole[i] = cut_from[i] < uncut ? cut_from[i] : whole[cut_from[i] - uncut];
    std::vector<double> areas(uncut, 0.0);
    std::vector<glm::dvec3> sums(2 * uncut, glm::dvec3(0.0));
    const auto add = [&](size_t patch, size_t to) {
        const double area = covered_area(patches[patch]);
        areas[to] += area;
        for (const size_t side : {0, 1})
            sums[2 * to + side] += area * glm::dvec3(luminance[2 * patch + side]);
    };
    for (size_t i = 0; i < whole.size(); ++i)
        add(uncut + i, whole[i]);
    shared = luminance;
    for (size_t i = 0; i < whole.size(); ++i) {
        const uint32_t first = whole[i];
        if (areas[first] < 0.0)
            continue;
        add(first, first);
        for (const size_t side : {0, 1})
            shared[2 * first + side] = areas[first] > 0.0
                                           ? glm::vec3(sums[2 * first + side] / areas[first])
                                           : luminance[2 * first + side];
        areas[first] = -1.0;
    }
    for (size_t i = 0; i < whole.size(); ++i)
        for (const size_t side : {0, 1})
            shared[2 * (uncut + i) + side] = shared[2 * size_t(whole[i]) + side];
}

uint32_t LitSurfaces::side(const visibility::Hit& hit, glm::vec3 direction) const {
    return side_at(hit.facing == visibility::Facing::back ? PatchTree::Approach{}
                                                          : tree.approach(hit),
                   hit, direction);
}

void LitSurfaces::sides(std::span<const visibility::Hit> hits,
                        std::span<const visibility::Ray> rays, std::span<uint32_t> result) const {
    constexpr size_t most = 64;
    std::array<PatchTree::Approach, most> ways;
    for (size_t first = 0; first < hits.size(); first += most) {
        const size_t count = std::min(most, hits.size() - first);
        tree.approach(hits.subspan(first, count), ways);
        for (size_t i = 0; i < count; ++i)
            __builtin_prefetch(ways[i].piece);
        for (size_t i = 0; i < count; ++i)
            result[first + i] = side_at(ways[i], hits[first + i], rays[first + i].direction);
    }
}

uint32_t LitSurfaces::side_at(const PatchTree::Approach& from, const visibility::Hit& hit,
                              glm::vec3 direction) const {
    glm::vec2 weights;
    const PatchTree::Node* node = tree.arrive(from, weights);
    if (!node || node->at == PatchTree::none)
        return no_side;
    const bool back = glm::dot(hit.normal, direction) > 0.0f;
    if (!node->crossed) // the patch itself need not be loaded
        return 2 * node->at + (back ? 1 : 0);
    const Patch& patch = patches[node->at];
    const glm::vec3 point = patch.at(weights);
    const glm::vec3 lift = (back ? -ray_offset(point) : ray_offset(point)) * patch.normal;
    if (is_lit_as(patch, *node, back, point, lift, *visibility))
        return 2 * node->at + (back ? 1 : 0);
    // What stands on the patch lies between them: farther away from it is more of the same side.
    const glm::vec3 away = glm::normalize(point - patch.position)
                           * std::max(glm::length(patch.edge_u), glm::length(patch.edge_v));
    for (const glm::vec3 way : {away, 2.0f * away}) {
        if (visibility->transmittance({point + lift, way}) < 0.5f)
            break;
        const visibility::Hit beside =
            visibility->closest({point + way + 4.0f * lift, -8.0f * lift});
        glm::vec2 there;
        const PatchTree::Node* other = tree.leaf(beside, there);
        if (!other || other->at == PatchTree::none || beside.facing == visibility::Facing::back)
            break;
        const bool turned = glm::dot(beside.normal, lift) < 0.0f;
        if (is_lit_as(patches[other->at], *other, turned, point + way, lift, *visibility))
            return 2 * other->at + (turned ? 1 : 0);
    }
    return no_side;
}

glm::vec3 LitSurfaces::leaving(const visibility::Hit& hit, glm::vec3 direction) const {
    const uint32_t seen = side(hit, direction);
    return seen == no_side ? glm::vec3(0.0f) : luminance[seen];
}

LitSurfaces in_frame(LitSurfaces lit, const scene::Frame& own, const scene::Frame& other,
                     const visibility::Visibility& visibility) {
    lit.visibility = &visibility;
    if (own.unit == other.unit && own.origin == other.origin)
        return lit;
    const auto scale = float(own.unit / other.unit);
    const glm::vec3 offset(other.from_world(own.origin));
    const auto move = [&](Patch& patch) {
        patch.position = scale * patch.position + offset;
        patch.edge_u *= scale;
        patch.edge_v *= scale;
        patch.area *= scale * scale;
    };
    tbb::parallel_for_each(lit.patches, move);
    tbb::parallel_for_each(lit.receivers, move);
    return lit;
}

LitSurfaces turned(LitSurfaces lit, const glm::mat3& rotation,
                   const visibility::Visibility& visibility) {
    lit.visibility = &visibility;
    const auto turn = [&](Patch& patch) {
        for (glm::vec3* way : {&patch.position, &patch.normal, &patch.edge_u, &patch.edge_v})
            *way = rotation * *way;
    };
    tbb::parallel_for_each(lit.patches, turn);
    tbb::parallel_for_each(lit.receivers, turn);
    return lit;
}

} // namespace lpvbake::surface
