// The sweep where the device is the host's CPU, on all its threads: as the kernels have it, to the
// bit, but a cell's directions are projected while they are in its caches, and lanes are cells that
// lie side by side, which takes a fifth of the time.
#pragma once

#include "solver/sn/sweeper.h"

#include <array>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

class HostSweeper final : public Sweeper {
public:
    /// `directions` of a course are swept at once. The grid outlives it.
    HostSweeper(const Grid& grid, uint32_t directions, int order);

    void begin(const Course& course, const Directions& directions,
               std::span<const glm::vec4> beyond) override;
    void run(const PlaneOrder& order, const Chunk& chunk) override;
    void add_to(const Grid& grid, glm::ivec3 at, std::vector<std::vector<glm::vec3>>& sh) override;

private:
    void carry(int v);
    void put_given(const PlaneOrder& order, const Chunk& chunk, int plane, int v);
    void project(int plane, int v);
    /// Where the luminance of a row starts, -1 <= v <= cells along v: a channel after the other of
    /// each direction, of `pitch_` places along u each, the first of which lies before the grid.
    float* row(std::vector<float>& plane, int v) const {
        return &plane[size_t(v + 1) * directions_ * 3 * pitch_];
    }

    const Grid& grid_;
    size_t directions_, coefficients_;
    const Course* course_ = nullptr;
    const Directions* table_ = nullptr;
    size_t pitch_ = 0;
    std::vector<float> sums_;          ///< of the coefficients: [cell][3 * coefficient + channel]
    std::vector<float> before_, here_; ///< planes
};

/// Directions of a course, of `directions` over the sphere, that are swept at once: all, or of each
/// quadrant as many as the planes of a flat grid leave room for.
uint32_t host_directions(const Grid& grid, int directions);

/// Host memory, bytes.
uint64_t host_sweep_bytes(const Grid& grid, int directions, int order);

} // namespace lpvbake::solver::sn
