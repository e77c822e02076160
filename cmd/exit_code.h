// What the process returns.
#pragma once

#include "lpvbake/error.h"

#include <optional>

namespace lpvbake::cmd {

enum class ExitCode {
    ok = 0,
    usage = 1,
    file = 2,
    invalid = 3,
    failure = 4,
    unsupported = 5,
    io = 6,
    difference = 7,
    device = 8,
    memory = 9,
    interrupted = 130,
    terminated = 143,
};

struct ExitCodeMeaning {
    ExitCode code;
    std::optional<ErrorKind> error; ///< the kind of error that ends in it
    const char* name;               ///< of that kind
    const char* meaning;
    bool again = false; ///< the same command may do another time
};

/// `lpvbake --help` prints this table.
inline constexpr ExitCodeMeaning exit_codes[] = {
    {ExitCode::ok, std::nullopt, "", "done"},
    {ExitCode::usage, ErrorKind::argument, "argument", "the command line is wrong"},
    {ExitCode::file, ErrorKind::file, "file", "a file is not there, or is none"},
    {ExitCode::invalid, ErrorKind::invalid, "invalid", "the input is invalid"},
    {ExitCode::failure, ErrorKind::failure, "failure", "something failed while running"},
    {ExitCode::unsupported, ErrorKind::unsupported, "unsupported",
     "the input needs a feature that is not supported (it is named)"},
    {ExitCode::io, ErrorKind::io, "io",
     "the system does not read or write (no space, no permission, a fault)", true},
    {ExitCode::difference, ErrorKind::difference, "difference", "a difference was found"},
    {ExitCode::device, ErrorKind::device, "device", "the Vulkan device is missing or was lost",
     true},
    {ExitCode::memory, ErrorKind::memory, "memory",
     "out of memory; less is needed with a lower --resolution", true},
    {ExitCode::interrupted, ErrorKind::interrupted, "interrupted", "interrupted (SIGINT)", true},
    {ExitCode::terminated, ErrorKind::terminated, "terminated", "terminated (SIGTERM)", true},
};

constexpr const ExitCodeMeaning& meaning_of(ErrorKind kind) {
    for (const ExitCodeMeaning& row : exit_codes)
        if (row.error == kind)
            return row;
    return meaning_of(ErrorKind::failure);
}

} // namespace lpvbake::cmd
