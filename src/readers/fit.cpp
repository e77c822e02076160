#include "readers/equations.h"
#include "readers/fit_nonlinear.h"

#include "colour/colour.h"
#include "volume/compare.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace lpvbake::readers {
namespace {

using Row = std::array<double, volume::sh_count(volume::sh_max_order)>;

/// Sum of |E| over 26 normals and RGB.
double all_normals(std::span<const glm::dvec3> coefficients, const std::vector<Row>& transfer) {
    double sum = 0;
    for (const auto& row : transfer) {
        glm::dvec3 e(0.0);
        for (std::size_t k = 0; k < coefficients.size(); ++k)
            e += row[k] * coefficients[k];
        sum += std::abs(e.x) + std::abs(e.y) + std::abs(e.z);
    }
    return sum;
}

using Coefficients = std::vector<std::vector<glm::vec3>>; // Volume::sh

/// FitReport::moved and moved_dark, of the bands that the reader has.
void tell_moved(const Reader& reader, const Coefficients& before, const Volume& after,
                FitReport& report) {
    const int order = order_of(reader, after);
    const std::size_t count = std::size_t(volume::sh_count(order));
    constexpr Reader plain{.name = "", .highest_order = volume::sh_max_order};
    std::vector<Row> transfer;
    for (const glm::dvec3& n : volume::neighbour_normals())
        transfer.push_back(transfer_of(plain, order, n));
    std::vector<double> was(after.grid.size()), moved(after.grid.size());
    tbb::parallel_for(std::size_t(0), was.size(), [&](std::size_t cell) {
        if (!after.is_valid(cell))
            return;
        std::array<glm::dvec3, volume::sh_count(volume::sh_max_order)> c, change;
        bool same = true;
        for (std::size_t k = 0; k < count; ++k) {
            c[k] = glm::dvec3(before[k][cell]);
            change[k] = glm::dvec3(after.sh[k][cell]) - c[k];
            same = same && change[k] == glm::dvec3(0.0);
        }
        was[cell] = all_normals(std::span(c).first(count), transfer);
        moved[cell] = same ? 0.0 : all_normals(std::span(change).first(count), transfer);
    });
    double cells = 0; // that are valid
    for (std::size_t i = 0; i < was.size(); ++i)
        cells += after.is_valid(i);
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

/// What is solved for in each cell: coefficients, or, for a cube, what its six sides store, which
/// is not negative: irradiance towards +x, -x, +y, ... Bands 0 to 2 can have any six.
class Unknowns {
public:
    Unknowns(const Reader& reader, const Volume& volume)
        : reader_(reader),
          order_(order_of(reader, volume)),
          sides_(reader.evaluation == Evaluation::cube && order_ == 2) {}

    std::size_t count() const { return sides_ ? 6 : std::size_t(volume::sh_count(order_)); }
    bool not_negative() const { return sides_; }

    /// What the reader shows of each.
    Row row(glm::dvec3 n) const {
        if (!sides_)
            return transfer_of(reader_, order_, n);
        Row result{};
        for (std::size_t axis = 0; axis < 3; ++axis)
            result[2 * axis + (n[int(axis)] < 0 ? 1 : 0)] = n[int(axis)] * n[int(axis)];
        return result;
    }

    /// By which square its change counts in the mean square of irradiance over normals.
    double share(std::size_t k) const {
        if (sides_)
            return 1.0 / 6;
        int l = 0;
        while (std::size_t(volume::sh_count(l)) <= k)
            ++l;
        const double factor = volume::sh_cosine_factor(l);
        return factor * factor / (4 * std::numbers::pi);
    }

    void get(const Volume& volume, std::size_t cell, std::span<glm::dvec3> values) const {
        if (!sides_) {
            for (std::size_t k = 0; k < values.size(); ++k)
                values[k] = glm::dvec3(volume.sh[k][cell]);
            return;
        }
        for (int side = 0; side < 6; ++side) {
            glm::dvec3 n(0.0), e(0.0);
            n[side / 2] = side % 2 ? -1 : 1;
            const Row transfer = transfer_of(reader_, order_, n);
            for (std::size_t k = 0; k < 9; ++k)
                e += transfer[k] * glm::dvec3(volume.sh[k][cell]);
            values[std::size_t(side)] = glm::max(e, 0.0);
        }
    }

    void set(std::span<const glm::dvec3> values, Volume& volume, std::size_t cell) const {
        if (!sides_) {
            for (std::size_t k = 0; k < values.size(); ++k)
                volume.sh[k][cell] = glm::vec3(values[k]);
            return;
        }
        const auto put = [&](std::size_t k, int l, double basis, glm::dvec3 e) {
            volume.sh[k][cell] = glm::vec3(e / (volume::sh_cosine_factor(l) * basis));
        };
        std::array<glm::dvec3, 3> even, odd;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            even[axis] = 0.5 * (values[2 * axis] + values[2 * axis + 1]);
            odd[axis] = 0.5 * (values[2 * axis] - values[2 * axis + 1]);
        }
        const glm::dvec3 mean = (even[0] + even[1] + even[2]) / 3.0;
        put(0, 0, double(volume::sh_y0), mean);
        put(1, 1, double(volume::sh_y1), odd[1]);
        put(2, 1, double(volume::sh_y1), odd[2]);
        put(3, 1, double(volume::sh_y1), odd[0]);
        put(6, 2, 2 * double(volume::sh_y2b), even[2] - mean);
        put(8, 2, 2 * double(volume::sh_y2c), even[0] - even[1]);
    }

private:
    const Reader& reader_;
    int order_;
    bool sides_;
};

FitReport fit_linear(const Reader& reader, std::span<const FitPoint> points,
                     const FitSettings& settings, Volume& volume) {
    FitReport report;
    const Unknowns unknowns(reader, volume);
    const std::size_t count = unknowns.count();
    const Lookups lookups(reader, volume, points, count,
                          [&](glm::dvec3 n) { return unknowns.row(n); });
    report.cells = lookups.cells.size();
    report.points = lookups.used.size();
    if (report.points == 0)
        return report;

    Equations equations{lookups, {}, std::vector<float>(lookups.unknowns())};
    Values before(lookups.unknowns());
    const std::vector<double> holds = holds_of(settings, volume, lookups.cells);
    for (std::size_t u = 0; u < lookups.cells.size(); ++u) {
        const std::size_t cell = lookups.cells[u];
        for (std::size_t k = 0; k < count; ++k)
            equations.hold[u * count + k] = float(holds[u] * unknowns.share(k));
        unknowns.get(volume, cell, std::span(before).subspan(u * count, count));
    }
    Values lacking(lookups.used.size());
    const std::vector<double> weights = weights_of(settings, points);
    for (std::size_t i = 0; i < lacking.size(); ++i) {
        const FitPoint& point = points[lookups.used[i]];
        equations.weights.push_back(float(weights[lookups.used[i]]));
        lacking[i] = point.irradiance - lookups.shown(before, i, count);
    }
    Values least; // of the change
    if (unknowns.not_negative())
        for (const glm::dvec3& value : before)
            least.push_back(-value);
    const Values change = solve(equations, lacking, least, settings, report);
    for (std::size_t i = 0; i < before.size(); ++i)
        before[i] =
            unknowns.not_negative() ? glm::max(before[i] + change[i], 0.0) : before[i] + change[i];
    for (std::size_t u = 0; u < lookups.cells.size(); ++u)
        unknowns.set(std::span(before).subspan(u * count, count), volume, lookups.cells[u]);
    return report;
}

/// What the reader shows at points.
Values shown_at(const Reader& reader, const Volume& volume, std::span<const FitPoint> points) {
    Values shown(points.size());
    tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t i) {
        shown[i] = irradiance(reader, volume, points[i].position, points[i].normal);
    });
    return shown;
}

constexpr double least_share = 0.25; ///< of the way to what was fitted; next to it is none

/// Half of the way back to values that were given.
void go_back(const Coefficients& given, Coefficients& sh) {
    for (std::size_t k = 0; k < sh.size(); ++k)
        for (std::size_t cell = 0; cell < sh[k].size(); ++cell)
            sh[k][cell] = 0.5f * (given[k][cell] + sh[k][cell]);
}

/// Whether the points say so, by more than the standard error of what they say together.
bool is_nearer(std::span<const FitPoint> points, const Values& was, const Values& is) {
    double sum = 0, squares = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const glm::dvec3 more =
            glm::abs(is[i] - points[i].irradiance) - glm::abs(was[i] - points[i].irradiance);
        const double counts = points[i].weight * (more.x + more.y + more.z);
        sum += counts;
        squares += counts * counts;
    }
    return sum + std::sqrt(squares) <= 0;
}

} // namespace

SurfaceError error_of(const Reader& reader, const Volume& volume,
                      std::span<const FitPoint> points) {
    const Values shown = shown_at(reader, volume, points);
    const auto luminance = [](glm::dvec3 e) { return glm::dot(e, colour::rec709_luminance); };
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

WorstPlace worst_place(const Reader& reader, const Volume& volume,
                       std::span<const FitPoint> points) {
    std::vector<volume::CellWeights> taps(points.size());
    std::vector<double> wrong(points.size());
    const auto sum_of = [](glm::dvec3 e) { return e.x + e.y + e.z; };
    tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t i) {
        const auto& [position, normal, weight, truth] = points[i];
        taps[i] = taps_of(reader, volume, position, normal);
        wrong[i] = sum_of(glm::abs(irradiance(reader, volume, position, normal) - truth));
    });
    std::vector<glm::dvec2> cells(volume.grid.size()); // what is wrong, faces of surface
    double arrives = 0, whole = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        arrives += points[i].weight * sum_of(points[i].irradiance);
        whole += points[i].weight;
        for (std::size_t k = 0; k < taps[i].cell.size(); ++k)
            if (const double share = points[i].weight * taps[i].weight[k]; share > 0)
                cells[taps[i].cell[k]] += share * glm::dvec2(wrong[i], 1.0);
    }
    WorstPlace worst;
    std::size_t worst_cell = 0;
    for (std::size_t cell = 0; cell < cells.size(); ++cell)
        if (const double error = cells[cell].y < 0.5 || !(arrives > 0)
                                     ? 0.0
                                     : cells[cell].x / cells[cell].y * whole / arrives;
            error > worst.error) {
            worst.error = error;
            worst_cell = cell;
        }
    if (!(worst.error > 0))
        return worst;
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t k = 0; k < taps[i].cell.size(); ++k)
            if (taps[i].cell[k] == worst_cell)
                worst.position += points[i].weight * taps[i].weight[k] * wrong[i]
                                  / cells[worst_cell].x * points[i].position;
    return worst;
}

FitReport fit(const Reader& reader, std::span<const FitPoint> points, const FitSettings& settings,
              Volume& volume, std::span<const FitPoint> judges) {
    const Coefficients given = volume.sh;
    const Values before = shown_at(reader, volume, judges);
    const bool linear = is_linear(reader);
    FitReport report = linear ? fit_linear(reader, points, settings, volume)
                              : fit_nonlinear(reader, points, settings, volume);
    while (!is_nearer(judges, before, shown_at(reader, volume, judges))) {
        if (!linear || report.share <= least_share) {
            volume.sh = given;
            report.share = report.moved = report.moved_dark = 0;
            return report;
        }
        go_back(given, volume.sh);
        report.share /= 2;
    }
    if (linear)
        tell_moved(reader, given, volume, report);
    return report;
}

} // namespace lpvbake::readers
