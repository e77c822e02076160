// The rows of a suite as lines for people and as `lpvbake report --help` documents them.
#pragma once

#include "report/suite.h"

#include <nlohmann/json_fwd.hpp>

#include <string>

namespace lpvbake::report {

/// `width`: letters of the longest name of a case.
std::string suite_head(std::size_t width);
std::string suite_line(const SuiteRow& row, std::size_t width);

nlohmann::ordered_json suite_row_json(const SuiteRow& row);

/// SuiteRow::failures in a line.
std::string failures_text(const SuiteRow& row);

} // namespace lpvbake::report
