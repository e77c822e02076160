// Option files: TOML, whose keys are options, before the first header of all commands that have
// them, in a command's table of that alone.
#pragma once

#include "options/option.h"

#include <map>
#include <set>
#include <string>
#include <vector>

namespace lpvbake::cmd::options {

/// The options of each command, by its name.
using CommandOptions = std::map<std::string, const Options*>;

/// Sets what is not given yet, nor excluded by what is, from several files, of which the later win,
/// as a command's table does over what stands before it. Throws Error (file, argument: names file,
/// line and key, in whichever table).
void read_options(const std::vector<std::string>& paths, const std::string& command,
                  const CommandOptions& commands, Options& options);

/// Sets what is not given yet, nor excluded by what is, of some groups, from what Options::recorded
/// returned. Throws Error (invalid) that begins with `place`.
void read_recorded(const std::string& recorded, const std::string& place,
                   const std::set<std::string>& groups, Options& options);

/// "; did you mean --resolution?", or nothing where no word is near. A beginning is near too.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix = "");

} // namespace lpvbake::cmd::options
