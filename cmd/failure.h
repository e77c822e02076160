// What the program says of a command that fails.
#pragma once

#include "options/command_line.h"

#include <exception>

namespace lpvbake::cmd {

/// Prints what was thrown as a line on standard error and, where the result would have been JSON
/// and is not there yet, as an object on standard output. Returns the exit code.
int fail_by(const std::exception_ptr& thrown, const options::Asked& asked);

} // namespace lpvbake::cmd
