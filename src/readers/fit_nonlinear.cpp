#include "readers/fit_nonlinear.h"

#include "colour/colour.h"
#include "readers/equations.h"
#include "volume/compare.h"

#include <cassert>
#include <cmath>
#include <numbers>

namespace lpvbake::readers {
namespace {

using Cell = std::array<glm::dvec3, 4>;

/// Band 1 of a colour as a vector (x, y, z).
glm::dvec3 first_band(const Cell& c, int colour) {
    return {c[3][colour], c[1][colour], c[2][colour]};
}

void set_slope(Shown& shown, int colour, double l0, glm::dvec3 l1) {
    shown.slope[0][colour] = l0;
    shown.slope[1][colour] = l1.y;
    shown.slope[2][colour] = l1.z;
    shown.slope[3][colour] = l1.x;
}

const double mean_factor = std::numbers::pi * double(volume::sh_y0); ///< of c_0
const double slope_factor = 2 * std::numbers::pi / 3 * double(volume::sh_y1);

/// E = m ((1 - r) / (1 + r) + 4 r q^p), which is Evaluation::geomerics.
void geomerics(double l0, glm::dvec3 l1, glm::dvec3 n, int colour, Shown& shown) {
    const double length = glm::length(l1), mean = mean_factor * l0;
    if (!(l0 > 0)) {
        shown.irradiance[colour] = 0;
        set_slope(shown, colour, mean_factor, slope_factor * n);
        return;
    }
    const double grow = double(volume::sh_y1) / (3 * double(volume::sh_y0) * l0); // r = grow |l1|
    if (!(grow * length > 1e-9)) {
        shown.irradiance[colour] = mean;
        set_slope(shown, colour, mean_factor, slope_factor * n);
        return;
    }
    const bool most = grow * length >= 1;
    const double r = most ? 1 : grow * length;
    const glm::dvec3 d = l1 / length;
    const double along = glm::dot(d, n), q = std::clamp(0.5 + 0.5 * along, 1e-12, 1.0);
    const double p = 1 + 2 * r, power = std::pow(q, p);
    const double share = (1 - r) / (1 + r) + 4 * r * power;
    const double by_r =
        most ? 0 : mean * (-2 / ((1 + r) * (1 + r)) + 4 * power + 8 * r * power * std::log(q));
    const double by_q = mean * 4 * r * p * power / q;
    shown.irradiance[colour] = mean * share;
    set_slope(shown, colour, mean_factor * share - by_r * r / l0,
              by_r * grow * d + by_q * 0.5 / length * (n - along * d));
}

void zh3(const Cell& c, glm::dvec3 n, Shown& shown) {
    glm::dvec3 axis(0.0);
    for (int colour = 0; colour < 3; ++colour)
        axis += colour::rec709_luminance[colour] * first_band(c, colour);
    const double length = glm::length(axis);
    axis = length > 0 ? axis / length : axis;
    const double cosine = glm::dot(axis, n);
    const double zonal = length > 0 ? volume::sh_cosine_factor(2) * double(volume::sh_y2b)
                                          * (3 * cosine * cosine - 1)
                                    : 0;
    for (int colour = 0; colour < 3; ++colour) {
        const double l0 = c[0][colour];
        const glm::dvec3 l1 = first_band(c, colour);
        const double along = glm::dot(l1, axis), s = std::abs(along);
        shown.irradiance[colour] = mean_factor * l0 + slope_factor * glm::dot(l1, n);
        double by_l0 = mean_factor;
        glm::dvec3 by_l1 = slope_factor * n;
        if (l0 > 0) {
            const double r = std::min(s / l0, std::numbers::sqrt3);
            shown.irradiance[colour] += zonal * l0 * (0.08 * r + 0.6 * r * r);
            if (s / l0 < std::numbers::sqrt3) {
                by_l0 -= zonal * 0.6 * r * r;
                by_l1 += zonal * (0.08 + 1.2 * r) * std::copysign(1.0, along) * axis;
            } else {
                by_l0 += zonal * (0.08 * r + 0.6 * r * r);
            }
        }
        set_slope(shown, colour, by_l0, by_l1);
    }
}

/// The problem: points and the cells that they are read from.
class Problem {
public:
    Problem(const Reader& reader, std::span<const FitPoint> points, const FitSettings& settings,
            const Volume& volume)
        : evaluation_(reader.evaluation) {
        std::vector<uint32_t> unknown(volume.grid.size(), none);
        const std::vector<double> weights = weights_of(settings, points);
        for (std::size_t p = 0; p < points.size(); ++p) {
            FitPoint point = points[p];
            point.weight = weights[p];
            if (!(point.weight > 0))
                continue;
            const volume::CellWeights taps = taps_of(reader, volume, point.position, point.normal);
            const std::size_t before = entries_.size();
            for (std::size_t i = 0; i < taps.cell.size(); ++i)
                if (taps.weight[i] > 0) {
                    uint32_t& u = unknown[taps.cell[i]];
                    if (u == none) {
                        u = uint32_t(cells.size());
                        cells.push_back(taps.cell[i]);
                        by_cell_.emplace_back();
                    }
                    by_cell_[u].push_back({uint32_t(used.size()), taps.weight[i]});
                    entries_.push_back({u, taps.weight[i]});
                }
            if (entries_.size() == before)
                continue;
            used.push_back(point);
            first_.push_back(entries_.size());
        }
        hold_ = holds_of(settings, volume, cells);
    }

    /// Rows and what is lacking at x; the sum of squares.
    double linearize(const Values& x, const Values& given, std::vector<Shown>* rows) const {
        const double of_points = ordered_sum<double>(used.size(), [&](std::size_t i) {
            Cell mixed{};
            for (std::size_t e = first_[i]; e < first_[i + 1]; ++e)
                for (std::size_t k = 0; k < 4; ++k)
                    mixed[k] += entries_[e].weight * x[4 * entries_[e].other + k];
            Shown shown = shown_with_slope(evaluation_, mixed, used[i].normal);
            shown.irradiance = used[i].irradiance - shown.irradiance;
            if (rows)
                (*rows)[i] = shown;
            return used[i].weight * glm::dot(shown.irradiance, shown.irradiance);
        });
        return of_points + ordered_sum<double>(x.size(), [&](std::size_t i) {
                   const glm::dvec3 change = x[i] - given[i];
                   return hold(i) * glm::dot(change, change);
               });
    }

    /// out = hold x + transpose(rows) weight (rows x), and of `lacking` instead of rows x.
    void apply(const std::vector<Shown>& rows, const Values& x, bool lacking, Values& out) const {
        Values of_points(used.size());
        tbb::parallel_for(std::size_t(0), used.size(), [&](std::size_t i) {
            glm::dvec3 sum = rows[i].irradiance;
            if (!lacking) {
                sum = glm::dvec3(0.0);
                for (std::size_t e = first_[i]; e < first_[i + 1]; ++e)
                    for (std::size_t k = 0; k < 4; ++k)
                        sum += entries_[e].weight * rows[i].slope[k] * x[4 * entries_[e].other + k];
            }
            of_points[i] = used[i].weight * sum;
        });
        tbb::parallel_for(std::size_t(0), cells.size(), [&](std::size_t u) {
            for (std::size_t k = 0; k < 4; ++k) {
                glm::dvec3 sum = hold(4 * u + k) * x[4 * u + k];
                for (const auto& [i, weight] : by_cell_[u])
                    sum += weight * rows[i].slope[k] * of_points[i];
                out[4 * u + k] = sum;
            }
        });
    }

    /// One over the diagonal.
    Values preconditioner(const std::vector<Shown>& rows) const {
        Values result(4 * cells.size());
        tbb::parallel_for(std::size_t(0), cells.size(), [&](std::size_t u) {
            for (std::size_t k = 0; k < 4; ++k) {
                glm::dvec3 sum(hold(4 * u + k));
                for (const auto& [i, weight] : by_cell_[u])
                    sum += used[i].weight * weight * weight * rows[i].slope[k] * rows[i].slope[k];
                for (int c = 0; c < 3; ++c)
                    result[4 * u + k][c] = sum[c] > 0 ? 1 / sum[c] : 0;
            }
        });
        return result;
    }

    std::vector<std::size_t> cells;
    std::vector<FitPoint> used;

private:
    static constexpr uint32_t none = ~0u;
    struct Entry {
        uint32_t other;
        double weight;
    };

    /// Of an unknown: by the mean square of irradiance over normals.
    double hold(std::size_t i) const {
        const double factor = volume::sh_cosine_factor(i % 4 == 0 ? 0 : 1);
        return hold_[i / 4] * factor * factor / (4 * std::numbers::pi);
    }

    Evaluation evaluation_;
    std::vector<Entry> entries_;
    std::vector<std::size_t> first_{0};
    std::vector<std::vector<Entry>> by_cell_;
    std::vector<double> hold_;
};

/// The change that the linearized equations ask for.
Values step_of(const Problem& problem, const std::vector<Shown>& rows, const Values& moved,
               const FitSettings& settings, FitReport& report) {
    const std::size_t unknowns = moved.size();
    Values x(unknowns, glm::dvec3(0.0)), residual(unknowns), way(unknowns), product(unknowns), back;
    for (const glm::dvec3& value : moved)
        back.push_back(-value);
    problem.apply(rows, back, true, residual);
    const Values inverse = problem.preconditioner(rows);
    const auto size_of = [&] {
        return ordered_sum<glm::dvec3>(
            unknowns, [&](std::size_t i) { return inverse[i] * residual[i] * residual[i]; });
    };
    for (std::size_t i = 0; i < unknowns; ++i)
        way[i] = inverse[i] * residual[i];
    glm::dvec3 size = size_of();
    const glm::dvec3 first = size;
    const auto left = [&] {
        const glm::dvec3 share = ratio(size, first);
        return std::sqrt(std::max({share.x, share.y, share.z}));
    };
    report.residual = left();
    for (int step = 0; step < settings.steps && report.residual > settings.tolerance;
         ++step, ++report.steps) {
        problem.apply(rows, way, false, product);
        const glm::dvec3 length = ratio(size, ordered_sum<glm::dvec3>(unknowns, [&](std::size_t i) {
                                            return way[i] * product[i];
                                        }));
        for (std::size_t i = 0; i < unknowns; ++i) {
            x[i] += length * way[i];
            residual[i] -= length * product[i];
        }
        const glm::dvec3 next = size_of(), turn = ratio(next, size);
        for (std::size_t i = 0; i < unknowns; ++i)
            way[i] = inverse[i] * residual[i] + turn * way[i];
        size = next;
        report.residual = left();
    }
    return x;
}

/// FitReport::moved and moved_dark, as the reader evaluates the cells.
void tell_moved(const Problem& problem, Evaluation evaluation, const Values& before,
                const Values& after, const Volume& volume, FitReport& report) {
    const auto of_cell = [&](const Values& x, std::size_t u, glm::dvec3 n) {
        const Cell c{x[4 * u], x[4 * u + 1], x[4 * u + 2], x[4 * u + 3]};
        return shown_with_slope(evaluation, c, n).irradiance;
    };
    std::vector<glm::dvec2> sums(problem.cells.size()); // moved, was
    tbb::parallel_for(std::size_t(0), sums.size(), [&](std::size_t u) {
        if (!volume.is_valid(problem.cells[u]))
            return;
        for (const glm::dvec3& n : volume::neighbour_normals()) {
            const glm::dvec3 was = of_cell(before, u, n), d = of_cell(after, u, n) - was;
            sums[u] += glm::dvec2(std::abs(d.x) + std::abs(d.y) + std::abs(d.z),
                                  std::abs(was.x) + std::abs(was.y) + std::abs(was.z));
        }
    });
    const double whole = ordered_sum<double>(sums.size(), [&](std::size_t u) { return sums[u].y; });
    if (!(whole > 0))
        return;
    const double dark = 0.01 * whole / double(sums.size());
    const auto moved = ordered_sum<glm::dvec2>(sums.size(), [&](std::size_t u) {
        return sums[u].y < dark ? glm::dvec2(0.0, sums[u].x) : glm::dvec2(sums[u].x, 0.0);
    });
    report.moved = moved.x / whole;
    report.moved_dark = moved.y / whole;
}

} // namespace

Shown shown_with_slope(Evaluation evaluation, const std::array<glm::dvec3, 4>& coefficients,
                       glm::dvec3 n) {
    assert(evaluation == Evaluation::geomerics || evaluation == Evaluation::zh3);
    Shown shown{};
    if (evaluation == Evaluation::zh3)
        zh3(coefficients, n, shown);
    else
        for (int colour = 0; colour < 3; ++colour)
            geomerics(coefficients[0][colour], first_band(coefficients, colour), n, colour, shown);
    return shown;
}

FitReport fit_nonlinear(const Reader& reader, std::span<const FitPoint> points,
                        const FitSettings& settings, Volume& volume,
                        const NonlinearSettings& nonlinear) {
    assert(!is_linear(reader) && volume.sh_order >= 1);
    FitReport report;
    const Problem problem(reader, points, settings, volume);
    report.cells = problem.cells.size();
    report.points = problem.used.size();
    Values given;
    for (const std::size_t cell : problem.cells)
        for (std::size_t k = 0; k < 4; ++k)
            given.emplace_back(volume.sh[k][cell]);
    Values x = given;
    std::vector<Shown> rows(problem.used.size());
    double least = problem.linearize(x, given, &rows);
    for (int outer = 0; outer < nonlinear.outer && report.points > 0; ++outer) {
        Values moved(x.size());
        for (std::size_t i = 0; i < x.size(); ++i)
            moved[i] = x[i] - given[i];
        const Values step = step_of(problem, rows, moved, settings, report);
        const double before = least;
        double length = 1;
        for (int halving = 0; halving <= nonlinear.halvings; ++halving, length /= 2) {
            Values there = x;
            for (std::size_t i = 0; i < x.size(); ++i)
                there[i] += length * step[i];
            if (const double sum = problem.linearize(there, given, nullptr); sum < least) {
                least = sum;
                x = std::move(there);
                break;
            }
        }
        if (!(before - least > nonlinear.gain * before))
            break;
        problem.linearize(x, given, &rows);
    }
    for (std::size_t i = 0; i < x.size(); ++i)
        volume.sh[i % 4][problem.cells[i / 4]] = glm::vec3(x[i]);
    tell_moved(problem, reader.evaluation, given, x, volume, report);
    return report;
}

} // namespace lpvbake::readers
