// The least squares of a fit: sparse lookups, normal equations, conjugate gradients.
//
// All sums have an order that depends on the numbers of points and cells alone, so that results
// have the same bits for any number of threads.
#pragma once

#include "readers/fit.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <vector>

namespace lpvbake::readers {

using Values = std::vector<glm::dvec3>;

/// A colour as four floats, the last 0: what a register takes.
using Colour = glm::vec4;
using Colours = std::vector<Colour>;

inline constexpr std::size_t sum_chunk = 512; ///< of sums, whatever the number of threads

/// Sum of term(i) in an order that depends on `count` alone.
template <typename Sum, typename Term>
Sum ordered_sum(std::size_t count, const Term& term) {
    std::vector<Sum> partial((count + sum_chunk - 1) / sum_chunk);
    tbb::parallel_for(std::size_t(0), partial.size(), [&](std::size_t c) {
        Sum sum{};
        for (std::size_t i = c * sum_chunk; i < std::min(count, (c + 1) * sum_chunk); ++i)
            sum += term(i);
        partial[c] = sum;
    });
    Sum sum{};
    for (const Sum& part : partial)
        sum += part;
    return sum;
}

/// a / b of each colour; 0 where there is nothing left to divide.
glm::dvec3 ratio(glm::dvec3 a, glm::dvec3 b);

/// What holds each of the cells, in faces: see FitSettings.
std::vector<double> holds_of(const FitSettings& settings, const Volume& volume,
                             std::span<const std::size_t> cells);

/// What the error of each point counts: see FitSettings::bright.
std::vector<double> weights_of(const FitSettings& settings, std::span<const FitPoint> points);

/// Sparse rows and columns: points by the cells that they are read from, and back. Unknowns are
/// the cells that any point is read from, by rising index.
class Lookups {
public:
    /// `row_of` gives what a cell of weight 1 adds to a point, for each of its `coefficients`.
    template <typename RowOf>
    Lookups(const Reader& reader, const Volume& volume, std::span<const FitPoint> points,
            std::size_t coefficients, const RowOf& row_of)
        : coefficients_(coefficients) {
        std::vector<volume::CellWeights> taps(points.size());
        tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t p) {
            if (points[p].weight > 0)
                taps[p] = taps_of(reader, volume, points[p].position, points[p].normal);
        });
        constexpr uint32_t none = ~0u;
        std::vector<uint32_t> unknown(volume.grid.size(), none);
        for (const volume::CellWeights& tap : taps)
            for (std::size_t i = 0; i < tap.cell.size(); ++i)
                if (tap.weight[i] > 0)
                    unknown[tap.cell[i]] = 0;
        for (std::size_t cell = 0; cell < unknown.size(); ++cell)
            if (unknown[cell] != none) {
                unknown[cell] = uint32_t(cells.size());
                cells.push_back(cell);
            }

        by_point_.first.reserve(points.size() + 1);
        by_point_.entries.reserve(8 * points.size());
        rows_.reserve(coefficients * points.size());
        by_point_.first.push_back(0);
        by_cell_.first.assign(cells.size() + 1, 0);
        for (std::size_t p = 0; p < points.size(); ++p) {
            const std::size_t before = by_point_.entries.size();
            for (std::size_t i = 0; i < taps[p].cell.size(); ++i)
                if (taps[p].weight[i] > 0) {
                    const uint32_t u = unknown[taps[p].cell[i]];
                    by_point_.entries.push_back({u, float(taps[p].weight[i])});
                    ++by_cell_.first[u + 1];
                }
            if (by_point_.entries.size() == before)
                continue;
            used.push_back(p);
            by_point_.first.push_back(by_point_.entries.size());
            const auto row = row_of(points[p].normal);
            for (std::size_t k = 0; k < coefficients; ++k)
                rows_.push_back(float(row[k]));
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

    /// What the reader shows at used point i of values x[unknown * count + k]; count, that of the
    /// coefficients, is an integral_constant for loops of a length that is known.
    template <class Value, class Count>
    Value shown(const std::vector<Value>& x, std::size_t i, Count count) const {
        using Number = typename Value::value_type;
        const float* row = &rows_[i * count];
        Value sum(0);
        for (const auto& [u, weight] : by_point_.of(i)) {
            const Value* value = &x[u * count];
            Value towards(0);
            for (std::size_t k = 0; k < count; ++k)
                towards += Number(row[k]) * value[k];
            sum += Number(weight) * towards;
        }
        return sum;
    }

    /// The transpose: adds to the coefficients of unknown u what the values of its points give.
    template <class Count>
    void gather(const Colours& of_points, std::size_t u, Colour* out, Count count) const {
        for (const auto& [i, weight] : by_cell_.of(u)) {
            const float* row = &rows_[i * count];
            const Colour value = weight * of_points[i];
            for (std::size_t k = 0; k < count; ++k)
                out[k] += row[k] * value;
        }
    }

    /// Calls each(used point, the weight of unknown u at it, its row).
    template <class Each>
    void of_unknown(std::size_t u, const Each& each) const {
        for (const auto& [i, weight] : by_cell_.of(u))
            each(i, weight, &rows_[i * coefficients_]);
    }

    std::vector<std::size_t> cells; ///< of the unknowns
    std::vector<std::size_t> used;  ///< points, by rising index

private:
    struct Entry {
        uint32_t other;
        float weight;
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
    std::vector<float> rows_; ///< [used point * coefficients + k]
};

/// The normal equations: what holds the cells, and what the points ask for.
struct Equations {
    const Lookups& lookups;
    std::vector<float> weights; ///< a used point
    std::vector<float> hold;    ///< an unknown's coefficient

    /// out = hold * x + transpose(weight * of_points), and the sum of x * out.
    glm::dvec3 transpose(const Colours& of_points, const Colours& x, Colours& out) const;
    /// The same of what the reader shows of x, which `of_points` is room for.
    glm::dvec3 apply(const Colours& x, Colours& of_points, Colours& out) const;
};

/// Brings the points nearer to what they lack by a change of the unknowns, from no change on, and
/// tells report.steps and residual. With `least` (values of the change) no unknown falls below it:
/// between rounds of steps those that did are fixed there, and released where they would rise.
Values solve(const Equations& equations, const Values& lacking, const Values& least,
             const FitSettings& settings, FitReport& report);

} // namespace lpvbake::readers
