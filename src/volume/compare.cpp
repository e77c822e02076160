#include "volume/compare.h"

#include "colour/colour.h"
#include "lpvbake/error.h"
#include "text.h"
#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numbers>

namespace lpvbake::volume {
namespace {

constexpr size_t normal_count = 26;
constexpr size_t cell_samples = normal_count * 3;
using CellIrradiance = std::array<double, cell_samples>; ///< [channel * 26 + normal], lux

/// Evaluates the irradiance of a volume's cells.
class Irradiance {
public:
    explicit Irradiance(const Volume& volume) : volume_(volume), weights_(volume.sh.size()) {
        std::vector<float> one(volume.sh.size());
        for (size_t k = 0; k < one.size(); ++k) {
            one[k] = 1;
            for (size_t n = 0; n < normal_count; ++n)
                weights_[k][n] = sh_irradiance(one, glm::vec3(neighbour_normals()[n]));
            one[k] = 0;
        }
    }

    /// Clamps what is below 0, and counts it in `negative`.
    CellIrradiance operator()(size_t cell, uint64_t& negative) const {
        CellIrradiance e{};
        for (size_t k = 0; k < weights_.size(); ++k)
            for (size_t c = 0; c < 3; ++c) {
                const double coefficient = volume_.sh[k][cell][glm::length_t(c)];
                for (size_t n = 0; n < normal_count; ++n)
                    e[c * normal_count + n] += coefficient * weights_[k][n];
            }
        for (double& value : e)
            if (value < 0 && std::isfinite(value)) { // what is not finite stays and is seen
                value = 0;
                ++negative;
            }
        return e;
    }

private:
    const Volume& volume_;
    std::vector<std::array<double, normal_count>> weights_;
};

/// The samples of two volumes.
struct Samples {
    const Volume& a;
    const Volume& b;
    Irradiance irradiance_a{a};
    Irradiance irradiance_b{b};

    Samples(const Volume& of_a, const Volume& of_b) : a(of_a), b(of_b) {}
};

/// Differences are kept as floats, so that a percentile needs no list of them: 16 bits at a time,
/// counted, since the bits of floats from 0 up are in the order of the floats.
float absolute_difference(double a, double b) {
    return float(std::abs(a - b));
}

using Histogram = std::vector<uint64_t>;
using Histograms = tbb::enumerable_thread_specific<Histogram>;
constexpr size_t bins = 1 << 16;

/// The bin that holds the sample of this rank (from 0), which becomes its rank within the bin.
size_t find_bin(const Histograms& counts, uint64_t& rank) {
    for (size_t bin = 0; bin + 1 < bins; ++bin) {
        uint64_t count = 0;
        for (const Histogram& own : counts)
            count += own[bin];
        if (rank < count)
            return bin;
        rank -= count;
    }
    return bins - 1;
}

struct Sums {
    double a = 0, b = 0, abs = 0, squares = 0, energy_a = 0, energy_b = 0;
    uint64_t negative_a = 0, negative_b = 0;

    Sums operator+(const Sums& o) const {
        return {a + o.a,
                b + o.b,
                abs + o.abs,
                squares + o.squares,
                energy_a + o.energy_a,
                energy_b + o.energy_b,
                negative_a + o.negative_a,
                negative_b + o.negative_b};
    }
};

using Range = tbb::blocked_range<size_t>;
constexpr size_t grain = 4096; ///< cells summed in a row

/// x >= 0 as a fraction of `whole` >= 0.
double relative(double x, double whole) {
    return whole > 0 ? x / whole : x > 0 ? std::numeric_limits<double>::infinity() : 0;
}

double mean_of(double sum, uint64_t count) {
    return count > 0 ? sum / double(count) : 0;
}

/// The fewest digits that read back as the same number.
template <typename Number>
std::string shortest(Number value) {
    char digits[32];
    return {digits, std::to_chars(digits, std::end(digits), value).ptr};
}

template <typename Vector>
std::string triple(const Vector& v, const char* between) {
    return shortest(v.x) + between + shortest(v.y) + between + shortest(v.z);
}

void require_one_lattice(const Volume& a, const Volume& b) {
    if (const auto why = lattice_difference(a.grid, b.grid))
        throw Error(ErrorKind::invalid, "the volumes are not on one grid: " + *why);
}

/// `of_a` and `of_b` are grids of A and B, of one kind.
GridDifference grid_difference(const Volume& a, const Volume& b, const ConstGridView& of_a,
                               const ConstGridView& of_b) {
    const float *x = of_a.data, *y = of_b.data;
    const auto channels = size_t(of_a.kind->width());
    GridDifference result;
    result.kind = of_a.kind;
    result.name = of_a.name();
    double squares = 0, reference = 0;
    struct {
        double max = 0;
        size_t at = 0;
    } inside, outside; // of the cells valid in both
    uint64_t valid = 0;
    for (size_t cell = 0, i = 0; cell < a.grid.size(); ++cell) {
        const bool both = valid_in_both(a, b, cell);
        auto& worst = both ? inside : outside;
        bool differs = false;
        for (size_t c = 0; c < channels; ++c, ++i) {
            const double d = std::abs(double(x[i]) - double(y[i]));
            differs = differs || x[i] != y[i];
            if (both) {
                squares += d * d;
                reference += double(y[i]) * double(y[i]);
            }
            if (d > worst.max)
                worst = {d, i};
        }
        valid += both;
        result.cells += differs;
        result.cells_valid_both += differs && both;
    }
    result.rms = std::sqrt(mean_of(squares, valid * channels));
    result.relative = relative(result.rms, std::sqrt(mean_of(reference, valid * channels)));
    const auto& [max, at] = inside.max > 0 ? inside : outside;
    result.max_abs = max;
    result.cell = a.grid.cell_at(at / channels);
    result.channel = int(at % channels);
    result.a = x[at];
    result.b = y[at];
    return result;
}

/// Fills in what concerns grids, and `identical`.
void compare_grids(const Volume& a, const Volume& b, Comparison& result) {
    std::vector<std::pair<ConstGridView, ConstGridView>> pairs;
    const std::vector<ConstGridView> of_a = grids_of(a);
    std::vector<ConstGridView> of_b = grids_of(b);
    for (const ConstGridView& grid : of_a) {
        const auto twin = std::ranges::find_if(of_b, [&](const ConstGridView& other) {
            return other.kind == grid.kind && other.k == grid.k;
        });
        if (twin == of_b.end()) {
            result.only_a.push_back(grid.name());
            continue;
        }
        pairs.emplace_back(grid, *twin);
        of_b.erase(twin);
    }
    for (const ConstGridView& grid : of_b)
        result.only_b.push_back(grid.name());
    result.grids.resize(pairs.size());
    tbb::parallel_for(size_t(0), pairs.size(), [&](size_t i) {
        result.grids[i] = grid_difference(a, b, pairs[i].first, pairs[i].second);
    });
    result.identical =
        result.only_a.empty() && result.only_b.empty()
        && std::ranges::all_of(result.grids, [](const auto& grid) { return grid.cells == 0; });
}

void count_validity(const Volume& a, const Volume& b, Comparison& result) {
    for (size_t cell = 0; cell < a.grid.size(); ++cell) {
        const bool in_a = a.is_valid(cell), in_b = b.is_valid(cell);
        ++(in_a && in_b ? result.valid_both
           : in_a       ? result.valid_only_a
           : in_b       ? result.valid_only_b
                        : result.valid_neither);
    }
}

double signed_ratio(double a, double b) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    return b != 0 ? a / b : a != 0 ? std::copysign(infinity, a) : 1;
}

/// The first round over the samples: all that is a sum, and the upper bits of the differences.
/// Fills in `cell_max`, lux.
void sum_samples(const Samples& samples, Histograms& upper, std::vector<float>& cell_max,
                 Comparison& result) {
    const Volume &a = samples.a, &b = samples.b;
    result.cell_error.assign(a.grid.size(), 0);
    const auto add = [&](const Range& range, Sums sum) {
        Histogram& histogram = upper.local();
        for (size_t cell = range.begin(); cell < range.end(); ++cell) {
            if (!valid_in_both(a, b, cell))
                continue;
            const CellIrradiance ea = samples.irradiance_a(cell, sum.negative_a);
            const CellIrradiance eb = samples.irradiance_b(cell, sum.negative_b);
            double cell_sum = 0;
            for (size_t s = 0; s < cell_samples; ++s) {
                sum.a += ea[s];
                sum.b += eb[s];
                cell_sum += std::abs(ea[s] - eb[s]);
                sum.squares += (ea[s] - eb[s]) * (ea[s] - eb[s]);
                const float d = absolute_difference(ea[s], eb[s]);
                cell_max[cell] = std::max(cell_max[cell], d);
                ++histogram[std::bit_cast<uint32_t>(d) >> 16];
            }
            sum.abs += cell_sum;
            result.cell_error[cell] = float(cell_sum / cell_samples);
            sum.energy_a += glm::dot(glm::dvec3(a.sh[0][cell]), colour::rec709_luminance);
            sum.energy_b += glm::dot(glm::dvec3(b.sh[0][cell]), colour::rec709_luminance);
        }
        return sum;
    };
    const Sums sums = tbb::parallel_deterministic_reduce(Range(0, a.grid.size(), grain), Sums{},
                                                         add, std::plus<Sums>());
    if (!std::isfinite(sums.a) || !std::isfinite(sums.b))
        throw Error(ErrorKind::invalid, "the volumes have irradiance that is not finite");

    result.samples = result.valid_both * cell_samples;
    result.mean_a = mean_of(sums.a, result.samples);
    result.mean_b = mean_of(sums.b, result.samples);
    result.relative_l1 = relative(sums.abs, sums.b);
    result.rms = std::sqrt(mean_of(sums.squares, result.samples));
    result.relative_rms = relative(result.rms, result.mean_b);
    result.negative_a = sums.negative_a;
    result.negative_b = sums.negative_b;
    result.energy_a = std::sqrt(4 * std::numbers::pi) * sums.energy_a;
    result.energy_b = std::sqrt(4 * std::numbers::pi) * sums.energy_b;
    result.energy_ratio = signed_ratio(sums.energy_a, sums.energy_b);
    for (float& error : result.cell_error)
        error = float(relative(error, result.mean_b));
}

/// The second round: what needs the mean, and the lower bits of the 95th percentile.
void count_samples(const Samples& samples, const Histograms& upper,
                   const std::vector<double>& limits, Comparison& result) {
    result.exceeding.assign(limits.size(), 0);
    if (result.samples == 0)
        return;
    const Volume &a = samples.a, &b = samples.b;
    uint64_t rank = (95 * result.samples + 99) / 100 - 1; // ceil(0.95 n), counted from 0
    const auto upper_bits = uint32_t(find_bin(upper, rank));
    Histograms lower(Histogram(bins, 0)), counts(Histogram(limits.size(), 0));
    tbb::parallel_for(Range(0, a.grid.size(), grain), [&](const Range& range) {
        Histogram& histogram = lower.local();
        Histogram& exceeding = counts.local();
        uint64_t counted_before = 0;
        for (size_t cell = range.begin(); cell < range.end(); ++cell) {
            if (!valid_in_both(a, b, cell))
                continue;
            const CellIrradiance ea = samples.irradiance_a(cell, counted_before);
            const CellIrradiance eb = samples.irradiance_b(cell, counted_before);
            for (size_t s = 0; s < cell_samples; ++s) {
                const float d = absolute_difference(ea[s], eb[s]);
                if (const auto bits = std::bit_cast<uint32_t>(d); bits >> 16 == upper_bits)
                    ++histogram[bits & 0xffff];
                for (size_t l = 0; l < limits.size(); ++l)
                    exceeding[l] += relative(d, result.mean_b) > limits[l];
            }
        }
    });
    const uint32_t bits = upper_bits << 16 | uint32_t(find_bin(lower, rank));
    result.percentile95 = relative(std::bit_cast<float>(bits), result.mean_b);
    for (const Histogram& own : counts)
        for (size_t l = 0; l < limits.size(); ++l)
            result.exceeding[l] += own[l];
}

/// The largest difference, the cells with the largest ones, and in each the sample that has it.
void list_worst(const Samples& samples, const std::vector<float>& cell_max, int wanted,
                Comparison& result) {
    float largest = 0;
    std::vector<size_t> cells;
    for (size_t cell = 0; cell < cell_max.size(); ++cell)
        if (cell_max[cell] > 0) {
            cells.push_back(cell);
            largest = std::max(largest, cell_max[cell]);
        }
    result.max = relative(largest, result.mean_b);
    const size_t listed = std::min(cells.size(), size_t(std::max(wanted, 0)));
    std::partial_sort(cells.begin(), cells.begin() + std::ptrdiff_t(listed), cells.end(),
                      [&](size_t left, size_t right) {
                          return cell_max[left] != cell_max[right]
                                     ? cell_max[left] > cell_max[right]
                                     : left < right;
                      });
    cells.resize(listed);
    for (const size_t cell : cells) {
        uint64_t counted_before = 0;
        const CellIrradiance ea = samples.irradiance_a(cell, counted_before);
        const CellIrradiance eb = samples.irradiance_b(cell, counted_before);
        size_t s = 0;
        while (absolute_difference(ea[s], eb[s]) < cell_max[cell])
            ++s;
        result.worst.push_back({samples.a.grid.cell_at(cell), neighbour_normals()[s % normal_count],
                                int(s / normal_count), ea[s], eb[s],
                                relative(cell_max[cell], result.mean_b)});
    }
}

} // namespace

const std::array<glm::dvec3, 26>& neighbour_normals() {
    static const std::array<glm::dvec3, 26> normals = [] {
        std::array<glm::dvec3, 26> made;
        size_t n = 0;
        for (int z = -1; z <= 1; ++z)
            for (int y = -1; y <= 1; ++y)
                for (int x = -1; x <= 1; ++x)
                    if (x != 0 || y != 0 || z != 0)
                        made[n++] = glm::normalize(glm::dvec3(x, y, z));
        return made;
    }();
    return normals;
}

bool valid_in_both(const Volume& a, const Volume& b, std::size_t cell) {
    return a.is_valid(cell) && b.is_valid(cell);
}

std::optional<std::string> lattice_difference(const Grid& a, const Grid& b) {
    const double tolerance = 1e-6 * b.cell;
    const int longest = std::max({b.dims.x, b.dims.y, b.dims.z, 1});
    const glm::dvec3 shift = glm::abs(a.origin - b.origin);
    const glm::dquat off = glm::conjugate(a.turn) * b.turn;
    if (a.dims != b.dims)
        return "dims: " + triple(a.dims, " x ") + " and " + triple(b.dims, " x ") + " cells";
    if (!(std::abs(a.cell - b.cell) * longest <= tolerance))
        return "cell: " + shortest(a.cell) + " and " + shortest(b.cell) + " m";
    if (!(std::max({shift.x, shift.y, shift.z}) <= tolerance))
        return "origin: (" + triple(a.origin, ", ") + ") and (" + triple(b.origin, ", ") + ") m";
    if (!(2 * glm::length(glm::dvec3(off.x, off.y, off.z)) * longest <= 1e-6))
        return format("turn: they lie %.3g degrees apart",
                      glm::degrees(2 * std::acos(std::min(1.0, std::abs(off.w)))));
    return {};
}

Comparison compare(const Volume& a, const Volume& b, const CompareSettings& settings) {
    require_one_lattice(a, b);
    Comparison result;
    compare_grids(a, b, result);
    count_validity(a, b, result);
    const Samples samples(a, b);
    Histograms upper(Histogram(bins, 0));
    std::vector<float> cell_max(a.grid.size());
    sum_samples(samples, upper, cell_max, result);
    count_samples(samples, upper, settings.limits, result);
    list_worst(samples, cell_max, settings.worst, result);
    return result;
}

Volume difference(const Volume& a, const Volume& b) {
    require_one_lattice(a, b);
    const size_t cells = a.grid.size();
    Volume result;
    result.grid = a.grid;
    result.sh_order = std::max(a.sh_order, b.sh_order);
    result.sh = a.sh;
    result.sh.resize(std::max(a.sh.size(), b.sh.size()), std::vector<glm::vec3>(cells));
    for (size_t k = 0; k < b.sh.size(); ++k)
        for (size_t i = 0; i < cells; ++i)
            result.sh[k][i] -= b.sh[k][i];
    const std::vector<ConstGridView> of_a = grids_of(a);
    for (size_t i = 0; i < of_a.size(); ++i) {
        const GridKind& kind = *of_a[i].kind;
        if (!kind.subtracted || of_a[i].k > 0)
            continue;
        const std::vector<ConstGridView> of_b = grids_of(b, kind);
        const size_t both = std::min(grids_of(a, kind).size(), of_b.size());
        if (both == 0)
            continue;
        set_grids(result, kind, int(both));
        for (const GridView& grid : grids_of(result, kind))
            std::ranges::transform(of_a[i + size_t(grid.k)].values(), of_b[size_t(grid.k)].values(),
                                   grid.data, std::minus<float>());
    }
    result.validity.resize(cells);
    for (size_t i = 0; i < cells; ++i)
        result.validity[i] = valid_in_both(a, b, i);
    return result;
}

} // namespace lpvbake::volume
