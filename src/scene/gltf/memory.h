// A limit on the memory that a file may make its loader take.
#pragma once

#include "lpvbake/error.h"

#include <cstdint>
#include <limits>
#include <string>

namespace lpvbake::scene::gltf {

/// Sums what is about to be allocated. Asked before every allocation whose size a file decides, by
/// one thread, so that whoever asks for too much is the same one in every run.
class MemoryLimit {
public:
    MemoryLimit(std::string file, uint64_t bytes) : file_(std::move(file)), limit_(bytes) {}

    /// `count` elements of `size` bytes for what stands at `place`. Throws Error (memory).
    void take(uint64_t count, uint64_t size, const std::string& place) {
        constexpr uint64_t most = std::numeric_limits<uint64_t>::max();
        const uint64_t bytes = size != 0 && count > most / size ? most : count * size;
        if (bytes > limit_ - taken_)
            throw Error(ErrorKind::memory,
                        file_ + ": " + place + ": would take the scene past "
                            + std::to_string(limit_ >> 20)
                            + " MiB of memory; allow more with `max_memory` or simplify the scene");
        taken_ += bytes;
    }

    uint64_t limit() const { return limit_; }
    uint64_t left() const { return limit_ - taken_; }

private:
    std::string file_;
    uint64_t limit_;
    uint64_t taken_ = 0;
};

} // namespace lpvbake::scene::gltf
