// What the cells of a part of the grid see, and the lists of what they gather.
#pragma once

#include "solver/gather/clusters.h"
#include "solver/gather/layout.h"
#include "solver/gather/sky_bins.h"
#include "volume/grid.h"

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace lpvbake::solver::gather {

/// Cells along the edge of a zone.
inline constexpr int zone_edge = 16;

/// Where surfaces are: box (i, j, k) of level n spans the centres of cells i 2^n to (i + 1) 2^n
/// along x and so on.
class Occupied {
public:
    Occupied(const std::vector<surface::Patch>& patches, const Grid& grid);
    /// True if a surface may cross the box from cell `lo` to lo + 2^level; lo a multiple of that.
    bool operator()(glm::ivec3 lo, int level) const;

private:
    std::vector<Grid> grids_;
    std::vector<std::vector<uint8_t>> levels_;
};

/// What all zones share.
struct Surroundings {
    const Grid& grid;
    const visibility::Visibility& visibility;
    const Clusters& clusters;
    const std::vector<SkyBin>& sky;
    const Occupied& occupied;
    std::span<const float> validity;
    int vpls;
    float kappa;
};

/// Sources of a job, in the kernel's words.
struct Sources {
    std::vector<glm::vec4> points, triangles, bins;
    void clear();
};

/// A cube of cells that tests the same clusters and bins of sky for visibility: those among which
/// the light that reaches it is spread most evenly. A cell tests one point of each, another one
/// than its neighbours, so that penumbrae are right on average; where the corners of a cube of
/// cells agree, the cells inside take their answer.
class Zone {
public:
    Zone(const Surroundings& world, glm::ivec3 base);

    uint64_t rays() const { return rays_; }

    /// Finds out what a cell (of this zone) sees.
    void test_visibility(glm::ivec3 cell) { bits(cell - base_); }
    /// Appends the points and triangles of up to eight cells that were tested, lane by lane; their
    /// light is taken at `points`.
    void gather_surfaces(std::span<const glm::ivec3> cells, std::span<const glm::vec3> points,
                         Sources& sources) const;
    /// The same for the bins of sky.
    void gather_sky(std::span<const glm::ivec3> cells, int order, Sources& sources) const;

private:
    /// A point of a cluster that a cell may test.
    struct Target {
        glm::vec3 point, normal;
    };

    void choose_clusters();
    size_t slot(glm::ivec3 point) const;
    const uint64_t* bits(glm::ivec3 point);
    bool usable(glm::ivec3 point) const;
    bool aim(glm::vec3 from, uint32_t source, uint32_t pattern, visibility::Ray& ray,
             float& threshold) const;
    void test(glm::ivec3 point, const std::vector<uint64_t>& open, uint64_t* own);
    /// Which of some cells see a source, a channel: all channels of `all`, and one more of each.
    struct Masks {
        uint32_t all = 0;
        std::array<uint32_t, 3> one{};
        bool operator==(const Masks&) const = default;
    };
    Masks masks_of(std::span<const glm::ivec3> cells, size_t source) const;
    void descend(uint32_t cluster, uint32_t mask, glm::vec3 channels, glm::vec3 centre,
                 glm::vec3 half, Sources& sources) const;

    const Surroundings& world_;
    glm::ivec3 base_, dims_;
    std::vector<uint32_t> clusters_;
    std::vector<Target> targets_;
    size_t channels_ = 1;         ///< of a cell's bits, a plane each: 3 where something tints
    size_t planes_ = 1;           ///< and, where something is a veil, one of what is seen by chance
    size_t words_ = 0;            ///< of a plane
    std::vector<uint16_t> known_; ///< a point: 1 + its place in bits_, or 0
    std::vector<std::unique_ptr<uint64_t[]>> bits_; ///< bit i: cluster i, then the bins
    uint64_t rays_ = 0;

    /// Tests of one cell: the source, and what has to pass for it to be seen.
    struct Test {
        uint32_t source;
        float threshold;
    };
    std::vector<Test> tests_;
    std::vector<visibility::Ray> ways_;
    std::vector<glm::vec3> passes_;
};

} // namespace lpvbake::solver::gather
