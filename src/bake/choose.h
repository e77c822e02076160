// Settings of a bake from the error or the time that is wanted.
#pragma once

#include "bake/plan.h"
#include "solver/pilot.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::bake {

/// What of a bake's settings is left to choose, and by what.
struct Wish {
    /// Solvers that may be taken, best first; at least one.
    std::vector<const solver::SolverKind*> solvers{solver_kinds().begin(), solver_kinds().end()};
    std::optional<int> order;      ///< of the harmonics; none: 2, or 4 where `error` needs it and
                                   ///< the files keep it
    int kept_order = 4;            ///< highest band that the files will keep
    std::optional<double> error;   ///< relative error of irradiance, at most
    std::optional<double> seconds; ///< of a bake without loading and writing, at most
    /// Parameters that are not to be chosen, of those solvers that have them.
    std::vector<solver::ParameterValue> given;
    /// Of the scene's light (bake/pilot.h), and what it took; none: the Cornell box stands for it.
    std::optional<solver::Pilot> pilot;
    double pilot_seconds = 0;
};

struct Choice {
    BakePlan plan;                      ///< with the settings
    double error = 0;                   ///< expected_error
    std::optional<solver::Pilot> pilot; ///< Wish::pilot
    std::string text; ///< solver and settings, as in "gather, order 2, 192 clusters, ..."
    std::vector<std::string> warnings; ///< what of the wish is not reached

    const solver::SolverSettings& solver() const { return plan.settings.solver; }
    /// Not so where the scene is beyond what a pilot tells.
    bool foretold() const;
};

/// Plans settings for a wish: the fastest that are expected to reach the error, or the most
/// accurate in the time, among rungs of each solver's ladder from coarse to fine; without either
/// the first of Wish::solvers. All else is as `base` has it. What no rung reaches is told in a
/// warning, and the nearest is taken. Depends on the arguments and on constants of the program,
/// never on a clock. Throws Error as plan_bake does where no rung can be planned.
Choice choose_settings(const SceneFacts& scene, const BakeSettings& base, const Wish& wish,
                       const gpu::DeviceInfo& device);

/// Whether a pilot tells what bakes of its scene err by.
bool is_foretold(const solver::Pilot& pilot);

/// The pilot, or what stands for it where there is none: that of the Cornell box.
const solver::Pilot& pilot_for(const BakeSettings& settings,
                               const std::optional<solver::Pilot>& pilot);

/// Relative L1 of irradiance at cells that is expected of settings, at most in nine of ten scenes:
/// by the pilot of the scene, or without one by that of the Cornell box.
/// Bands above `kept_order` do not count.
double expected_error(const BakeSettings& settings,
                      const std::optional<solver::Pilot>& pilot = std::nullopt, int kept_order = 4);

} // namespace lpvbake::bake
