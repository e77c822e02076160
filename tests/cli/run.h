// Runs the program as a shell does.
#pragma once

#include "unit/volumes.h"

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
/// shipped Cornell box.
inline CliResult run_lpvbake(const TemporaryFolder& folder, const std::string& arguments) {
    const std::string command = "cd '" + folder.path().string()
                                + "' && ROOM='" LPVBAKE_EXAMPLES
                                  "/cornell_box.gltf' && '" LPVBAKE_BINARY "' "
                                + arguments + " > stdout 2> stderr";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000, slurp(folder / "stdout"),
            slurp(folder / "stderr")};
}

} // namespace lpvbake
