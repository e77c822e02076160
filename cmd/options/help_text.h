// What --help prints.
#pragma once

#include "options/command_line.h"

#include <string>

namespace lpvbake::cmd::options {

/// The terminal's columns, at most 100; 100 where standard output is none.
std::size_t help_width();

/// Of all commands, in lines of at most `width` characters.
std::string overview_text(const Commands& commands, std::size_t width);

/// Of one command: examples, options, and how it works. Examples, which are to be copied, and names
/// of options stay whole.
std::string help_text(const Command& command, const Options& options, std::size_t width);

/// The JSON documents that the command reads and writes; empty: none.
std::string documents_of(const Command& command);

} // namespace lpvbake::cmd::options
