// The hard cases: scenes that break naive code, with what is true of each.
#pragma once

#include <string>

namespace lpvbake::scenes {

/// Writes the scenes as glTF and `suite.json` into a folder that is there.
void write_hard_cases(const std::string& folder);

} // namespace lpvbake::scenes
