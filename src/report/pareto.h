// Speed against error: which methods are beaten, and by how much one needs longer than another.
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace lpvbake::report {

/// What a method costs and how wrong it is.
struct SpeedError {
    double seconds = 0;
    double error = 0;
};

/// True for each point that no other beats: none is as fast and as accurate, and better in one.
std::vector<bool> pareto_front(std::span<const SpeedError> points);

/// How a method compares with a curve of another, whose error falls as its time grows.
struct EqualError {
    enum class Kind {
        crosses, ///< the curve needs `factor` times the method's time for the same error
        beyond,  ///< the curve's end is not there yet after `factor` times the method's time
        already, ///< the curve's start is as good already, in `factor` of the method's time
    };
    Kind kind = Kind::crosses;
    double factor = 1;
};

/// Time on the curve at the method's error over the method's time; between two points of the curve
/// logarithms are interpolated. The curve is in the order of rising time; what is slower and no
/// better than a point before it is passed over. None for an empty curve, and for times or errors
/// that are not above 0.
std::optional<EqualError> at_equal_error(SpeedError method, std::span<const SpeedError> curve);

} // namespace lpvbake::report
