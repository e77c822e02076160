// Runs the program as a shell does.
#pragma once

#include "exit_code.h"
#include "unit/volumes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include <sys/wait.h>

namespace lpvbake {

struct CliResult {
    int status = -1; ///< 1000: ended by a signal
    std::string out;
    std::string err;
};

/// Runs `lpvbake ARGUMENTS` in a folder; the arguments are words of a shell, in which $ROOM is the
/// shipped Cornell box. `environment` is words as NAME=VALUE.
inline CliResult run_lpvbake(const TemporaryFolder& folder, const std::string& arguments,
                             const std::string& environment = "") {
    const std::string command =
        "cd '" + folder.path().string() + "' && ROOM='" LPVBAKE_EXAMPLES "/cornell_box.gltf' && "
        + environment + " '" LPVBAKE_BINARY "' " + arguments + " > stdout 2> stderr";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000, slurp(folder / "stdout"),
            slurp(folder / "stderr")};
}

/// Expects a status and one line on standard error that contains `text`, and no result.
inline void expect_one_error(const CliResult& result, const std::string& arguments,
                             cmd::ExitCode code, const std::string& text) {
    EXPECT_EQ(result.status, int(code)) << arguments << "\n" << result.err;
    EXPECT_EQ(result.out, "") << arguments;
    EXPECT_EQ(result.err.find("lpvbake: error: "), 0u) << arguments << "\n" << result.err;
    EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
    EXPECT_NE(result.err.find(text), std::string::npos) << arguments << "\n" << result.err;
}

} // namespace lpvbake
