// Settings of a bake from the error or the time that is wanted.
#pragma once

#include "bake/plan.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::bake {

/// What of a bake's settings is left to choose, and by what.
struct Wish {
    /// Solvers that may be taken, best first; at least one.
    std::vector<const solver::SolverKind*> solvers{solver_kinds().begin(), solver_kinds().end()};
    std::optional<int> order;      ///< of the harmonics; none: 2, or 4 where `error` needs it
    std::optional<double> error;   ///< relative error of irradiance, at most
    std::optional<double> seconds; ///< of a bake without loading and writing, at most
    /// Parameters that are not to be chosen, of those solvers that have them.
    std::vector<solver::ParameterValue> given;
};

struct Choice {
    BakePlan plan;    ///< with the settings
    double error = 0; ///< expected_error
    std::string text; ///< solver and settings, as in "gather, order 2, 192 clusters, ..."
    std::vector<std::string> warnings; ///< what of the wish is not reached

    const solver::SolverSettings& solver() const { return plan.settings.solver; }
};

/// Plans settings for a wish: the fastest that are expected to reach the error, or the most
/// accurate in the time, among rungs of each solver's ladder from coarse to fine; without either
/// the first of Wish::solvers. All else is as `base` has it. What no rung reaches is told in a
/// warning, and the nearest is taken. Depends on the arguments and on constants of the program,
/// never on a clock. Throws Error as plan_bake does where no rung can be planned.
Choice choose_settings(const SceneFacts& scene, const BakeSettings& base, const Wish& wish,
                       const gpu::DeviceInfo& device);

/// Relative error of irradiance that is expected of settings: that of the Cornell box,
/// the hardest of the scenes that it was measured in; more evenly lit ones err by down to a third.
double expected_error(const BakeSettings& settings);

} // namespace lpvbake::bake
