// report --suite: runs a suite of hard cases and prints its table.
#pragma once

#include "baseline.h"
#include "report/suite.h"
#include "scene_options.h"

#include <string>

namespace lpvbake::cmd {

struct SuiteRun {
    std::string suite; ///< path
    report::SuiteSelection selection;
    BaselineOptions baseline;
};

/// Throws Error: what load_suite and run_suite throw, difference if a limit does not hold.
void run_suite(const SuiteRun& run, const RunOptions& o);

} // namespace lpvbake::cmd
