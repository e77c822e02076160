#include "readers/equations.h"

#include <cassert>
#include <cmath>
#include <functional>
#include <limits>
#include <type_traits>

namespace lpvbake::readers {
namespace {

/// What holds the cells counts so much more in the preconditioner than in the equations. Values
/// that points leave open are then settled by what holds them from the first steps on: dark cells
/// move before lit ones do.
constexpr double lean = 300;

constexpr std::size_t most = volume::sh_count(volume::sh_max_order);

Colour colour(glm::dvec3 v) {
    return {glm::vec3(v), 0.0f};
}

/// Calls use(count) with the number as a constant: bands 0 to `order`, or the sides of a cube.
template <class Use>
auto with_count(std::size_t count, const Use& use) {
    switch (count) {
    case 1:
        return use(std::integral_constant<std::size_t, 1>());
    case 4:
        return use(std::integral_constant<std::size_t, 4>());
    case 6:
        return use(std::integral_constant<std::size_t, 6>());
    case 9:
        return use(std::integral_constant<std::size_t, 9>());
    case 16:
        return use(std::integral_constant<std::size_t, 16>());
    default:
        assert(count == most);
        return use(std::integral_constant<std::size_t, most>());
    }
}

/// Unknowns that may move, a colour: 1 or 0. Empty: all.
using Mask = Colours;

/// What makes steps fewer: the inverses of the equations' blocks, a cell each, or, with a mask, of
/// their diagonal.
class Preconditioner {
public:
    Preconditioner(const Equations& equations, bool blocks)
        : count_(equations.lookups.coefficients()),
          blocks_(blocks),
          inverse_(equations.lookups.cells.size() * (blocks ? count_ * count_ : count_)) {
        tbb::parallel_for(std::size_t(0), equations.lookups.cells.size(), [&](std::size_t u) {
            std::array<double, most * most> block{};
            equations.lookups.of_unknown(u, [&](std::size_t i, float weight, const float* row) {
                const double square =
                    double(equations.weights[i]) * double(weight) * double(weight);
                for (std::size_t k = 0; k < count_; ++k)
                    for (std::size_t l = 0; l <= k; ++l)
                        block[k * count_ + l] += square * double(row[k]) * double(row[l]);
            });
            for (std::size_t k = 0; k < count_; ++k)
                block[k * count_ + k] += lean * double(equations.hold[u * count_ + k]);
            if (blocks_)
                invert(block, &inverse_[u * count_ * count_]);
            else
                for (std::size_t k = 0; k < count_; ++k) {
                    const double whole = block[k * count_ + k];
                    inverse_[u * count_ + k] = float(whole > 0 ? 1 / whole : 0);
                }
        });
    }

    /// x += length * way, residual -= length * product, scaled = inverse * residual; gives the sum
    /// of residual * scaled.
    glm::dvec3 advance(Colour length, const Colours& way, const Colours& product, const Mask& free,
                       Colours& x, Colours& residual, Colours& scaled) const {
        return with_count(count_, [&](auto count) {
            return ordered_sum<glm::dvec3>(x.size() / count, [&](std::size_t u) {
                const std::size_t first = u * count;
                Colour left[count];
                for (std::size_t k = 0; k < count; ++k) {
                    x[first + k] += length * way[first + k];
                    left[k] = residual[first + k] -= length * product[first + k];
                }
                glm::dvec3 size(0.0);
                for (std::size_t k = 0; k < count; ++k) {
                    Colour sum(0.0f);
                    if (blocks_) {
                        const float* row = &inverse_[(first + k) * count];
                        for (std::size_t l = 0; l < count; ++l)
                            sum += row[l] * left[l];
                    } else {
                        sum = inverse_[first + k] * left[k] * free[first + k];
                    }
                    scaled[first + k] = sum;
                    size += glm::dvec3(sum) * glm::dvec3(left[k]);
                }
                return size;
            });
        });
    }

private:
    /// Of a symmetric block, of which the lower half is given; by Cholesky's factors. Rows that
    /// nothing asks for stay 0.
    void invert(std::array<double, most * most>& block, float* inverse) const {
        for (std::size_t k = 0; k < count_; ++k)
            for (std::size_t l = 0; l <= k; ++l) {
                double sum = block[k * count_ + l];
                for (std::size_t m = 0; m < l; ++m)
                    sum -= block[k * count_ + m] * block[l * count_ + m];
                if (k == l)
                    block[k * count_ + k] = sum > 0 ? std::sqrt(sum) : 0;
                else
                    block[k * count_ + l] =
                        block[l * count_ + l] > 0 ? sum / block[l * count_ + l] : 0;
            }
        for (std::size_t column = 0; column < count_; ++column) {
            std::array<double, most> x{};
            x[column] = 1;
            for (std::size_t k = column; k < count_; ++k) {
                for (std::size_t l = column; l < k; ++l)
                    x[k] -= block[k * count_ + l] * x[l];
                x[k] = block[k * count_ + k] > 0 ? x[k] / block[k * count_ + k] : 0;
            }
            for (std::size_t k = count_; k-- > 0;) {
                for (std::size_t l = k + 1; l < count_; ++l)
                    x[k] -= block[l * count_ + k] * x[l];
                x[k] = block[k * count_ + k] > 0 ? x[k] / block[k * count_ + k] : 0;
                inverse[k * count_ + column] = float(x[k]);
            }
        }
    }

    std::size_t count_;
    bool blocks_;
    std::vector<float> inverse_;
};

/// Steps of conjugate gradients on the free unknowns, from x on; `residual` is that of x.
void descend(const Equations& equations, const Mask& free, const Preconditioner& inverse, int steps,
             double enough, Colours& x, Colours& residual, FitReport& report, glm::dvec3& first) {
    const std::size_t unknowns = x.size();
    Colours product(unknowns), way(unknowns), scaled(unknowns), of_points(equations.weights.size());
    glm::dvec3 size = inverse.advance(Colour(0.0f), way, product, free, x, residual, scaled);
    way = scaled;
    if (first == glm::dvec3(0.0))
        first = size;
    const auto left = [&] {
        const glm::dvec3 share = ratio(size, first);
        return std::sqrt(std::max({share.x, share.y, share.z}));
    };
    report.residual = left();
    for (int step = 0; step < steps && report.residual > enough; ++step, ++report.steps) {
        const Colour length = colour(ratio(size, equations.apply(way, of_points, product)));
        const glm::dvec3 next = inverse.advance(length, way, product, free, x, residual, scaled);
        const Colour turn = colour(ratio(next, size));
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, unknowns), [&](const auto& range) {
            for (std::size_t i = range.begin(); i < range.end(); ++i)
                way[i] = scaled[i] + turn * way[i];
        });
        size = next;
        report.residual = left();
    }
}

/// Of the normal equations at x.
void find_residual(const Equations& equations, const Values& lacking, const Colours& x,
                   Colours& residual) {
    Colours of_points(lacking.size());
    tbb::parallel_for(std::size_t(0), lacking.size(), [&](std::size_t i) {
        of_points[i] = equations.weights[i]
                       * (colour(lacking[i])
                          - equations.lookups.shown(x, i, equations.lookups.coefficients()));
    });
    Colours back(x.size());
    for (std::size_t i = 0; i < x.size(); ++i)
        back[i] = -x[i];
    equations.transpose(of_points, back, residual);
}

} // namespace

glm::dvec3 ratio(glm::dvec3 a, glm::dvec3 b) {
    glm::dvec3 result(0.0);
    for (int c = 0; c < 3; ++c)
        if (b[c] > 0)
            result[c] = a[c] / b[c];
    return result;
}

std::vector<double> holds_of(const FitSettings& settings, const Volume& volume,
                             std::span<const std::size_t> cells) {
    const auto light_of = [&](std::size_t cell) { // mean over directions, up to a factor
        const glm::vec3 l0 = volume.sh[0][cell];
        return std::max(0.0, double(l0.x) + double(l0.y) + double(l0.z));
    };
    const auto sums = ordered_sum<glm::dvec2>(volume.grid.size(), [&](std::size_t cell) {
        return volume.is_valid(cell) ? glm::dvec2(light_of(cell), 1.0) : glm::dvec2(0.0);
    });
    const double bright = sums.y > 0 ? 0.1 * sums.x / sums.y : 0;
    std::vector<double> holds;
    for (const std::size_t cell : cells) {
        const double light = light_of(cell);
        holds.push_back(!volume.is_valid(cell) ? settings.hold_other
                        : light >= bright
                            ? settings.hold_valid
                            : settings.hold_valid * std::max(settings.hold_dark, light / bright));
    }
    return holds;
}

std::vector<double> weights_of(const FitSettings& settings, std::span<const FitPoint> points) {
    const auto brightness = [](const FitPoint& point) {
        return point.irradiance.x + point.irradiance.y + point.irradiance.z;
    };
    std::vector<std::pair<double, double>> by_light; // brightness, light
    double whole = 0;
    for (const FitPoint& point : points) {
        by_light.emplace_back(brightness(point), point.weight * brightness(point));
        whole += by_light.back().second;
    }
    std::ranges::sort(by_light, std::greater());
    double limit = std::numeric_limits<double>::infinity(), above = 0;
    for (std::size_t i = 0; i < by_light.size() && above <= settings.bright * whole; ++i) {
        limit = by_light[i].first;
        above += by_light[i].second;
    }
    std::vector<double> weights;
    for (const FitPoint& point : points) {
        const double share = brightness(point) > limit ? limit / brightness(point) : 1.0;
        weights.push_back(point.weight * share * share);
    }
    return weights;
}

glm::dvec3 Equations::transpose(const Colours& of_points, const Colours& x, Colours& out) const {
    return with_count(lookups.coefficients(), [&](auto count) {
        return ordered_sum<glm::dvec3>(lookups.cells.size(), [&](std::size_t u) {
            Colour sums[count];
            for (std::size_t k = 0; k < count; ++k)
                sums[k] = hold[u * count + k] * x[u * count + k];
            lookups.gather(of_points, u, sums, count);
            glm::dvec3 along(0.0);
            for (std::size_t k = 0; k < count; ++k) {
                out[u * count + k] = sums[k];
                along += glm::dvec3(x[u * count + k]) * glm::dvec3(sums[k]);
            }
            return along;
        });
    });
}

glm::dvec3 Equations::apply(const Colours& x, Colours& of_points, Colours& out) const {
    with_count(lookups.coefficients(), [&](auto count) {
        tbb::parallel_for(std::size_t(0), weights.size(), [&](std::size_t i) {
            of_points[i] = weights[i] * lookups.shown(x, i, count);
        });
    });
    return transpose(of_points, x, out);
}

Values solve(const Equations& equations, const Values& lacking, const Values& least,
             const FitSettings& settings, FitReport& report) {
    constexpr int rounds = 6;
    const std::size_t unknowns = equations.lookups.unknowns();
    const Preconditioner inverse(equations, least.empty());
    Colours x(unknowns, Colour(0.0f)), residual(unknowns);
    Mask free;
    glm::dvec3 first(0.0);
    find_residual(equations, lacking, x, residual);
    if (least.empty())
        descend(equations, free, inverse, settings.steps, settings.tolerance, x, residual, report,
                first);
    else
        free.assign(unknowns, Colour(1.0f));
    for (int round = 0; round < rounds && !least.empty(); ++round) {
        descend(equations, free, inverse, 2 * settings.steps / rounds, settings.tolerance, x,
                residual, report, first);
        for (std::size_t i = 0; i < unknowns; ++i)
            x[i] = glm::max(x[i], colour(least[i]));
        find_residual(equations, lacking, x, residual);
        for (std::size_t i = 0; i < unknowns; ++i)
            for (int c = 0; c < 3; ++c)
                free[i][c] = x[i][c] > float(least[i][c]) || residual[i][c] > 0 ? 1.0f : 0.0f;
    }
    return {x.begin(), x.end()};
}

} // namespace lpvbake::readers
