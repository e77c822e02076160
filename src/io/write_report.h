// What became of a volume that was written.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake {

enum class Precision { full, half };

/// What became of a request that could not be met to the letter.
struct WriteReport {
    struct File {
        std::string path;
        uint64_t bytes = 0;
    };
    /// Such as: half asked for, but values exceed 65504, wrote float.
    std::vector<std::string> warnings;
    std::vector<File> files;
    Precision precision = Precision::full; ///< that of the files
    /// Of an EXR: tiles a row and rows; else 0.
    int columns = 0, rows = 0;

    uint64_t bytes() const {
        uint64_t sum = 0;
        for (const File& file : files)
            sum += file.bytes;
        return sum;
    }
};

} // namespace lpvbake
