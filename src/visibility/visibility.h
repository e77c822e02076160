// The one service that answers rays: against all placed triangles, in frame units.
//
// Opaque surfaces block with both faces, masked ones where they are covered, blended and
// transmitting ones by their alpha, and colour what they let through; with
// MaterialRules::cull_backfaces the back of a single-sided surface is not there.
#pragma once

#include "scene/frame.h"
#include "scene/roles.h"
#include "visibility/air.h"
#include "visibility/caster.h"
#include "visibility/isa.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::visibility {

/// A segment origin + t * direction, t in [t_min, t_max]; direction of any length.
struct Ray {
    glm::vec3 origin;
    glm::vec3 direction;
    float t_min = 0.0f;
    float t_max = 1.0f;
};

inline constexpr uint32_t no_hit = ~0u;

/// Which side of a surface a ray meets. A double-sided surface has two fronts.
enum class Facing : int8_t { front, back, both };

/// A point on a surface.
struct Hit {
    float t = 0.0f;
    uint32_t instance = no_hit; ///< no_hit: nothing was hit
    uint32_t triangle = 0;      ///< of the instance's mesh
    glm::vec2 barycentric{0};   ///< weights of the triangle's second and third vertex
    glm::vec3 normal{0};        ///< unit, out of the triangle's front
    Facing facing = Facing::front;
    glm::vec3 tint{
        1.0f}; ///< what surfaces and air that the ray has passed make of light, hit or not
};

/// One surface on the way of a ray.
struct Crossing {
    float t = 0.0f;
    Facing facing = Facing::front;
    float transmittance = 0.0f; ///< share of light that passes, 0: opaque
    uint32_t instance = 0;
    glm::vec3 tint{1.0f}; ///< and what becomes of it
};

/// A surface beside a point.
struct NearSurface {
    glm::vec3 way;    ///< from the point to the nearest of the triangle
    glm::vec3 normal; ///< unit, out of the triangle's front
    bool two_fronts;
};

/// Where the light of a cell is taken (capture.h).
struct Capture {
    glm::vec3 point;  ///< frame units
    bool open = true; ///< false: on no side of the surfaces around; the point is the cell's centre
};

/// How rays lie to each other, eight by eight in their order. Embree walks its tree with all eight
/// at once where they are alike, and where they are not would lose by that.
enum class Bundle {
    loose,
    tight, ///< they start close together and go nearly the same way
};

/// How far apart (frame units) surfaces around a point may lie and are in one place: several times
/// what positions are rounded by.
float same_place(glm::vec3 point);

class Visibility {
public:
    /// Builds the acceleration structure over all placed triangles of the roles that are there:
    /// those that light meets, or that an eye sees (scene::is_asked). Zero-area ones are left out.
    Visibility(const Scene& scene, const scene::Frame& frame, Isa isa = Isa::automatic,
               bool (*is_there)(Role) = scene::blocks);
    ~Visibility();
    Visibility(Visibility&&) noexcept;

    /// The same surfaces, asked in units of frame `other` where this is asked in those of `own`.
    /// Both have one structure.
    Visibility in_frame(const scene::Frame& own, const scene::Frame& other) const;
    /// The same surfaces in air, in the frame that the structure was built in: what is left of
    /// light is among the tints of hits and in what filter() tells. Null: in none.
    Visibility in_air(std::shared_ptr<const Air> air) const;
    const Air* air() const { return air_.get(); }
    /// The same, but for who answers closest_of_many(), and what places see. Null: Embree.
    Visibility by(std::shared_ptr<const Caster> caster) const;
    /// What a caster is made of. None of zero area; there may be none at all.
    CastSurfaces surfaces() const;
    /// Rays that it is best asked at a time; 0: any number, it makes no difference.
    size_t batch() const { return caster_ ? caster_->batch() : 0; }
    const Caster* caster() const { return caster_.get(); }
    /// Units of the frame that the structure was built in, in one of this one's.
    float scale() const { return scale_; }
    /// From this frame to that one.
    glm::vec3 to_structure(glm::vec3 point) const {
        return is_placed() ? scale_ * point + offset_ : point;
    }

    /// Nearest surface; of those in one place a front before a back. A blended one counts with
    /// probability alpha, drawn from the ray and the surface, so that the same ray always gives the
    /// same answer.
    Hit closest(const Ray& ray) const;
    /// The same for an eye, to which the back of a single-sided surface is never there.
    Hit closest_front(const Ray& ray) const;
    /// Product of the shares that all surfaces on the segment let through, 0 to 1; not of air.
    float transmittance(const Ray& ray) const;
    /// What is left of light on the segment, a channel: those shares, the tints, and what air
    /// leaves.
    glm::vec3 filter(const Ray& ray) const;
    /// The tints alone, of what light or, with `fronts`, an eye has passed; those of surfaces at
    /// the segment's end are not among them.
    glm::vec3 tint(const Ray& ray, bool fronts = false) const;
    /// What traces, with its version and instruction set, and the caster's name: other ones may
    /// round otherwise.
    std::string tracer() const;
    /// Some surface lets a part of the light pass.
    bool is_veiled() const;
    /// Some surface colours what it lets through, or air does.
    bool is_tinted() const;
    /// All surfaces on the segment by rising t. A ray through an edge that two triangles of an
    /// instance share meets them as one.
    void crossings(const Ray& ray, std::vector<Crossing>& out) const;

    /// From `point` to the nearest surface around it, less than `radius` away (frame units), of
    /// what lies before all of `planes`: through point + w, perpendicular to w, before it where x.w
    /// < `share` w.w, x seen from the point. What at its triangle's centroid covers less than half
    /// is not there. None: there is nothing.
    std::optional<glm::vec3> nearest_point(glm::vec3 point, float radius,
                                           std::span<const glm::vec3> planes, float share) const;

    /// All triangles less than `radius` away from the point, of which nearest_point() has the
    /// nearest; in the scene's order.
    void surfaces_near(glm::vec3 point, float radius, std::vector<NearSurface>& out) const;
    /// Surfaces in the place of a point of one of them: what a line through the point along the
    /// unit vector `normal` meets at most `reach` away (frame units), by geometry, without a ray's
    /// rounding; also by its edge, and in the scene's order. Each as a hit of a ray against
    /// `normal`, but for t, which is how far before the point it lies. What covers less than half
    /// there is none.
    void sheets_at(glm::vec3 point, glm::vec3 normal, float reach, std::vector<Hit>& out) const;
    /// Where the light of a cell is taken, [i, i + 1] x ... in frame units, in the lattice or not.
    Capture capture(glm::ivec3 cell) const;
    /// The same of any place, frame units.
    Capture capture_at(glm::vec3 place) const;

    /// The box of all triangles, frame units.
    glm::vec3 lo() const;
    glm::vec3 hi() const;

    /// The same for many rays on all threads; results at the rays' places.
    void closest(std::span<const Ray> rays, std::span<Hit> hits) const;
    void filter(std::span<const Ray> rays, std::span<glm::vec3> result) const;

    /// The same on the calling thread, eight rays at a time. Loose ones are answered as single
    /// rays, to the bit; where a tight one hits differs by rounding, and depends on its eight.
    void closest_of_eights(std::span<const Ray> rays, Bundle bundle, std::span<Hit> hits) const;
    void filter_of_eights(std::span<const Ray> rays, Bundle bundle,
                          std::span<glm::vec3> result) const;
    /// The same of loose rays, by the caster where there is one.
    void closest_of_many(std::span<const Ray> rays, std::span<Hit> hits) const;

    struct Impl;

private:
    struct Captures;
    friend class PackedRays;
    Visibility(std::shared_ptr<Impl> impl, float scale, glm::vec3 offset);
    /// Of a ray in the structure's frame.
    void dim(const Ray& ray, Hit& hit) const;
    glm::vec3 left_in_air(const Ray& ray) const;
    bool is_placed() const { return scale_ != 1.0f || offset_ != glm::vec3(0.0f); }
    Ray to_structure(const Ray& ray) const {
        return is_placed()
                   ? Ray{to_structure(ray.origin), scale_ * ray.direction, ray.t_min, ray.t_max}
                   : ray;
    }
    std::span<const Ray> to_structure(std::span<const Ray> rays, std::span<Ray> placed) const;
    /// Where no surface on the segment is opaque.
    glm::vec3 filter_of_others(const Ray& ray) const;
    std::shared_ptr<Impl> impl_;
    std::shared_ptr<Captures> captures_;
    std::shared_ptr<const Air> air_;
    std::shared_ptr<const Caster> caster_;
    float scale_ = 1.0f;
    glm::vec3 offset_{0.0f};
};

/// Batches of rays laid out as Embree takes them, to measure what its traversal alone costs.
class PackedRays {
public:
    PackedRays();
    ~PackedRays();
    PackedRays(PackedRays&&) noexcept;
    PackedRays& operator=(PackedRays&&) noexcept;

    /// Takes a batch (100 bytes a ray) of which the nearest hits are wanted, or whether there is
    /// any.
    void add(std::span<const Ray> rays, Bundle bundle, bool any_hit);
    uint64_t size() const; ///< rays
    /// Traces all batches eight rays at a time on all threads, as if every surface were opaque, and
    /// keeps nothing but the number of rays that met one.
    uint64_t trace(const Visibility& visibility) const;

private:
    struct Batches;
    std::unique_ptr<Batches> batches_;
};

} // namespace lpvbake::visibility
