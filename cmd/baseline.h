// report --baseline: what became worse since.
#pragma once

#include "report/baseline.h"

#include <string>

namespace lpvbake::cmd {

/// What --baseline says.
struct BaselineOptions {
    std::string path; ///< empty: none
    bool update = false;
    report::BaselineSlack slack;
};

/// Throws Error before any work is done: what load_baseline throws; file (it cannot be written).
void check_baseline(const BaselineOptions& o);

/// Writes what is measured into the baseline, or compares it and tells of it. The reason to fail,
/// empty unless something became worse. Throws Error (file; argument: no row is in
/// both).
std::string judge_by_baseline(const BaselineOptions& o, const report::Baseline& now);

} // namespace lpvbake::cmd
