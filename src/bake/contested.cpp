#include "bake/contested.h"

#include "colour/colour.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lpvbake::bake {
namespace {

constexpr std::size_t most_asked = 1 << 15; ///< points; where there are more, every so many
constexpr std::size_t most_looks = 16;      ///< from each, at its nearest rivals
constexpr double felt = 0.05; ///< of the mean irradiance: errors below it are not looked into
constexpr float lift = 0.25f; ///< cells above the surface, where a point looks for others
constexpr double alike = 0.5; ///< cosine between normals that the bands do not tell apart

double luminance(glm::dvec3 e) {
    return glm::dot(e, colour::rec709_luminance);
}

/// Points by the cell that they are looked up in.
class Places {
public:
    Places(const readers::Reader& reader, const Volume& volume,
           std::span<const readers::FitPoint> points)
        : grid_(volume.grid),
          order_(points.size()) {
        for (const readers::FitPoint& point : points)
            at.push_back(volume.grid.to_grid(point.position)
                         + reader.offset * volume.grid.to_axes(point.normal));
        std::iota(order_.begin(), order_.end(), std::size_t(0));
        std::vector<std::size_t> key;
        for (const glm::dvec3& p : at)
            key.push_back(cell_of(glm::ivec3(glm::floor(p))));
        std::ranges::stable_sort(order_, {}, [&](std::size_t i) { return key[i]; });
        first_.assign(grid_.size() + 1, 0);
        for (const std::size_t k : key)
            ++first_[k + 1];
        std::partial_sum(first_.begin(), first_.end(), first_.begin());
    }

    /// Calls each(point) for those less than a cell away along every axis, and some more.
    template <class Each>
    void around(glm::dvec3 p, const Each& each) const {
        const glm::ivec3 c(glm::floor(p));
        const glm::ivec3 lo = glm::clamp(c - 1, glm::ivec3(0), grid_.dims - 1);
        const glm::ivec3 hi = glm::clamp(c + 1, glm::ivec3(0), grid_.dims - 1);
        glm::ivec3 i;
        for (i.z = lo.z; i.z <= hi.z; ++i.z)
            for (i.y = lo.y; i.y <= hi.y; ++i.y)
                for (i.x = lo.x; i.x <= hi.x; ++i.x) {
                    const std::size_t cell = cell_of(i);
                    for (std::size_t k = first_[cell]; k < first_[cell + 1]; ++k)
                        each(order_[k]);
                }
    }

    std::vector<glm::dvec3> at; ///< where each point is looked up, cells

private:
    std::size_t cell_of(glm::ivec3 c) const {
        return grid_.index(glm::clamp(c, glm::ivec3(0), grid_.dims - 1));
    }

    const Grid& grid_;
    std::vector<std::size_t> order_, first_;
};

bool share_cells(const volume::CellWeights& a, const volume::CellWeights& b) {
    for (std::size_t i = 0; i < a.cell.size(); ++i)
        for (std::size_t k = 0; k < b.cell.size(); ++k)
            if (a.weight[i] > 0 && b.weight[k] > 0 && a.cell[i] == b.cell[k])
                return true;
    return false;
}

/// A point, and the nearest one that asks for other light of its cells.
struct Asked {
    double error = 0;       ///< shown less what arrives, luminance
    bool contested = false; ///< there is such a point
    bool along = false;     ///< it lies in one plane with it, behind something that stands there
    double distance = 0;    ///< else: between their planes, cells
};

/// Of point p, whose error is known.
void ask(const readers::Reader& reader, const Volume& volume,
         std::span<const readers::FitPoint> points, const visibility::Visibility& visibility,
         const Places& places, std::size_t p, Asked& asked) {
    const readers::FitPoint& point = points[p];
    std::vector<std::pair<double, std::size_t>> rivals; // distance, point
    places.around(places.at[p], [&](std::size_t q) {
        const glm::dvec3 way = glm::abs(places.at[q] - places.at[p]);
        const double distance = std::max({way.x, way.y, way.z});
        const double differs = luminance(points[q].irradiance) - luminance(point.irradiance);
        if (distance < 1 && glm::dot(points[q].normal, point.normal) > alike
            && differs * asked.error > 0 && std::abs(differs) > std::abs(asked.error))
            rivals.emplace_back(distance, q);
    });
    std::ranges::sort(rivals);
    if (rivals.size() > most_looks)
        rivals.resize(most_looks);
    const auto taps = readers::taps_of(reader, volume, point.position, point.normal);
    const auto above = [&](const readers::FitPoint& of) {
        return glm::vec3(volume.grid.to_grid(of.position))
               + lift * glm::vec3(volume.grid.to_axes(of.normal));
    };
    const glm::vec3 from = above(point);
    for (const auto& [distance, q] : rivals) {
        const visibility::Hit hit = visibility.closest({from, above(points[q]) - from, 0.0f, 1.0f});
        if (hit.instance == visibility::no_hit
            || !share_cells(taps,
                            readers::taps_of(reader, volume, points[q].position, points[q].normal)))
            continue;
        asked.contested = true;
        asked.distance = std::abs(glm::dot(places.at[q] - places.at[p], point.normal));
        asked.along = asked.distance < double(lift)
                      || std::abs(glm::dot(glm::dvec3(hit.normal), point.normal)) < alike;
        return;
    }
}

/// By which factor cells have to be smaller so that of `strips` (shrinks with the cells) and
/// `steps` (share by distance in cells, rising; gone where cells are no larger than it) no more
/// than contested_most is left.
double factor_of(double strips, std::span<const std::pair<double, double>> steps) {
    double best = 0, kept = 0;
    for (std::size_t i = 0; i <= steps.size() && kept < contested_most; ++i) {
        const double most = i < steps.size() ? std::min(1.0, steps[i].first) : 1.0;
        best = std::max(best, std::min(most, (contested_most - kept) / std::max(strips, 1e-9)));
        if (i < steps.size())
            kept += steps[i].second;
    }
    return best;
}

} // namespace

Contested find_contested(const readers::Reader& reader, const Volume& volume,
                         std::span<const readers::FitPoint> points,
                         const visibility::Visibility& visibility) {
    Contested result{.cell = volume.grid.cell};
    const std::size_t stride = (points.size() + most_asked - 1) / most_asked;
    double arrives = 0, weight = 0; // of the points that are asked
    for (std::size_t p = 0; p < points.size(); p += stride) {
        arrives += points[p].weight * luminance(points[p].irradiance);
        weight += points[p].weight;
    }
    if (!(arrives > 0))
        return result;
    const double mean = arrives / weight;
    const Places places(reader, volume, points);
    std::vector<Asked> asked((points.size() + stride - 1) / stride);
    tbb::parallel_for(std::size_t(0), asked.size(), [&](std::size_t n) {
        const readers::FitPoint& point = points[n * stride];
        asked[n].error =
            luminance(readers::irradiance(reader, volume, point.position, point.normal))
            - luminance(point.irradiance);
        if (std::abs(asked[n].error) > felt * mean)
            ask(reader, volume, points, visibility, places, n * stride, asked[n]);
    });

    double strips = 0, most = 0;
    std::vector<std::pair<double, double>> steps;
    for (std::size_t n = 0; n < asked.size(); ++n) {
        if (!asked[n].contested)
            continue;
        const readers::FitPoint& point = points[n * stride];
        const double error = std::abs(asked[n].error), share = point.weight * error / arrives;
        result.share += share;
        if (asked[n].along)
            strips += share;
        else
            steps.emplace_back(asked[n].distance, share);
        if (error > most) {
            most = error;
            result.worst = point.position;
        }
    }
    std::ranges::sort(steps);
    if (result.share > contested_most)
        result.cell *= factor_of(strips, steps);
    return result;
}

} // namespace lpvbake::bake
