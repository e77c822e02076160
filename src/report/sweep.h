// Which bakes a report measures.
#pragma once

#include "bake/bake.h"

#include <string>
#include <utility>
#include <vector>

namespace lpvbake {

/// An option of bake with the values that it takes in turn.
struct SweepAxis {
    std::string option; ///< long name without dashes: see sweep_options()
    std::vector<std::string> values;
};

/// Every combination of its axes' values.
using Sweep = std::vector<SweepAxis>;

/// One bake of a report.
struct SweepRow {
    BakeSettings settings;
    /// What sets it apart, as bake's command line has it: option without dashes, value.
    std::vector<std::pair<std::string, std::string>> options;
};

/// At most so many rows make a report.
inline constexpr std::size_t most_rows = 1000;

/// The options that a sweep can set.
std::vector<std::string> sweep_options();

/// Throws Error (usage) that names option and value unless this is an option with a value that it
/// takes.
void check_sweep_value(const std::string& option, const std::string& value);

/// Each occlusion mode of lpv and each quality of the others at 16, 32 and 64 cells, one bounce; and at
/// 32 cells a propagation that is cut off after 16 steps, and reflective shadow maps of a quarter
/// of the usual texels.
std::vector<Sweep> default_sweeps();

/// The rows of all sweeps in order, the last axis of each running fastest; a row that was there
/// before is left out. All start from `base`. Throws Error (usage): see check_sweep_value; more
/// than most_rows rows; an axis without values or given twice.
std::vector<SweepRow> sweep_rows(const std::vector<Sweep>& sweeps, const BakeSettings& base);

} // namespace lpvbake
