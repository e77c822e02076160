// lpvbake COMMAND ...: turns what a command throws into one line and an exit code.

#include "commands.h"
#include "exit_code.h"
#include "options/wording.h"
#include "terminal.h"

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>

namespace lpvbake::cmd {
namespace {

int fail(ErrorKind kind, const std::string& text) {
    std::fprintf(stderr, "lpvbake: error: %s\n", on_one_line(options::in_options(text)).c_str());
    return int(exit_code_of(kind));
}

} // namespace
} // namespace lpvbake::cmd

int main(int argc, char** argv) {
    using namespace lpvbake;
    std::signal(SIGXFSZ, SIG_IGN); // a file past its limit is an error like a full disk
    try {
        cmd::options::run_command_line(cmd::all_commands(), {argv + 1, argv + argc});
        cmd::finish_stdout();
        return 0;
    } catch (const Error& error) {
        return cmd::fail(error.kind, error.what());
    } catch (const std::bad_alloc&) {
        return cmd::fail(ErrorKind::memory, "out of memory; a lower --resolution needs less");
    } catch (const std::exception& error) {
        return cmd::fail(ErrorKind::failure, error.what());
    }
}
