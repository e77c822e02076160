#include "visibility/visibility.h"

#include "lpvbake/error.h"
#include "lpvbake/volume.h"
#include "mix_word.h"
#include "scene/material.h"
#include "visibility/capture.h"
#include "visibility/opposites.h"

#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/concurrent_unordered_map.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>

namespace lpvbake::visibility {

float same_place(glm::vec3 point) {
    const glm::vec3 size = glm::abs(point);
    return 2.5e-5f + 1e-6f * std::max({size.x, size.y, size.z});
}

namespace {

/// Where a triangle of the acceleration structure comes from.
struct Origin {
    uint32_t instance;
    uint32_t triangle;
};

struct CellHash {
    size_t operator()(glm::ivec3 cell) const {
        return mix_word(mix_word(mix_word(uint32_t(cell.x)) ^ uint32_t(cell.y)) ^ uint32_t(cell.z));
    }
};

} // namespace

/// Of cells on surfaces: what was found, so that it is found once.
struct Visibility::Captures {
    tbb::concurrent_unordered_map<glm::ivec3, Capture, CellHash> of_cells;
};

struct Visibility::Impl {
    const Scene& scene;
    std::vector<Origin> origins;
    std::vector<uint8_t> mirrored;    ///< an instance
    std::vector<uint8_t> two_fronts;  ///< an instance
    std::vector<uint8_t> see_through; ///< a material
    bool any_see_through = false, any_veil = false;
    std::vector<uint8_t> tinting;       ///< an instance
    std::vector<glm::vec3> attenuation; ///< an instance
    bool any_tinting = false;
    glm::vec3 lo{0.0f}, hi{0.0f};
    RTCDevice device = nullptr;
    Isa isa = Isa::automatic; ///< of the device
    RTCScene bvh = nullptr;
    const glm::vec3* positions = nullptr; ///< of the acceleration structure, which owns them
    size_t vertices = 0;
    const glm::uvec3* triangles = nullptr;
    std::optional<Opposites> opposites;

    explicit Impl(const Scene& s) : scene(s) {}
    ~Impl() {
        rtcReleaseScene(bvh);
        rtcReleaseDevice(device);
    }

    const Mesh& mesh_of(uint32_t primitive) const {
        return scene.meshes[size_t(scene.instances[origins[primitive].instance].mesh)];
    }
    Facing facing(uint32_t primitive, bool meets_back) const {
        if (two_fronts[origins[primitive].instance])
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
        if (is_culled(primitive, meets_back))
            return 0.0f;
        return scene::is_partly_clear(material) ? sample(primitive, uv).alpha : 1.0f;
    }
    /// What is not there where a ray meets its back.
    bool is_culled(uint32_t primitive, bool meets_back) const {
        return scene.rules.cull_backfaces && facing(primitive, meets_back) == Facing::back;
    }
    scene::SurfaceSample sample(uint32_t primitive, glm::vec2 uv) const {
        return scene::sample_surface(scene, mesh_of(primitive), origins[primitive].triangle,
                                     barycentric(primitive, uv));
    }
    /// Colour of what passes a primitive that tints.
    glm::vec3 tint(uint32_t primitive, glm::vec2 uv, bool meets_back) const {
        // A volume is entered once, whichever way light goes.
        return sample(primitive, uv)
            .tint(meets_back ? glm::vec3(1.0f) : attenuation[origins[primitive].instance]);
    }
};

namespace {

/// What a traversal that asks about every hit is after.
enum class Wanted { nearest, all, any_opaque };

/// To whom the back of a single-sided surface may be there.
enum class Seen { by_light, by_eye };

/// The context comes first so that it can be cast back.
struct Query {
    RTCIntersectContext context;
    const Visibility::Impl* impl;
    Wanted wanted;
    Seen seen;
    std::vector<Crossing>* crossings = nullptr; ///< all
    /// Bits, by the rays' ids: met what is not opaque (any_opaque), passed what tints (nearest).
    unsigned met_others = 0;

    Query(const Visibility::Impl& of, Wanted what, Bundle bundle = Bundle::loose,
          Seen by = Seen::by_light)
        : impl(&of),
          wanted(what),
          seen(by) {
        rtcInitIntersectContext(&context);
        if (bundle == Bundle::tight)
            context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        if (what == Wanted::all || by == Seen::by_eye || of.any_see_through)
            context.filter = filter_hit;
    }
    static void filter_hit(const RTCFilterFunctionNArguments* args);
};

bool meets_back(RTCRayN* ray, RTCHitN* hit, unsigned n, unsigned i) {
    return RTCRayN_dir_x(ray, n, i) * RTCHitN_Ng_x(hit, n, i)
               + RTCRayN_dir_y(ray, n, i) * RTCHitN_Ng_y(hit, n, i)
               + RTCRayN_dir_z(ray, n, i) * RTCHitN_Ng_z(hit, n, i)
           > 0.0f;
}

/// A number in [0, 1) that depends on the line of a ray and on a primitive.
float draw(RTCRayN* ray, unsigned n, unsigned i, uint32_t primitive) {
    uint32_t bits = mix_word(primitive);
    for (const float x :
         {RTCRayN_org_x(ray, n, i), RTCRayN_org_y(ray, n, i), RTCRayN_org_z(ray, n, i),
          RTCRayN_dir_x(ray, n, i), RTCRayN_dir_y(ray, n, i), RTCRayN_dir_z(ray, n, i)})
        bits = mix_word(bits ^ std::bit_cast<uint32_t>(x));
    return float(bits >> 8) * 0x1p-24f;
}

void Query::filter_hit(const RTCFilterFunctionNArguments* args) {
    Query& query = *reinterpret_cast<Query*>(args->context);
    for (unsigned i = 0; i < args->N; ++i) {
        if (args->valid[i] == 0)
            continue;
        const uint32_t primitive = RTCHitN_primID(args->hit, args->N, i);
        const glm::vec2 uv{RTCHitN_u(args->hit, args->N, i), RTCHitN_v(args->hit, args->N, i)};
        const bool back = meets_back(args->ray, args->hit, args->N, i);
        const Visibility::Impl& impl = *query.impl;
        const bool culled =
            query.seen == Seen::by_eye && impl.facing(primitive, back) == Facing::back;
        const float alpha = culled ? 0.0f : impl.alpha(primitive, uv, back);
        const uint32_t instance = impl.origins[primitive].instance;
        // What covers nothing may tint all the same.
        const bool tints =
            impl.tinting[instance] && alpha < 1.0f && !culled && !impl.is_culled(primitive, back);
        const unsigned ray = 1u << RTCRayN_id(args->ray, args->N, i);
        bool stays = alpha >= 1.0f;
        if (query.wanted == Wanted::all) {
            if (alpha > 0.0f || tints)
                query.crossings->push_back(
                    {RTCRayN_tfar(args->ray, args->N, i), impl.facing(primitive, back),
                     1.0f - alpha, instance,
                     tints ? impl.tint(primitive, uv, back) : glm::vec3(1.0f)});
            stays = false;
        } else if (query.wanted == Wanted::any_opaque) {
            if ((alpha > 0.0f || tints) && !stays)
                query.met_others |= ray;
        } else if (!stays) {
            stays = draw(args->ray, args->N, i, primitive) < alpha;
            if (!stays && tints)
                query.met_others |= ray;
        }
        if (!stays)
            args->valid[i] = 0;
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

constexpr size_t eight = 8;

/// Eight rays of which some may be missing.
struct alignas(32) Packet {
    int valid[eight];
    RTCRayHit8 r;

    explicit Packet(std::span<const Ray> rays) {
        for (size_t i = 0; i < eight; ++i) {
            const Ray& ray = rays[std::min(i, rays.size() - 1)];
            valid[i] = i < rays.size() ? -1 : 0;
            r.ray.org_x[i] = ray.origin.x;
            r.ray.org_y[i] = ray.origin.y;
            r.ray.org_z[i] = ray.origin.z;
            r.ray.dir_x[i] = ray.direction.x;
            r.ray.dir_y[i] = ray.direction.y;
            r.ray.dir_z[i] = ray.direction.z;
            r.ray.tnear[i] = ray.t_min;
            r.ray.tfar[i] = ray.t_max;
            r.ray.time[i] = 0.0f;
            r.ray.mask[i] = ~0u;
            r.ray.id[i] = unsigned(i);
            r.ray.flags[i] = 0;
            r.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
            r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
    }
};

Hit to_hit(const Visibility::Impl& impl, glm::vec3 direction, float t, uint32_t primitive,
           glm::vec2 uv, glm::vec3 normal) {
    const Origin origin = impl.origins[primitive];
    return {t,
            origin.instance,
            origin.triangle,
            impl.barycentric(primitive, uv),
            glm::normalize(normal),
            impl.facing(primitive, glm::dot(direction, normal) > 0.0f),
            glm::vec3(1.0f)};
}

/// How far two places on a ray may lie apart by rounding.
float rounding_at(float t) {
    return 1e-5f * std::max(1.0f, std::abs(t));
}

constexpr float slack = 1.0f + 1e-5f; ///< of radii, so that equally near ones are met

/// Whether a line meets a primitive, and where, in double precision.
std::optional<Hit> sheet_at(const Visibility::Impl& impl, uint32_t primitive, glm::dvec3 point,
                            glm::dvec3 along, double reach) {
    constexpr double rim = 1e-12; // of its size: nothing slips through an edge
    const glm::uvec3 v = impl.triangles[primitive];
    const glm::dvec3 a = glm::dvec3(impl.positions[v.x]) - point;
    const glm::dvec3 ab = glm::dvec3(impl.positions[v.y]) - point - a;
    const glm::dvec3 ac = glm::dvec3(impl.positions[v.z]) - point - a;
    const glm::dvec3 normal = glm::cross(ab, ac);
    const double slope = glm::dot(along, normal);
    const double height = glm::dot(a, normal) / slope;
    if (!(std::abs(height) <= reach))
        return std::nullopt;
    const glm::dvec3 across = glm::cross(along, a);
    const glm::dvec2 uv = glm::dvec2(-glm::dot(across, ac), glm::dot(across, ab)) / slope;
    const glm::vec2 weights(uv);
    if (!(uv.x >= -rim && uv.y >= -rim && uv.x + uv.y <= 1.0 + rim)
        || impl.alpha(primitive, weights, slope < 0.0) < 0.5f)
        return std::nullopt;
    return to_hit(impl, glm::vec3(-along), float(height), primitive, weights,
                  glm::vec3(glm::normalize(normal)));
}

/// As Visibility::sheets_at.
void find_sheets(const Visibility::Impl& impl, glm::vec3 point, glm::vec3 normal, float reach,
                 std::vector<Hit>& out) {
    thread_local std::vector<uint32_t> near;
    near.clear();
    RTCPointQuery query{point.x, point.y, point.z, 0.0f, reach * slack};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    const auto meet = [](RTCPointQueryFunctionArguments* args) {
        static_cast<std::vector<uint32_t>*>(args->userPtr)->push_back(args->primID);
        return false;
    };
    rtcPointQuery(impl.bvh, &query, &context, meet, &near);
    std::ranges::sort(near);
    out.clear();
    for (const uint32_t primitive : near)
        if (const auto sheet = sheet_at(impl, primitive, point, normal, double(reach)))
            out.push_back(*sheet);
}

/// Where sheets lie on each other rounding tells which a ray meets: a front before a back.
void turn_to_front(const Visibility::Impl& impl, const Ray& ray, uint32_t primitive, Hit& hit) {
    if (hit.instance == no_hit || hit.facing != Facing::back)
        return;
    const glm::vec3 point = ray.origin + hit.t * ray.direction;
    const glm::vec3 normal = -hit.normal;
    const float reach = same_place(point);
    const auto turn = [&](Hit sheet) {
        sheet.t = hit.t;
        sheet.tint = hit.tint;
        hit = sheet;
    };
    if (const Opposites::Answer near = impl.opposites->at(primitive, point); near.known) {
        for (const Opposites::Other& other : near.others) {
            if (glm::any(glm::lessThan(point, other.lo - slack * reach))
                || glm::any(glm::greaterThan(point, other.hi + slack * reach)))
                continue;
            const auto sheet = sheet_at(impl, other.primitive, point, normal, double(reach));
            if (sheet && sheet->facing != Facing::back)
                return turn(*sheet);
        }
        return;
    }
    thread_local std::vector<Hit> sheets;
    find_sheets(impl, point, normal, reach, sheets);
    for (const Hit& sheet : sheets)
        if (sheet.facing != Facing::back)
            return turn(sheet);
}

/// All surfaces on a segment by rising t.
void trace_all(const Visibility::Impl& impl, const Ray& ray, Seen seen,
               std::vector<Crossing>& out) {
    out.clear();
    Query query(impl, Wanted::all, Bundle::loose, seen);
    query.crossings = &out;
    RTCRayHit r = to_embree(ray);
    rtcIntersect1(impl.bvh, &query.context, &r);
    const auto key = [](const Crossing& c) {
        return std::tuple(c.t, c.instance, c.facing, c.transmittance, c.tint.x, c.tint.y, c.tint.z);
    };
    std::sort(out.begin(), out.end(),
              [&](const Crossing& a, const Crossing& b) { return key(a) < key(b); });
    const auto same = [](const Crossing& a, const Crossing& b) {
        return a.instance == b.instance && a.facing == b.facing && b.t - a.t <= rounding_at(b.t);
    };
    out.erase(std::unique(out.begin(), out.end(), same), out.end());
}

/// Product of the tints of what a ray passes before `end`.
glm::vec3 tint_before(const Visibility::Impl& impl, const Ray& ray, float end, Seen seen) {
    thread_local std::vector<Crossing> met;
    trace_all(impl, {ray.origin, ray.direction, ray.t_min, end}, seen, met);
    const float last = std::isfinite(end) ? end - rounding_at(end) : end;
    glm::vec3 product(1.0f);
    for (const Crossing& crossing : met)
        if (crossing.t < last)
            product *= crossing.tint;
    return product;
}

/// Tells a hit, or that there is none, what its ray has passed.
void look_back(const Query& query, const Ray& ray, unsigned id, Hit& hit) {
    if (query.met_others & 1u << id)
        hit.tint =
            tint_before(*query.impl, ray, hit.instance == no_hit ? ray.t_max : hit.t, query.seen);
}

Hit nearest(const Visibility::Impl& impl, const Ray& ray, Seen seen) {
    Query query(impl, Wanted::nearest, Bundle::loose, seen);
    RTCRayHit r = to_embree(ray);
    rtcIntersect1(impl.bvh, &query.context, &r);
    Hit hit;
    if (r.hit.geomID != RTC_INVALID_GEOMETRY_ID)
        hit = to_hit(impl, ray.direction, r.ray.tfar, r.hit.primID, {r.hit.u, r.hit.v},
                     {r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z});
    look_back(query, ray, 0, hit);
    turn_to_front(impl, ray, r.hit.primID, hit);
    return hit;
}

} // namespace

namespace {

/// Never of a set that is not known by its name: it says how answers are rounded.
RTCDevice new_device(Isa isa) {
    RTCDevice device = rtcNewDevice((std::string("isa=") + name_of(isa)).c_str());
    if (!device) {
        const bool memory = rtcGetDeviceError(nullptr) == RTC_ERROR_OUT_OF_MEMORY;
        throw Error(memory ? ErrorKind::memory : ErrorKind::failure,
                    memory ? "Embree cannot be started: out of memory"
                           : "Embree cannot be started");
    }
    // Whether its build has the set shows by the widths that it traces natively.
    const RTCDeviceProperty wide = isa == Isa::sse2     ? RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED
                                   : isa == Isa::avx512 ? RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED
                                                        : RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED;
    if (!rtcGetDeviceProperty(device, wide)) {
        rtcReleaseDevice(device);
        throw Error(ErrorKind::argument, std::string("`isa` ") + name_of(isa)
                                             + ": this build of Embree does not have it");
    }
    return device;
}

} // namespace

Visibility::Visibility(std::shared_ptr<Impl> impl, float scale, glm::vec3 offset)
    : impl_(std::move(impl)),
      captures_(std::make_shared<Captures>()),
      scale_(scale),
      offset_(offset) {}

Visibility Visibility::in_frame(const scene::Frame& own, const scene::Frame& other) const {
    Visibility placed(impl_, scale_ * float(other.unit / own.unit),
                      to_structure(glm::vec3(own.from_world(other.origin))));
    placed.air_ = air_;
    placed.caster_ = caster_;
    return placed;
}

Visibility Visibility::in_air(std::shared_ptr<const Air> air) const {
    Visibility other(impl_, scale_, offset_);
    other.captures_ = captures_;
    other.air_ = std::move(air);
    other.caster_ = caster_;
    return other;
}

Visibility Visibility::by(std::shared_ptr<const Caster> caster) const {
    Visibility other(impl_, scale_, offset_);
    other.captures_ = captures_;
    other.air_ = air_;
    other.caster_ = std::move(caster);
    return other;
}

CastSurfaces Visibility::surfaces() const {
    CastSurfaces surfaces{{impl_->positions, impl_->vertices}, {}};
    surfaces.triangles.reserve(impl_->origins.size());
    for (uint32_t i = 0; i < impl_->origins.size(); ++i) {
        const Material& material = impl_->scene.materials[size_t(impl_->mesh_of(i).material)];
        surfaces.triangles.push_back(
            {impl_->triangles[i], scene::is_partly_clear(material), impl_->is_culled(i, true)});
    }
    return surfaces;
}

void Visibility::dim(const Ray& ray, Hit& hit) const {
    if (air_)
        hit.tint *= air_->left(ray.origin, ray.direction, ray.t_min,
                               hit.instance == no_hit ? ray.t_max : hit.t);
}

glm::vec3 Visibility::left_in_air(const Ray& ray) const {
    return air_ ? air_->left(ray.origin, ray.direction, ray.t_min, ray.t_max) : glm::vec3(1.0f);
}

Visibility::Visibility(const Scene& scene, const scene::Frame& frame, Isa isa,
                       bool (*is_there)(Role))
    : Visibility(std::make_shared<Impl>(scene), 1.0f, glm::vec3(0.0f)) {
    Impl& impl = *impl_;
    for (const Material& material : scene.materials) {
        impl.see_through.push_back(scene::is_see_through(scene, material));
        impl.any_see_through |= impl.see_through.back() != 0;
        impl.any_veil |= scene::is_veil(material);
    }

    uint64_t vertices = 0, triangles = 0;
    for (const Instance& instance : scene.instances) {
        if (!is_there(instance.role))
            continue;
        vertices += scene.meshes[size_t(instance.mesh)].positions.size();
        triangles += scene.meshes[size_t(instance.mesh)].triangles.size();
    }
    if (vertices >= ~0u || triangles >= ~0u)
        throw Error(ErrorKind::unsupported,
                    scene.path + ": more than 2^32 placed vertices or triangles");

    impl.isa = available(isa);
    impl.device = new_device(impl.isa);
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
        impl.mirrored.push_back(scene::is_mirrored(instance));
        impl.two_fronts.push_back(scene.materials[size_t(mesh.material)].double_sided);
        impl.tinting.push_back(is_there(instance.role) && scene::is_tinting(scene, mesh));
        impl.any_tinting |= impl.tinting.back() != 0;
        impl.attenuation.push_back(scene::attenuation_of(scene, instance));
        if (!is_there(instance.role))
            continue;
        const std::vector<glm::vec3> placed = scene::positions_in_frame(scene, instance, frame);
        std::copy(placed.begin(), placed.end(), positions + base);
        for (const glm::vec3& p : placed) {
            impl.lo = glm::min(impl.lo, p);
            impl.hi = glm::max(impl.hi, p);
        }
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
    if (base == 0)
        impl.lo = impl.hi = glm::vec3(0.0f);
    auto* target = static_cast<glm::uvec3*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                sizeof(glm::uvec3), std::max<size_t>(indices.size(), 1)));
    if (indices.empty())
        indices.push_back(glm::uvec3(0)); // a degenerate triangle that no ray meets
    std::copy(indices.begin(), indices.end(), target);
    impl.positions = positions;
    impl.vertices = vertices;
    impl.triangles = target;
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(impl.bvh, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(impl.bvh);
    const glm::vec3 farthest = glm::max(glm::abs(impl.lo), glm::abs(impl.hi));
    impl.opposites.emplace(impl.bvh, positions, std::span(target, impl.origins.size()),
                           same_place(farthest), [&impl](uint32_t primitive) {
                               return impl.two_fronts[impl.origins[primitive].instance] != 0;
                           });
    if (const RTCError error = rtcGetDeviceError(impl.device); error != RTC_ERROR_NONE)
        throw Error(error == RTC_ERROR_OUT_OF_MEMORY ? ErrorKind::memory : ErrorKind::failure,
                    "Embree cannot build its tree over " + std::to_string(triangles)
                        + " triangles (error " + std::to_string(error) + ")");
}

namespace {

/// A convex polygon, of a triangle that up to so many planes have cut.
struct Polygon {
    static constexpr size_t most = 3 + 8;
    std::array<glm::vec3, most> corner;
    size_t count = 0;
};

/// The part where x.w <= limit.
Polygon cut(const Polygon& polygon, glm::vec3 w, float limit) {
    Polygon part;
    for (size_t i = 0; i < polygon.count; ++i) {
        const glm::vec3 a = polygon.corner[i], b = polygon.corner[(i + 1) % polygon.count];
        const float at_a = glm::dot(a, w) - limit, at_b = glm::dot(b, w) - limit;
        if (at_a <= 0.0f)
            part.corner[part.count++] = a;
        if ((at_a < 0.0f && at_b > 0.0f) || (at_a > 0.0f && at_b < 0.0f))
            part.corner[part.count++] = a + at_a / (at_a - at_b) * (b - a);
    }
    return part;
}

glm::vec3 nearest_on_segment(glm::vec3 a, glm::vec3 b) {
    const glm::vec3 along = b - a;
    const float square = glm::dot(along, along);
    return square > 0.0f ? a + std::clamp(-glm::dot(a, along) / square, 0.0f, 1.0f) * along : a;
}

/// The polygon's point nearest to the origin; `normal` is the triangle's, of any length.
glm::vec3 nearest_on(const Polygon& polygon, glm::vec3 normal) {
    bool above = true;
    for (size_t i = 0; i < polygon.count && above; ++i) {
        const glm::vec3 a = polygon.corner[i], b = polygon.corner[(i + 1) % polygon.count];
        above = glm::dot(glm::cross(b - a, -a), normal) >= 0.0f;
    }
    if (above)
        return glm::dot(polygon.corner[0], normal) / glm::dot(normal, normal) * normal;
    glm::vec3 best(HUGE_VALF);
    for (size_t i = 0; i < polygon.count; ++i) {
        const glm::vec3 p =
            nearest_on_segment(polygon.corner[i], polygon.corner[(i + 1) % polygon.count]);
        if (i == 0 || glm::dot(p, p) < glm::dot(best, best))
            best = p;
    }
    return best;
}

struct NearestQuery {
    const Visibility::Impl& impl;
    glm::vec3 point;
    std::span<const glm::vec3> planes;
    float share;
    float square; ///< of the distance to the best, or to look within
    uint32_t primitive = ~0u;
    glm::vec3 way{0.0f};

    /// Whether the box of these corners, seen from the point, lies beyond the best by more than
    /// rounding: most of what a leaf of the tree holds does.
    bool is_far(glm::vec3 a, glm::vec3 b, glm::vec3 c) const {
        const glm::vec3 lo = glm::min(a, glm::min(b, c)), hi = glm::max(a, glm::max(b, c));
        const glm::vec3 gap = glm::max(lo, -hi), size = glm::max(-lo, hi);
        const float rounding = 1e-5f * std::max({size.x, size.y, size.z});
        return std::max({gap.x, gap.y, gap.z}) > std::sqrt(square) * slack + rounding;
    }

    void look_at(uint32_t candidate) {
        const glm::uvec3 v = impl.triangles[candidate];
        Polygon part{
            {impl.positions[v.x] - point, impl.positions[v.y] - point, impl.positions[v.z] - point},
            3};
        if (is_far(part.corner[0], part.corner[1], part.corner[2]))
            return;
        const glm::vec3 normal =
            glm::cross(part.corner[1] - part.corner[0], part.corner[2] - part.corner[0]);
        if (!(glm::dot(normal, normal) > 0.0f))
            return;
        for (const glm::vec3 w : planes)
            if (part = cut(part, w, share * glm::dot(w, w)); part.count == 0)
                return;
        const glm::vec3 p = nearest_on(part, normal);
        const float away = glm::dot(p, p);
        // Of equally near ones the first, however the tree leads to them.
        if (!(away < square || (away == square && candidate < primitive))
            || impl.alpha(candidate, glm::vec2(1.0f / 3.0f), false) < 0.5f)
            return;
        square = away;
        primitive = candidate;
        way = p;
    }
};

} // namespace

std::optional<glm::vec3> Visibility::nearest_point(glm::vec3 point, float radius,
                                                   std::span<const glm::vec3> planes,
                                                   float share) const {
    point = to_structure(point);
    radius *= scale_;
    std::vector<glm::vec3> placed;
    if (is_placed()) {
        for (const glm::vec3 w : planes)
            placed.push_back(scale_ * w);
        planes = placed;
    }
    NearestQuery nearest{*impl_, point, planes, share, radius * radius};
    RTCPointQuery query{point.x, point.y, point.z, 0.0f, radius * slack};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    const auto meet = [](RTCPointQueryFunctionArguments* args) {
        auto& own = *static_cast<NearestQuery*>(args->userPtr);
        const float before = own.square;
        own.look_at(args->primID);
        if (own.square == before)
            return false;
        args->query->radius = std::sqrt(own.square) * slack;
        return true;
    };
    rtcPointQuery(impl_->bvh, &query, &context, meet, &nearest);
    return nearest.primitive == ~0u ? std::nullopt : std::optional(nearest.way / scale_);
}

void Visibility::surfaces_near(glm::vec3 point, float radius, std::vector<NearSurface>& out) const {
    struct Found {
        NearestQuery looking;
        std::vector<std::pair<uint32_t, glm::vec3>> surfaces; // primitives, the ways there
    };
    point = to_structure(point);
    radius *= scale_;
    Found found{{*impl_, point, {}, 0.0f, radius * radius}, {}};
    RTCPointQuery query{point.x, point.y, point.z, 0.0f, radius * slack};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    const auto meet = [](RTCPointQueryFunctionArguments* args) {
        auto& own = *static_cast<Found*>(args->userPtr);
        NearestQuery looking = own.looking;
        looking.look_at(args->primID);
        if (looking.primitive != ~0u)
            own.surfaces.emplace_back(looking.primitive, looking.way);
        return false;
    };
    rtcPointQuery(impl_->bvh, &query, &context, meet, &found);
    std::ranges::sort(found.surfaces, {}, [](const auto& each) { return each.first; });
    out.clear();
    for (const auto& [primitive, way] : found.surfaces) {
        const glm::uvec3 v = impl_->triangles[primitive];
        const glm::vec3 a = impl_->positions[v.x];
        out.push_back(
            {way / scale_,
             glm::normalize(glm::cross(impl_->positions[v.y] - a, impl_->positions[v.z] - a)),
             impl_->two_fronts[impl_->origins[primitive].instance] != 0});
    }
}

void Visibility::sheets_at(glm::vec3 point, glm::vec3 normal, float reach,
                           std::vector<Hit>& out) const {
    find_sheets(*impl_, to_structure(point), normal, scale_ * reach, out);
    for (Hit& hit : out)
        hit.t /= scale_;
}

Capture Visibility::capture(glm::ivec3 cell) const {
    const glm::vec3 centre = glm::vec3(cell) + 0.5f;
    if (!nearest_point(centre, surface_margin, {}, 0.0f))
        return {centre};
    auto& captures = captures_->of_cells;
    const auto known = captures.find(cell);
    if (known != captures.end())
        return known->second;
    return captures.emplace(cell, capture_at(centre)).first->second;
}

Capture Visibility::capture_at(glm::vec3 place) const {
    std::vector<NearSurface> near;
    surfaces_near(place, surface_margin, near);
    return near.empty() ? Capture{place} : find_capture(*this, place, near);
}

Visibility::~Visibility() = default;
Visibility::Visibility(Visibility&&) noexcept = default;

glm::vec3 Visibility::lo() const {
    return (impl_->lo - offset_) / scale_;
}
glm::vec3 Visibility::hi() const {
    return (impl_->hi - offset_) / scale_;
}

Hit Visibility::closest(const Ray& ray) const {
    const Ray placed = to_structure(ray);
    Hit hit = nearest(*impl_, placed, Seen::by_light);
    dim(placed, hit);
    return hit;
}

Hit Visibility::closest_front(const Ray& ray) const {
    return nearest(*impl_, to_structure(ray), Seen::by_eye);
}

void Visibility::crossings(const Ray& ray, std::vector<Crossing>& out) const {
    trace_all(*impl_, to_structure(ray), Seen::by_light, out);
}

namespace {

/// What is left of light on a segment: 0, or by others(ray) where it meets what is not opaque.
template <typename Left, typename Others>
Left left_of(const Visibility::Impl& impl, const Ray& ray, const Others& others) {
    Query query(impl, Wanted::any_opaque);
    RTCRay r = to_embree(ray).ray;
    rtcOccluded1(impl.bvh, &query.context, &r);
    return r.tfar < 0.0f ? Left(0.0f) : query.met_others ? others(ray) : Left(1.0f);
}

} // namespace

float Visibility::transmittance(const Ray& ray) const {
    return left_of<float>(*impl_, to_structure(ray), [&](const Ray& of) {
        thread_local std::vector<Crossing> met;
        trace_all(*impl_, of, Seen::by_light, met);
        float product = 1.0f;
        for (const Crossing& crossing : met)
            product *= crossing.transmittance;
        return product;
    });
}

glm::vec3 Visibility::filter(const Ray& ray) const {
    const Ray placed = to_structure(ray);
    const glm::vec3 passed =
        left_of<glm::vec3>(*impl_, placed, [&](const Ray& of) { return filter_of_others(of); });
    return passed == glm::vec3(0.0f) ? passed : passed * left_in_air(placed);
}

glm::vec3 Visibility::filter_of_others(const Ray& ray) const {
    thread_local std::vector<Crossing> met;
    trace_all(*impl_, ray, Seen::by_light, met);
    glm::vec3 product(1.0f);
    for (const Crossing& crossing : met)
        product *= crossing.transmittance * crossing.tint;
    return product;
}

glm::vec3 Visibility::tint(const Ray& ray, bool fronts) const {
    return impl_->any_tinting ? tint_before(*impl_, to_structure(ray), ray.t_max,
                                            fronts ? Seen::by_eye : Seen::by_light)
                              : glm::vec3(1.0f);
}

std::string Visibility::tracer() const {
    const auto part = [&](RTCDeviceProperty property) {
        return std::to_string(rtcGetDeviceProperty(impl_->device, property));
    };
    return "Embree " + part(RTC_DEVICE_PROPERTY_VERSION_MAJOR) + "."
           + part(RTC_DEVICE_PROPERTY_VERSION_MINOR) + "." + part(RTC_DEVICE_PROPERTY_VERSION_PATCH)
           + " " + name_of(impl_->isa) + (caster_ ? ", " + caster_->name() : "");
}

bool Visibility::is_veiled() const {
    return impl_->any_veil;
}

bool Visibility::is_tinted() const {
    return impl_->any_tinting || air_;
}

std::span<const Ray> Visibility::to_structure(std::span<const Ray> rays,
                                              std::span<Ray> placed) const {
    if (!is_placed())
        return rays;
    for (size_t i = 0; i < rays.size(); ++i)
        placed[i] = to_structure(rays[i]);
    return placed.first(rays.size());
}

void Visibility::closest_of_eights(std::span<const Ray> rays, Bundle bundle,
                                   std::span<Hit> hits) const {
    Query query(*impl_, Wanted::nearest, bundle);
    std::array<Ray, eight> own;
    for (size_t first = 0; first < rays.size(); first += eight) {
        const std::span<const Ray> some =
            to_structure(rays.subspan(first, std::min(eight, rays.size() - first)), own);
        Packet packet(some);
        query.met_others = 0;
        rtcIntersect8(packet.valid, impl_->bvh, &query.context, &packet.r);
        const RTCHit8& hit = packet.r.hit;
        for (size_t i = 0; i < some.size(); ++i) {
            hits[first + i] =
                hit.geomID[i] == RTC_INVALID_GEOMETRY_ID
                    ? Hit{}
                    : to_hit(*impl_, some[i].direction, packet.r.ray.tfar[i], hit.primID[i],
                             {hit.u[i], hit.v[i]}, {hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]});
            look_back(query, some[i], unsigned(i), hits[first + i]);
            turn_to_front(*impl_, some[i], hit.primID[i], hits[first + i]);
            dim(some[i], hits[first + i]);
        }
    }
}

void Visibility::filter_of_eights(std::span<const Ray> rays, Bundle bundle,
                                  std::span<glm::vec3> result) const {
    Query query(*impl_, Wanted::any_opaque, bundle);
    std::array<Ray, eight> own;
    for (size_t first = 0; first < rays.size(); first += eight) {
        const std::span<const Ray> some =
            to_structure(rays.subspan(first, std::min(eight, rays.size() - first)), own);
        Packet packet(some);
        query.met_others = 0;
        rtcOccluded8(packet.valid, impl_->bvh, &query.context, &packet.r.ray);
        for (size_t i = 0; i < some.size(); ++i) {
            glm::vec3& passed = result[first + i];
            passed = packet.r.ray.tfar[i] < 0.0f    ? glm::vec3(0.0f)
                     : query.met_others & (1u << i) ? filter_of_others(some[i])
                                                    : glm::vec3(1.0f);
            if (air_ && passed != glm::vec3(0.0f))
                passed *= left_in_air(some[i]);
        }
    }
}

void Visibility::closest_of_many(std::span<const Ray> rays, std::span<Hit> hits) const {
    if (!caster_)
        return closest_of_eights(rays, Bundle::loose, hits);
    thread_local std::vector<Ray> own;
    thread_local std::vector<Caster::Met> met;
    own.resize(is_placed() ? rays.size() : 0);
    met.resize(rays.size());
    const std::span<const Ray> placed = to_structure(rays, own);
    caster_->nearest(placed, met);
    const Impl& impl = *impl_;
    for (size_t i = 0; i < rays.size(); ++i) {
        const Ray& ray = placed[i];
        Hit& hit = hits[i];
        const uint32_t primitive = met[i].triangle;
        if (primitive == Caster::unsure) {
            hit = nearest(impl, ray, Seen::by_light);
        } else if (primitive == Caster::none) {
            hit = {};
        } else {
            const glm::uvec3 v = impl.triangles[primitive];
            const glm::vec3 a = impl.positions[v.x];
            hit = to_hit(impl, ray.direction, met[i].t, primitive, met[i].barycentric,
                         glm::cross(impl.positions[v.y] - a, impl.positions[v.z] - a));
            turn_to_front(impl, ray, primitive, hit);
        }
        dim(ray, hit);
    }
}

namespace {

constexpr size_t block = 1024; ///< rays that a thread takes at a time

template <typename Result, typename Trace>
void in_blocks(std::span<const Ray> rays, std::span<Result> results, const Trace& trace) {
    tbb::parallel_for(size_t(0), (rays.size() + block - 1) / block, [&](size_t i) {
        const size_t count = std::min(block, rays.size() - i * block);
        trace(rays.subspan(i * block, count), results.subspan(i * block, count));
    });
}

} // namespace

void Visibility::closest(std::span<const Ray> rays, std::span<Hit> hits) const {
    in_blocks(rays, hits, [&](std::span<const Ray> some, std::span<Hit> of) {
        closest_of_eights(some, Bundle::loose, of);
    });
}

void Visibility::filter(std::span<const Ray> rays, std::span<glm::vec3> result) const {
    in_blocks(rays, result, [&](std::span<const Ray> some, std::span<glm::vec3> of) {
        filter_of_eights(some, Bundle::loose, of);
    });
}

struct PackedRays::Batches {
    struct Part {
        Packet packet;
        Bundle bundle;
        bool any_hit;
    };
    std::vector<Part> parts;
    uint64_t rays = 0;
};

PackedRays::PackedRays() : batches_(std::make_unique<Batches>()) {}
PackedRays::~PackedRays() = default;
PackedRays::PackedRays(PackedRays&&) noexcept = default;
PackedRays& PackedRays::operator=(PackedRays&&) noexcept = default;

void PackedRays::add(std::span<const Ray> rays, Bundle bundle, bool any_hit) {
    for (size_t first = 0; first < rays.size(); first += eight)
        batches_->parts.push_back(
            {Packet(rays.subspan(first, std::min(eight, rays.size() - first))), bundle, any_hit});
    batches_->rays += rays.size();
}

uint64_t PackedRays::size() const {
    return batches_->rays;
}

uint64_t PackedRays::trace(const Visibility& visibility) const {
    const RTCScene bvh = visibility.impl_->bvh;
    const auto met = [&](const tbb::blocked_range<size_t>& range, uint64_t sum) {
        RTCIntersectContext loose, tight;
        rtcInitIntersectContext(&loose);
        rtcInitIntersectContext(&tight);
        tight.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const Batches::Part& part = batches_->parts[i];
            Packet p = part.packet;
            RTCIntersectContext* context = part.bundle == Bundle::tight ? &tight : &loose;
            if (part.any_hit)
                rtcOccluded8(p.valid, bvh, context, &p.r.ray);
            else
                rtcIntersect8(p.valid, bvh, context, &p.r);
            for (size_t k = 0; k < eight; ++k)
                sum += p.valid[k]
                       && (part.any_hit ? p.r.ray.tfar[k] < 0.0f
                                        : p.r.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID);
        }
        return sum;
    };
    return tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, batches_->parts.size(), block / eight), uint64_t(0), met,
        std::plus<uint64_t>());
}

} // namespace lpvbake::visibility
