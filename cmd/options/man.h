// Manual pages, in the macros of man(7).
#pragma once

#include "options/command_line.h"

#include <string>

namespace lpvbake::cmd::options {

/// lpvbake(1): what there is, and the exit codes.
std::string man_page(const Commands& commands);

/// lpvbake-COMMAND(1).
std::string man_page(const Command& command);

} // namespace lpvbake::cmd::options
