// lpvbake COMMAND ...: finds the command, runs it, and turns what it throws into one line and an
// exit code.

#include "command_line.h"
#include "commands.h"
#include "exit_code.h"
#include "terminal.h"

#include <CLI/CLI.hpp>

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>

namespace lpvbake {
namespace {

const char summary[] =
    "Bakes the indirect light of a glTF scene into a grid of spherical harmonics, on Vulkan.\n"
    "Results go to standard output, everything else to standard error.\n";

std::string exit_code_table() {
    std::string table = "Exit codes:";
    for (const ExitCodeMeaning& row : exit_codes) {
        char line[128];
        std::snprintf(line, sizeof line, "\n  %3d  %s", int(row.code), row.meaning);
        table += line;
    }
    return table;
}

int fail(ErrorKind kind, const std::string& text) {
    std::fprintf(stderr, "lpvbake: error: %s\n", on_one_line(text).c_str());
    return int(exit_code_of(kind));
}

/// Parses and runs. Throws Error, and whatever a library throws.
int run(int argc, char** argv) {
    CLI::App root(summary, "lpvbake");
    Action action;
    root.require_subcommand(1);
    root.set_version_flag("--version", "lpvbake " LPVBAKE_VERSION);
    root.footer("lpvbake COMMAND --help explains a command.\n\n" + exit_code_table());
    add_bake(root, action);
    add_reference(root, action);
    add_info(root, action);
    add_render(root, action);
    add_diff(root, action);
    add_convert(root, action);
    add_report(root, action);
    add_devices(root, action);
    try {
        root.parse(argc, argv);
    } catch (const CLI::Success& wish) { // --help, --version
        root.exit(wish);
        finish_stdout();
        return 0;
    } catch (const CLI::ParseError& error) {
        throw Error(ErrorKind::argument, explain(root, error, {argv + 1, argv + argc}));
    }
    action();
    finish_stdout();
    return 0;
}

} // namespace
} // namespace lpvbake

int main(int argc, char** argv) {
    using namespace lpvbake;
    std::signal(SIGXFSZ, SIG_IGN); // a file past its limit is an error like a full disk
    try {
        return run(argc, argv);
    } catch (const Error& error) {
        return fail(error.kind, error.what());
    } catch (const std::bad_alloc&) {
        return fail(ErrorKind::memory, "out of memory; a lower --resolution needs less");
    } catch (const std::exception& error) {
        return fail(ErrorKind::failure, error.what());
    }
}
