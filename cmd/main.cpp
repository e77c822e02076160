// lpvbake COMMAND ...: turns what a command throws into one line and an exit code.

#include "background.h"
#include "commands.h"
#include "exit_code.h"
#include "options/wording.h"
#include "terminal.h"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>

#include <unistd.h>

namespace lpvbake::cmd {
namespace {

int fail(ErrorKind kind, const std::string& text) {
    std::fprintf(stderr, "lpvbake: error: %s\n", on_one_line(options::in_options(text)).c_str());
    return int(exit_code_of(kind));
}

/// Says what was thrown, and returns the exit code.
int fail_by(const std::exception_ptr& thrown) {
    try {
        std::rethrow_exception(thrown);
    } catch (const Error& error) {
        return fail(error.kind, error.what());
    } catch (const std::bad_alloc&) {
        std::fputs("lpvbake: error: out of memory; a lower --resolution needs less\n", stderr);
        return int(ExitCode::memory);
    } catch (const std::exception& error) {
        return fail(ErrorKind::failure, is_want_of_threads(error) ? want_of_threads : error.what());
    } catch (...) {
        return fail(ErrorKind::failure, "something was thrown that is no exception");
    }
}

/// Where what was thrown cannot get to main: out of a library that is being loaded (log4cplus,
/// which OpenVDB brings, starts threads then), a destructor, a thread.
void end_at_once() {
    if (const std::exception_ptr thrown = std::current_exception())
        _exit(fail_by(thrown));
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
    try {
        cmd::options::run_command_line(cmd::all_commands(), {argv + 1, argv + argc});
        cmd::finish_stdout();
        return 0;
    } catch (...) {
        return cmd::fail_by(std::current_exception());
    }
}
