#include "medium/closed_map.h"

#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::medium {
namespace {

constexpr int face_texels = 192; ///< along an edge of a cube around a light
constexpr int tile_texels = 8;   ///< of a coarser cube, in which what is near is sought
constexpr int coarse = face_texels / tile_texels;
constexpr double widest = 0.35;   ///< radians: of the disc around a light
constexpr double ring_share = 12; ///< rings of places in a disc
constexpr float nothing = HUGE_VALF;

/// The least of each row within `reach` texels on both sides (van Herk 1992).
void least_of_rows(const std::vector<float>& in, glm::ivec2 count, int reach,
                   std::vector<float>& out) {
    const int window = 2 * reach + 1;
    tbb::parallel_for(0, count.y, [&](int y) {
        const int padded = (count.x + 2 * reach + window - 1) / window * window;
        std::vector<float> row(std::size_t(padded), nothing), back(row), forth(row);
        std::copy_n(in.begin() + std::ptrdiff_t(y) * count.x, count.x, row.begin() + reach);
        for (int x = 0; x < padded; ++x)
            forth[std::size_t(x)] = x % window == 0
                                        ? row[std::size_t(x)]
                                        : std::min(forth[std::size_t(x) - 1], row[std::size_t(x)]);
        for (int x = padded - 1; x >= 0; --x)
            back[std::size_t(x)] = x % window == window - 1
                                       ? row[std::size_t(x)]
                                       : std::min(back[std::size_t(x) + 1], row[std::size_t(x)]);
        for (int x = 0; x < count.x; ++x)
            out[std::size_t(y) * std::size_t(count.x) + std::size_t(x)] =
                std::min(back[std::size_t(x)], forth[std::size_t(x) + std::size_t(window) - 1]);
    });
}

/// The least within a disc around each texel.
std::vector<float> least_in_discs(const std::vector<float>& in, glm::ivec2 count, double radius) {
    std::vector<float> out(in.size(), nothing), rows(in.size());
    const int rings = int(radius);
    for (int aside = 0; aside <= rings; ++aside) {
        least_of_rows(in, count, int(std::sqrt(radius * radius - double(aside) * aside)), rows);
        tbb::parallel_for(0, count.y, [&](int y) {
            for (const int from : {y - aside, y + aside}) {
                if (from < 0 || from >= count.y)
                    continue;
                const auto width = std::size_t(count.x);
                for (std::size_t x = 0; x < width; ++x) {
                    float& least = out[std::size_t(y) * width + x];
                    least = std::min(least, rows[std::size_t(from) * width + x]);
                }
            }
        });
    }
    return out;
}

std::vector<float> negative(std::vector<float> values) {
    for (float& value : values)
        value = -value;
    return values;
}

/// Places of a unit disc in rings, the middle first.
std::vector<glm::dvec2> disc_places() {
    std::vector<glm::dvec2> places{glm::dvec2(0)};
    for (int ring = 1; ring <= int(ring_share); ++ring) {
        const int count = int(std::ceil(2 * glm::pi<double>() * ring));
        for (int i = 0; i < count; ++i) {
            const double turn = 2 * glm::pi<double>() * i / count;
            places.push_back(ring / ring_share * glm::dvec2(std::cos(turn), std::sin(turn)));
        }
    }
    return places;
}

/// A direction through a place of a face of the cube around a light, in tangents.
glm::dvec3 towards(int face, glm::dvec2 at) {
    glm::dvec3 way;
    way[face / 2] = face % 2 ? -1 : 1;
    way[(face / 2 + 1) % 3] = at.x;
    way[(face / 2 + 2) % 3] = at.y;
    return way;
}

glm::dvec3 on_face(std::size_t texel, int edge) {
    const auto n = std::size_t(edge);
    const glm::dvec2 at(texel % n, texel / n % n);
    return glm::normalize(towards(int(texel / (n * n)), 2.0 * (at + 0.5) / double(edge) - 1.0));
}

std::size_t tile_of(std::size_t texel) {
    const std::size_t x = texel % face_texels, y = texel / face_texels % face_texels;
    const std::size_t face = texel / (face_texels * face_texels);
    return (face * coarse + y / tile_texels) * coarse + x / tile_texels;
}

} // namespace

ClosedMap::ClosedMap(const Light& light, const visibility::Visibility& visibility,
                     const scene::Frame& frame, int per_cell, double metres)
    : parallel_(light.type == LightType::directional) {
    if (parallel_) {
        make_parallel(visibility, glm::normalize(light.direction), frame.extent, per_cell,
                      metres / frame.unit);
    } else {
        at_ = frame.from_world(light.position);
        make_around(visibility, frame.extent, metres / frame.unit);
    }
}

/// The distances at which the rays of texels meet what is opaque.
template <class RayOf>
void ClosedMap::look(const visibility::Visibility& visibility, std::size_t texels,
                     const RayOf& ray_of) {
    depths_.assign(texels, nothing);
    constexpr std::size_t some = 1024;
    const bool any_passes = visibility.is_veiled() || visibility.is_tinted();
    tbb::parallel_for(std::size_t(0), (texels + some - 1) / some, [&](std::size_t block) {
        const std::size_t first = block * some, count = std::min(some, texels - first);
        std::vector<visibility::Ray> own(count);
        for (std::size_t i = 0; i < count; ++i)
            own[i] = ray_of(first + i);
        std::vector<visibility::Hit> hits(count);
        std::vector<visibility::Crossing> crossings;
        if (!any_passes)
            visibility.closest_of_eights(own, visibility::Bundle::tight, hits);
        for (std::size_t i = 0; i < count; ++i) {
            if (!any_passes) {
                if (hits[i].instance != visibility::no_hit)
                    depths_[first + i] = hits[i].t;
                continue;
            }
            crossings.clear();
            visibility.crossings(own[i], crossings);
            const auto opaque =
                std::ranges::find_if(crossings, [](const visibility::Crossing& crossing) {
                    return crossing.transmittance * crossing.tint == glm::vec3(0.0f);
                });
            if (opaque != crossings.end())
                depths_[first + i] = opaque->t;
        }
    });
}

/// Depths with holes closed are kept where they are less, of all other texels nothing.
void ClosedMap::keep_holes(const std::vector<float>& closed) {
    for (std::size_t i = 0; i < depths_.size(); ++i)
        depths_[i] = closed[i] < depths_[i] - 1e-3f - 1e-4f * closed[i] ? closed[i] : nothing;
}

void ClosedMap::make_parallel(const visibility::Visibility& visibility, glm::dvec3 direction,
                              glm::dvec3 size, int per_cell, double radius) {
    const auto [u, v] = visibility::tangents_of(direction);
    u_ = u;
    v_ = v;
    pitch_ = 1.0 / per_cell;
    glm::dvec2 half(0.0);
    double before = HUGE_VAL, beyond = -HUGE_VAL;
    for (int i = 0; i < 8; ++i) {
        const glm::dvec3 share(i & 1, i >> 1 & 1, i >> 2), corner = (share - 0.5) * size;
        half = glm::max(half, glm::dvec2(glm::dot(corner, u), glm::dot(corner, v)));
        for (const glm::dvec3 edge :
             {corner, glm::mix(glm::dvec3(visibility.lo()), glm::dvec3(visibility.hi()), share)
                          - 0.5 * size}) {
            before = std::min(before, glm::dot(edge, direction));
            beyond = std::max(beyond, glm::dot(edge, direction));
        }
    }
    const double texels = std::min(radius, glm::length(size)) / pitch_;
    const int aside = int(std::ceil(2 * texels));
    count_ = glm::ivec2(glm::ceil(2.0 * double(per_cell) * half)) + 2 * aside;
    at_ = 0.5 * size + (before - 1) * direction;
    const auto width = std::size_t(count_.x);
    look(visibility, width * std::size_t(count_.y), [&](std::size_t i) {
        const glm::dvec2 place(i % width, i / width);
        const glm::dvec2 at = (place + 0.5 - 0.5 * glm::dvec2(count_)) * pitch_;
        return visibility::Ray{glm::vec3(at_ + at.x * u_ + at.y * v_), glm::vec3(direction), 0.0f,
                               float(beyond - before + 2)};
    });
    keep_holes(negative(
        least_in_discs(negative(least_in_discs(depths_, count_, texels)), count_, texels)));
}

std::size_t ClosedMap::texel_of(glm::dvec3 direction) {
    const glm::dvec3 size = glm::abs(direction);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const int face = 2 * axis + (direction[axis] < 0 ? 1 : 0);
    const glm::dvec2 at(direction[(axis + 1) % 3] / size[axis],
                        direction[(axis + 2) % 3] / size[axis]);
    const glm::ivec2 texel =
        glm::clamp(glm::ivec2(0.5 * (at + 1.0) * double(face_texels)), 0, face_texels - 1);
    return (std::size_t(face) * face_texels + std::size_t(texel.y)) * face_texels
           + std::size_t(texel.x);
}

void ClosedMap::make_around(const visibility::Visibility& visibility, glm::dvec3 size,
                            double radius) {
    constexpr std::size_t texels = 6 * face_texels * face_texels;
    constexpr std::size_t tiles = 6 * coarse * coarse;
    constexpr double tile = 2 * glm::root_two<double>() / coarse; // across, at most
    const double far = glm::length(size) + glm::length(at_ - 0.5 * size)
                       + glm::length(glm::dvec3(visibility.hi() - visibility.lo()));
    const double from = double(visibility::same_place(glm::vec3(at_)));
    look(visibility, texels, [&](std::size_t i) {
        const glm::dvec3 way = on_face(i, face_texels);
        return visibility::Ray{glm::vec3(at_ + from * way), glm::vec3(way), 0.0f, float(far)};
    });

    // The widest disc that counts in a tile is that of what is nearest around it.
    std::vector<float> nearest(tiles, nothing);
    for (std::size_t i = 0; i < texels; ++i)
        nearest[tile_of(i)] = std::min(nearest[tile_of(i)], depths_[i]);
    const auto disc_at = [&](double depth) { return std::min(widest, radius / depth); };
    std::vector<double> discs(tiles, 0.0);
    tbb::parallel_for(std::size_t(0), tiles, [&](std::size_t i) {
        const glm::dvec3 own = on_face(i, coarse);
        for (std::size_t j = 0; j < tiles; ++j)
            if (const double disc = disc_at(nearest[j]);
                disc > discs[i] && glm::length(own - on_face(j, coarse)) < disc + tile)
                discs[i] = disc;
    });
    const std::vector<glm::dvec2> places = disc_places();
    /// Calls see(texel, how far off) for places of a disc around a texel.
    const auto look_around = [&](std::size_t i, double disc, const auto& see) {
        const glm::dvec3 way = on_face(i, face_texels);
        const auto [u, v] = visibility::tangents_of(way);
        for (const glm::dvec2 place : places)
            see(texel_of(way + disc * (place.x * u + place.y * v)), disc * glm::length(place));
    };
    // What the grid is seen in, and discs around that.
    const glm::dvec3 middle = 0.5 * size - at_;
    const double away = glm::length(middle), ball = 0.5 * glm::length(size);
    const auto is_seen = [&](std::size_t i, double aside) {
        if (away <= ball)
            return true;
        const double cosine = glm::dot(on_face(i, face_texels), middle) / away;
        return std::acos(std::clamp(cosine, -1.0, 1.0)) < std::asin(ball / away) + aside;
    };
    std::vector<float> eroded = depths_;
    tbb::parallel_for(std::size_t(0), texels, [&](std::size_t i) {
        if (const double disc = discs[tile_of(i)]; disc > 0 && is_seen(i, widest + tile))
            look_around(i, disc, [&](std::size_t seen, double aside) {
                if (aside <= disc_at(double(depths_[seen])))
                    eroded[i] = std::min(eroded[i], depths_[seen]);
            });
    });
    std::vector<float> closed = eroded;
    tbb::parallel_for(std::size_t(0), texels, [&](std::size_t i) {
        if (eroded[i] < depths_[i] && is_seen(i, tile))
            look_around(i, disc_at(double(eroded[i])), [&](std::size_t seen, double) {
                closed[i] = std::max(closed[i], eroded[seen]);
            });
    });
    keep_holes(closed);
}

std::optional<double> ClosedMap::reach(glm::dvec3 origin, glm::dvec3 direction) const {
    float depth = nothing;
    double from = 0;
    if (parallel_) {
        const glm::dvec3 way = origin - at_;
        const glm::dvec2 at(glm::dot(way, u_), glm::dot(way, v_));
        const glm::ivec2 texel(glm::floor(at / pitch_ + 0.5 * glm::dvec2(count_)));
        if (glm::all(glm::greaterThanEqual(texel, glm::ivec2(0)))
            && glm::all(glm::lessThan(texel, count_)))
            depth = depths_[std::size_t(texel.y) * std::size_t(count_.x) + std::size_t(texel.x)];
        from = glm::dot(way, direction);
    } else {
        depth = depths_[texel_of(direction)];
    }
    if (depth == nothing)
        return std::nullopt;
    return double(depth) - from;
}

} // namespace lpvbake::medium
