#include "surface/light_map.h"

#include "mix_word.h"
#include "scene/material.h"
#include "surface/cutting.h"
#include "surface/in_place.h"
#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <iterator>
#include <utility>

namespace lpvbake::surface {
namespace {

constexpr int deepest = 24;    ///< level of the smallest texels
constexpr int tile_levels = 5; ///< a tile has 32 x 32 texels to begin with, or fewer
constexpr size_t most_texels =
    1 << 16; ///< of a tile before edges; more, and its quarters are tiles
constexpr float share_of_patch = 0.15f; ///< of a patch's longest edge squared: a texel at most
constexpr float least_cosine = 0.1f;
/// Of the flux within a patch's longest edge, by edges: where a beam ends that is no wider, and
/// elsewhere, where such errors of neighbours make up for each other.
constexpr float beam_error = 0.01f, rim_error = 0.04f;
constexpr int passes = 8; ///< over edges
constexpr uint32_t none = ~0u;

/// A square of a map: of 2^level x 2^level.
struct Square {
    uint32_t x = 0, y = 0;
    int level = 0;

    Square child(uint32_t i) const { return {2 * x + (i & 1), 2 * y + (i >> 1), level + 1}; }
    double edge() const { ///< of a map that is [-1, 1]^2: 2^(1 - level)
        return std::bit_cast<double>(uint64_t(1024 - level) << 52);
    }
    glm::dvec2 at(glm::dvec2 inside) const { return (glm::dvec2(x, y) + inside) * edge() - 1.0; }
    uint32_t left() const { return x << (deepest - level); } ///< in squares of the deepest level
    uint32_t top() const { return y << (deepest - level); }
    uint32_t width() const { return 1u << (deepest - level); }
};

uint64_t spread_bits(uint32_t word) {
    uint64_t bits = word;
    bits = (bits | bits << 16) & 0x0000ffff0000ffffull;
    bits = (bits | bits << 8) & 0x00ff00ff00ff00ffull;
    bits = (bits | bits << 4) & 0x0f0f0f0f0f0f0f0full;
    bits = (bits | bits << 2) & 0x3333333333333333ull;
    return (bits | bits << 1) & 0x5555555555555555ull;
}

/// Place on Morton's curve, by which squares are sorted.
uint64_t morton(uint32_t x, uint32_t y) {
    return spread_bits(x) | spread_bits(y) << 1;
}

/// The same as std::floor(), without a call.
int floor_of(float x) {
    const int cut = int(x);
    return cut - int(float(cut) > x);
}

/// A part of a map that has to be seen, and the level that this takes.
struct Part {
    glm::dvec2 lo, hi;
    int level;
};

/// One of a light's maps.
struct ViewMap {
    const Light& light;
    scene::RsmView view;
    scene::Cone cone;
    glm::dvec2 half; ///< lengths of the view's u, v
    float nearest, farthest;
    uint32_t key;
    std::vector<scene::TexelFlux> fluxes; ///< a level
    std::vector<Part> parts;              ///< the scene, and what of it lies in the grid

    ViewMap(const Light& of, const scene::RsmView& seen, const scene::Frame& frame, uint32_t random)
        : light(of),
          view(seen),
          half(glm::length(seen.u), glm::length(seen.v)),
          nearest(seen.perspective ? ray_offset(glm::vec3(seen.origin)) : 0.0f),
          farthest(!seen.perspective ? float(seen.farthest - seen.nearest)
                   : of.range > 0.0  ? float(of.range / frame.unit)
                                     : HUGE_VALF),
          key(random) {
        if (of.type == LightType::spot)
            cone = scene::Cone(of);
        for (int level = 0; level <= deepest; ++level)
            fluxes.emplace_back(of, frame, seen, 1 << level);
    }

    /// Adds what of the map shows the box; false if nothing does.
    bool add_part(glm::dvec3 lo, glm::dvec3 hi, int texels) {
        glm::dvec2 least(1.0), most(-1.0);
        for (int i = 0; i < 8; ++i) {
            const glm::dvec3 from =
                glm::dvec3(i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z)
                - view.origin;
            const double depth = view.perspective ? glm::dot(from, view.axis) : 1.0;
            if (!(depth > 1e-6 * glm::length(from))) {
                least = glm::dvec2(-1.0);
                most = glm::dvec2(1.0);
                break;
            }
            const glm::dvec2 at =
                glm::dvec2(glm::dot(from, view.u), glm::dot(from, view.v)) / (half * half * depth);
            least = glm::min(least, at);
            most = glm::max(most, at);
        }
        least = glm::max(least, glm::dvec2(-1.0));
        most = glm::min(most, glm::dvec2(1.0));
        if (glm::any(glm::greaterThan(least, most)))
            return false;
        const double size = std::max({most.x - least.x, most.y - least.y, 1e-6});
        parts.push_back(
            {least, most,
             std::clamp(int(std::ceil(std::log2(2.0 * texels / size))), 0, deepest - 4)});
        return true;
    }

    /// The level that is wanted at a square; -1 where the scene is not.
    int wanted_level(const Square& square) const {
        const glm::dvec2 lo = square.at({0, 0}), hi = square.at({1, 1});
        int level = -1;
        for (const Part& part : parts)
            if (glm::all(glm::lessThanEqual(part.lo, hi))
                && glm::all(glm::lessThanEqual(lo, part.hi)))
                level = std::max(level, part.level);
        return level;
    }

    /// Light that leaves through a square, lumen. TexelFlux is meant for small ones.
    double flux(const Square& square) const {
        if (square.level >= (view.perspective ? 4 : 0))
            return fluxes[size_t(square.level)](int(square.x), int(square.y));
        double sum = 0;
        for (uint32_t i = 0; i < 4; ++i)
            sum += flux(square.child(i));
        return sum;
    }

    /// A point of the square at random, within the cone.
    glm::dvec2 point(const Square& square) const {
        uint32_t bits = mix_word(mix_word(key + uint32_t(square.level)) ^ square.x);
        bits = mix_word(bits ^ square.y);
        glm::dvec2 at(0.0);
        for (int attempt = 0; attempt < 8; ++attempt) {
            const uint32_t more = mix_word(bits += 0x9e3779b9u);
            at = square.at(
                {(double(bits >> 8) + 0.5) * 0x1p-24, (double(more >> 8) + 0.5) * 0x1p-24});
            if (light.type != LightType::spot || cone(glm::normalize(view.along(at))) > 0.0)
                break;
        }
        return at;
    }

    visibility::Ray ray(glm::dvec2 at) const {
        if (view.perspective)
            return {glm::vec3(view.origin), glm::vec3(glm::normalize(view.along(at))), nearest,
                    farthest};
        return {glm::vec3(view.start(at) + view.nearest * view.axis), glm::vec3(view.axis), nearest,
                farthest};
    }

    /// Area of a square across the ray at a distance, frame units squared.
    double across(const Square& square, glm::dvec2 at, double distance) const {
        const glm::dvec2 edges = half * square.edge();
        const double plane = edges.x * edges.y;
        if (!view.perspective)
            return plane;
        const double slant = glm::length(view.along(at));
        return plane * distance * distance / (slant * slant * slant);
    }
};

/// A square with what its ray meets.
struct Texel {
    Square square;
    bool seam = false;  ///< its parent reached out of its triangle
    bool bent = false;  ///< a neighbour sees another plane
    bool edged = false; ///< and one that is not joined to its own
    float flux = 0;     ///< lumen
    float across = 0;   ///< frame units squared
    bool gone = false;  ///< split
    uint32_t bin = none;
    std::array<uint32_t, 2> beyond{none, none}; ///< bins of neighbours that see other surfaces
    float edge = 0;                             ///< longest of patches there
    float on_surface = 0;                       ///< more, where the surface is oblique
    float area = 0;                             ///< as that, however oblique it is
    visibility::Hit hit;
    glm::vec3 position{0};
    glm::vec3 normal{0}; ///< towards the light

    bool missed() const { return hit.instance == visibility::no_hit; }
};

/// A triangle as rays of a map meet it.
struct Plane {
    glm::dvec3 corner{0.0}, u{0.0}, v{0.0}, normal{0.0};
    double square = 0, area = 0;
    glm::dvec3 heights{0.0}; ///< over the edges opposite the corners

    Plane() = default;
    explicit Plane(const glm::dmat3& corners)
        : corner(corners[0]),
          u(corners[1] - corners[0]),
          v(corners[2] - corners[0]),
          normal(glm::cross(u, v)),
          square(glm::dot(normal, normal)),
          area(0.5 * std::sqrt(square)),
          heights(2.0 * area / glm::dvec3(glm::length(u - v), glm::length(v), glm::length(u))) {}
    /// Weights of the second and third corner where a ray meets the plane.
    glm::dvec2 weights(const scene::RsmView& view, glm::dvec2 at) const {
        const glm::dvec3 start = view.start(at), along = view.along(at);
        const double way = glm::dot(normal, corner - start) / glm::dot(normal, along);
        const glm::dvec3 from = start + way * along - corner;
        return glm::dvec2(glm::dot(glm::cross(from, v), normal),
                          glm::dot(glm::cross(u, from), normal))
               / square;
    }
    /// From a point to the nearest edge.
    double reach(glm::dvec2 weights) const {
        return std::min({(1.0 - weights.x - weights.y) * heights.x, weights.x * heights.y,
                         weights.y * heights.z});
    }
    static bool inside(glm::dvec2 weights) {
        return std::min({weights.x, weights.y, 1.0 - weights.x - weights.y}) >= 0.0;
    }
};

/// What a tile of a map gives.
struct TileFlux {
    LightMap::Tile tile;
    std::vector<SideFlux> sides; ///< one may come twice

    Square square() const { return {tile.x, tile.y, tile.level}; }
};

class Tile {
public:
    explicit Tile(const LightMapper& mapper) : mapper_(mapper) {}

    /// False, and only its rays counted, where a tile has to be drawn as its quarters.
    bool draw(const ViewMap& map, TileFlux& result) {
        const Square square = result.square();
        map_ = &map;
        texels_.clear();
        order_.clear();
        open_.clear();
        missed_ = 0;
        rays_ = 0;
        add(square);
        recent_.fill(none);
        const bool fits = trace_all(square.level < deepest - 4 ? most_texels : ~size_t(0));
        if (fits) {
            lo_ = {square.left(), square.top()};
            hi_ = lo_ + square.width();
            begin_ = morton(lo_.x, lo_.y);
            refine();
            result.tile.power.missed += missed_;
            give(result);
        }
        result.tile.rays += rays_;
        return fits;
    }

private:
    /// Where a texel begins on Morton's curve; and what of it most neighbours ask for, so that
    /// they need not load it.
    struct Place {
        uint64_t begin;
        uint32_t texel;
        int level;
        uint32_t instance, triangle; ///< that it meets

        uint64_t places() const { return uint64_t(1) << (2 * (deepest - level)); }
        bool meets_as(const Texel& other) const {
            return instance == other.hit.instance && triangle == other.hit.triangle;
        }
    };

    /// Opens a square, or its squares of the level that is wanted.
    void add(const Square& square, bool seam = false) {
        const int wanted = map_->wanted_level(square);
        if (wanted > square.level) {
            for (uint32_t i = 0; i < 4; ++i)
                add(square.child(i));
            return;
        }
        const double flux = map_->flux(square);
        if (wanted < 0)
            missed_ += flux;
        else if (flux > 0.0) {
            Texel texel;
            texel.square = square;
            texel.seam = seam;
            texel.flux = float(flux);
            open_.push_back(texel);
        }
    }

    /// Traces what is open, and what this opens; false, and stopped, beyond `most`.
    bool trace_all(size_t most) {
        while (!open_.empty()) {
            if (texels_.size() + open_.size() > most)
                return false;
            trace(open_);
            std::swap(traced_, open_);
            open_.clear();
            for (const Texel& texel : traced_)
                if (const float excess = coarseness(texel); excess > 1.0f)
                    split(texel.square, excess > 16.0f ? 3 : excess > 4.0f ? 2 : 1);
                else if (is_seam(texel))
                    split(texel.square, 1, true);
                else
                    texels_.push_back(texel);
        }
        return true;
    }

    /// Opens the squares that are `levels` smaller.
    void split(const Square& square, int levels, bool seam = false) {
        for (uint32_t i = 0; i < 4; ++i)
            if (levels > 1 && square.level + 1 < deepest)
                split(square.child(i), levels - 1);
            else
                add(square.child(i), seam);
    }

    void trace(std::span<Texel> texels) {
        places_.clear();
        batch_.clear();
        for (const Texel& texel : texels) {
            places_.push_back(map_->point(texel.square));
            batch_.push_back(map_->ray(places_.back()));
        }
        hits_.resize(batch_.size());
        mapper_.lit.visibility->closest_of_eights(batch_, visibility::Bundle::tight, hits_);
        rays_ += batch_.size();
        for (size_t i = 0; i < texels.size(); ++i) {
            Texel& texel = texels[i];
            texel.hit = hits_[i];
            if (texel.missed())
                continue;
            const glm::vec3 direction = batch_[i].direction;
            texel.position = batch_[i].origin + hits_[i].t * direction;
            texel.normal =
                glm::dot(hits_[i].normal, direction) > 0.0f ? -hits_[i].normal : hits_[i].normal;
            texel.across = float(map_->across(texel.square, places_[i], double(hits_[i].t)));
            texel.on_surface =
                texel.across / std::max(least_cosine, -glm::dot(texel.normal, direction));
            texel.area = texel.across / std::max(1e-6f, -glm::dot(texel.normal, direction));
            texel.edge = mapper_.patch_edge(texel.position);
        }
    }

    /// Area of a texel in that which it may have beside patches; 0: as it comes.
    float coarseness(const Texel& texel) const {
        if (texel.missed() || texel.hit.facing == visibility::Facing::back
            || texel.square.level >= deepest)
            return 0.0f;
        return texel.on_surface / (share_of_patch * texel.edge * texel.edge);
    }

    /// Reaches out of a triangle that is larger than itself: there may be a gap.
    bool is_seam(const Texel& texel) {
        if (texel.seam || texel.missed() || texel.square.level >= deepest)
            return false;
        const Plane& plane = plane_of(texel.hit);
        if (plane.area < 4.0 * double(texel.on_surface)
            || plane.reach(texel.hit.barycentric)
                   > 1.5 * double(texel.on_surface / std::sqrt(texel.across)))
            return false;
        for (uint32_t i = 0; i < 4; ++i)
            if (!Plane::inside(plane.weights(map_->view, texel.square.at({i & 1, i >> 1}))))
                return true;
        return false;
    }

    /// Splits texels at edges until what falls within a patch's edge is known well enough.
    void refine() {
        const size_t most = 3 * texels_.size() + 4096;
        bins_.resize(std::bit_ceil(2 * texels_.size() + 1));
        size_t known = 0; // texels whose edges are
        for (int pass = 0;; ++pass) {
            sort_from(known);
            find_edges(known);
            known = texels_.size();
            const size_t room = known < most ? (most - known) / 3 : 0;
            if (pass == passes || room == 0)
                return;
            std::vector<std::pair<float, uint32_t>> wanted = uncertain();
            if (wanted.empty())
                return;
            if (wanted.size() > room) {
                std::ranges::nth_element(wanted, wanted.begin() + std::ptrdiff_t(room));
                wanted.resize(room);
            }
            for (const auto& [error, i] : wanted) {
                texels_[i].gone = true;
                split(texels_[i].square, 1, true);
            }
            trace_all(~size_t(0));
        }
    }

    /// Brings texels from `first` on to their places on the curve, and those that are gone away.
    void sort_from(size_t first) {
        std::erase_if(order_, [&](const Place& place) { return texels_[place.texel].gone; });
        const auto middle = std::ptrdiff_t(order_.size());
        for (size_t i = first; i < texels_.size(); ++i) {
            const Texel& texel = texels_[i];
            order_.push_back({morton(texel.square.left(), texel.square.top()), uint32_t(i),
                              texel.square.level, texel.hit.instance, texel.hit.triangle});
        }
        std::ranges::sort(order_.begin() + middle, order_.end(), {}, &Place::begin);
        std::ranges::inplace_merge(order_, order_.begin() + middle, {}, &Place::begin);
        // Runs of equal length, so that one is found without a search.
        const uint64_t places = uint64_t(hi_.x - lo_.x) * (hi_.y - lo_.y);
        run_shift_ =
            std::max(0, int(std::bit_width(places)) - int(std::bit_width(order_.size())) - 1);
        runs_.assign(size_t(places >> run_shift_) + 1, 0);
        size_t next = 0;
        for (size_t run = 0; run < runs_.size(); ++run) {
            while (next < order_.size()
                   && order_[next].begin < begin_ + (uint64_t(run) << run_shift_))
                ++next;
            runs_[run] = uint32_t(next);
        }
    }

    /// What a texel meets, by facing and cells of about the patches' edge: not the same by chance.
    uint32_t bin_of(const Texel& texel) const {
        if (texel.missed())
            return none;
        const uint32_t exponent = std::bit_cast<uint32_t>(texel.edge) >> 23; // it is positive
        const int octave = std::clamp(int(exponent) - 127, 0, 126);
        const float scale = std::bit_cast<float>(uint32_t(127 - octave) << 23); // 2^-octave
        const glm::vec3 size = glm::abs(texel.normal);
        const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        uint32_t bits = uint32_t(2 * axis + (texel.normal[axis] < 0.0f)) + 8u * uint32_t(octave);
        for (int i = 0; i < 3; ++i)
            bits = mix_word(bits) + uint32_t(floor_of(scale * texel.position[i]));
        return mix_word(bits) >> 1;
    }

    /// How what two texels see lies to each other.
    enum class Relation { plane, joined, apart };
    /// One plane, or surfaces that meet where the light sees both: then each lies before the plane
    /// of the other, or each behind it. What is partly transparent hides no edge and is none.
    Relation relation(const Texel& a, const Texel& b) const {
        if (a.hit.instance == b.hit.instance && a.hit.triangle == b.hit.triangle)
            return Relation::plane;
        if ((!a.missed() && mapper_.blended(a.hit)) || (!b.missed() && mapper_.blended(b.hit)))
            return Relation::joined;
        if (a.missed() || b.missed())
            return Relation::apart;
        const glm::vec3 way = b.position - a.position;
        const float before_a = glm::dot(a.normal, way), before_b = -glm::dot(b.normal, way);
        const float slack =
            0.1f * std::sqrt(std::max(a.across, b.across)) + 4.0f * ray_offset(a.position);
        const bool before = before_a >= -slack && before_b >= -slack;
        const bool behind = before_a <= slack && before_b <= slack;
        return before && behind   ? Relation::plane
               : before || behind ? Relation::joined
                                  : Relation::apart;
    }

    /// The texel around a place of the curve in the tile; null where the light does not shine.
    const Place* find(uint64_t place) const {
        const size_t run = size_t((place - begin_) >> run_shift_);
        const auto first = order_.begin();
        const auto after = std::upper_bound(
            first + runs_[run], first + runs_[run + 1], place,
            [](uint64_t wanted, const Place& there) { return wanted < there.begin; });
        if (after == first)
            return nullptr;
        const Place& found = *(after - 1);
        return place - found.begin < found.places() ? &found : nullptr;
    }

    /// Notes at two neighbours what the other sees.
    void compare(Texel& a, Texel& b) const {
        const Relation found = relation(a, b);
        if (found == Relation::plane)
            return;
        a.bent = b.bent = true;
        if (found != Relation::apart)
            return;
        a.edged = b.edged = true;
        a.bin = bin_of(a);
        b.bin = bin_of(b);
        const auto note = [](Texel& texel, uint32_t bin) {
            if (bin != none && bin != texel.bin && bin != texel.beyond[0])
                texel.beyond[texel.beyond[0] == none ? 0 : 1] = bin;
        };
        note(a, b.bin);
        note(b, a.bin);
    }

    /// Marks texels from `first` on, and all their neighbours, where they see different surfaces;
    /// neighbours outside of the tile are as large as the texel.
    void find_edges(size_t first) {
        std::vector<uint32_t> asks;
        open_.clear();
        for (size_t n = first; n < texels_.size(); ++n) {
            Texel& texel = texels_[n];
            const uint32_t x = texel.square.left(), y = texel.square.top(),
                           width = texel.square.width();
            const std::array<uint32_t, 3> xs{x - 1, x + width / 2, x + width};
            const std::array<uint32_t, 3> ys{y - 1, y + width / 2, y + width};
            std::array<uint64_t, 3> along_x, along_y;
            for (size_t i = 0; i < 3; ++i) {
                along_x[i] = morton(xs[i], 0);
                along_y[i] = morton(0, ys[i]);
            }
            for (size_t i = 0; i < 9; ++i) {
                if (i == 4)
                    continue;
                const glm::uvec2 at(xs[i % 3], ys[i / 3]);
                if (!inside(at)) {
                    if (i % 2 != 0 && around(texel, at))
                        asks.push_back(uint32_t(n));
                    continue;
                }
                const Place* other = find(along_x[i % 3] | along_y[i / 3]);
                if (!other || other->meets_as(texel))
                    continue;
                // One that is no larger and came before has met this one.
                const size_t there = other->texel;
                if (there < first || there > n || (there < n && other->level < texel.square.level))
                    compare(texel, texels_[there]);
            }
        }
        trace(open_);
        for (size_t i = 0; i < asks.size(); ++i)
            compare(texels_[asks[i]], open_[i]);
        open_.clear();
    }

    bool inside(glm::uvec2 at) const {
        return at.x >= lo_.x && at.y >= lo_.y && at.x < hi_.x && at.y < hi_.y;
    }

    /// Opens the square of a texel's size around a place outside of the tile; false where the light
    /// does not shine.
    bool around(const Texel& texel, glm::uvec2 at) {
        constexpr uint32_t size = 1u << deepest;
        const int level = texel.square.level;
        const Square square{at.x >> (deepest - level), at.y >> (deepest - level), level};
        if (at.x >= size || at.y >= size || map_->wanted_level(square) < 0
            || !(map_->flux(square) > 0.0))
            return false;
        Texel outside;
        outside.square = square;
        open_.push_back(outside);
        return true;
    }

    /// Texels that make a bin too uncertain, by how much: negative, so that the worst come first.
    std::vector<std::pair<float, uint32_t>> uncertain() {
        std::ranges::fill(bins_, Bin{});
        const auto bin = [&](uint32_t of) -> Bin& { return bins_[of & (bins_.size() - 1)]; };
        std::vector<uint32_t> edged;
        for (size_t i = 0; i < texels_.size(); ++i) {
            const Texel& texel = texels_[i];
            if (texel.gone || !texel.edged)
                continue;
            edged.push_back(uint32_t(i));
            // An edge cuts about half of the texels at it; what it leaves of one is uniform.
            const float variance = 0.1f * texel.flux * texel.flux;
            for (const uint32_t of : {texel.bin, texel.beyond[0], texel.beyond[1]})
                if (of != none)
                    bin(of).variance += variance;
        }
        if (edged.empty())
            return {};
        for (Texel& texel : texels_) {
            if (texel.gone || texel.missed())
                continue;
            if (texel.bin == none)
                texel.bin = bin_of(texel);
            Bin& to = bin(texel.bin);
            if (!(to.variance > 0.0f))
                continue;
            to.flux += texel.flux;
            to.lit += texel.on_surface / (texel.edge * texel.edge);
        }
        std::vector<std::pair<float, uint32_t>> found;
        for (const uint32_t i : edged) {
            const Texel& texel = texels_[i];
            if (texel.square.level >= deepest)
                continue;
            float worst = 0.0f; // over what is wanted
            for (const uint32_t of : {texel.bin, texel.beyond[0], texel.beyond[1]})
                if (of != none)
                    worst = std::max(worst, std::sqrt(bin(of).variance)
                                                / std::max(bin(of).flux, texel.flux)
                                                / (bin(of).lit < 0.5f ? beam_error : rim_error));
            if (worst > 1.0f)
                found.emplace_back(-worst, i);
        }
        return found;
    }

    /// Hands on what the texels hold.
    void give(TileFlux& result) {
        for (const Place& place : order_) {
            const Texel& texel = texels_[place.texel];
            const double area = texel.missed() ? 0.0 : double(texel.area);
            if (!mapper_.veiled() && (texel.edged || coarseness(texel) < 0.1f))
                give(texel.hit, -texel.normal, texel.edged, double(texel.flux), area, result);
            else
                spread(texel, area, result);
        }
        give_all(result);
    }

    /// Hands on the flux of a ray, with others: their sides are looked up together.
    void give(const visibility::Hit& hit, glm::vec3 direction, bool edged, double flux, double area,
              TileFlux& result) {
        if (given_.count == Given::most)
            give_all(result);
        const size_t i = given_.count++;
        given_.hits[i] = hit;
        given_.rays[i].direction = direction;
        given_.edged[i] = edged;
        given_.flux[i] = flux;
        given_.area[i] = area;
    }

    void give_all(TileFlux& result) {
        const size_t count = std::exchange(given_.count, 0);
        mapper_.lit.sides(std::span(given_.hits).first(count), given_.rays, given_.sides);
        for (size_t i = 0; i < count; ++i)
            give(i, result);
    }

    void give(size_t i, TileFlux& result) {
        const visibility::Hit& hit = given_.hits[i];
        const double area = given_.area[i];
        double flux = given_.flux[i];
        LightPower& power = result.tile.power;
        if (hit.instance == visibility::no_hit) {
            power.missed += flux;
            return;
        }
        if (map_->view.perspective) {
            const double left =
                scene::range_window(map_->light, double(hit.t) * mapper_.frame.unit);
            power.missed += flux * (1.0 - left);
            flux *= left;
        }
        if (hit.facing == visibility::Facing::back) {
            power.black += flux;
            return;
        }
        const auto is_recent = [&](uint32_t side) {
            const uint32_t place = recent_[side % recent_.size()];
            return place < result.sides.size() && result.sides[place].side == side;
        };
        uint32_t side = given_.sides[i];
        bool recent = is_recent(side);
        if (!recent) { // of one that is, a patch shows it
            side = mapper_.side_shown(side, hit, given_.rays[i].direction);
            recent = is_recent(side);
        }
        if (side == LitSurfaces::no_side) {
            power.lost += flux;
            return;
        }
        power.landed += flux;
        uint32_t& place = recent_[side % recent_.size()];
        if (!recent) {
            place = uint32_t(result.sides.size());
            result.sides.push_back({side});
        }
        SideFlux& to = result.sides[place];
        to.edged |= given_.edged[i];
        to.flux += flux;
        to.tinted += flux * glm::dvec3(hit.tint);
        to.squares += flux * flux;
        to.peak += flux * flux / area;
        const glm::dvec2 weights(hit.barycentric);
        to.weights += flux * weights;
        to.squared_weights += flux * glm::dvec3(weights * weights, weights.x * weights.y);
    }

    /// Gives the quarters of a texel to the patches that they lie on: by arithmetic where it and
    /// its neighbours see one plane and its triangle reaches, else by rays. By rays of their own
    /// also where surfaces let some through by chance: those that a texel was split by, or not,
    /// would count their own luck.
    void spread(const Texel& texel, double area, TileFlux& result) {
        const bool flat = !mapper_.veiled() && !texel.bent;
        std::array<glm::dvec2, 4> places;
        std::array<double, 4> shares;
        double sum = 0.0;
        for (uint32_t i = 0; i < 4; ++i) {
            places[i] = map_->point(texel.square.child(i));
            shares[i] = map_->light.type == LightType::spot
                            ? map_->cone(glm::normalize(map_->view.along(places[i])))
                            : 1.0;
            sum += shares[i];
        }
        if (!(sum > 0.0)) { // the rim of a cone
            give(texel.hit, -texel.normal, texel.edged, double(texel.flux), area, result);
            return;
        }
        for (uint32_t i = 0; i < 4; ++i) {
            if (!(shares[i] > 0.0))
                continue;
            visibility::Hit hit = texel.hit;
            glm::vec3 direction = -texel.normal;
            const glm::dvec2 weights =
                flat ? plane_of(texel.hit).weights(map_->view, places[i]) : glm::dvec2(-1.0);
            if (Plane::inside(weights)) {
                hit.barycentric = weights;
            } else {
                const visibility::Ray ray = map_->ray(places[i]);
                hit = mapper_.lit.visibility->closest(ray);
                direction = ray.direction;
            }
            give(hit, direction, texel.edged, double(texel.flux) * (shares[i] / sum), 0.25 * area,
                 result);
        }
    }

    /// The triangle that was hit; mostly that of the texel before.
    const Plane& plane_of(const visibility::Hit& hit) {
        if (hit.instance != plane_instance_ || hit.triangle != plane_triangle_) {
            plane_ = Plane(mapper_.triangle(hit));
            plane_instance_ = hit.instance;
            plane_triangle_ = hit.triangle;
        }
        return plane_;
    }

    struct Bin {
        float flux = 0;
        float variance = 0;
        float lit = 0; ///< area that texels cover, in that of the patch's edge squared
    };
    /// What is handed on together.
    struct Given {
        static constexpr size_t most = 64;
        size_t count = 0;
        std::array<visibility::Hit, most> hits;
        std::array<visibility::Ray, most> rays; ///< their directions
        std::array<bool, most> edged;
        std::array<double, most> flux, area;
        std::array<uint32_t, most> sides;
    };
    const LightMapper& mapper_;
    const ViewMap* map_ = nullptr;
    Given given_;
    std::vector<Texel> texels_;
    std::vector<Place> order_;   ///< of those that are not gone
    std::vector<uint32_t> runs_; ///< where runs of 2^run_shift_ places begin in it, and its end
    int run_shift_ = 0;
    uint64_t begin_ = 0;      ///< of the tile on the curve
    std::vector<Texel> open_; ///< to be traced
    std::vector<Texel> traced_;
    std::vector<glm::dvec2> places_;
    std::vector<visibility::Ray> batch_;
    std::vector<visibility::Hit> hits_;
    std::vector<Bin> bins_;
    glm::uvec2 lo_{0}, hi_{0}; ///< of the tile, in squares of the deepest level
    double missed_ = 0;
    uint64_t rays_ = 0;
    std::array<uint32_t, 512> recent_; ///< where sides of late stand in the result
    Plane plane_;
    uint32_t plane_instance_ = none, plane_triangle_ = none;
};

void add_tiles(const ViewMap& map, size_t index, const Square& square,
               std::vector<LightMap::Tile>& tiles, LightPower& power) {
    const int wanted = map.wanted_level(square);
    if (wanted < 0)
        power.missed += map.flux(square);
    else if (square.level + tile_levels >= wanted)
        tiles.push_back({index, square.x, square.y, square.level, {}, 0, 0});
    else
        for (uint32_t i = 0; i < 4; ++i)
            add_tiles(map, index, square.child(i), tiles, power);
}

/// The maps of a light over all of the scene: those of raster/ end with the grid.
std::vector<ViewMap> maps_of(const Light& light, const LightMapper& mapper, int texels,
                             uint32_t key, LightPower& power) {
    const glm::dvec3 lo(mapper.lit.visibility->lo()), hi(mapper.lit.visibility->hi());
    if (glm::any(glm::greaterThan(lo, hi)))
        return {};
    std::vector<scene::RsmView> views;
    if (light.type == LightType::directional) {
        const scene::Frame whole{glm::dvec3(0.0), mapper.frame.unit, hi - lo};
        views = scene::views_of(light, whole, glm::dvec3(0.0), hi - lo);
        for (scene::RsmView& view : views)
            view.origin += lo;
    } else {
        views = scene::views_of(light, mapper.frame, lo, hi);
    }
    std::vector<ViewMap> maps;
    const glm::dvec3 in_lo = glm::max(lo, glm::dvec3(0.0)),
                     in_hi = glm::min(hi, mapper.frame.extent);
    for (size_t i = 0; i < views.size(); ++i) {
        ViewMap map(light, views[i], mapper.frame, mix_word(8 * key + uint32_t(i)));
        if (!map.add_part(lo, hi, texels)) {
            power.missed += map.flux({});
            continue;
        }
        if (glm::all(glm::lessThanEqual(in_lo, in_hi)))
            map.add_part(in_lo, in_hi, texels);
        maps.push_back(std::move(map));
    }
    return maps;
}

} // namespace

/// Threads' own memory, kept from tile to tile.
struct LightMapper::Workers {
    tbb::enumerable_thread_specific<Tile> tiles;
    explicit Workers(const LightMapper& mapper) : tiles(std::cref(mapper)) {}

    /// Appends what a tile gives, or where it is too large what its quarters give.
    void draw(std::span<const ViewMap> maps, const LightMap::Tile& tile,
              std::vector<TileFlux>& result) {
        TileFlux& own = result.emplace_back();
        own.tile = {tile.map, tile.x, tile.y, tile.level, {}, tile.rays, 0};
        if (tiles.local().draw(maps[tile.map], own))
            return;
        const TileFlux whole = std::move(own);
        result.pop_back();
        std::array<std::vector<TileFlux>, 4> quarters;
        tbb::parallel_for(uint32_t(0), 4u, [&](uint32_t i) {
            const Square part = whole.square().child(i);
            draw(maps, {tile.map, part.x, part.y, part.level, {}, i == 0 ? whole.tile.rays : 0, 0},
                 quarters[i]);
        });
        for (std::vector<TileFlux>& part : quarters)
            std::ranges::move(part, std::back_inserter(result));
    }

    /// Draws tiles in blocks; take(place in `which`, parts) each in its order.
    template <class Take>
    void draw_all(std::span<const ViewMap> maps, std::span<const LightMap::Tile> which,
                  const Take& take) {
        constexpr size_t block = 64;
        std::array<std::vector<TileFlux>, block> done;
        for (size_t first = 0; first < which.size(); first += block) {
            const size_t count = std::min(block, which.size() - first);
            tbb::parallel_for(size_t(0), count, [&](size_t i) {
                done[i].clear();
                draw(maps, which[first + i], done[i]);
            });
            for (size_t i = 0; i < count; ++i)
                take(first + i, std::span(done[i]));
        }
    }
};

LightMapper::~LightMapper() = default;

LightMapper::LightMapper(const Scene& scene, const LitSurfaces& surfaces, const scene::Frame& in,
                         std::span<const Light> lights)
    : lit(surfaces),
      frame(in),
      scene_(scene),
      workers_(std::make_unique<Workers>(*this)) {
    double views = 0; // of all maps, about
    for (const Light& light : lights)
        views += light.type == LightType::point ? 6.0 : 1.0;
    const double texels = std::clamp(std::sqrt(65536.0 / std::max(views, 1.0)), 8.0, 128.0);
    base_ = int(std::bit_floor(unsigned(texels)));
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        blended_.push_back(scene::is_veil(scene.materials[size_t(mesh.material)]));
        veiled_ |= blended_.back() != 0;
    }
}

float LightMapper::patch_edge(glm::vec3 point) const {
    return graded(1.0f, Boxes(frame).distance(point));
}

uint32_t LightMapper::side_shown(uint32_t seen, const visibility::Hit& hit,
                                 glm::vec3 direction) const {
    const auto shown = [&](uint32_t side) {
        return side != LitSurfaces::no_side && lit.patches[side / 2].area > 0.0f;
    };
    if (shown(seen))
        return seen;
    const glm::vec3 normal = glm::dot(hit.normal, direction) > 0.0f ? -hit.normal : hit.normal;
    const auto [u, v] = visibility::tangents_of(normal);
    const glm::dmat3 corners = triangle(hit);
    const glm::vec3 position =
        corners
        * glm::dvec3(1.0 - double(hit.barycentric.x) - double(hit.barycentric.y), hit.barycentric);
    if (const uint32_t side = seen_at(lit, position, normal); side != LitSurfaces::no_side)
        return side;
    const float edge = patch_edge(position), offset = ray_offset(position);
    const float height = 0.02f * edge + 2.0f * offset;
    const glm::vec3 from = position + height * normal;
    const int around = 8;
    for (int i = 0; i < 3 * around; ++i) {
        const float radius = 0.1f * edge * float(1 << (i / around));
        const float angle = glm::two_pi<float>() * float(i) / float(around);
        const glm::vec3 aside = radius * (std::cos(angle) * u + std::sin(angle) * v);
        if (lit.visibility->transmittance({from, aside}) < 0.5f)
            continue;
        const visibility::Hit below =
            lit.visibility->closest({from + aside, -2.0f * height * normal});
        if (below.instance == visibility::no_hit)
            continue;
        if (const uint32_t side = lit.side(below, -normal); shown(side))
            return side;
    }
    return LitSurfaces::no_side;
}

glm::dmat3 LightMapper::triangle(const visibility::Hit& hit) const {
    const Instance& instance = scene_.instances[hit.instance];
    const Mesh& mesh = scene_.meshes[size_t(instance.mesh)];
    const glm::uvec3 corners = mesh.triangles[hit.triangle];
    glm::dmat3 result;
    for (int i = 0; i < 3; ++i)
        result[i] = frame.from_world(glm::dvec3(
            instance.to_world * glm::dvec4(glm::dvec3(mesh.positions[corners[i]]), 1.0)));
    return result;
}

namespace {

/// Sums up what tiles hold of a light's power, in their order.
void add_up(LightMap& map) {
    LightPower& power = map.power = map.beside;
    for (const LightMap::Tile& tile : map.tiles) {
        map.rays += tile.rays;
        power.landed += tile.power.landed;
        power.missed += tile.power.missed;
        power.black += tile.power.black;
        power.lost += tile.power.lost;
    }
    power.sent = power.landed + power.missed + power.black + power.lost;
}

void note_tile(const TileFlux& tile, LightMap& map) {
    map.tiles.push_back(tile.tile);
    map.tiles.back().met = tile.sides.size();
    for (const SideFlux& side : tile.sides)
        map.met.push_back(side.side);
}

/// Adds what one tile gives a side to what others give it; `places`: where each stands in `sides`.
void merge(const SideFlux& from, std::vector<uint32_t>& places, std::vector<SideFlux>& sides) {
    uint32_t& place = places[from.side];
    if (place == none) {
        place = uint32_t(sides.size());
        sides.push_back(from);
        return;
    }
    SideFlux& to = sides[place];
    to.edged |= from.edged;
    to.flux += from.flux;
    to.tinted += from.tinted;
    to.squares += from.squares;
    to.peak += from.peak;
    to.weights += from.weights;
    to.squared_weights += from.squared_weights;
}

/// take(place of a tile, a side) all sides that tiles give light to, in their order.
template <class Take>
void each_met(const LightMap& map, const Take& take) {
    size_t next = 0;
    for (size_t i = 0; i < map.tiles.size(); ++i)
        for (const size_t end = next + map.tiles[i].met; next < end; ++next)
            take(i, map.met[next]);
}

/// The tiles of a map for which is_wanted(place, side) holds of a side that they give light to.
template <class Wanted>
std::vector<size_t> tiles_with(const LightMap& map, const Wanted& is_wanted) {
    std::vector<size_t> tiles;
    each_met(map, [&](size_t tile, uint32_t side) {
        if ((tiles.empty() || tiles.back() != tile) && is_wanted(tile, side))
            tiles.push_back(tile);
    });
    return tiles;
}

/// A map of which some tiles were drawn anew, and of others what falls on the sides of those.
LightMap put_together(const LightMap& before, std::span<const TileFlux> drawn,
                      const std::vector<bool>& is_drawn, const std::vector<bool>& is_anew,
                      std::vector<uint32_t>& places) {
    std::vector<SideFlux> sides;
    for (const TileFlux& tile : drawn)
        for (const SideFlux& side : tile.sides)
            merge(side, places, sides);
    for (const SideFlux& side : before.sides)
        if (!is_anew[side.side])
            merge(side, places, sides);
    LightMap result;
    result.beside = before.beside;
    result.tiles = before.tiles;
    for (size_t i = 0; i < drawn.size(); ++i)
        if (is_drawn[i]) {
            result.tiles[i].power = drawn[i].tile.power;
            result.tiles[i].met = drawn[i].sides.size();
        }
    size_t next = 0;
    for (size_t i = 0; i < drawn.size(); next += before.tiles[i++].met)
        if (is_drawn[i])
            for (const SideFlux& side : drawn[i].sides)
                result.met.push_back(side.side);
        else
            for (const uint32_t side : std::span(before.met).subspan(next, before.tiles[i].met))
                result.met.push_back(side);
    for (const uint32_t side : result.met)
        if (uint32_t& place = places[side]; place != none) {
            result.sides.push_back(sides[place]);
            place = none;
        }
    add_up(result);
    return result;
}

} // namespace

LightMap LightMapper::draw(const Light& light, uint32_t key) {
    LightMap result;
    place_.resize(2 * lit.patches.size(), none);
    LightPower beside;
    const std::vector<ViewMap> maps = maps_of(light, *this, base_, key, beside);
    std::vector<LightMap::Tile> tiles;
    for (size_t i = 0; i < maps.size(); ++i)
        add_tiles(maps[i], i, {}, tiles, beside);
    workers_->draw_all(maps, tiles, [&](size_t, std::span<const TileFlux> parts) {
        for (const TileFlux& part : parts) {
            note_tile(part, result);
            for (const SideFlux& side : part.sides)
                merge(side, place_, result.sides);
        }
    });
    for (const SideFlux& side : result.sides)
        place_[side.side] = none;
    result.beside = beside;
    add_up(result);
    return result;
}

LightMap LightMapper::draw_again(const Light& light, uint32_t key, const LightMap& before,
                                 std::span<const uint32_t> cut) {
    // No ray depends on patches: only what meets those that were cut has another side now.
    std::vector<bool> is_anew(2 * lit.patches.size());
    for (const uint32_t patch : cut)
        is_anew[2 * size_t(patch)] = is_anew[2 * size_t(patch) + 1] = true;
    LightPower beside;
    const std::vector<ViewMap> maps = maps_of(light, *this, base_, key, beside);
    std::vector<TileFlux> drawn(before.tiles.size());
    std::vector<bool> is_drawn(drawn.size());
    const auto draw_some = [&](const std::vector<size_t>& places, const auto& take) {
        std::vector<LightMap::Tile> tiles;
        for (const size_t place : places)
            tiles.push_back(before.tiles[place]);
        workers_->draw_all(maps, tiles, [&](size_t i, std::span<TileFlux> parts) {
            take(parts.front(), drawn[places[i]]);
        });
    };
    const std::vector<size_t> changed =
        tiles_with(before, [&](size_t, uint32_t side) { return is_anew[side]; });
    draw_some(changed, [](TileFlux& from, TileFlux& to) { to = std::move(from); });
    // The sides that they give light to are summed up anew.
    for (const size_t i : changed) {
        is_drawn[i] = true;
        for (const SideFlux& side : drawn[i].sides)
            is_anew[side.side] = true;
    }
    each_met(before, [&](size_t tile, uint32_t side) {
        if (is_drawn[tile])
            is_anew[side] = true;
    });
    const std::vector<size_t> others = tiles_with(
        before, [&](size_t tile, uint32_t side) { return !is_drawn[tile] && is_anew[side]; });
    draw_some(others, [&](const TileFlux& from, TileFlux& to) {
        std::ranges::copy_if(from.sides, std::back_inserter(to.sides),
                             [&](const SideFlux& side) { return is_anew[side.side]; });
    });
    place_.resize(is_anew.size(), none);
    return put_together(before, drawn, is_drawn, is_anew, place_);
}

} // namespace lpvbake::surface
