// What `bake` does, for `rebake` too.
#pragma once

#include "bake_options.h"

namespace lpvbake::cmd {

/// Bakes, writes the outputs and prints the result. `options` are those of add_bake_options, which
/// `o` was read by. Throws Error.
void run_bake(BakeOptions o, const options::Options& options);

} // namespace lpvbake::cmd
