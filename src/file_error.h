// Which kind of error the system's word on a file is.
#pragma once

#include "lpvbake/error.h"

#include <cerrno>

namespace lpvbake {

/// Of an `errno`: ErrorKind::file where the path leads to no file, ErrorKind::io for all else,
/// which may go well another time.
constexpr ErrorKind kind_of_file_error(int code) {
    for (const int wrong_path : {ENOENT, ENOTDIR, EISDIR, ENAMETOOLONG, ELOOP})
        if (code == wrong_path)
            return ErrorKind::file;
    return ErrorKind::io;
}

} // namespace lpvbake
