#include "readers/fit.h"

#include "colour/colour.h"
#include "volume/compare.h"

#include <tbb/parallel_for.h>

#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace lpvbake::readers {
namespace {

using Values = std::vector<glm::dvec3>;

constexpr std::size_t chunk = 512; ///< of sums, whatever the number of threads

/// Sum of term(i) in an order that depends on `count` alone.
template <typename Sum, typename Term>
Sum ordered_sum(std::size_t count, const Term& term) {
    std::vector<Sum> partial((count + chunk - 1) / chunk);
    tbb::parallel_for(std::size_t(0), partial.size(), [&](std::size_t c) {
        Sum sum{};
        for (std::size_t i = c * chunk; i < std::min(count, (c + 1) * chunk); ++i)
            sum += term(i);
        partial[c] = sum;
    });
    Sum sum{};
    for (const Sum& part : partial)
        sum += part;
    return sum;
}

glm::dvec3 dot(const Values& a, const Values& b) {
    return ordered_sum<glm::dvec3>(a.size(), [&](std::size_t i) { return a[i] * b[i]; });
}

/// a / b of each colour; 0 where there is nothing left to divide.
glm::dvec3 ratio(glm::dvec3 a, glm::dvec3 b) {
    glm::dvec3 result(0.0);
    for (int c = 0; c < 3; ++c)
        if (b[c] > 0)
            result[c] = a[c] / b[c];
    return result;
}

/// Sparse rows and columns: points by the cells that they are read from, and back. Unknowns are
/// the cells that any point is read from, by rising index.
class Lookups {
public:
    Lookups(const Reader& reader, const Volume& volume, std::span<const FitPoint> points)
        : coefficients_(std::size_t(sh_count(order_of(reader, volume)))) {
        std::vector<CellWeights> taps(points.size());
        tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t p) {
            if (points[p].weight > 0)
                taps[p] = taps_of(reader, volume, points[p].position, points[p].normal);
        });
        constexpr uint32_t none = ~0u;
        std::vector<uint32_t> unknown(volume.grid.size(), none);
        for (const CellWeights& tap : taps)
            for (std::size_t i = 0; i < tap.cell.size(); ++i)
                if (tap.weight[i] > 0)
                    unknown[tap.cell[i]] = 0;
        for (std::size_t cell = 0; cell < unknown.size(); ++cell)
            if (unknown[cell] != none) {
                unknown[cell] = uint32_t(cells.size());
                cells.push_back(cell);
            }

        by_point_.first.push_back(0);
        by_cell_.first.assign(cells.size() + 1, 0);
        for (std::size_t p = 0; p < points.size(); ++p) {
            const std::size_t before = by_point_.entries.size();
            for (std::size_t i = 0; i < taps[p].cell.size(); ++i)
                if (taps[p].weight[i] > 0) {
                    const uint32_t u = unknown[taps[p].cell[i]];
                    by_point_.entries.push_back({u, taps[p].weight[i]});
                    ++by_cell_.first[u + 1];
                }
            if (by_point_.entries.size() == before)
                continue;
            used.push_back(p);
            by_point_.first.push_back(by_point_.entries.size());
            const auto row = transfer_of(reader, order_of(reader, volume), points[p].normal);
            rows_.insert(rows_.end(), row.begin(), row.begin() + std::ptrdiff_t(coefficients_));
        }
        for (std::size_t u = 0; u < cells.size(); ++u)
            by_cell_.first[u + 1] += by_cell_.first[u];
        by_cell_.entries.resize(by_point_.entries.size());
        std::vector<std::size_t> next(by_cell_.first.begin(), by_cell_.first.end() - 1);
        for (std::size_t i = 0; i < used.size(); ++i)
            for (const auto& [u, weight] : by_point_.of(i))
                by_cell_.entries[next[u]++] = {uint32_t(i), weight};
    }

    std::size_t coefficients() const { return coefficients_; }
    std::size_t unknowns() const { return cells.size() * coefficients_; }

    /// What the reader shows at used point i of values x[unknown * coefficients + k].
    glm::dvec3 shown(const Values& x, std::size_t i) const {
        const double* row = &rows_[i * coefficients_];
        glm::dvec3 sum(0.0);
        for (const auto& [u, weight] : by_point_.of(i)) {
            const glm::dvec3* value = &x[u * coefficients_];
            glm::dvec3 towards(0.0);
            for (std::size_t k = 0; k < coefficients_; ++k)
                towards += row[k] * value[k];
            sum += weight * towards;
        }
        return sum;
    }

    /// The transpose: adds to the coefficients of unknown u what the values of its points give.
    /// With `squares` the squares of the entries instead.
    void gather(const Values& of_points, std::size_t u, glm::dvec3* out, bool squares) const {
        for (const auto& [i, weight] : by_cell_.of(u)) {
            const double* row = &rows_[i * coefficients_];
            for (std::size_t k = 0; k < coefficients_; ++k) {
                const double entry = weight * row[k];
                out[k] += (squares ? entry * entry : entry) * of_points[i];
            }
        }
    }

    std::vector<std::size_t> cells; ///< of the unknowns
    std::vector<std::size_t> used;  ///< points, by rising index

private:
    struct Entry {
        uint32_t other;
        double weight;
    };
    struct Compressed {
        std::vector<std::size_t> first;
        std::vector<Entry> entries;
        std::span<const Entry> of(std::size_t i) const {
            return std::span(entries).subspan(first[i], first[i + 1] - first[i]);
        }
    };
    std::size_t coefficients_;
    Compressed by_point_, by_cell_;
    std::vector<double> rows_; ///< [used point * coefficients + k]
};

/// The normal equations: what holds the cells, and what the points ask for.
struct Equations {
    const Lookups& lookups;
    std::vector<double> weights; ///< a used point
    std::vector<double> hold;    ///< an unknown's coefficient

    /// hold * x + transpose(weight * of_points)
    void transpose(const Values& of_points, const Values& x, Values& out) const {
        const std::size_t count = lookups.coefficients();
        tbb::parallel_for(std::size_t(0), lookups.cells.size(), [&](std::size_t u) {
            for (std::size_t k = u * count; k < (u + 1) * count; ++k)
                out[k] = hold[k] * x[k];
            lookups.gather(of_points, u, &out[u * count], false);
        });
    }

    void apply(const Values& x, Values& of_points, Values& out) const {
        tbb::parallel_for(std::size_t(0), weights.size(),
                          [&](std::size_t i) { of_points[i] = weights[i] * lookups.shown(x, i); });
        transpose(of_points, x, out);
    }

    /// One over the diagonal; 0 where nothing asks.
    std::vector<double> preconditioner() const {
        const std::size_t count = lookups.coefficients();
        Values of_points(weights.size());
        for (std::size_t i = 0; i < weights.size(); ++i)
            of_points[i] = glm::dvec3(weights[i]);
        std::vector<double> result(lookups.unknowns());
        tbb::parallel_for(std::size_t(0), lookups.cells.size(), [&](std::size_t u) {
            std::array<glm::dvec3, sh_count(sh_max_order)> diagonal{};
            lookups.gather(of_points, u, diagonal.data(), true);
            for (std::size_t k = 0; k < count; ++k) {
                const double whole = diagonal[k].x + hold[u * count + k];
                result[u * count + k] = whole > 0 ? 1 / whole : 0;
            }
        });
        return result;
    }
};

bool is_valid(const Volume& volume, std::size_t cell) {
    return volume.validity.empty() || volume.validity[cell] != 0;
}

/// Mean of a cell's light over directions, up to a factor.
double light_of(const Volume& volume, std::size_t cell) {
    const glm::vec3 l0 = volume.sh[0][cell];
    return std::max(0.0, double(l0.x) + double(l0.y) + double(l0.z));
}

/// Of the valid cells.
double mean_light(const Volume& volume) {
    const auto sums = ordered_sum<glm::dvec2>(volume.grid.size(), [&](std::size_t cell) {
        return is_valid(volume, cell) ? glm::dvec2(light_of(volume, cell), 1.0) : glm::dvec2(0.0);
    });
    return sums.y > 0 ? sums.x / sums.y : 0;
}

/// Sum of |E| over 26 normals and RGB.
double all_normals(std::span<const glm::dvec3> coefficients,
                   const std::vector<std::array<double, sh_count(sh_max_order)>>& transfer) {
    double sum = 0;
    for (const auto& row : transfer) {
        glm::dvec3 e(0.0);
        for (std::size_t k = 0; k < coefficients.size(); ++k)
            e += row[k] * coefficients[k];
        sum += std::abs(e.x) + std::abs(e.y) + std::abs(e.z);
    }
    return sum;
}

/// FitReport::moved and moved_dark, of the bands that the reader has.
void tell_moved(const Reader& reader, const Volume& before, const Volume& after,
                FitReport& report) {
    const int order = order_of(reader, before);
    const std::size_t count = std::size_t(sh_count(order));
    constexpr Reader plain{.name = "", .highest_order = sh_max_order};
    std::vector<std::array<double, sh_count(sh_max_order)>> transfer;
    for (const glm::dvec3& n : neighbour_normals())
        transfer.push_back(transfer_of(plain, order, n));
    std::vector<double> was(before.grid.size()), moved(before.grid.size());
    tbb::parallel_for(std::size_t(0), was.size(), [&](std::size_t cell) {
        if (!is_valid(before, cell))
            return;
        std::array<glm::dvec3, sh_count(sh_max_order)> c, change;
        bool same = true;
        for (std::size_t k = 0; k < count; ++k) {
            c[k] = glm::dvec3(before.sh[k][cell]);
            change[k] = glm::dvec3(after.sh[k][cell]) - c[k];
            same = same && change[k] == glm::dvec3(0.0);
        }
        was[cell] = all_normals(std::span(c).first(count), transfer);
        moved[cell] = same ? 0.0 : all_normals(std::span(change).first(count), transfer);
    });
    double cells = 0; // that are valid
    for (std::size_t i = 0; i < was.size(); ++i)
        cells += is_valid(before, i);
    const double whole = ordered_sum<double>(was.size(), [&](std::size_t i) { return was[i]; });
    if (!(whole > 0))
        return;
    const auto sums = ordered_sum<glm::dvec2>(was.size(), [&](std::size_t i) {
        return was[i] < 0.01 * whole / cells ? glm::dvec2(0.0, moved[i])
                                             : glm::dvec2(moved[i], 0.0);
    });
    report.moved = sums.x / whole;
    report.moved_dark = sums.y / whole;
}

/// Conjugate gradients: the change of the unknowns that brings the points nearer to what they lack.
Values solve(const Equations& equations, const Values& lacking, const FitSettings& settings,
             FitReport& report) {
    const std::size_t unknowns = equations.lookups.unknowns();
    Values x(unknowns, glm::dvec3(0.0)), residual(unknowns), product(unknowns), way(unknowns);
    Values of_points(lacking.size());
    for (std::size_t i = 0; i < lacking.size(); ++i)
        of_points[i] = equations.weights[i] * lacking[i];
    equations.transpose(of_points, x, residual);
    const std::vector<double> inverse = equations.preconditioner();
    const auto preconditioned = [&] {
        return ordered_sum<glm::dvec3>(
            unknowns, [&](std::size_t i) { return inverse[i] * residual[i] * residual[i]; });
    };
    for (std::size_t i = 0; i < unknowns; ++i)
        way[i] = inverse[i] * residual[i];
    glm::dvec3 size = preconditioned();
    const glm::dvec3 first = size;
    const auto left = [&] {
        const glm::dvec3 share = ratio(size, first);
        return std::sqrt(std::max({share.x, share.y, share.z}));
    };
    report.residual = left();
    for (; report.steps < settings.steps && report.residual > settings.tolerance; ++report.steps) {
        equations.apply(way, of_points, product);
        const glm::dvec3 step = ratio(size, dot(way, product));
        tbb::parallel_for(std::size_t(0), unknowns, [&](std::size_t i) {
            x[i] += step * way[i];
            residual[i] -= step * product[i];
        });
        const glm::dvec3 next = preconditioned();
        const glm::dvec3 turn = ratio(next, size);
        tbb::parallel_for(std::size_t(0), unknowns, [&](std::size_t i) {
            way[i] = inverse[i] * residual[i] + turn * way[i];
        });
        size = next;
        report.residual = left();
    }
    return x;
}

} // namespace

SurfaceError error_of(const Reader& reader, const Volume& volume,
                      std::span<const FitPoint> points) {
    Values shown(points.size());
    tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t i) {
        shown[i] = irradiance(reader, volume, points[i].position, points[i].normal);
    });
    const auto luminance = [](glm::dvec3 e) { return glm::dot(e, rec709_luminance); };
    struct Sums {
        double distance = 0, whole = 0, shown = 0, truth = 0, weight = 0;
        Sums& operator+=(const Sums& other) {
            distance += other.distance;
            whole += other.whole;
            shown += other.shown;
            truth += other.truth;
            weight += other.weight;
            return *this;
        }
    };
    const auto all = ordered_sum<Sums>(points.size(), [&](std::size_t i) {
        const auto& [position, normal, weight, truth] = points[i];
        const glm::dvec3 d = glm::abs(shown[i] - truth);
        return Sums{weight * (d.x + d.y + d.z), weight * (truth.x + truth.y + truth.z),
                    weight * luminance(shown[i]), weight * luminance(truth), weight};
    });
    const double dark = all.weight > 0 ? 0.01 * all.truth / all.weight : 0;
    const auto hidden = ordered_sum<Sums>(points.size(), [&](std::size_t i) {
        const auto& [position, normal, weight, truth] = points[i];
        if (!(luminance(truth) < dark))
            return Sums{};
        return Sums{.shown = weight * luminance(shown[i]), .weight = weight};
    });
    const auto relative = [](double x, double whole) {
        return whole > 0 ? x / whole : x > 0 ? std::numeric_limits<double>::infinity() : 0.0;
    };
    SurfaceError error;
    error.relative = relative(all.distance, all.whole);
    error.energy = all.truth > 0 ? all.shown / all.truth : 1 + relative(all.shown, all.truth);
    if (hidden.weight > 0)
        error.leak = (hidden.shown / hidden.weight) / (all.truth / all.weight);
    return error;
}

FitReport fit(const Reader& reader, std::span<const FitPoint> points, const FitSettings& settings,
              Volume& volume) {
    assert(is_linear(reader));
    FitReport report;
    report.before = report.after = error_of(reader, volume, points);
    const Lookups lookups(reader, volume, points);
    const std::size_t count = lookups.coefficients();
    report.cells = lookups.cells.size();
    report.points = lookups.used.size();
    if (report.points == 0)
        return report;

    Equations equations{lookups, {}, std::vector<double>(lookups.unknowns())};
    Values before(lookups.unknowns());
    const double bright = 0.1 * mean_light(volume);
    for (std::size_t u = 0; u < lookups.cells.size(); ++u) {
        const std::size_t cell = lookups.cells[u];
        const double light = light_of(volume, cell);
        const double held =
            !is_valid(volume, cell) ? settings.hold_other
            : light >= bright       ? settings.hold_valid
                              : settings.hold_valid * std::max(settings.hold_dark, light / bright);
        // The mean square over normals is that of the coefficients over 4 pi.
        for (int l = 0, k = 0; k < int(count); ++l)
            for (const double factor = sh_cosine_factor(l); k < sh_count(l); ++k) {
                equations.hold[u * count + std::size_t(k)] =
                    held * factor * factor / (4 * std::numbers::pi);
                before[u * count + std::size_t(k)] = glm::dvec3(volume.sh[std::size_t(k)][cell]);
            }
    }
    Values lacking(lookups.used.size());
    for (std::size_t i = 0; i < lacking.size(); ++i) {
        const FitPoint& point = points[lookups.used[i]];
        equations.weights.push_back(point.weight);
        lacking[i] = point.irradiance - lookups.shown(before, i);
    }
    const Values change = solve(equations, lacking, settings, report);
    const Volume given = volume;
    for (std::size_t u = 0; u < lookups.cells.size(); ++u)
        for (std::size_t k = 0; k < count; ++k)
            volume.sh[k][lookups.cells[u]] =
                glm::vec3(before[u * count + k] + change[u * count + k]);
    report.after = error_of(reader, volume, points);
    tell_moved(reader, given, volume, report);
    return report;
}

} // namespace lpvbake::readers
