#include "medium/beams.h"

#include "colour/colour.h"
#include "medium/closed_map.h"
#include "medium/medium.h"
#include "scene/photometry.h"
#include "visibility/tangents.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>

namespace lpvbake::medium {
namespace {

constexpr double unit = 0x1p40; ///< of the sums: a beam of weight 1 over a cell's edge
constexpr double near = 2.0;    ///< cells around a light in which its beams are all there is
constexpr int most_texels = 32; ///< along an edge of a tile
constexpr double hair =
    double(surface_margin) + 1e-4;   ///< cells: walls are as far off surfaces at most
constexpr double gauss = 0.28867513; ///< places of the two points in [-1/2, 1/2]

/// A ray of light: from `begin` to `end` of its way it is in the grid.
struct Beam {
    glm::dvec3 origin, direction; ///< frame units; unit vector
    double begin = 0, end = 0;
    double weight = 1;      ///< directional: 1; else its solid angle, sr
    double intensity = 1;   ///< share of the light's: of a spot's cone
    double traced_from = 0; ///< where light comes from
    double aside = 0;       ///< how far it begins beside the middle of a sphere
};

/// One of the 2^3 of a cell around 0.
glm::dvec3 gauss_point(int i) {
    return gauss * (2.0 * glm::dvec3(i & 1, i >> 1 & 1, i >> 2) - 1.0);
}

/// From the square [0, 1]^2 to the unit disc, equal areas to equal ones (Shirley and Chiu 1997).
glm::dvec2 on_disc(glm::dvec2 at) {
    const glm::dvec2 square = 2.0 * at - 1.0, size = glm::abs(square);
    if (std::max(size.x, size.y) == 0)
        return square;
    const bool wide = size.x > size.y;
    const double radius = wide ? square.x : square.y;
    const double turn =
        glm::quarter_pi<double>() * (wide ? square.y / square.x : square.x / square.y);
    const double angle = wide ? turn : glm::half_pi<double>() - turn;
    return radius * glm::dvec2(std::cos(angle), std::sin(angle));
}

/// Of the cap of directions whose cosine to its axis is at least 1 - `height`, the mean of each
/// band's coefficients over those of the axis.
std::array<double, 5> cap_shares(double height) {
    std::array<double, 5> shares{1, 1, 1, 1, 1};
    const double x = 1 - height;
    double legendre[6] = {1, x};
    for (int l = 1; l < 5; ++l) {
        legendre[l + 1] = ((2 * l + 1) * x * legendre[l] - l * legendre[l - 1]) / (l + 1);
        shares[std::size_t(l)] = height < 1e-7
                                     ? 1 - 0.25 * l * (l + 1) * height
                                     : (legendre[l - 1] - legendre[l + 1]) / ((2 * l + 1) * height);
    }
    return shares;
}

/// Solid angle of a rectangle of the plane at distance 1, from its corner below the axis on.
double solid_angle_to(double x, double y) {
    return std::atan2(x * y, std::sqrt(x * x + y * y + 1));
}

void add(uint64_t& sum, uint64_t more) {
    std::atomic_ref(sum).fetch_add(more, std::memory_order_relaxed);
}

/// Sums over the cells of a grid, a beam at a time.
class Beams {
public:
    Beams(const Light& light, const visibility::Visibility& visibility, const scene::Frame& frame,
          std::span<const std::vector<glm::vec3>> walls, const BeamSettings& settings)
        : light_(light),
          visibility_(visibility),
          unit_(frame.unit),
          size_(frame.extent),
          walls_(walls),
          settings_(settings),
          frame_(frame),
          at_(light.type == LightType::directional ? glm::dvec3(0)
                                                   : frame.from_world(light.position)),
          radius_(radius_of(light, settings.lamp_radii) / frame.unit) {
        grid_.dims = glm::ivec3(glm::round(frame.extent));
        parallel_ = light.type == LightType::directional;
        shaped_ = light.type == LightType::spot || light.range > 0;
        if (light.type == LightType::spot)
            cone_ = scene::Cone(light);
        channels_ = visibility.is_tinted() || settings.medium ? 3 : 1;
        if (settings.medium) {
            const Medium& air = *settings.medium;
            const glm::dvec3 lost = air.extinction();
            peak_ = air.peak();
            is_grey_ = lost.x == lost.y && lost.y == lost.z;
            is_even_ = air.is_even();
            air_lo_ = frame.from_world(air.box.lo);
            air_hi_ = frame.from_world(air.box.hi);
        }
        lit_.resize(channels_ * grid_.size());
        dark_.resize(channels_ * grid_.size());
        if (shaped_)
            shaped_sums_.resize(channels_ * grid_.size());
        if (!parallel_)
            find_near();
        find_walled();
    }

    DirectLight light() {
        if (parallel_)
            send_parallel();
        else
            send_from_point();
        return result();
    }

private:
    // ------------------------------------------------------------ which beams

    /// Where a line is in the grid.
    std::optional<glm::dvec2> through(glm::dvec3 origin, glm::dvec3 direction) const {
        return within(origin, direction, glm::dvec3(0), size_, -HUGE_VAL, HUGE_VAL);
    }

    /// A lattice across the light, of a spacing that does not depend on its direction.
    void send_parallel() {
        const glm::dvec3 direction = glm::normalize(light_.direction), middle = 0.5 * size_;
        const auto [u, v] = visibility::tangents_of(direction);
        glm::dvec3 half(0.0); // of the box along u, v and the light
        double before = HUGE_VAL;
        for (int i = 0; i < 8; ++i) {
            const glm::dvec3 corner = glm::dvec3(i & 1, i >> 1 & 1, i >> 2) * size_ - middle;
            half = glm::max(half, glm::dvec3(glm::dot(corner, u), glm::dot(corner, v),
                                             glm::dot(corner, direction)));
            const glm::dvec3 lo(visibility_.lo()), hi(visibility_.hi());
            before = std::min(
                before, glm::dot(glm::mix(lo, hi, glm::dvec3(i & 1, i >> 1 & 1, i >> 2)) - middle,
                                 direction));
        }
        const double from = std::min(before, -half.z) - 1.0;
        const int k = settings_.per_cell;
        const double disc = std::tan(0.5 * settings_.sun_angle);
        const glm::ivec2 count(glm::ceil(2.0 * double(k) * glm::dvec2(half)));
        tbb::parallel_for(0, count.y, [&, u = u, v = v](int j) {
            std::vector<Beam> beams;
            for (int i = 0; i < count.x; ++i) {
                const glm::dvec2 at =
                    (glm::dvec2(i, j) + 0.5 - 0.5 * glm::dvec2(count)) / double(k);
                const glm::dvec2 aside = disc * place_on_disc(i, j);
                Beam beam;
                beam.origin = middle + at.x * u + at.y * v;
                beam.direction = glm::normalize(direction + aside.x * u + aside.y * v);
                beam.traced_from = from;
                if (const auto in = through(beam.origin, beam.direction)) {
                    beam.begin = in->x;
                    beam.end = in->y;
                    beams.push_back(beam);
                }
            }
            send(beams);
        });
    }

    /// A place on the unit disc. Beams and their places together are a lattice in four dimensions,
    /// by the roots of x^5 = x + 1 (Roberts 2018): those of neighbours are spread over the disc.
    glm::dvec2 place_on_disc(int i, int j) const {
        if (settings_.sun_angle == 0 && radius_ == 0)
            return glm::dvec2(0);
        const glm::dvec2 lattice(0.8566748838545029 * i + 0.7338918566271259 * j,
                                 0.6287067210378087 * i + 0.5385972572236101 * j);
        return on_disc(glm::fract(lattice));
    }

    /// A square of a face of the cube around a light, in tangents.
    struct Tile {
        int face;
        glm::dvec2 lo;
        double edge;
        int texels = 0; ///< along the edge
    };

    glm::dvec3 towards(int face, glm::dvec2 at) const {
        glm::dvec3 way;
        way[face / 2] = face % 2 ? -1 : 1;
        way[(face / 2 + 1) % 3] = at.x;
        way[(face / 2 + 2) % 3] = at.y;
        return way;
    }

    /// Parts a tile until it has few texels, which are as small as asked where they leave the grid.
    void part(Tile tile, std::vector<Tile>& tiles) const {
        const glm::dvec3 centre = 0.5 * size_ - at_;
        const double distance = glm::length(centre), radius = 0.5 * glm::length(size_) + radius_;
        const glm::dvec3 axis = glm::normalize(towards(tile.face, tile.lo + 0.5 * tile.edge));
        double cosine = 1, depth = 0;
        for (int i = 0; i < 5; ++i) {
            const glm::dvec2 at =
                tile.lo + tile.edge * (i == 4 ? glm::dvec2(0.5) : glm::dvec2(i & 1, i >> 1));
            const glm::dvec3 way = towards(tile.face, at);
            cosine = std::min(cosine, glm::dot(axis, glm::normalize(way)));
            if (const auto in = through(at_, way))
                depth = std::max(depth, in->y);
        }
        const double wide = std::acos(cosine);
        if (distance > radius
            && std::acos(std::clamp(glm::dot(axis, centre) / distance, -1.0, 1.0))
                   > wide + std::asin(radius / distance))
            return;
        depth = depth == 0 ? distance + radius : depth + radius_;
        if (light_.type == LightType::spot)
            depth = std::min(depth, reach_beside(axis, wide));
        const double texels = std::ceil(settings_.per_cell * tile.edge * depth);
        if (texels > most_texels && tile.edge > 1e-6) {
            for (int i = 0; i < 4; ++i)
                part({tile.face, tile.lo + 0.5 * tile.edge * glm::dvec2(i & 1, i >> 1),
                      0.5 * tile.edge},
                     tiles);
            return;
        }
        tile.texels = std::max(1, int(std::min<double>(texels, most_texels)));
        tiles.push_back(tile);
    }

    /// How far beams go beside a spot's cone: as far as readers take cells of its rim, and where
    /// other parts of a sphere send light.
    double reach_beside(glm::dvec3 direction, double wide) const {
        const double beside =
            std::acos(std::clamp(glm::dot(direction, cone_.axis), -1.0, 1.0)) - wide - cone_.outer;
        return beside > 0
                   ? (near + 2 * radius_) / std::sin(std::min(beside, glm::half_pi<double>()))
                   : HUGE_VAL;
    }

    void send_from_point() {
        std::vector<Tile> tiles;
        for (int face = 0; face < 6; ++face)
            for (int i = 0; i < 16; ++i)
                part({face, 0.5 * glm::dvec2(i % 4, i / 4) - 1.0, 0.5}, tiles);
        tbb::parallel_for(std::size_t(0), tiles.size(), [&](std::size_t i) {
            const Tile& tile = tiles[i];
            const double edge = tile.edge / tile.texels;
            const glm::ivec2 first =
                tile.texels * glm::ivec2(glm::round((tile.lo + 1.0) / tile.edge));
            std::vector<Beam> beams;
            for (int y = 0; y < tile.texels; ++y)
                for (int x = 0; x < tile.texels; ++x)
                    if (const auto beam = from_point(tile.face, tile.lo + edge * glm::dvec2(x, y),
                                                     edge, place_on_disc(first.x + x, first.y + y)))
                        beams.push_back(*beam);
            send(beams);
        });
    }

    /// Through the texel that begins at `lo`. What a sphere that is equally bright all over sends
    /// along one direction comes from a disc across it, evenly, at `place` of the unit disc.
    std::optional<Beam> from_point(int face, glm::dvec2 lo, double edge, glm::dvec2 place) const {
        const glm::dvec2 hi = lo + edge;
        Beam beam;
        beam.origin = at_;
        beam.direction = glm::normalize(towards(face, lo + 0.5 * edge));
        if (radius_ > 0) {
            const auto [u, v] = visibility::tangents_of(beam.direction);
            beam.origin += radius_ * (place.x * u + place.y * v);
            beam.aside = radius_ * glm::length(place);
        }
        const auto in = through(beam.origin, beam.direction);
        if (!in || in->y <= 0)
            return std::nullopt;
        beam.begin = std::max(0.0, in->x);
        beam.end = in->y;
        const double surface =
            std::sqrt(std::max(0.0, radius_ * radius_ - beam.aside * beam.aside));
        beam.traced_from = surface + double(visibility::same_place(glm::vec3(at_)));
        beam.weight = solid_angle_to(hi.x, hi.y) - solid_angle_to(lo.x, hi.y)
                      - solid_angle_to(hi.x, lo.y) + solid_angle_to(lo.x, lo.y);
        if (light_.range > 0)
            beam.end = std::min(beam.end, light_.range / unit_);
        if (light_.type == LightType::spot) {
            beam.intensity = cone_(beam.direction);
            beam.end = std::min(beam.end, reach_beside(beam.direction, 0.0));
        }
        if (beam.begin >= beam.end)
            return std::nullopt;
        return beam;
    }

    // ------------------------------------------------------------ what they sum

    void send(std::span<const Beam> beams) {
        std::vector<visibility::Ray> rays;
        for (const Beam& beam : beams)
            rays.push_back({glm::vec3(beam.origin + beam.traced_from * beam.direction),
                            glm::vec3(beam.direction), 0.0f,
                            float(std::max(0.0, beam.end - beam.traced_from))});
        uint64_t steps = 0;
        std::vector<visibility::Crossing> crossings;
        if (visibility_.is_veiled() || visibility_.is_tinted()) {
            for (std::size_t i = 0; i < beams.size(); ++i) {
                crossings.clear();
                visibility_.crossings(rays[i], crossings);
                close_holes(beams[i], crossings);
                steps += walk(beams[i], crossings);
            }
        } else {
            std::vector<visibility::Hit> hits(rays.size());
            visibility_.closest_of_eights(rays, visibility::Bundle::tight, hits);
            for (std::size_t i = 0; i < beams.size(); ++i) {
                crossings.clear();
                if (hits[i].instance != visibility::no_hit)
                    crossings.push_back({hits[i].t, {}, 0.0f, 0, glm::vec3(1.0f)});
                close_holes(beams[i], crossings);
                steps += walk(beams[i], crossings);
            }
        }
        add(beams_, beams.size());
        add(steps_, steps);
    }

    void close_holes(const Beam& beam, std::vector<visibility::Crossing>& crossings) const {
        if (!settings_.closed)
            return;
        const std::optional<double> reach = settings_.closed->reach(beam.origin, beam.direction);
        if (!reach)
            return;
        const auto t = float(*reach - beam.traced_from);
        std::erase_if(crossings,
                      [t](const visibility::Crossing& crossing) { return crossing.t >= t; });
        crossings.push_back({t, {}, 0.0f, 0, glm::vec3(1.0f)});
    }

    /// Through the grid, cell by cell, and in each from surface to surface.
    uint64_t walk(const Beam& beam, std::span<const visibility::Crossing> crossings) {
        glm::ivec3 cell, step;
        glm::dvec3 next, across;
        const glm::dvec3 enters = beam.origin + beam.begin * beam.direction;
        for (int axis = 0; axis < 3; ++axis) {
            const double d = beam.direction[axis];
            cell[axis] = std::clamp(int(std::floor(enters[axis])), 0, grid_.dims[axis] - 1);
            step[axis] = d < 0 ? -1 : 1;
            across[axis] = d != 0 ? std::abs(1 / d) : HUGE_VAL;
            next[axis] = d != 0 ? (cell[axis] + (d > 0 ? 1 : 0) - beam.origin[axis]) / d : HUGE_VAL;
        }
        glm::vec3 left(1.0f);
        std::size_t passed = 0;
        uint64_t steps = 0;
        AirOnWay air;
        if (settings_.medium) {
            air.through = passing(column_before(beam));
            air.part = within(beam.origin, beam.direction, air_lo_, air_hi_, beam.begin, beam.end)
                           .value_or(glm::dvec2(0.0));
        }
        for (double t = beam.begin; t < beam.end;) {
            const int axis = next.x <= next.y && next.x <= next.z ? 0 : next.y <= next.z ? 1 : 2;
            const double leaves = std::min(next[axis], beam.end);
            ++steps;
            while (t < leaves) {
                double until = leaves;
                if (passed < crossings.size())
                    until = std::clamp(beam.traced_from + double(crossings[passed].t), t, leaves);
                if (until > t)
                    add_way(beam, cell, t, until, left, air);
                t = until;
                if (t < leaves) {
                    left *= crossings[passed].transmittance * crossings[passed].tint;
                    ++passed;
                }
            }
            t = std::max(t, leaves);
            cell[axis] += step[axis];
            next[axis] += across[axis];
            if (cell[axis] < 0 || cell[axis] >= grid_.dims[axis])
                break;
        }
        return steps;
    }

    /// The medium's density over a part of a beam, metres.
    double column(const Beam& beam, double from, double to) const {
        return settings_.medium->column(frame_.to_world(beam.origin + from * beam.direction),
                                        frame_.to_world(beam.origin + to * beam.direction));
    }
    /// Before the grid: from the lamp, or from beyond all of the medium.
    double column_before(const Beam& beam) const {
        double from = 0;
        if (parallel_) {
            const glm::dvec3 lo = frame_.from_world(settings_.medium->box.lo);
            const glm::dvec3 hi = frame_.from_world(settings_.medium->box.hi);
            from = beam.begin - glm::length(hi - lo) - glm::length(0.5 * (lo + hi - size_))
                   - glm::length(size_);
        }
        return column(beam, from, beam.begin);
    }
    /// Air on a beam's way through the grid.
    struct AirOnWay {
        glm::dvec3 through{1.0}; ///< what that so far lets pass
        glm::dvec2 part{0.0};    ///< of the beam that is in the medium's box
    };
    double own_column(const Beam& beam, const AirOnWay& air, double from, double to) const {
        if (!is_even_)
            return column(beam, from, to);
        return std::max(0.0, std::min(to, air.part.y) - std::max(from, air.part.x)) * unit_;
    }
    /// What so much of the density lets through.
    glm::dvec3 passing(double density) const {
        const glm::dvec3 extinction = settings_.medium->extinction();
        if (is_grey_)
            return glm::dvec3(std::exp(-extinction.x * density));
        return glm::exp(-extinction * density);
    }
    /// What arrives on a part of a beam of its light, of which `through` comes to where it begins
    /// and `passes` of that through it, times the density over its peak: the mean along the part.
    glm::vec3 in_air(glm::dvec3 through, glm::dvec3 passes, double own, double length) const {
        glm::vec3 share;
        const glm::dvec3 extinction = settings_.medium->extinction();
        for (int c = 0; c < 3; ++c) {
            const double x = extinction[c] * own;
            const double fading = x < 1e-3 ? own * (1 - x * (1.0 / 2 - x * (1.0 / 6 - x / 24)))
                                           : (1 - passes[c]) / extinction[c];
            share[c] = float(through[c] * fading / (peak_ * length * unit_));
        }
        return share;
    }

    /// A beam's way in a cell, of which `left` arrives but for air, which is added to what is on
    /// the way.
    void add_way(const Beam& beam, glm::ivec3 at, double from, double to, glm::vec3 left,
                 AirOnWay& air) {
        const std::size_t cell = grid_.index(at);
        const double start = from;
        const glm::dvec3 before = air.through;
        glm::vec3 seen = left;
        if (settings_.medium) {
            const double own = own_column(beam, air, from, to);
            const glm::dvec3 passes = passing(own);
            seen *= in_air(before, passes, own, to - from);
            air.through *= passes;
        }
        if (const uint32_t near_cell = near_of(at); near_cell != none)
            add_near(beam, near_cell, from, to, seen);
        if (walled_[cell]) {
            if (!clip(beam, cell, from, to))
                return;
            if (settings_.medium) {
                const double own = own_column(beam, air, from, to);
                seen = left
                       * in_air(before * passing(own_column(beam, air, start, from)), passing(own),
                                own, to - from);
            }
        }
        const double way = beam.weight * (to - from) * unit;
        const auto all = uint64_t(std::llround(way));
        for (std::size_t channel = 0; channel < channels_; ++channel) {
            const double share = double(seen[int(channel)]);
            const auto lit = share == 1 ? all : uint64_t(std::llround(share * way));
            if (lit > 0)
                add(lit_[channels_ * cell + channel], lit);
            if (lit < all)
                add(dark_[channels_ * cell + channel], all - lit);
            if (shaped_ && lit > 0)
                add(shaped_sums_[channels_ * cell + channel],
                    uint64_t(std::llround(shape(beam, from, to) * share * way)));
        }
    }

    /// The share of a light's intensity that a beam has, by its cone and its range.
    double shape(const Beam& beam, double from, double to) const {
        const double along = 0.5 * (from + to);
        const double away = beam.aside > 0 ? std::hypot(along, beam.aside) : along;
        return beam.intensity * scene::range_window(light_, away * unit_);
    }

    /// Cuts off what of a way lies behind the cell's walls, which are that far off the surfaces at
    /// most.
    bool clip(const Beam& beam, std::size_t cell, double& from, double& to) const {
        const glm::dvec3 start = beam.origin - (glm::dvec3(grid_.cell_at(cell)) + 0.5);
        for (const std::vector<glm::vec3>& wall : walls_) {
            const glm::dvec3 w(wall[cell]);
            if (w == glm::dvec3(0))
                continue;
            const double most = glm::length(w) * (glm::length(w) - hair);
            const double first = most - glm::dot(start, w), along = glm::dot(beam.direction, w);
            if (along > 0)
                to = std::min(to, first / along);
            else if (along < 0)
                from = std::max(from, first / along);
            else if (first <= 0)
                return false;
        }
        return from < to;
    }

    void find_walled() {
        walled_.assign(grid_.size(), 0);
        for (const std::vector<glm::vec3>& wall : walls_)
            for (std::size_t cell = 0; cell < wall.size(); ++cell) {
                const float square = glm::dot(wall[cell], wall[cell]);
                walled_[cell] |= square > 0.0f && square < 0.75f; // half a cell's diagonal
            }
    }

    // ------------------------------------------------------------ beside the light

    static constexpr uint32_t none = ~0u;
    static constexpr int near_edge = 6; ///< cells of the block around a light

    void find_near() {
        first_near_ = glm::ivec3(glm::clamp(glm::floor(at_), -1e9, 1e9)) - near_edge / 2 + 1;
        const glm::ivec3 last = first_near_ + near_edge;
        if (glm::all(glm::lessThan(first_near_, grid_.dims))
            && glm::all(glm::greaterThan(last, glm::ivec3(0))))
            near_sums_.resize(std::size_t(near_edge * near_edge * near_edge) * channels_
                              * std::size_t(volume::sh_count(settings_.order)));
    }

    uint32_t near_of(glm::ivec3 cell) const {
        if (near_sums_.empty())
            return none;
        const glm::ivec3 c = cell - first_near_;
        for (int axis = 0; axis < 3; ++axis)
            if (c[axis] < 0 || c[axis] >= near_edge)
                return none;
        return uint32_t(c.x + near_edge * (c.y + near_edge * c.z));
    }

    void add_near(const Beam& beam, uint32_t cell, double from, double to, glm::vec3 left) {
        const volume::ShValues y = volume::sh_basis(settings_.order, glm::vec3(-beam.direction));
        const auto count = std::size_t(volume::sh_count(settings_.order));
        const double way = beam.weight * (to - from) * shape(beam, from, to) * unit;
        for (std::size_t channel = 0; channel < channels_; ++channel)
            for (std::size_t k = 0; k < count; ++k)
                add(near_sums_[(channels_ * cell + channel) * count + k],
                    uint64_t(std::llround(double(left[int(channel)]) * way * double(y[k]))));
    }

    // ------------------------------------------------------------ the result

    /// What would arrive if nothing stood in the way, for a light of 1 lx or cd, by coefficient.
    void free_light(glm::ivec3 cell, std::span<double> out) const {
        std::ranges::fill(out, 0.0);
        const glm::dvec3 centre = glm::dvec3(cell) + 0.5;
        if (radius_ > 0) {
            sphere_light(centre, out);
            return;
        }
        for (int i = 0; i < 8; ++i) {
            const glm::dvec3 way = at_ - centre - gauss_point(i);
            const double square = glm::dot(way, way);
            const volume::ShValues y =
                volume::sh_basis(settings_.order, glm::vec3(way / std::sqrt(square)));
            for (std::size_t k = 0; k < out.size(); ++k)
                out[k] += double(y[k]) / (8 * square * unit_ * unit_);
        }
    }

    /// The same of a sphere, and inside of it as on its surface, in a cell around `centre`; where
    /// light changes steeply, in parts of the cell.
    void sphere_light(glm::dvec3 centre, std::span<double> out) const {
        const double away = glm::length(at_ - centre);
        const int parts = away < near || std::abs(away - radius_) < 1 ? 4 : 1;
        const double luminance = 1 / (glm::pi<double>() * radius_ * radius_ * unit_ * unit_);
        for (int part = 0; part < parts * parts * parts; ++part)
            for (int i = 0; i < 8; ++i) {
                const glm::ivec3 place(part % parts, part / parts % parts, part / parts / parts);
                const glm::dvec3 way =
                    at_ - centre
                    - ((glm::dvec3(place) + 0.5 + gauss_point(i)) / double(parts) - 0.5);
                const double square = glm::dot(way, way);
                const double sine = std::min(1.0, radius_ * radius_ / square); // squared
                const double height = sine / (1 + std::sqrt(1 - sine));        // of its cap
                const std::array<double, 5> shares = cap_shares(height);
                const double light =
                    2 * glm::pi<double>() * height * luminance / (8 * parts * parts * parts);
                const volume::ShValues y =
                    volume::sh_basis(settings_.order, glm::vec3(way / std::sqrt(square)));
                for (std::size_t l = 0, k = 0; k < out.size(); ++l)
                    for (std::size_t m = 0; m <= 2 * l; ++m, ++k)
                        out[k] += light * shares[l] * double(y[k]);
            }
    }

    /// A disc's part in each coefficient, for a light of 1 lx.
    void sun_light(std::span<double> out) const {
        const volume::ShValues y =
            volume::sh_basis(settings_.order, glm::vec3(-glm::normalize(light_.direction)));
        const std::array<double, 5> shares = cap_shares(1 - std::cos(0.5 * settings_.sun_angle));
        for (std::size_t l = 0, k = 0; k < out.size(); ++l)
            for (std::size_t m = 0; m <= 2 * l; ++m, ++k)
                out[k] = shares[l] * double(y[k]);
    }

    DirectLight result() {
        const auto count = std::size_t(volume::sh_count(settings_.order));
        DirectLight made;
        made.beams = beams_;
        made.steps = steps_;
        made.visibility.resize(grid_.size());
        made.reached.resize(grid_.size());
        made.sh.assign(count, std::vector<glm::vec3>(grid_.size(), glm::vec3(0.0f)));
        std::vector<double> sun(count);
        if (parallel_)
            sun_light(sun);
        tbb::parallel_for(std::size_t(0), grid_.size(), [&](std::size_t cell) {
            glm::dvec3 seen, arrives;
            for (std::size_t i = 0; i < 3; ++i) {
                const std::size_t at = channels_ * cell + (channels_ == 3 ? i : 0);
                const double lit = double(lit_[at]), all = lit + double(dark_[at]);
                made.reached[cell] |= all > 0;
                seen[int(i)] = all > 0 ? lit / all : 0;
                arrives[int(i)] = !shaped_  ? seen[int(i)]
                                  : all > 0 ? double(shaped_sums_[at]) / all
                                            : 0;
            }
            made.visibility[cell] =
                channels_ == 1 ? float(seen.x) : float(glm::dot(colour::rec709_luminance, seen));
            if (arrives == glm::dvec3(0))
                return;
            std::vector<double> free(sun);
            const glm::ivec3 place = grid_.cell_at(cell);
            const glm::dvec3 power = light_.intensity * glm::dvec3(light_.color);
            if (!parallel_ && radius_ < 0.5 && glm::length(glm::dvec3(place) + 0.5 - at_) < near) {
                near_light(near_of(place), power, cell, made);
                return;
            }
            if (!parallel_)
                free_light(place, free);
            for (std::size_t k = 0; k < count; ++k)
                made.sh[k][cell] = glm::vec3(free[k] * power * arrives);
        });
        return made;
    }

    void near_light(uint32_t near_cell, glm::dvec3 power, std::size_t cell,
                    DirectLight& made) const {
        const std::size_t count = made.sh.size();
        for (std::size_t k = 0; k < count; ++k)
            for (std::size_t i = 0; i < 3; ++i) {
                const std::size_t channel = channels_ == 3 ? i : 0;
                const auto sum =
                    double(int64_t(near_sums_[(channels_ * near_cell + channel) * count + k]));
                made.sh[k][cell][int(i)] = float(power[int(i)] * sum / (unit * unit_ * unit_));
            }
    }

    const Light& light_;
    const visibility::Visibility& visibility_;
    double unit_; ///< metres
    glm::dvec3 size_;
    std::span<const std::vector<glm::vec3>> walls_;
    BeamSettings settings_;
    scene::Frame frame_;
    double peak_ = 0;                      ///< of the medium's density
    bool is_grey_ = false;                 ///< it takes as much of all channels
    bool is_even_ = false;                 ///< its density is 1 in all of its box
    glm::dvec3 air_lo_{0.0}, air_hi_{0.0}; ///< its box, frame units
    glm::dvec3 at_;                        ///< of a light that has a place
    double radius_;                        ///< of a sphere, frame units
    Grid grid_;
    bool parallel_ = false, shaped_ = false;
    scene::Cone cone_;
    std::size_t channels_ = 1;
    std::vector<uint64_t> lit_, dark_;  ///< [channels_ * cell + channel]
    std::vector<uint64_t> shaped_sums_; ///< what is lit, times shape()
    std::vector<uint8_t> walled_;
    glm::ivec3 first_near_{0};
    std::vector<uint64_t> near_sums_; ///< [(channels_ * cell + channel) * coefficients + k], signed
    uint64_t beams_ = 0, steps_ = 0;
};

} // namespace

DirectLight direct_light(const Light& light, const visibility::Visibility& visibility,
                         const scene::Frame& frame, std::span<const std::vector<glm::vec3>> walls,
                         const BeamSettings& settings) {
    return Beams(light, visibility, frame, walls, settings).light();
}

std::vector<float> shaft_share(const Light& light, const visibility::Visibility& visibility,
                               const scene::Frame& frame,
                               std::span<const std::vector<glm::vec3>> walls, int per_cell,
                               double closing, std::vector<float> open) {
    BeamSettings settings;
    settings.per_cell = per_cell;
    settings.order = 0;
    if (open.empty())
        open = direct_light(light, visibility, frame, walls, settings).visibility;
    const ClosedMap map(light, visibility, frame, per_cell, closing);
    settings.closed = &map;
    const DirectLight closed = direct_light(light, visibility, frame, walls, settings);
    for (std::size_t cell = 0; cell < open.size(); ++cell)
        open[cell] = std::max(0.0f, open[cell] - closed.visibility[cell]);
    return open;
}

namespace {

/// The share of a light that arrives at a point from one end of a way or, of a source that is a
/// disc of this radius across its end, from places all over it; frame units.
glm::vec3 share_of(const visibility::Visibility& visibility, glm::vec3 point, glm::dvec3 way,
                   double radius, double end) {
    if (radius == 0)
        return visibility.filter({point, glm::vec3(way), 0.0f, float(end)});
    constexpr int places = 64;
    constexpr double golden_angle = 2.399963229728653;
    const auto [u, v] = visibility::tangents_of(glm::normalize(way));
    glm::vec3 sum(0.0f);
    for (int i = 0; i < places; ++i) {
        const double out = radius * std::sqrt((i + 0.5) / places), turn = golden_angle * i; // Vogel
        const glm::dvec2 at = out * glm::dvec2(std::cos(turn), std::sin(turn));
        sum += visibility.filter({point, glm::vec3(way + at.x * u + at.y * v), 0.0f, float(end)});
    }
    return sum / float(places);
}

} // namespace

glm::vec3 static_illuminance(std::span<const Light> lights,
                             const visibility::Visibility& visibility, const scene::Frame& frame,
                             glm::vec3 point, glm::vec3 n, const BeamSettings& settings) {
    glm::dvec3 sum(0.0);
    for (const Light& light : lights) {
        if (!light.is_static)
            continue;
        glm::dvec3 way = -light.direction;
        double share = light.intensity, end = HUGE_VAL;
        double radius = std::tan(0.5 * settings.sun_angle);
        if (light.type != LightType::directional) {
            const glm::dvec3 at = frame.from_world(light.position);
            way = at - glm::dvec3(point);
            radius = radius_of(light, settings.lamp_radii) / frame.unit;
            const double length = glm::length(way), away = std::max(length, radius);
            const double metres = away * frame.unit;
            if (!(length > 0))
                continue;
            end = std::max(0.0,
                           1 - (radius + double(visibility::same_place(glm::vec3(at)))) / length);
            share *= scene::range_window(light, metres) / (metres * metres);
            if (light.type == LightType::spot)
                share *= scene::Cone(light)(-way / length);
        }
        share *= glm::dot(glm::dvec3(n), glm::normalize(way));
        if (share > 0)
            sum += share * glm::dvec3(light.color)
                   * glm::dvec3(share_of(visibility, point, way, radius, end));
    }
    return glm::vec3(sum);
}

} // namespace lpvbake::medium
