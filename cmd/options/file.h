// Option files, for a command's options.
#pragma once

#include "options/option.h"

#include <string>
#include <vector>

namespace lpvbake::cmd::options {

/// Sets what is not given yet, nor excluded by what is. Throws Error (file, argument: names file,
/// line and key).
void read_options(const std::string& path, const std::string& command, Options& options);

/// "; did you mean --resolution?", or nothing where no word is near. A beginning is near too.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix = "");

} // namespace lpvbake::cmd::options
