// Fits for readers whose irradiance is no linear map of order 1: geomerics and zh3.
#pragma once

#include "readers/fit.h"

namespace lpvbake::readers {

/// What such an evaluation makes of the four coefficients of a lookup (nits, RGB), and how it
/// changes with each. The axis of zh3 counts as fixed.
struct Shown {
    glm::dvec3 irradiance;
    std::array<glm::dvec3, 4> slope;
};
Shown shown_with_slope(Evaluation evaluation, const std::array<glm::dvec3, 4>& coefficients,
                       glm::dvec3 n);

struct NonlinearSettings {
    int outer = 8;      ///< steps of Gauss and Newton, at most
    int halvings = 5;   ///< of a step that makes it worse; then the steps end
    double gain = 1e-3; ///< they end, too, where one takes away less than this share
};

/// The least squares of `fit` by Gauss's and Newton's method from the values that are there, each
/// step by conjugate gradients (FitSettings::steps), as long as the sum falls: never worse than it
/// began. Changes bands 0 and 1. Sums have a fixed order.
FitReport fit_nonlinear(const Reader& reader, std::span<const FitPoint> points,
                        const FitSettings& settings, Volume& volume,
                        const NonlinearSettings& nonlinear = {});

} // namespace lpvbake::readers
