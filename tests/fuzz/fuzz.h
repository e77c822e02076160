// What fuzzers share: files to read from, and what may happen to them.
#pragma once

#include "lpvbake/error.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

#include <unistd.h>

namespace lpvbake::fuzz {

/// A folder of the process's own, in memory where the system has such, gone at its end.
class Folder {
public:
    Folder() {
        std::error_code ignored;
        std::string name = std::filesystem::is_directory("/dev/shm", ignored)
                               ? "/dev/shm/lpvbake-fuzz-XXXXXX"
                               : "/tmp/lpvbake-fuzz-XXXXXX";
        if (!mkdtemp(name.data()))
            std::abort();
        path_ = name;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }

    /// Replaces a file and returns its path.
    std::string write(const char* name, std::string_view bytes) const {
        const std::string path = path_ / name;
        std::ofstream(path, std::ios::binary | std::ios::trunc)
            .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
        return path;
    }

    static const fuzz::Folder& own() {
        static const fuzz::Folder folder;
        return folder;
    }

private:
    std::filesystem::path path_;
};

/// Aborts, which the fuzzer reports, unless `ok`.
inline void require(bool ok, const char* what) {
    if (ok)
        return;
    std::fprintf(stderr, "does not hold: %s\n", what);
    std::abort();
}

/// Runs f. Input may be refused, by an Error that blames the input and tells why; whatever else is
/// thrown is a finding. Returns true if nothing was.
template <class F>
bool accepts(const F& f) {
    try {
        f();
        return true;
    } catch (const Error& error) {
        fuzz::require(error.kind != ErrorKind::failure, "bad input is no failure of the program");
        fuzz::require(std::string_view(error.what()).size() > 8, "an error says what is wrong");
        return false;
    }
}

} // namespace lpvbake::fuzz
