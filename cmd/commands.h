// The subcommands: each declares its options and says what to do once they are parsed.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lpvbake {

/// What the command line asked for. Parsing sets it, main runs it. Throws Error.
using Action = std::function<void()>;

void add_bake(CLI::App& root, Action& action);
void add_reference(CLI::App& root, Action& action);
void add_info(CLI::App& root, Action& action);
void add_render(CLI::App& root, Action& action);
void add_diff(CLI::App& root, Action& action);
void add_convert(CLI::App& root, Action& action);
void add_report(CLI::App& root, Action& action);
void add_devices(CLI::App& root, Action& action);

} // namespace lpvbake
