// report --suite: runs a suite of hard cases and prints its table.
#pragma once

#include "report/suite.h"

#include <string>

namespace lpvbake {

struct SuiteRun {
    std::string suite; ///< path
    SuiteSelection selection;
    std::string device;
    int threads = 0;
    std::string format = "text";
    std::string progress = "auto";
};

/// What --help says of suites.
extern const char suite_manual[];

/// Throws Error: what load_suite and run_suite throw, difference if a limit does not hold.
void run_suite(const SuiteRun& run);

} // namespace lpvbake
