// Settings that keep an error in a time, found by measuring a few bakes in the scene itself.
#pragma once

#include "report/cells.h"
#include "report/report.h"
#include "report/sweep.h"
#include "report/verify.h"
#include "solver/pilot.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::report {

/// At least one of both is given.
struct Goal {
    std::optional<double> error;   ///< relative, of irradiance at cells, at most
    std::optional<double> seconds; ///< of a bake without loading and writing, at most
};

/// The settings that bake chooses from: the rungs of the solvers' ladders, at order 2 and, where
/// there is an error to keep, at order 4. What `given` lists is as it has it, in one value each
/// (the solver in any number); all rows hold the same light. Throws Error as sweep_rows does, and
/// (argument) where an option has several values.
std::vector<SweepRow> candidate_rows(const Sweep& given, const Goal& goal,
                                     const bake::BakeSettings& base,
                                     solver::SolverKinds kinds = bake::solver_kinds());

/// Settings that may be tried.
struct Candidate {
    SweepRow row;
    double error = 0, seconds = 0; ///< expected
    std::string command;           ///< that bakes by them, as the caller has it
};

/// A bake of one of them.
struct Trial {
    std::size_t candidate = 0; ///< index
    Timing seconds;            ///< of bake(), without loading and writing
    MeasuredError error;       ///< of irradiance at the cells
    FieldError field;          ///< the same with the paths' noise in it, and energy
    FieldError projected;      ///< beside the truth's bands up to the bake's order
    std::vector<std::string> warnings;
};

/// What is known before the first bake.
struct Search {
    Goal goal;
    Grid grid;
    reference::PathRules rules;
    DrawnCells drawn;
    std::optional<solver::Pilot> pilot; ///< of the scene, where there is an error to keep
    std::vector<Candidate> candidates;
    double truth_seconds = 0; ///< expected
    double least_seconds = 0; ///< expected of the truth and the bakes of the first candidate
    double most_seconds = 0;  ///< and of all that may follow
};

/// At most so many candidates are baked.
inline constexpr std::size_t most_trials = 6;

/// Plans, runs a pilot, draws, and looks with a few paths how long the truth will take. Throws
/// Error as plan_bake (memory only where no row fits) and draw_cells do.
Search begin_search(const Scene& scene, const std::vector<SweepRow>& rows, const Goal& goal,
                    const ReportSettings& settings, const gpu::Device& device, Progress& progress);

struct SearchResult {
    Truth truth;
    std::array<FieldError, 3> floor; ///< what bands up to floor_orders cost
    std::vector<Trial> trials;       ///< in their order
    std::size_t best = 0;            ///< index of the one that keeps the goal, or comes nearest
    bool found = false;              ///< it keeps it
};

/// Begins with the cheapest candidate that is expected to keep the goal, and learns from each trial
/// what to expect of the others: the error of a solver beside that of the bands, which the truth
/// tells, and its time, by what they were against what was expected. Ends with the first that keeps
/// the goal with the upper end of its error's interval and with the median of its times.
SearchResult search(const Scene& scene, const Search& search, const ReportSettings& settings,
                    const gpu::Device& device, Progress& progress);

} // namespace lpvbake::report
