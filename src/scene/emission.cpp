#include "scene/emission.h"

#include "colour/colour.h"
#include "scene/material.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <span>

namespace lpvbake::scene {
namespace {

/// Cells of a texture that a piece may cover along an axis before blocks of them stand for them.
constexpr double most_cells = 8.0;

using Level = EmissionMaps::Level;

glm::vec3 texel(const Image& image, int x, int y) {
    const uint8_t* p = &image.rgba[4 * (size_t(y) * size_t(image.width) + size_t(x))];
    const std::array<float, 256>& linear = colour::linear_values();
    return {linear[p[0]], linear[p[1]], linear[p[2]]};
}

/// A stretch of an axis of a texture, in texels, that is not wrapped; what lies on it are the
/// texels from `first` up to `last`, or, bilinearly, between the middles of these two.
struct Stretch {
    double lo, hi;
    int first, last;
    bool turned = false; ///< the texels run from hi to lo
};

/// Of texel `i` of an axis that goes on beyond the texture.
int wrapped(int64_t i, int size, Wrap wrap) {
    if (wrap == Wrap::clamp_to_edge)
        return int(std::clamp<int64_t>(i, 0, size - 1));
    const int64_t period = wrap == Wrap::repeat ? size : 2 * int64_t(size);
    const int64_t in = ((i % period) + period) % period;
    return int(in < size ? in : period - 1 - in);
}

/// A luminance, and the square of its largest channel.
template <class Number>
glm::vec<4, Number> with_square(glm::vec<3, Number> value) {
    const Number most = std::max({value.x, value.y, value.z});
    return {value, most * most};
}

/// Mean of a texture over one texel's square: between the middles of texels it is bilinear, so that
/// the neighbours have an eighth along each axis.
glm::vec3 mean_over_texel(const Texture& texture, const Image& image, int x, int y) {
    if (texture.nearest)
        return texel(image, x, y);
    static constexpr float share[] = {0.125f, 0.75f, 0.125f};
    glm::vec3 sum{0.0f};
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
            sum += share[i + 1] * share[j + 1]
                   * texel(image, wrapped(x + i, image.width, texture.wrap_u),
                           wrapped(y + j, image.height, texture.wrap_v));
    return sum;
}

/// The same, and its square, of all texels of a row.
std::vector<glm::vec4> row_of(const Texture& texture, const Image& image, int y) {
    std::vector<glm::vec4> row(size_t(image.width));
    if (texture.nearest) {
        for (int x = 0; x < image.width; ++x)
            row[size_t(x)] = with_square(texel(image, x, y));
        return row;
    }
    // Down first, then along.
    const int above = wrapped(y - 1, image.height, texture.wrap_v);
    const int below = wrapped(y + 1, image.height, texture.wrap_v);
    std::vector<glm::vec3> down(row.size());
    for (int x = 0; x < image.width; ++x)
        down[size_t(x)] =
            0.125f * (texel(image, x, above) + texel(image, x, below)) + 0.75f * texel(image, x, y);
    for (int x = 0; x < image.width; ++x) {
        const bool inner = x > 0 && x + 1 < image.width;
        const int left = inner ? x - 1 : wrapped(x - 1, image.width, texture.wrap_u);
        const int right = inner ? x + 1 : wrapped(x + 1, image.width, texture.wrap_u);
        row[size_t(x)] = with_square(0.125f * (down[size_t(left)] + down[size_t(right)])
                                     + 0.75f * down[size_t(x)]);
    }
    return row;
}

std::vector<Level> levels_of(const Texture& texture, const Image& image) {
    std::vector<Level> levels;
    glm::ivec2 below(image.width, image.height); // blocks; level 0 stays in the image
    while (below.x > 1 || below.y > 1) {
        Level level{(below.x + 1) / 2, (below.y + 1) / 2, {}};
        level.blocks.resize(size_t(level.width) * size_t(level.height));
        const int size = 1 << levels.size(); // of blocks below, in texels
        const auto extent = [&](int i, int whole) {
            return std::min((i + 1) * size, whole) - i * size;
        };
        tbb::parallel_for(0, level.height, [&](int y) {
            const std::span<glm::vec4> result =
                std::span(level.blocks)
                    .subspan(size_t(y) * size_t(level.width), size_t(level.width));
            float height = 0.0f;
            for (int row = 2 * y; row < std::min(2 * y + 2, below.y); ++row) {
                std::vector<glm::vec4> texels;
                if (levels.empty())
                    texels = row_of(texture, image, row);
                const std::span<const glm::vec4> of_row =
                    levels.empty() ? std::span<const glm::vec4>(texels)
                                   : std::span(levels.back().blocks)
                                         .subspan(size_t(row) * size_t(below.x), size_t(below.x));
                const float share = float(extent(row, image.height));
                height += share;
                for (int x = 0; x < below.x; ++x)
                    result[size_t(x / 2)] +=
                        share * float(extent(x, image.width)) * of_row[size_t(x)];
            }
            for (int x = 0; x < level.width; ++x)
                result[size_t(x)] /=
                    height * float(std::min((x + 1) * 2 * size, image.width) - x * 2 * size);
        });
        levels.push_back(std::move(level));
        below = {levels.back().width, levels.back().height};
    }
    return levels;
}

/// Between the middles of neighbouring texels, from lo to hi.
std::vector<Stretch> between_middles(double lo, double hi, int size, Wrap wrap) {
    std::vector<Stretch> stretches;
    if (wrap == Wrap::clamp_to_edge) {
        lo = std::clamp(lo, 0.0, double(size));
        hi = std::clamp(hi, 0.0, double(size));
    }
    for (int64_t i = int64_t(std::floor(lo - 0.5)); double(i) + 0.5 <= hi; ++i)
        stretches.push_back(
            {double(i) + 0.5, double(i) + 1.5, wrapped(i, size, wrap), wrapped(i + 1, size, wrap)});
    if (wrap == Wrap::clamp_to_edge)
        for (Stretch& s : stretches) { // beyond the outermost middles nothing changes
            s.lo = s.lo < 0.5 ? -HUGE_VAL : s.lo;
            s.hi = s.hi > double(size) - 0.5 ? HUGE_VAL : s.hi;
        }
    return stretches;
}

/// Blocks of 2^level texels, from lo to hi; all as one where they would be too many.
std::vector<Stretch> blocks_of(double lo, double hi, int size, Wrap wrap, int level) {
    std::vector<Stretch> stretches;
    const int length = 1 << level, count = (size + length - 1) / length;
    const auto add_texture = [&](double at, bool turned) {
        for (int k = 0; k < count; ++k) {
            const int i = turned ? count - 1 - k : k;
            const int first = i * length, last = std::min(first + length, size);
            const double from = at + (turned ? size - last : first);
            if (from < hi && from + (last - first) > lo)
                stretches.push_back({from, from + (last - first), first, last, turned});
        }
    };
    if (wrap == Wrap::clamp_to_edge) {
        if (lo < 0.0)
            stretches.push_back({-HUGE_VAL, 0.0, 0, 1});
        add_texture(0.0, false);
        if (hi > size)
            stretches.push_back({double(size), HUGE_VAL, size - 1, size});
        return stretches;
    }
    const double first_texture = std::floor(lo / size), last_texture = std::floor(hi / size);
    if (last_texture - first_texture > 2.0 * most_cells)
        return {{lo, hi, 0, size}};
    for (double t = first_texture; t <= last_texture; ++t)
        add_texture(t * size, wrap == Wrap::mirrored_repeat && std::fmod(t, 2.0) != 0.0);
    return stretches;
}

/// A convex polygon of few corners.
struct Polygon {
    std::array<glm::dvec2, 12> corners;
    size_t count = 0;

    void add(glm::dvec2 corner) {
        if (count < corners.size()) // else rounding made it look concave
            corners[count++] = corner;
    }
};

double area_of(const Polygon& polygon) {
    double twice = 0.0;
    for (size_t i = 1; i + 1 < polygon.count; ++i) {
        const glm::dvec2 a = polygon.corners[i] - polygon.corners[0];
        const glm::dvec2 b = polygon.corners[i + 1] - polygon.corners[0];
        twice += std::abs(a.x * b.y - a.y * b.x);
    }
    return 0.5 * twice;
}

/// What of it lies on the side where sign * (p[axis] - at) >= 0 (Sutherland and Hodgman 1974).
Polygon clipped(const Polygon& polygon, int axis, double at, double sign) {
    Polygon result;
    for (size_t i = 0; i < polygon.count; ++i) {
        const glm::dvec2 a = polygon.corners[i], b = polygon.corners[(i + 1) % polygon.count];
        const double da = sign * (a[axis] - at), db = sign * (b[axis] - at);
        if (da >= 0.0)
            result.add(a);
        if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0))
            result.add(a + (b - a) * (da / (da - db)));
    }
    return result;
}

Polygon clipped(const Polygon& polygon, int axis, const Stretch& stretch) {
    const Polygon above =
        std::isfinite(stretch.lo) ? clipped(polygon, axis, stretch.lo, 1.0) : polygon;
    return std::isfinite(stretch.hi) ? clipped(above, axis, stretch.hi, -1.0) : above;
}

/// Sums up luminance times area, and its moments.
class Moments {
public:
    explicit Moments(glm::dvec3 factor) : factor_(factor) {}
    /// `share` of the factor is the luminance; the last is the mean square of its largest channel.
    void add(double area, glm::dvec2 weights, glm::dvec4 share) {
        const glm::dvec3 luminance = factor_ * glm::dvec3(share);
        const double most = std::max({luminance.x, luminance.y, luminance.z});
        const double light = area * most;
        if (const double of_share = std::max({share.x, share.y, share.z}); of_share > 0.0)
            light_squares_ += area * share.w * (most / of_share) * (most / of_share);
        area_ += area;
        sum_ += area * luminance;
        light_ += light;
        first_ += light * weights;
        squares_ +=
            light * glm::dvec3(weights.x * weights.x, weights.y * weights.y, weights.x * weights.y);
    }
    PieceEmission of_piece() const {
        if (!(light_ > 0.0))
            return {};
        return {sum_ / area_, first_ / light_, squares_ / light_,
                float(std::min(1.0, light_ * light_ / (area_ * light_squares_)))};
    }

private:
    glm::dvec3 factor_;
    double area_ = 0.0, light_ = 0.0, light_squares_ = 0.0;
    glm::dvec3 sum_{0.0}, squares_{0.0};
    glm::dvec2 first_{0.0};
};

/// A piece in a texture, in texels.
class Footprint {
public:
    explicit Footprint(const std::array<glm::dvec2, 3>& corners)
        : lo(glm::min(corners[0], glm::min(corners[1], corners[2]))),
          hi(glm::max(corners[0], glm::max(corners[1], corners[2]))),
          origin_(corners[0]),
          u_(corners[1] - corners[0]),
          v_(corners[2] - corners[0]),
          twice_area_(u_.x * v_.y - u_.y * v_.x) {
        for (const glm::dvec2& corner : corners)
            polygon.add(corner);
    }
    /// Whether it covers an area by which texels can be told apart.
    bool is_flat() const {
        const double longest = std::max({glm::length(u_), glm::length(v_), glm::length(v_ - u_)});
        return !(std::abs(twice_area_) > 1e-6 * longest * std::max(longest, 1e-3));
    }
    glm::dvec2 weights(glm::dvec2 p) const {
        const glm::dvec2 w = p - origin_;
        return glm::dvec2(w.x * v_.y - w.y * v_.x, u_.x * w.y - u_.y * w.x) / twice_area_;
    }
    /// light(p): luminance at a texel place, of degree 2 at most over the polygon.
    template <class Light>
    void integrate(const Polygon& part, const Light& light, Moments& moments) const {
        for (size_t i = 1; i + 1 < part.count; ++i) {
            const glm::dvec2 a = part.corners[0], b = part.corners[i], c = part.corners[i + 1];
            const glm::dvec2 ab = b - a, ac = c - a;
            const double third = std::abs(ab.x * ac.y - ab.y * ac.x) / 6.0;
            for (const glm::dvec2 p : {0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)})
                moments.add(third, weights(p), light(p));
        }
    }

    Polygon polygon;
    glm::dvec2 lo, hi;

private:
    glm::dvec2 origin_, u_, v_;
    double twice_area_;
};

/// Cells of one texel that the footprint covers along an axis.
double cells_along(double lo, double hi, int size, Wrap wrap) {
    if (wrap == Wrap::clamp_to_edge)
        return std::clamp(hi, 0.0, double(size)) - std::clamp(lo, 0.0, double(size));
    return hi - lo;
}

/// Mean of the texels from `x.first` to x.last and y.first to y.last, which are whole blocks of the
/// level or the outermost texels.
glm::vec4 mean_of(const Texture& texture, const Image& image, const std::vector<Level>& levels,
                  int level, const Stretch& x, const Stretch& y) {
    const int length = 1 << level;
    const auto whole = [&](const Stretch& s, int size) {
        return s.first % length == 0 && (s.last % length == 0 || s.last == size);
    };
    if (level > 0 && !(whole(x, image.width) && whole(y, image.height)))
        return mean_of(texture, image, levels, level - 1, x, y);
    glm::vec4 sum{0.0f};
    float texels = 0.0f;
    for (int row = y.first >> level; (row << level) < y.last; ++row)
        for (int column = x.first >> level; (column << level) < x.last; ++column) {
            const float area = float(std::min((row + 1) << level, y.last) - (row << level))
                               * float(std::min((column + 1) << level, x.last) - (column << level));
            const glm::vec4 value =
                level == 0 ? with_square(mean_over_texel(texture, image, column, row))
                           : levels[size_t(level - 1)]
                                 .blocks[size_t(row) * size_t(levels[size_t(level - 1)].width)
                                         + size_t(column)];
            sum += area * value;
            texels += area;
        }
    return sum / texels;
}

double greatest(glm::dvec2 v) {
    return std::max(std::abs(v.x), std::abs(v.y));
}

void add_bilinear(const Texture& texture, const Image& image, const Footprint& footprint,
                  Moments& moments) {
    const std::vector<Stretch> columns =
        between_middles(footprint.lo.x, footprint.hi.x, image.width, texture.wrap_u);
    for (const Stretch& y :
         between_middles(footprint.lo.y, footprint.hi.y, image.height, texture.wrap_v)) {
        const Polygon row = clipped(footprint.polygon, 1, y);
        if (row.count < 3)
            continue;
        for (const Stretch& x : columns) {
            const Polygon part = clipped(row, 0, x);
            if (part.count < 3)
                continue;
            const glm::dvec3 a = texel(image, x.first, y.first), b = texel(image, x.last, y.first);
            const glm::dvec3 c = texel(image, x.first, y.last), d = texel(image, x.last, y.last);
            const auto share = [](double at, const Stretch& s) {
                return s.first == s.last ? 0.0 : std::clamp(at - s.lo, 0.0, 1.0);
            };
            footprint.integrate(
                part,
                [&](glm::dvec2 p) {
                    return with_square(glm::mix(glm::mix(a, b, share(p.x, x)),
                                                glm::mix(c, d, share(p.x, x)), share(p.y, y)));
                },
                moments);
        }
    }
}

/// A block's stretch along an axis as those of its halves, one level below.
std::vector<Stretch> halves(const Stretch& block, int level) {
    const int middle = block.first + (1 << (level - 1));
    if (middle >= block.last || !std::isfinite(block.hi - block.lo)
        || block.hi - block.lo != double(block.last - block.first))
        return {block};
    const double at =
        block.turned ? block.hi - (middle - block.first) : block.lo + (middle - block.first);
    const Stretch lower{block.lo, at, block.first, middle, false};
    const Stretch upper{at, block.hi, middle, block.last, false};
    if (!block.turned)
        return {lower, upper};
    return {{block.lo, at, middle, block.last, true}, {at, block.hi, block.first, middle, true}};
}

/// Blocks of a texture, as a piece covers them.
struct Blocks {
    const Texture& texture;
    const Image& image;
    const std::vector<Level>& levels;
    const Footprint& footprint;
    int lowest; ///< level
    Moments& moments;

    /// `part` of the piece lies in it. One that the piece covers in part is seen to by its
    /// quarters, unless it glows evenly.
    void add(const Stretch& x, const Stretch& y, int level, const Polygon& part) const {
        const glm::dvec4 mean = mean_of(texture, image, levels, level, x, y);
        const double most = std::max({mean.x, mean.y, mean.z});
        const bool even = mean.w <= 1.00001 * most * most;
        const bool whole = area_of(part) >= (1.0 - 1e-9) * (x.hi - x.lo) * (y.hi - y.lo);
        if (even || whole || level <= lowest) {
            footprint.integrate(
                part, [&](glm::dvec2) { return mean; }, moments);
            return;
        }
        const std::vector<Stretch> columns = halves(x, level);
        for (const Stretch& row : halves(y, level)) {
            const Polygon in_row = clipped(part, 1, row);
            if (in_row.count < 3)
                continue;
            for (const Stretch& column : columns)
                if (const Polygon quarter = clipped(in_row, 0, column); quarter.count >= 3)
                    add(column, row, level - 1, quarter);
        }
    }
};

void add_blocks(const Texture& texture, const Image& image, const std::vector<Level>& levels,
                int level, const Footprint& footprint, Moments& moments) {
    const Blocks blocks{texture, image, levels, footprint, std::max(0, level - 5), moments};
    const std::vector<Stretch> columns =
        blocks_of(footprint.lo.x, footprint.hi.x, image.width, texture.wrap_u, level);
    for (const Stretch& y :
         blocks_of(footprint.lo.y, footprint.hi.y, image.height, texture.wrap_v, level)) {
        const Polygon row = clipped(footprint.polygon, 1, y);
        if (row.count < 3)
            continue;
        for (const Stretch& x : columns)
            if (const Polygon part = clipped(row, 0, x); part.count >= 3)
                blocks.add(x, y, level, part);
    }
}

} // namespace

Unevenness unevenness(const PieceEmission& emission, glm::vec3 edge_u, glm::vec3 edge_v) {
    const glm::vec2 c = emission.centre;
    const float uu = glm::dot(edge_u, edge_u), vv = glm::dot(edge_v, edge_v);
    const float uv = glm::dot(edge_u, edge_v);
    // A variance of weights is 1/18 over a triangle, and a covariance -1/36.
    const glm::vec3 more = emission.squares - glm::vec3(c.x * c.x, c.y * c.y, c.x * c.y)
                           - glm::vec3(1.0f / 18.0f, 1.0f / 18.0f, -1.0f / 36.0f);
    return {glm::length((c.x - 1.0f / 3.0f) * edge_u + (c.y - 1.0f / 3.0f) * edge_v),
            std::abs(more.x * uu + more.y * vv + 2.0f * more.z * uv)};
}

EmissionMaps::EmissionMaps(const Scene& scene) : scene_(scene), levels_(scene.textures.size()) {
    for (const Material& material : scene.materials)
        if (material.emission_texture >= 0 && material.emission != glm::vec3(0.0f)) {
            const size_t index = size_t(material.emission_texture);
            const Texture& texture = scene.textures[index];
            if (levels_[index].empty())
                levels_[index] = levels_of(texture, scene.images[size_t(texture.image)]);
        }
}

PieceEmission EmissionMaps::by_points(const Mesh& mesh, uint32_t triangle,
                                      const std::array<glm::vec2, 3>& corners, int steps) const {
    Moments moments{glm::dvec3(1.0)};
    const auto add = [&](glm::vec2 w) {
        const glm::vec2 at = (1.0f - w.x - w.y) * corners[0] + w.x * corners[1] + w.y * corners[2];
        moments.add(1.0, w, with_square(glm::dvec3(sample_emission(scene_, mesh, triangle, at))));
    };
    for (int i = 0; i < steps; ++i)
        for (int j = 0; i + j < steps; ++j) {
            add((glm::vec2(i, j) + 1.0f / 3.0f) / float(steps));
            if (i + j + 1 < steps)
                add((glm::vec2(i, j) + 2.0f / 3.0f) / float(steps));
        }
    return moments.of_piece();
}

PieceEmission EmissionMaps::over(const Mesh& mesh, uint32_t triangle,
                                 const std::array<glm::vec2, 3>& corners) const {
    const Material& material = scene_.materials[size_t(mesh.material)];
    const bool opaque = !is_partly_clear(material);
    if (material.emission == glm::vec3(0.0f))
        return {};
    if (material.emission_texture < 0)
        return opaque ? PieceEmission{material.emission} : by_points(mesh, triangle, corners, 4);
    const Texture& texture = scene_.textures[size_t(material.emission_texture)];
    const Image& image = scene_.images[size_t(texture.image)];
    std::array<glm::dvec2, 3> places{};
    if (const std::vector<glm::vec2>& uv = mesh.uv_emission; !uv.empty())
        for (size_t i = 0; i < 3; ++i) {
            const glm::uvec3 v = mesh.triangles[triangle];
            const glm::dvec2 w = corners[i];
            places[i] = (glm::dvec2(uv[v.x]) * (1.0 - w.x - w.y) + glm::dvec2(uv[v.y]) * w.x
                         + glm::dvec2(uv[v.z]) * w.y)
                        * glm::dvec2(image.width, image.height);
        }
    const Footprint footprint(places);
    const glm::dvec2 extent = footprint.hi - footprint.lo;
    const double most = std::max(extent.x, extent.y);
    if (!opaque || footprint.is_flat() || !(greatest(footprint.hi) < 1e9)
        || !(greatest(footprint.lo) < 1e9))
        return by_points(mesh, triangle, corners,
                         most < 1e9 ? std::clamp(int(2.0 * most), 4, 16) : 4);
    const double cells =
        std::max(cells_along(footprint.lo.x, footprint.hi.x, image.width, texture.wrap_u),
                 cells_along(footprint.lo.y, footprint.hi.y, image.height, texture.wrap_v));
    const std::vector<Level>& levels = levels_[size_t(material.emission_texture)];
    int level = 0;
    while (level < int(levels.size()) && cells > most_cells * double(1 << level))
        ++level;
    Moments moments{glm::dvec3(material.emission)};
    if (level == 0 && !texture.nearest)
        add_bilinear(texture, image, footprint, moments);
    else
        add_blocks(texture, image, levels, level, footprint, moments);
    return moments.of_piece();
}

} // namespace lpvbake::scene
