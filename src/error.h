// The one exception type of the program, and the exit codes that it carries to the edge.
#pragma once

#include <stdexcept>
#include <string>

namespace lpvbake {

/// What the process returns. `lpvbake --help` prints this table.
enum class ExitCode {
    ok = 0,
    usage = 1,
    file = 2,
    invalid = 3,
    failure = 4,
    unsupported = 5,
    difference = 7,
    device = 8,
    memory = 9,
    interrupted = 130,
    terminated = 143,
};

struct ExitCodeMeaning {
    ExitCode code;
    const char* meaning;
};

inline constexpr ExitCodeMeaning exit_codes[] = {
    {ExitCode::ok, "done"},
    {ExitCode::usage, "the command line is wrong"},
    {ExitCode::file, "a file cannot be read or written"},
    {ExitCode::invalid, "the input is invalid"},
    {ExitCode::failure, "something failed while running"},
    {ExitCode::unsupported, "the input needs a feature that is not supported (it is named)"},
    {ExitCode::difference, "a difference was found"},
    {ExitCode::device, "the Vulkan device is missing or was lost"},
    {ExitCode::memory, "out of memory"},
    {ExitCode::interrupted, "interrupted (SIGINT)"},
    {ExitCode::terminated, "terminated (SIGTERM)"},
};

/// A failure with the exit code it ends in. The text is one line that names the file, the place in
/// it and the remedy.
class Error : public std::runtime_error {
public:
    Error(ExitCode exit_code, const std::string& text)
        : std::runtime_error(text), code(exit_code) {}
    ExitCode code;
};

} // namespace lpvbake
