// What the places of a part of space see, and the lists of what they gather.
#pragma once

#include "solver/gather/clusters.h"
#include "solver/gather/layout.h"
#include "solver/gather/look_layout.h"
#include "solver/gather/sky_bins.h"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace lpvbake::solver::gather {

/// Frame units along the edge of a zone.
inline constexpr int zone_edge = 16;

/// What all zones share.
struct Surroundings {
    const visibility::Visibility& visibility;
    const Clusters& clusters;
    const std::vector<SkyBin>& sky;
    int vpls;
    float kappa;
};

/// Sources of a job, in the kernel's words.
struct Sources {
    std::vector<glm::vec4> points, triangles, bins;
    void clear();
};

/// A number for each place of the frame that spreads over all 32 bits whatever the stride between
/// places: it chooses what is tested from there.
uint32_t pattern_of(glm::vec3 place);

/// The shader by which a device looks from places for itself (look.rgen).
std::span<const uint32_t> look_program();

/// Places that test the same clusters and bins of sky for visibility: those among which the light
/// that reaches them is spread most evenly. Each tests one point of each, by its pattern, so that
/// penumbrae are right on average.
class Zone {
public:
    /// All places lie in the box, frame units, about a `step` apart.
    Zone(const Surroundings& world, glm::vec3 lo, glm::vec3 hi, float step = 1.0f);

    /// Of what a place sees: a bit a cluster, then a bin, in planes.
    size_t words() const { return words_ * planes_; }
    /// A place that looks `from` a point at the sources in `open` (of one plane; empty: all), to
    /// set the bits (of words(), 0 before) of those that it sees: by chance, as much as passes.
    struct Look {
        glm::vec3 from;
        uint32_t pattern;
        std::span<const uint64_t> open;
        uint64_t* sees;

        bool opens(uint32_t source) const {
            return open.empty() || (open[source / 64] >> (source % 64) & 1) != 0;
        }
    };
    /// How many places weigh the points of clusters at once, at most.
    static constexpr size_t most_looks = 16;
    /// Each as if it looked alone; together they weigh the points of clusters in less time, and are
    /// given to a caster at once, which weighs them itself. Returns how many rays it took.
    uint64_t look(std::span<const Look> places) const;
    /// How many places a caster is given at once, where there is one that looks; 0: there is none,
    /// as in air, or it has no room for so many clusters.
    size_t together() const;
    uint64_t look(glm::vec3 from, uint32_t pattern, std::span<const uint64_t> open,
                  uint64_t* sees) const {
        const Look place{from, pattern, open, sees};
        return look({&place, 1});
    }

    /// Appends the points and triangles of up to eight places by what they see, lane by lane; their
    /// light is taken at `points`.
    void gather_surfaces(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                         Sources& sources) const;
    /// The same sources, with the light of up to pass_layers layers from `first` on.
    void gather_layers(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                       size_t first, Sources& sources) const;
    /// As gather_surfaces, for the bins of sky; or for those of a layer.
    void gather_sky(std::span<const uint64_t* const> sees, int order, Sources& sources,
                    std::optional<size_t> layer = {}) const;

protected:
    const Surroundings& world_;
    std::vector<uint32_t> clusters_;
    size_t channels_ = 1; ///< of a place's bits, a plane each: 3 where something tints
    size_t planes_ = 1;   ///< and, where something is a veil, one of what is seen by chance
    size_t words_ = 0;    ///< of a plane

private:
    uint32_t sources() const { return uint32_t(clusters_.size() + world_.sky.size()); }
    /// The points of a cluster that places may test, coordinate by coordinate, so that all are
    /// weighed at once.
    struct alignas(16) Targets {
        std::array<std::array<float, strata>, 3> point, normal;
    };

    void choose_clusters(glm::vec3 centre, glm::vec3 half, float step);
    bool aim(glm::vec3 from, uint32_t source, uint32_t pattern, visibility::Ray& ray,
             float& threshold) const;
    struct Lanes;
    void aim(uint32_t source, Lanes& eight) const;
    struct Tests;
    void find_tests(std::span<const Look> places, std::span<Tests> tests) const;
    uint64_t ask(std::span<const Look> places, std::span<const Tests> tests) const;
    std::vector<glm::uvec4> given_to_look(std::span<const Look> places,
                                          std::span<const uint32_t> asked) const;
    uint64_t look_on_device(std::span<const Look> places, std::span<Tests> tests) const;
    void set(const Look& place, size_t plane, uint32_t source) const {
        place.sees[plane * words_ + source / 64] |= uint64_t(1) << (source % 64);
    }
    void set_seen(const Look& place, const Tests& tests, std::span<const glm::vec3> passed) const;
    /// Which of some places see a source, a channel: all channels of `all`, and one more of each.
    struct Masks {
        uint32_t all = 0;
        std::array<uint32_t, 3> one{};
        bool operator==(const Masks&) const = default;
    };
    Masks masks_of(std::span<const uint64_t* const> sees, size_t source) const;
    /// take(cluster, is_point, mask, channels) each cluster that the places gather, as a point or
    /// as a triangle.
    template <class Take>
    void each_seen(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                   const Take& take) const;
    template <class Take>
    void descend(uint32_t cluster, uint32_t mask, glm::vec3 channels, glm::vec3 centre,
                 glm::vec3 half, const Take& take) const;

    std::vector<Targets> targets_; ///< a cluster
};

} // namespace lpvbake::solver::gather
