// The subcommands.
#pragma once

#include "options/command_line.h"

namespace lpvbake {

Command bake_command();
Command reference_command();
Command info_command();
Command render_command();
Command diff_command();
Command convert_command();
Command report_command();
Command devices_command();
Command help_command();

/// In the order of --help.
inline Commands all_commands() {
    return {bake_command(),   reference_command(), info_command(),
            render_command(), diff_command(),      convert_command(),
            report_command(), devices_command(),   help_command()};
}

} // namespace lpvbake
