// Which bakes a report measures.
#pragma once

#include "bake/settings.h"

#include <string>
#include <utility>
#include <vector>

namespace lpvbake::report {

/// An option of bake with the values that it takes in turn.
struct SweepAxis {
    std::string option; ///< long name without dashes: see sweep_options()
    std::vector<std::string> values;
};

/// Every combination of its axes' values.
using Sweep = std::vector<SweepAxis>;

/// One bake of a report.
struct SweepRow {
    bake::BakeSettings settings;
    /// What sets it apart, as bake's command line has it: option without dashes, value. Empty: it
    /// is what bake takes.
    std::vector<std::pair<std::string, std::string>> options;
};

/// Its options for a table: "lpv 32 face", or that there are none.
std::string row_name(const SweepRow& row);

/// At most so many rows make a report.
inline constexpr std::size_t most_rows = 1000;

/// The options that a sweep can set: those of all bakes, then the parameters of the solvers.
std::vector<std::string> sweep_options(solver::SolverKinds kinds = bake::solver_kinds());

/// Throws Error (argument) that names option and value unless this is an option with a value that
/// it takes.
void check_sweep_value(const std::string& option, const std::string& value,
                       solver::SolverKinds kinds = bake::solver_kinds());

/// What bake takes when nothing is asked of it; each occlusion mode of lpv and each quality of the
/// others at 16, 32 and 64 cells; and at 32 cells a propagation that is cut off after 16 steps, and
/// reflective shadow maps of a quarter of the usual texels. All hold the light that bake takes.
std::vector<Sweep> default_sweeps();

/// The rows of all sweeps in order, the last axis of each running fastest; a row that was there
/// before is left out, one without options also where others say the same, and of a row what its
/// solver lacks. All start from `base`. The solver is
/// that of a row's "solver", else the first that has its other options, else that of `base`. Throws
/// Error (argument): see check_sweep_value; more than most_rows rows; an axis without values or
/// given twice.
std::vector<SweepRow> sweep_rows(const std::vector<Sweep>& sweeps, const bake::BakeSettings& base,
                                 solver::SolverKinds kinds = bake::solver_kinds());

} // namespace lpvbake::report
