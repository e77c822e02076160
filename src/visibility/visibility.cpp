#include "visibility/visibility.h"

#include "error.h"
#include "scene/material.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>

namespace lpvbake {
namespace {

/// Where a triangle of the acceleration structure comes from.
struct Origin {
    uint32_t instance;
    uint32_t triangle;
};

/// Spreads the bits of a word evenly (Wellons' lowbias32 constants).
uint32_t mix(uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

} // namespace

struct Visibility::Impl {
    const Scene& scene;
    std::vector<Origin> origins;
    std::vector<uint8_t> mirrored;    ///< an instance
    std::vector<uint8_t> see_through; ///< a material
    bool any_see_through = false;
    glm::vec3 lo{0.0f}, hi{0.0f};
    RTCDevice device = nullptr;
    RTCScene bvh = nullptr;

    explicit Impl(const Scene& s) : scene(s) {}
    ~Impl() {
        rtcReleaseScene(bvh);
        rtcReleaseDevice(device);
    }

    const Mesh& mesh_of(uint32_t primitive) const {
        return scene.meshes[size_t(scene.instances[origins[primitive].instance].mesh)];
    }
    const Material& material_of(uint32_t primitive) const {
        return scene.materials[size_t(mesh_of(primitive).material)];
    }
    Facing facing(uint32_t primitive, bool meets_back) const {
        if (material_of(primitive).double_sided)
            return Facing::both;
        return meets_back ? Facing::back : Facing::front;
    }
    /// Embree's weights are of the turned winding where the instance mirrors.
    glm::vec2 barycentric(uint32_t primitive, glm::vec2 uv) const {
        return mirrored[origins[primitive].instance] ? glm::vec2(uv.y, uv.x) : uv;
    }
    /// Covered share where a ray meets a primitive: 0 for a culled back.
    float alpha(uint32_t primitive, glm::vec2 uv, bool meets_back) const {
        const Mesh& mesh = mesh_of(primitive);
        const Material& material = scene.materials[size_t(mesh.material)];
        if (!see_through[size_t(mesh.material)])
            return 1.0f;
        if (scene.rules.cull_backfaces && meets_back && !material.double_sided)
            return 0.0f;
        if (material.alpha_mode == AlphaMode::opaque)
            return 1.0f;
        return sample_surface(scene, mesh, origins[primitive].triangle, barycentric(primitive, uv))
            .alpha;
    }
};

namespace {

/// A traversal that asks about every hit; the context comes first so that it can be cast back.
struct Query {
    RTCIntersectContext context;
    const Visibility::Impl* impl;
    std::vector<Crossing>* crossings; ///< null: look for the nearest hit
};

bool meets_back(RTCRayN* ray, RTCHitN* hit, unsigned n, unsigned i) {
    return RTCRayN_dir_x(ray, n, i) * RTCHitN_Ng_x(hit, n, i)
               + RTCRayN_dir_y(ray, n, i) * RTCHitN_Ng_y(hit, n, i)
               + RTCRayN_dir_z(ray, n, i) * RTCHitN_Ng_z(hit, n, i)
           > 0.0f;
}

void filter_hit(const RTCFilterFunctionNArguments* args) {
    const Query& query = *reinterpret_cast<const Query*>(args->context);
    for (unsigned i = 0; i < args->N; ++i) {
        if (args->valid[i] == 0)
            continue;
        const uint32_t primitive = RTCHitN_primID(args->hit, args->N, i);
        const glm::vec2 uv{RTCHitN_u(args->hit, args->N, i), RTCHitN_v(args->hit, args->N, i)};
        const bool back = meets_back(args->ray, args->hit, args->N, i);
        const float alpha = query.impl->alpha(primitive, uv, back);
        if (query.crossings) {
            if (alpha > 0.0f)
                query.crossings->push_back({RTCRayN_tfar(args->ray, args->N, i),
                                            query.impl->facing(primitive, back), 1.0f - alpha,
                                            query.impl->origins[primitive].instance});
            args->valid[i] = 0;
        } else if (alpha < 1.0f) {
            const uint32_t bits = mix(std::bit_cast<uint32_t>(uv.x)
                                      ^ mix(std::bit_cast<uint32_t>(uv.y) ^ mix(primitive)));
            if (float(bits >> 8) * 0x1p-24f >= alpha)
                args->valid[i] = 0;
        }
    }
}

RTCRayHit to_embree(const Ray& ray) {
    RTCRayHit r{};
    r.ray.org_x = ray.origin.x;
    r.ray.org_y = ray.origin.y;
    r.ray.org_z = ray.origin.z;
    r.ray.dir_x = ray.direction.x;
    r.ray.dir_y = ray.direction.y;
    r.ray.dir_z = ray.direction.z;
    r.ray.tnear = ray.t_min;
    r.ray.tfar = ray.t_max;
    r.ray.mask = ~0u;
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    return r;
}

} // namespace

Visibility::Visibility(const Scene& scene, const Frame& frame)
    : impl_(std::make_unique<Impl>(scene)) {
    Impl& impl = *impl_;
    for (const Material& material : scene.materials) {
        impl.see_through.push_back(is_see_through(scene, material));
        impl.any_see_through |= impl.see_through.back() != 0;
    }

    uint64_t vertices = 0, triangles = 0;
    for (const Instance& instance : scene.instances) {
        vertices += scene.meshes[size_t(instance.mesh)].positions.size();
        triangles += scene.meshes[size_t(instance.mesh)].triangles.size();
    }
    if (vertices >= ~0u || triangles >= ~0u)
        throw Error(ExitCode::unsupported,
                    scene.path + ": more than 2^32 placed vertices or triangles");

    impl.device = rtcNewDevice(nullptr);
    if (!impl.device)
        throw Error(ExitCode::failure, "Embree cannot be started");
    impl.bvh = rtcNewScene(impl.device);
    // Robust: a ray through an edge shared by two triangles meets at least one of them.
    rtcSetSceneFlags(impl.bvh,
                     RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
    RTCGeometry geometry = rtcNewGeometry(impl.device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* positions = static_cast<glm::vec3*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(glm::vec3), std::max<uint64_t>(vertices, 1)));
    std::vector<glm::uvec3> indices;
    indices.reserve(triangles);
    impl.origins.reserve(triangles);
    impl.lo = glm::vec3(HUGE_VALF);
    impl.hi = glm::vec3(-HUGE_VALF);
    uint32_t base = 0;
    for (uint32_t i = 0; i < scene.instances.size(); ++i) {
        const Instance& instance = scene.instances[i];
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const std::vector<glm::vec3> placed = positions_in_frame(scene, instance, frame);
        std::copy(placed.begin(), placed.end(), positions + base);
        for (const glm::vec3& p : placed) {
            impl.lo = glm::min(impl.lo, p);
            impl.hi = glm::max(impl.hi, p);
        }
        impl.mirrored.push_back(is_mirrored(instance));
        for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
            glm::uvec3 v = mesh.triangles[t];
            const glm::vec3 a = placed[v.x], b = placed[v.y], c = placed[v.z];
            if (glm::cross(b - a, c - a) == glm::vec3(0.0f))
                continue;
            if (impl.mirrored.back())
                std::swap(v.y, v.z);
            indices.push_back(v + base);
            impl.origins.push_back({i, t});
        }
        base += uint32_t(placed.size());
    }
    auto* target = static_cast<glm::uvec3*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                sizeof(glm::uvec3), std::max<size_t>(indices.size(), 1)));
    if (indices.empty())
        indices.push_back(glm::uvec3(0)); // a degenerate triangle that no ray meets
    std::copy(indices.begin(), indices.end(), target);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(impl.bvh, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(impl.bvh);
    if (const RTCError error = rtcGetDeviceError(impl.device); error != RTC_ERROR_NONE)
        throw Error(error == RTC_ERROR_OUT_OF_MEMORY ? ExitCode::memory : ExitCode::failure,
                    "Embree cannot build its tree over " + std::to_string(triangles)
                        + " triangles (error " + std::to_string(error) + ")");
}

Visibility::~Visibility() = default;
Visibility::Visibility(Visibility&&) noexcept = default;

glm::vec3 Visibility::lo() const {
    return impl_->lo;
}
glm::vec3 Visibility::hi() const {
    return impl_->hi;
}

Hit Visibility::closest(const Ray& ray) const {
    Query query{{}, impl_.get(), nullptr};
    rtcInitIntersectContext(&query.context);
    if (impl_->any_see_through)
        query.context.filter = filter_hit;
    RTCRayHit r = to_embree(ray);
    rtcIntersect1(impl_->bvh, &query.context, &r);
    Hit hit;
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return hit;
    const Origin origin = impl_->origins[r.hit.primID];
    const glm::vec3 normal{r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z};
    hit.t = r.ray.tfar;
    hit.instance = origin.instance;
    hit.triangle = origin.triangle;
    hit.barycentric = impl_->barycentric(r.hit.primID, {r.hit.u, r.hit.v});
    hit.normal = glm::normalize(normal);
    hit.facing = impl_->facing(r.hit.primID, glm::dot(ray.direction, normal) > 0.0f);
    return hit;
}

void Visibility::crossings(const Ray& ray, std::vector<Crossing>& out) const {
    out.clear();
    Query query{{}, impl_.get(), &out};
    rtcInitIntersectContext(&query.context);
    query.context.filter = filter_hit;
    RTCRayHit r = to_embree(ray);
    rtcIntersect1(impl_->bvh, &query.context, &r);
    const auto key = [](const Crossing& c) {
        return std::tuple(c.t, c.instance, c.facing, c.transmittance);
    };
    std::sort(out.begin(), out.end(),
              [&](const Crossing& a, const Crossing& b) { return key(a) < key(b); });
    const auto same = [](const Crossing& a, const Crossing& b) {
        return a.instance == b.instance && a.facing == b.facing
               && b.t - a.t <= 1e-5f * std::max(1.0f, std::abs(b.t));
    };
    out.erase(std::unique(out.begin(), out.end(), same), out.end());
}

float Visibility::transmittance(const Ray& ray) const {
    if (impl_->any_see_through) {
        thread_local std::vector<Crossing> met;
        crossings(ray, met);
        float product = 1.0f;
        for (const Crossing& crossing : met)
            product *= crossing.transmittance;
        return product;
    }
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay r = to_embree(ray).ray;
    rtcOccluded1(impl_->bvh, &context, &r);
    return r.tfar < 0.0f ? 0.0f : 1.0f;
}

void Visibility::closest(std::span<const Ray> rays, std::span<Hit> hits) const {
    tbb::parallel_for(size_t(0), rays.size(), [&](size_t i) { hits[i] = closest(rays[i]); });
}

void Visibility::transmittance(std::span<const Ray> rays, std::span<float> result) const {
    tbb::parallel_for(size_t(0), rays.size(),
                      [&](size_t i) { result[i] = transmittance(rays[i]); });
}

} // namespace lpvbake
