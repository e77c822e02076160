// How wrong a volume is in its own scene, by paths at a few of its cells and points of surfaces.
#pragma once

#include "lpvbake/progress.h"
#include "readers/readers.h"
#include "reference/paths.h"
#include "scene/scene.h"
#include "visibility/isa.h"
#include "volume/levels.h"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace lpvbake::report {

struct VerifySettings {
    uint64_t points = 256;         ///< half of them cells, half on surfaces
    double noise = 1.0;            ///< of what paths bring, of the error, at most
    uint64_t most_paths = 1 << 11; ///< from each point
    uint64_t seed = 1;
    visibility::Isa isa = visibility::Isa::automatic;
    std::optional<Bounds> box; ///< metres; places in it alone count
};

/// A relative error of irradiance (sum |E - T| / sum T) that was measured at some of many places.
struct MeasuredError {
    uint64_t points = 0;      ///< 0: no light arrives where it was measured, and nothing is known
    double error = 0;         ///< the paths' noise taken off
    double low = 0, high = 0; ///< of 95 %
    double noise = 0;         ///< of the paths: mean standard error over mean irradiance
};

/// Where a volume is most wrong.
struct WrongPlace {
    bool on_surface = false;
    glm::dvec3 position{0.0};    ///< metres
    double shown = 0, true_ = 0; ///< irradiance, lux, mean of RGB and of all directions of a cell
    double share = 0; ///< of all that is wrong at such places which this place stands for
};

struct Verified {
    MeasuredError cells;    ///< the field at the centres of valid cells, towards 26 directions
    MeasuredError surfaces; ///< what the reader shows on surfaces inside the grid
    std::vector<WrongPlace> worst; ///< up to five, the worst first
    uint64_t rays = 0;             ///< traced in all
    double seconds = 0;
    bool converged = true; ///< VerifySettings::noise was reached
};

/// Cells and points are drawn by even steps, half in proportion to their number and half to their
/// light, which is where most of an error is; intervals are from 1000 samples of the points drawn
/// (Efron's bootstrap, percentiles). `levels` is a volume of the scene, nested ones or bricks,
/// which are read as one field, or ones beside each other; of a level cells count that no finer one
/// has a share in, of bricks the samples that are the finest there, of volumes beside each other
/// those that no other one is read at first. `rules` are those of its light. Depends on no clock.
/// Throws Error (invalid) as trace_probes.
Verified verify(const Scene& scene, const volume::Levels& levels, const reference::PathRules& rules,
                const readers::Reader& reader, const VerifySettings& settings, Progress& progress);

/// A place that was drawn, with what is known there.
struct VerifiedPoint {
    double stands_for = 1; ///< places like it
    double wrong = 0;      ///< |E - T|, lux, with the noise of T in it
    double agreed = 0;     ///< the same as far as independent estimates of T agree on E - T
    double true_ = 0;      ///< T
    double noise = 0;      ///< standard error of T
};

/// As MeasuredError has it: the truth lies between `wrong` and `agreed`.
MeasuredError measured_error(std::span<const VerifiedPoint> points, uint64_t seed);

} // namespace lpvbake::report
