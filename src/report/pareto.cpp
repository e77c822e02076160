#include "report/pareto.h"

#include <cmath>

namespace lpvbake::report {

std::vector<bool> pareto_front(std::span<const SpeedError> points) {
    std::vector<bool> front(points.size(), true);
    for (std::size_t i = 0; i < points.size(); ++i)
        for (const SpeedError& other : points) {
            const bool no_worse =
                other.seconds <= points[i].seconds && other.error <= points[i].error;
            const bool better = other.seconds < points[i].seconds || other.error < points[i].error;
            if (no_worse && better)
                front[i] = false;
        }
    return front;
}

std::optional<EqualError> at_equal_error(SpeedError method, std::span<const SpeedError> curve) {
    const auto positive = [](SpeedError p) { return p.seconds > 0 && p.error > 0; };
    if (curve.empty() || !positive(method) || !positive(curve[0]))
        return std::nullopt;
    if (curve[0].error <= method.error)
        return EqualError{EqualError::Kind::already, curve[0].seconds / method.seconds};
    SpeedError before = curve[0];
    for (const SpeedError& point : curve) {
        if (!positive(point))
            return std::nullopt;
        if (point.error <= method.error) {
            const double share =
                std::log(before.error / method.error) / std::log(before.error / point.error);
            const double seconds = before.seconds * std::pow(point.seconds / before.seconds, share);
            return EqualError{EqualError::Kind::crosses, seconds / method.seconds};
        }
        if (point.error < before.error)
            before = point;
    }
    return EqualError{EqualError::Kind::beyond, curve.back().seconds / method.seconds};
}

} // namespace lpvbake::report
