// What a look at some cells tells of a scene's light, and what solvers lose of it.
#pragma once

#include <array>

namespace lpvbake::solver {

/// What is lost of irradiance at cells, relative L1: by each limit alone, all else as fine as a
/// pilot has it.
struct Pilot {
    std::array<double, 2> bands{};    ///< with bands up to 1; up to 2
    std::array<double, 2> clusters{}; ///< with few_clusters that a cell tests; with more_clusters
    bool operator==(const Pilot&) const = default;
};

inline constexpr int few_clusters = 48, more_clusters = 192;

/// Of the bands up to `order`, even where they are exact.
double lost_bands(const Pilot& pilot, int order);

/// Of so many clusters: it falls with a power of their number, which the pilot tells.
double lost_clusters(const Pilot& pilot, int clusters);

} // namespace lpvbake::solver
