// What shells complete command lines by.
#pragma once

#include "options/command_line.h"

#include <string>

namespace lpvbake::cmd::options {

/// A script for bash, to be sourced or to lie in share/bash-completion/completions/lpvbake.
std::string bash_completion(const Commands& commands);
/// For zsh: _lpvbake along its fpath.
std::string zsh_completion(const Commands& commands);
/// For fish: lpvbake.fish in a folder of completions.
std::string fish_completion(const Commands& commands);

} // namespace lpvbake::cmd::options
