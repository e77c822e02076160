#include "reference/peer.h"

#include "lpvbake/error.h"
#include "reference/sampling.h"
#include "scene/material.h"
#include "scene/sky.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace lpvbake::reference {
namespace {

constexpr uint32_t wave_size = 2048; ///< rays: what a wave keeps of them stays in a core's cache
/// From so many rays a point on, eight neighbours are alike enough to walk down Embree's tree
/// together: of 64 rays that takes 1.4 to 1.9 times as long as apart, of 4096 a third less.
constexpr size_t dense = 1024;
constexpr int most_reflections = 1000;
constexpr float pi = glm::pi<float>();

float unit_float(uint64_t bits) {
    return float(bits >> 40) * 0x1p-24f;
}

/// The directions i -> (1 - (2 i + 1) / N, 2 pi i / golden ratio) in the order of a curve over the
/// octahedron, so that neighbours in the list are neighbours on the sphere.
std::vector<glm::vec3> fibonacci_lattice(uint32_t count) {
    struct Numbered {
        uint32_t code;
        glm::vec3 direction;
    };
    std::vector<Numbered> places;
    for (uint32_t i = 0; i < count; ++i) {
        const double z = 1.0 - (2.0 * i + 1.0) / count;
        const double turns = i * (glm::golden_ratio<double>() - 1.0);
        const double phi = glm::two_pi<double>() * (turns - std::floor(turns));
        const double r = std::sqrt(1.0 - z * z);
        const glm::dvec3 w{r * std::cos(phi), r * std::sin(phi), z};
        // The octahedron's faces unfolded to a square, its cells numbered by interleaved bits.
        const double sum = std::abs(w.x) + std::abs(w.y) + std::abs(w.z);
        glm::dvec2 at = glm::dvec2(w) / sum;
        if (w.z < 0.0)
            at = glm::dvec2(std::copysign(1.0 - std::abs(at.y), at.x),
                            std::copysign(1.0 - std::abs(at.x), at.y));
        const auto cell = glm::uvec2(glm::clamp((at + 1.0) * 2048.0, 0.0, 4095.0));
        uint32_t code = 0;
        for (uint32_t bit = 0; bit < 12; ++bit)
            code |= (cell.x >> bit & 1u) << (2 * bit) | (cell.y >> bit & 1u) << (2 * bit + 1);
        places.push_back({code, glm::vec3(w)});
    }
    std::ranges::stable_sort(places, {}, &Numbered::code);
    std::vector<glm::vec3> directions;
    for (const Numbered& place : places)
        directions.push_back(place.direction);
    return directions;
}

/// A uniformly distributed rotation (Shoemake 1992, "Uniform random rotations").
glm::mat3 random_rotation(uint64_t key) {
    const double share = double(mix_bits(key + 1) >> 11) * 0x1p-53;
    const double a = glm::two_pi<double>() * double(mix_bits(key + 2) >> 11) * 0x1p-53;
    const double b = glm::two_pi<double>() * double(mix_bits(key + 3) >> 11) * 0x1p-53;
    const double r = std::sqrt(1.0 - share), s = std::sqrt(share);
    const glm::dvec4 q{r * std::sin(a), r * std::cos(a), s * std::sin(b), s * std::cos(b)};
    const double x = q.x, y = q.y, z = q.z, w = q.w;
    return glm::mat3(1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w),
                     2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w),
                     2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y));
}

/// What an instance's surface does to light; `even`: the same at all its points.
struct Surface {
    bool even;
    bool glows;
    glm::vec3 albedo, emission;
};

struct PeerLight {
    LightType type;
    glm::vec3 color;     ///< times intensity: lux, or cd over the square of a frame unit
    glm::vec3 position;  ///< frame units
    glm::vec3 direction; ///< in which it travels
    float range;         ///< frame units; 0: unlimited
    float cos_inner, cos_outer;
};

/// All that is the same for every wave.
struct PeerWork {
    const Scene& scene;
    const visibility::Visibility& visibility;
    const PeerSettings& settings;
    std::span<const glm::vec3> points;
    std::vector<glm::vec3> directions;
    std::vector<Surface> surfaces; ///< an instance
    std::vector<PeerLight> sources;
    bool emitters;
    bool sky;
    float across;
    std::vector<glm::vec3> normals;

    PeerWork(const Scene& of, const visibility::Visibility& rays, const scene::Frame& frame,
             std::span<const glm::vec3> from, const PeerSettings& how);

    /// Points whose rays share waves.
    size_t group() const { return std::max<size_t>(1, wave_size / directions.size()); }
    size_t groups() const { return (points.size() + group() - 1) / group(); }
};

PeerWork::PeerWork(const Scene& of, const visibility::Visibility& rays, const scene::Frame& frame,
                   std::span<const glm::vec3> from, const PeerSettings& how)
    : scene(of),
      visibility(rays),
      settings(how),
      points(from),
      directions(fibonacci_lattice(std::clamp(how.rays, 1u, 1u << 24))),
      emitters(how.paths.emitters && scene::has_emitters(of)),
      sky(scene::has_sky(of)),
      across(1.01f * glm::length(rays.hi() - rays.lo()) + 1.0f) {
    check_peer(scene);
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const Material& material = scene.materials[size_t(mesh.material)];
        if (instance.role == Role::cast_only) {
            surfaces.push_back({true, false, glm::vec3(0.0f), glm::vec3(0.0f)});
            continue;
        }
        surfaces.push_back({material.base_color_texture < 0 && mesh.colors.empty()
                                && (material.emission_texture < 0 || !emitters),
                            emitters && material.emission != glm::vec3(0.0f),
                            glm::clamp(glm::vec3(material.base_color), glm::vec3(0.0f),
                                       glm::vec3(scene.rules.max_albedo)),
                            material.emission});
    }
    for (const Light& light : scene.lights) {
        const bool directional = light.type == LightType::directional;
        const double intensity = light.intensity / (directional ? 1.0 : frame.unit * frame.unit);
        sources.push_back({light.type, light.color * float(intensity),
                           glm::vec3(frame.from_world(light.position)), glm::vec3(light.direction),
                           float(light.range / frame.unit),
                           float(std::cos(std::min(light.inner_cone, light.outer_cone))),
                           float(std::cos(light.outer_cone))});
    }
    for (const Light& sun : scene::sky_suns(scene.sky))
        sources.push_back({sun.type, sun.color, {}, glm::vec3(sun.direction), 0.0f, 0.0f, 0.0f});
    if (settings.irradiance)
        for (const glm::dvec3& n : volume::neighbour_normals())
            normals.push_back(glm::vec3(n));
}

/// Traces waves of one thread.
class Waves {
public:
    /// `recorder`, if any, gets all rays.
    explicit Waves(const PeerWork& work, visibility::PackedRays* recorder = nullptr)
        : work_(work),
          recorder_(recorder),
          light_(wave_size),
          paths_(wave_size),
          rays_(wave_size),
          hits_(wave_size),
          lit_(wave_size),
          shadows_(wave_size),
          arriving_(wave_size),
          visible_(wave_size) {}

    /// The points [first, end); returns the number of rays.
    uint64_t trace(size_t first, size_t end, PeerField& field);

private:
    /// A path on its way. Its random numbers follow from its key.
    struct Path {
        glm::vec3 throughput;
        uint32_t slot; ///< of the wave
        uint64_t key;
    };
    /// A point of a surface that light falls on.
    struct Lit {
        glm::vec3 point, normal;
    };
    /// What a light adds unless the point lies in its shadow.
    struct Arriving {
        uint32_t slot;
        glm::vec3 light;
    };
    /// An index over the rays of some points, one point after the other.
    struct RayIndex {
        size_t point = 0, ray = 0;
        void next(size_t rays) {
            if (++ray == rays) {
                ray = 0;
                ++point;
            }
        }
    };

    void follow();
    void shade(int reflections);
    void add_punctual_lights();
    void add_indirect();
    void go_on(int reflections);

    const PeerWork& work_;
    visibility::PackedRays* recorder_;
    uint64_t traced_ = 0;
    std::vector<glm::vec3> light_; ///< a slot of the wave
    // One entry a path that is under way, of which there are count_. Entries are written member by
    // member: a whole one would be put together on the stack first, and be waited for.
    size_t count_ = 0;
    std::vector<Path> paths_;
    std::vector<visibility::Ray> rays_;
    std::vector<visibility::Hit> hits_;
    std::vector<Lit> lit_;
    // One entry a shadow ray.
    std::vector<visibility::Ray> shadows_;
    std::vector<Arriving> arriving_;
    std::vector<glm::vec3> visible_;
    std::vector<glm::vec3> indirect_;
};

/// What a surface does to light at a hit: {albedo, emission}.
std::pair<glm::vec3, glm::vec3> surface_at(const PeerWork& work, const visibility::Hit& hit) {
    const Surface& surface = work.surfaces[hit.instance];
    if (surface.even)
        return {surface.albedo, surface.glows ? surface.emission : glm::vec3(0.0f)};
    const Mesh& mesh = work.scene.meshes[size_t(work.scene.instances[hit.instance].mesh)];
    const scene::SurfaceSample sample =
        scene::sample_surface(work.scene, mesh, hit.triangle, hit.barycentric);
    if (!surface.glows || !(sample.alpha > 0.0f))
        return {sample.albedo, glm::vec3(0.0f)};
    // The hit was drawn with probability alpha already, which sample_emission has as a factor.
    return {sample.albedo,
            scene::sample_emission(work.scene, mesh, hit.triangle, hit.barycentric) / sample.alpha};
}

/// The sky that a ray of `count` over the sphere sees: the mean over a share of it like its own.
glm::vec3 sky_around(const Sky& sky, glm::vec3 w, size_t count) {
    if (!sky.map)
        return sky.luminance;
    const double edge = std::sqrt(4.0 * glm::pi<double>() / double(count));
    const double radius = std::sqrt(std::max(0.0, 1.0 - double(w.y) * double(w.y)));
    const double low = std::max(-1.0, double(w.y) - 0.5 * edge * radius);
    const double high = std::min(1.0, double(w.y) + 0.5 * edge * radius);
    const double width = std::min(glm::two_pi<double>(), edge * edge / std::max(high - low, 1e-9));
    const double azimuth = std::atan2(double(w.x), double(w.z));
    return glm::vec3(scene::sky_mean(sky, std::min(low, high - 1e-9), high, azimuth - 0.5 * width,
                                     azimuth + 0.5 * width));
}

/// Takes what the hits emit, and the sky where there are none, and keeps those that reflect.
void Waves::shade(int reflections) {
    const bool last = work_.settings.paths.bounces && reflections == *work_.settings.paths.bounces;
    size_t kept = 0;
    for (size_t i = 0; i < count_; ++i) {
        const visibility::Hit& hit = hits_[i];
        paths_[i].throughput *= hit.tint;
        if (hit.instance == visibility::no_hit && work_.sky) {
            const Path& path = paths_[i];
            const glm::vec3 w = rays_[i].direction;
            light_[path.slot] +=
                path.throughput
                * (reflections == 0 ? sky_around(work_.scene.sky, w, work_.directions.size())
                                    : scene::sky_rest(work_.scene.sky, w));
        }
        if (hit.instance == visibility::no_hit || hit.facing == visibility::Facing::back)
            continue;
        const auto [albedo, emission] = surface_at(work_, hit);
        const Path& path = paths_[i];
        const glm::vec3 throughput = path.throughput * albedo;
        light_[path.slot] += path.throughput * emission;
        if (last || throughput == glm::vec3(0.0f))
            continue;
        const visibility::Ray& ray = rays_[i];
        const glm::vec3 n = glm::dot(hit.normal, ray.direction) > 0.0f ? -hit.normal : hit.normal;
        const glm::vec3 point = ray.origin + hit.t * ray.direction;
        lit_[kept].point = point + ray_offset(point) * n;
        lit_[kept].normal = n;
        if (work_.settings.indirect) {
            hits_[kept] = hit;
            hits_[kept].normal = n;
        }
        paths_[kept].slot = path.slot;
        paths_[kept].key = path.key;
        paths_[kept].throughput = throughput;
        ++kept;
    }
    count_ = kept;
}

void Waves::add_punctual_lights() {
    for (const PeerLight& source : work_.sources) {
        size_t kept = 0;
        for (size_t i = 0; i < count_; ++i) {
            const auto& [point, normal] = lit_[i];
            glm::vec3 way = -work_.across * source.direction;
            float share = -glm::dot(normal, source.direction), end = 1.0f;
            if (source.type != LightType::directional) {
                way = source.position - point;
                const float square = glm::dot(way, way), distance = std::sqrt(square);
                if (!(square > 0.0f))
                    continue;
                share = glm::dot(normal, way) / (distance * square);
                end = std::max(0.0f, 1.0f - ray_offset(source.position) / distance);
                if (source.range > 0.0f) {
                    const float part = square / (source.range * source.range);
                    share *= std::clamp(1.0f - part * part, 0.0f, 1.0f);
                }
                if (source.type == LightType::spot) {
                    const float cosine = -glm::dot(way, source.direction) / distance;
                    share *= spot_ramp(cosine, source.cos_inner, source.cos_outer);
                }
            }
            if (!(share > 0.0f))
                continue;
            visibility::Ray& shadow = shadows_[kept];
            shadow.origin = point;
            shadow.direction = way;
            shadow.t_min = 0.0f;
            shadow.t_max = end;
            arriving_[kept].slot = paths_[i].slot;
            arriving_[kept].light = share / pi * paths_[i].throughput * source.color;
            ++kept;
        }
        const std::span<const visibility::Ray> shadows(shadows_.data(), kept);
        work_.visibility.filter_of_eights(shadows, visibility::Bundle::loose, visible_);
        if (recorder_)
            recorder_->add(shadows, visibility::Bundle::loose, true);
        traced_ += kept;
        for (size_t i = 0; i < kept; ++i)
            light_[arriving_[i].slot] += visible_[i] * arriving_[i].light;
    }
}

void Waves::add_indirect() {
    indirect_.assign(count_, glm::vec3(0.0f));
    work_.settings.indirect({hits_.data(), count_}, indirect_);
    for (size_t i = 0; i < count_; ++i)
        light_[paths_[i].slot] += paths_[i].throughput / pi * indirect_[i];
}

/// Leaves the paths that are reflected once more, and their rays.
void Waves::go_on(int reflections) {
    const bool unlimited = !work_.settings.paths.bounces;
    size_t kept = 0;
    for (size_t i = 0; i < count_; ++i) {
        const Path& path = paths_[i];
        const uint64_t key = mix_bits(path.key + 0x9e3779b97f4a7c15u);
        glm::vec3 throughput = path.throughput;
        if (unlimited && reflections > 0) {
            const float survival = std::min(1.0f, max_component(throughput));
            if (unit_float(mix_bits(~key)) >= survival)
                continue;
            throughput /= survival;
        }
        visibility::Ray& ray = rays_[kept];
        ray.origin = lit_[i].point;
        ray.direction =
            sample_cosine(lit_[i].normal, glm::vec2(unit_float(key), unit_float(key << 24)));
        ray.t_min = 0.0f;
        ray.t_max = HUGE_VALF;
        paths_[kept].slot = path.slot;
        paths_[kept].key = key;
        paths_[kept].throughput = throughput;
        ++kept;
    }
    count_ = kept;
}

/// Follows paths whose first rays are given to their ends.
void Waves::follow() {
    const std::optional<int> limit = work_.settings.paths.bounces;
    for (int reflections = 0; count_ > 0 && reflections <= most_reflections; ++reflections) {
        if (limit && reflections == *limit && !work_.emitters && !work_.sky)
            return;
        if (reflections > 0)
            go_on(reflections - 1);
        const bool close = reflections == 0 && work_.directions.size() >= dense;
        const visibility::Bundle bundle =
            close ? visibility::Bundle::tight : visibility::Bundle::loose;
        const std::span<const visibility::Ray> rays(rays_.data(), count_);
        work_.visibility.closest_of_eights(rays, bundle, hits_);
        if (recorder_)
            recorder_->add(rays, bundle, false);
        traced_ += rays.size();
        shade(reflections);
        add_punctual_lights();
        if (work_.settings.indirect) {
            add_indirect();
            return;
        }
    }
}

uint64_t Waves::trace(size_t first, size_t end, PeerField& field) {
    const size_t rays = work_.directions.size(), all = (end - first) * rays;
    const int order = work_.settings.sh_order;
    traced_ = 0;
    std::vector<glm::mat3> turns;
    std::vector<uint64_t> keys;
    for (size_t point = first; point < end; ++point) {
        keys.push_back(join_bits(work_.settings.seed, point));
        turns.push_back(random_rotation(keys.back()));
    }
    std::array<glm::vec3, volume::sh_count(volume::sh_max_order)> sh{};
    std::array<glm::vec3, 26> irradiance{};
    RayIndex at;
    for (size_t start = 0; start < all; start += wave_size) {
        const size_t count = std::min<size_t>(wave_size, all - start);
        RayIndex place = at;
        for (size_t i = 0; i < count; ++i, place.next(rays)) {
            paths_[i].throughput = glm::vec3(1.0f);
            paths_[i].slot = uint32_t(i);
            paths_[i].key = mix_bits(keys[place.point] + place.ray);
            rays_[i].origin = work_.points[first + place.point];
            rays_[i].direction = turns[place.point] * work_.directions[place.ray];
            rays_[i].t_min = 0.0f;
            rays_[i].t_max = HUGE_VALF;
            light_[i] = glm::vec3(0.0f);
        }
        count_ = count;
        follow();
        for (size_t i = 0; i < count; ++i, at.next(rays)) {
            const auto [point, ray] = at;
            if (const glm::vec3 light = light_[i]; light != glm::vec3(0.0f)) {
                const glm::vec3 w = turns[point] * work_.directions[ray];
                const volume::ShValues basis = volume::sh_basis(order, w);
                for (size_t k = 0; k < field.sh.size(); ++k)
                    sh[k] += basis[k] * light;
                for (size_t n = 0; n < work_.normals.size(); ++n)
                    irradiance[n] += std::max(0.0f, glm::dot(work_.normals[n], w)) * light;
            }
            if (ray + 1 < rays)
                continue;
            const float weight = 4.0f * pi / float(rays);
            for (size_t k = 0; k < field.sh.size(); ++k)
                field.sh[k][first + point] = weight * sh[k];
            for (size_t n = 0; n < work_.normals.size(); ++n)
                field.irradiance[n][first + point] = weight * irradiance[n];
            sh = {};
            irradiance = {};
        }
    }
    return traced_;
}

PeerField empty_field(const PeerWork& work) {
    const std::vector<glm::vec3> dark(work.points.size(), glm::vec3(0.0f));
    PeerField field;
    field.sh.assign(size_t(volume::sh_count(work.settings.sh_order)), dark);
    field.irradiance.assign(work.normals.size(), dark);
    return field;
}

} // namespace

void check_peer(const Scene& scene) {
    if (scene::any_of_role(scene, [](Role role) { return role == Role::lights_only; }))
        throw Error(
            ErrorKind::unsupported,
            scene.path
                + ": has surfaces of `lights_only`, which rays of path-traced probes do not "
                  "meet; leave these out with `no_peer`");
}

PeerField trace_peer(const Scene& scene, const visibility::Visibility& visibility,
                     const scene::Frame& frame, std::span<const glm::vec3> points,
                     const PeerSettings& settings) {
    const PeerWork work(scene, visibility, frame, points, settings);
    PeerField field = empty_field(work);
    std::vector<uint64_t> traced(work.groups());
    tbb::enumerable_thread_specific<Waves> waves([&] { return Waves(work); });
    tbb::parallel_for(size_t(0), work.groups(), [&](size_t i) {
        const size_t first = i * work.group();
        traced[i] =
            waves.local().trace(first, std::min(first + work.group(), points.size()), field);
    });
    field.traced = std::accumulate(traced.begin(), traced.end(), uint64_t(0));
    return field;
}

visibility::PackedRays peer_rays(const Scene& scene, const visibility::Visibility& visibility,
                                 const scene::Frame& frame, std::span<const glm::vec3> points,
                                 const PeerSettings& settings) {
    const PeerWork work(scene, visibility, frame, points, settings);
    PeerField field = empty_field(work);
    visibility::PackedRays rays;
    Waves waves(work, &rays);
    for (size_t first = 0; first < points.size(); first += work.group())
        waves.trace(first, std::min(first + work.group(), points.size()), field);
    return rays;
}

} // namespace lpvbake::reference
