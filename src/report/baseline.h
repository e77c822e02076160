// Numbers of an earlier report, kept in a file, and what has become worse since.
#pragma once

#include "report/report.h"
#include "report/suite.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::report {

/// Numbers of a row by their names: "error", "surface", the readers', "leak", ... are the better
/// the smaller, as is "seconds"; "energy" is a ratio that is best at 1. All are finite.
using BaselineRow = std::map<std::string, double>;
/// By "SCENE: ROW", or "CASE: SOLVER".
using Baseline = std::map<std::string, BaselineRow>;

Baseline baseline_of(const Report& report);
Baseline baseline_of(const std::vector<SuiteRow>& rows);

/// Throws Error: file, invalid (names file and row).
Baseline load_baseline(const std::string& path);
/// Sorted by name, a row a line. Throws Error (file).
void save_baseline(const std::string& path, const Baseline& baseline);

/// How much worse a number may be: by a share of it, and by 5e-4 anyway.
struct BaselineSlack {
    double errors = 0.02;
    std::optional<double> seconds; ///< none: times are not compared
};

struct BaselineComparison {
    uint64_t compared = 0, added = 0; ///< rows that the baseline has, and has not
    /// "room.glb: sn 32: error is 0.0612, was 0.0546", a text for each number that is worse, or
    /// gone.
    std::vector<std::string> worse;
};

/// Compares the rows that both have.
BaselineComparison compare_baselines(const Baseline& kept, const Baseline& now,
                                     const BaselineSlack& slack);

} // namespace lpvbake::report
