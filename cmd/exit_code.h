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

/// Whether the same command may do another time.
enum class Retry { never, once, again, more_memory };
inline constexpr const char* retry_names[] = {"never", "once", "again", "with more memory"};

struct ExitCodeMeaning {
    ExitCode code;
    std::optional<ErrorKind> error; ///< the kind of error that ends in it
    const char* name;               ///< of that kind
    const char* meaning;
    Retry retry = Retry::never;
};

/// `lpvbake --help` prints this table.
inline constexpr ExitCodeMeaning exit_codes[] = {
    {ExitCode::ok, std::nullopt, "", "done"},
    {ExitCode::usage, ErrorKind::argument, "argument", "the command line is wrong"},
    {ExitCode::file, ErrorKind::file, "file", "a file is not there, or is none", Retry::once},
    {ExitCode::invalid, ErrorKind::invalid, "invalid", "the input is invalid"},
    {ExitCode::failure, ErrorKind::failure, "failure", "something failed while running"},
    {ExitCode::unsupported, ErrorKind::unsupported, "unsupported",
     "the input needs a feature that is not supported (it is named)"},
    {ExitCode::io, ErrorKind::io, "io",
     "the system does not read or write (no space, no permission, a fault)", Retry::again},
    {ExitCode::difference, ErrorKind::difference, "difference", "a difference was found"},
    {ExitCode::device, ErrorKind::device, "device", "the Vulkan device is missing or was lost",
     Retry::again},
    {ExitCode::memory, ErrorKind::memory, "memory",
     "out of memory; less is needed with a lower --resolution", Retry::more_memory},
    {ExitCode::interrupted, ErrorKind::interrupted, "interrupted", "interrupted (SIGINT)",
     Retry::again},
    {ExitCode::terminated, ErrorKind::terminated, "terminated", "terminated (SIGTERM)",
     Retry::again},
};

constexpr const ExitCodeMeaning& meaning_of(ErrorKind kind) {
    for (const ExitCodeMeaning& row : exit_codes)
        if (row.error == kind)
            return row;
    return meaning_of(ErrorKind::failure);
}

} // namespace lpvbake::cmd
