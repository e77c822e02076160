#include "visibility/opposites.h"

#include <algorithm>

namespace lpvbake::visibility {
namespace {

constexpr size_t most_others = 64;
/// What all searches may visit for each triangle of the scene, in their mean, and at least: around
/// large triangles lies much.
constexpr int64_t visits_a_triangle = 64, least_visits = 1 << 18;

} // namespace

Opposites::Opposites(RTCScene bvh, const glm::vec3* positions,
                     std::span<const glm::uvec3> triangles, float near,
                     std::function<bool(uint32_t)> has_two_fronts)
    : bvh_(bvh),
      positions_(positions),
      triangles_(triangles),
      near_(near),
      has_two_fronts_(std::move(has_two_fronts)),
      unknown_{true, {}},
      of_(triangles.size()),
      visits_left_(std::max(least_visits, visits_a_triangle * int64_t(triangles.size()))) {}

Opposites::~Opposites() {
    for (const std::atomic<const Near*>& near : of_)
        if (const Near* const own = near.load(); own != &none_ && own != &unknown_)
            delete own;
}

Opposites::Box Opposites::box_of(uint32_t primitive) const {
    const glm::uvec3 v = triangles_[primitive];
    const glm::vec3 a = positions_[v.x], b = positions_[v.y], c = positions_[v.z];
    return {glm::min(a, glm::min(b, c)), glm::max(a, glm::max(b, c))};
}

/// Its length is 0 for a sliver, whose side rounding may turn.
glm::dvec3 Opposites::normal_of(uint32_t primitive) const {
    constexpr double thin = 1e-3; // of the square of the longest edge
    const glm::uvec3 v = triangles_[primitive];
    const glm::dvec3 a(positions_[v.x]), ab = glm::dvec3(positions_[v.y]) - a,
                                         ac = glm::dvec3(positions_[v.z]) - a, bc = ac - ab;
    const glm::dvec3 normal = glm::cross(ab, ac);
    const double size = glm::length(normal);
    const double longest = std::max({glm::dot(ab, ab), glm::dot(ac, ac), glm::dot(bc, bc)});
    return size > thin * longest ? normal / size : glm::dvec3(0.0);
}

const Opposites::Near* Opposites::find(uint32_t primitive) const {
    constexpr double aslant = 1e-3; // so that rounding turns none that is left out to its front
    struct Search {
        const Opposites& all;
        uint32_t primitive;
        Box box;
        glm::dvec3 normal;
        int64_t visits = 0;
        Near found = {};
    };
    const float margin = 4.0f * near_;
    const Box box = box_of(primitive);
    Search search{*this, primitive, {box.lo - margin, box.hi + margin}, normal_of(primitive)};
    const glm::vec3 centre = 0.5f * (box.lo + box.hi);
    RTCPointQuery query{centre.x, centre.y, centre.z, 0.0f,
                        1.001f * glm::length(0.5f * (box.hi - box.lo) + margin)};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    const auto meet = [](RTCPointQueryFunctionArguments* args) {
        Search& own = *static_cast<Search*>(args->userPtr);
        if (own.found.too_many)
            return false;
        const Opposites& all = own.all;
        own.found.too_many = ++own.visits > all.visits_left_.load(std::memory_order_relaxed);
        const Box other = all.box_of(args->primID);
        const bool touches = glm::all(glm::lessThanEqual(other.lo, own.box.hi))
                             && glm::all(glm::greaterThanEqual(other.hi, own.box.lo));
        if (touches && args->primID != own.primitive
            && (all.has_two_fronts_(args->primID)
                || glm::dot(own.normal, all.normal_of(args->primID)) <= aslant)) {
            own.found.others.push_back({args->primID, other.lo, other.hi});
            own.found.too_many |= own.found.others.size() > most_others;
        }
        if (!own.found.too_many)
            return false;
        args->query->radius = 0.0f; // that is all
        return true;
    };
    rtcPointQuery(bvh_, &query, &context, meet, &search);
    visits_left_.fetch_sub(search.visits, std::memory_order_relaxed);
    const Near* near = &none_;
    if (search.found.too_many) {
        near = &unknown_;
    } else if (!search.found.others.empty()) {
        std::ranges::sort(search.found.others, {}, &Other::primitive);
        near = new Near(std::move(search.found));
    }
    const Near* before = nullptr;
    if (of_[primitive].compare_exchange_strong(before, near, std::memory_order_acq_rel))
        return near;
    if (near != &none_ && near != &unknown_)
        delete near;
    return before;
}

Opposites::Answer Opposites::at(uint32_t primitive, glm::vec3 place) const {
    const Box box = box_of(primitive);
    if (!(glm::all(glm::greaterThanEqual(place, box.lo - near_))
          && glm::all(glm::lessThanEqual(place, box.hi + near_))))
        return {false, {}};
    const Near* near = of_[primitive].load(std::memory_order_acquire);
    if (!near)
        near = find(primitive);
    return {!near->too_many, near->others};
}

} // namespace lpvbake::visibility
