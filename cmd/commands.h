// The subcommands.
#pragma once

#include "options/command_line.h"

namespace lpvbake::cmd {

options::Command bake_command();
options::Command light_command();
options::Command rebake_command();
options::Command reference_command();
options::Command info_command();
options::Command render_command();
options::Command verify_command();
options::Command diff_command();
options::Command convert_command();
options::Command mix_command();
options::Command merge_command();
options::Command report_command();
options::Command world_command();
options::Command devices_command();
options::Command help_command();

/// In the order of --help.
inline options::Commands all_commands() {
    return {bake_command(),    light_command(),   rebake_command(), reference_command(),
            info_command(),    render_command(),  verify_command(), diff_command(),
            convert_command(), mix_command(),     merge_command(),  world_command(),
            report_command(),  devices_command(), help_command()};
}

} // namespace lpvbake::cmd
