// The written reference of a command, for people and for programs.
#pragma once

#include "options/command_line.h"

#include <nlohmann/json.hpp>

#include <string>

namespace lpvbake::cmd::options {

/// Name, summary, manual and options of a command: see lpvbake help --help.
nlohmann::ordered_json reference_json(const Command& command);

/// The same as a section of a page in Markdown, with a table for each group of options.
std::string reference_markdown(const Command& command);

} // namespace lpvbake::cmd::options
