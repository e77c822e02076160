// lpvbake COMMAND ...: turns what a command throws into one line and an exit code.

#include "commands.h"
#include "failure.h"
#include "terminal.h"

#include <csignal>
#include <cstdlib>
#include <exception>

#include <unistd.h>

namespace lpvbake::cmd {
namespace {

/// Where what was thrown cannot get to main: out of a library that is being loaded (log4cplus,
/// which OpenVDB brings, starts threads then), a destructor, a thread.
void end_at_once() {
    if (const std::exception_ptr thrown = std::current_exception())
        _exit(fail_by(thrown, {}));
    std::abort();
}

void watch_terminate(int, char**, char**) {
    std::set_terminate(end_at_once);
}

/// Called before the libraries' own initializers (System V ABI, "Initialization and Termination
/// Functions").
[[gnu::section(".preinit_array"), gnu::used]] void (*const first_of_all)(int, char**,
                                                                         char**) = watch_terminate;

} // namespace
} // namespace lpvbake::cmd

int main(int argc, char** argv) {
    using namespace lpvbake;
    std::signal(SIGXFSZ, SIG_IGN); // a file past its limit is an error like a full disk
    cmd::options::Asked asked;
    try {
        cmd::options::run_command_line(cmd::all_commands(), {argv + 1, argv + argc}, asked);
        cmd::finish_stdout();
        return 0;
    } catch (...) {
        return cmd::fail_by(std::current_exception(), asked);
    }
}
