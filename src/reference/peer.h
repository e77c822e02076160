// What a user would otherwise bake: path-traced probes, written for speed.
//
// The rays of a point are a spherical Fibonacci lattice (Marques et al. 2013) of N directions that
// is turned at random for each point, as in Majercik et al. 2019, but with every ray used once.
// They are traced in waves by packets of eight, in an order in which eight neighbours go the same
// way; at each reflection come shadow rays to the punctual lights, light by light, then all rays
// that go on. Single precision, no error estimate.
#pragma once

#include "reference/paths.h"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace lpvbake::reference {

/// For hits of one wave, their normals towards the side that was hit: the irradiance (RGB, lux)
/// that this side gets from all but the direct light of punctual lights. Called by several threads
/// at once.
using IndirectLookup =
    std::function<void(std::span<const visibility::Hit> hits, std::span<glm::vec3> irradiance)>;

struct PeerSettings {
    /// As of the reference. Emitters and the sky count where a ray meets them, and are not aimed
    /// at; the bright spots of a sky (see sky_suns) light surfaces as punctual lights do. Without a
    /// limit of bounces a path goes on with the probability of its throughput's largest channel
    /// from the second reflection on, up to 1000.
    PathRules paths;
    int sh_order = 1;        ///< 0 to 4
    uint32_t rays = 256;     ///< from each point, 1 to 2^24
    uint64_t seed = 1;       ///< another one gives an independent estimate
    bool irradiance = false; ///< PeerField::irradiance is wanted
    /// If set, paths end at their first hit, which reflects this besides the punctual lights' light
    /// (such as a radiosity solution): probes that share a solver's bounces. paths.bounces then
    /// only tells whether anything is reflected at all.
    IndirectLookup indirect;
};

struct PeerField {
    /// sh[k][point]: coefficient k of incident luminance, RGB, nits, canonical (see sh.h).
    std::vector<std::vector<glm::vec3>> sh;
    /// irradiance[n][point] on the plane that faces neighbour_normals()[n], RGB, lux, summed over
    /// the same rays; empty unless wanted.
    std::vector<std::vector<glm::vec3>> irradiance;
    uint64_t traced = 0; ///< rays in all, reflected and shadow rays included
};

/// Throws Error (unsupported) for a scene with surfaces that no ray meets but whose emission
/// lights.
void check_peer(const Scene& scene);

/// Throws Error as check_peer. Traces probes at `points` (frame units) on all threads; the same
/// bits for any number of them.
PeerField trace_peer(const Scene& scene, const visibility::Visibility& visibility,
                     const scene::Frame& frame, std::span<const glm::vec3> points,
                     const PeerSettings& settings);

/// All rays that trace_peer traces for these points, packed as it traces them: what Embree alone
/// takes for them is PackedRays::trace's time. 100 bytes a ray: give a few of the points.
visibility::PackedRays peer_rays(const Scene& scene, const visibility::Visibility& visibility,
                                 const scene::Frame& frame, std::span<const glm::vec3> points,
                                 const PeerSettings& settings);

} // namespace lpvbake::reference
