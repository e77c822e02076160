// The constants of what is expected of a bake: time, memory and error. All that is fitted to
// measurements, and nothing else.
//
// Seconds are those of two threads, fitted to bakes of the Cornell box and of two rooms with a door
// at 16, 32 and 64 cells, on 2026-11-22 (470b823; the sweep 237960f), those of lighting and gather
// to 25 scenes of all kinds at 32, on 2026-11-29 (2b98a50).
// tests/bench/models.py prints how far each stage is from what is expected here.
//
// Errors are relative L1 of irradiance at cells, fitted to bakes of 24 scenes of all kinds beside
// path-traced references, on 2026-11-29 (67d2fde). tests/bench/expected_error.py measures and fits
// them; tests/baselines/expected_error.json keeps what it measured.
#pragma once

#include "solver/pilot.h"

namespace lpvbake::solver::models {

namespace seconds {

inline constexpr double visibility_triangle = 4e-7;

inline constexpr double lighting = 0.1;
inline constexpr double lighting_patch = 6e-6;
inline constexpr double lighting_triangle = 4e-6;
inline constexpr double lighting_light = 0.04;
inline constexpr double lighting_ray = 2.5e-7;
inline constexpr double lighting_layer = 0.02; ///< of a layer, of the rays' time

inline constexpr double maps = 0.05;
inline constexpr double maps_texel = 1.5e-7;
inline constexpr double maps_triangle = 2e-7; ///< in each map

inline constexpr double validity_cell = 5e-6; ///< over the cells along the longest axis
inline constexpr double walls_cell = 1e-6;

// Of 2026-11-28, after the rays came to be shared.
inline constexpr double fit = 0.1; ///< the points that check it
inline constexpr double fit_ray = 2.5e-7;
inline constexpr double fit_point = 1.5e-5; ///< all steps of its solution

inline constexpr double beam = 2e-7;      ///< of 2026-11-30, with its ray
inline constexpr double beam_cell = 1e-8; ///< of its way
inline constexpr double beam_air_cell = 2.5e-8;
inline constexpr double beam_uneven_cell = 5.5e-8; ///< in air that is not even or not grey
inline constexpr double shaft_lamp = 1.1;          ///< to close the map of a lamp
inline constexpr double shaft_texel = 4e-9; ///< of the sun's map, for each in a disc's radius
inline constexpr double air_cell = 2e-7;    ///< of the medium's mean and of what is scattered
inline constexpr double local_ray = 2e-7;   ///< of 2026-11-30, with what it adds

inline constexpr double geometry_patch = 5e-7;
inline constexpr double links_cell = 15e-6; ///< as validity_cell
inline constexpr double inject = 0.01;
inline constexpr double inject_patch =
    2.5e-6; ///< that is lit; of 2026-11-30, with cells asked once
inline constexpr double propagate_layer = 1.6; ///< of a layer, of the propagation of all light
inline constexpr double sweep_layer = 0.9;     ///< of a layer, of the sweep of all light
inline constexpr double propagate = 0.02;

inline constexpr double gather = 0.05;
inline constexpr double gather_patch = 3e-6;
inline constexpr double gather_place = 1.5e-5;    ///< that is given: all that its own rays see
inline constexpr double gather_ray = 2e-7;        ///< for each cluster, with those to the sky
inline constexpr double gather_sample = 1.2e-5;   ///< of a block, whose samples share what they see
inline constexpr double gather_shared_ray = 6e-8; ///< for each cluster, with those to the sky
inline constexpr double look_place = 2.5e-5;      ///< what lies around it
inline constexpr double brick_place = 8e-6;       ///< its walls, and what trimming asks of it
inline constexpr double gather_layer = 0.04;      ///< of a layer, of all that a gather takes
inline constexpr double gather_above_2 = 1.35;    ///< as long for a solved cell above order 2
inline constexpr double discs_texel = 4e-7;       ///< of each map, for each cell

/// Where the device has a part.
struct Device {
    double propagate_step;
    double propagate_cell; ///< in each step
    double sweep;
    double sweep_cell;     ///< along each direction; a tenth beside surfaces
    double gather_cell;    ///< that is solved
    double gather_cluster; ///< in each cell that is solved
};
/// Lavapipe on the same two threads.
inline constexpr Device on_cpu{2e-4, 7e-8, 0.05, 3e-8, 0.9e-5, 5e-8};
/// An H200 beside them: the Cornell box at 32, 64 and 128 cells and five scenes at 32, on
/// 2026-11-29 (d0ef345).
inline constexpr Device on_gpu{5e-5, 1.3e-10, 0.2, 1.05e-8, 0.6e-5, 3.3e-8};

constexpr const Device& of_device(bool gpu) {
    return gpu ? on_gpu : on_cpu;
}

/// Of the work, what more threads do not share: 2, 4, 8 and 16 of them in the same bakes.
inline constexpr double serial = 0.3;

/// Time of so many threads over that of two.
constexpr double of_threads(int threads) {
    return serial + (1 - serial) * 2 / threads;
}

} // namespace seconds

/// Of the Cornell box and three real scenes at 48, 96 and 128 cells, and of one of them at 512, on
/// 2026-12-01.
namespace bytes {

inline constexpr unsigned fixed = 16u << 20;
inline constexpr unsigned triangle = 170;
inline constexpr unsigned cell = 4;          ///< beside the coefficients and walls of the volume
inline constexpr unsigned patch = 230;       ///< that is lit
inline constexpr unsigned patch_lamps = 140; ///< more, with punctual lights
inline constexpr unsigned gather_cell = 15;
inline constexpr unsigned gather_patch = 170;        ///< its clusters, of a side that may shine
inline constexpr unsigned gather_lists = 100u << 20; ///< of clusters that packets of cells see
inline constexpr unsigned gather_lists_cell = 1700;  ///< where these cells are few
inline constexpr unsigned lpv = 20u << 20;
inline constexpr unsigned lpv_cell = 85;
inline constexpr unsigned lpv_patch = 250;
inline constexpr unsigned beams_cell = 64; ///< sums of a light, where some surface colours it
inline constexpr unsigned fit_point = 700;
inline constexpr unsigned hit = 4;   ///< of a ray between elements
inline constexpr unsigned tint = 12; ///< and what it passed, where surfaces colour light

} // namespace bytes

/// Propagation in a closed room is a diffusion of this coefficient, cells^2 a step; an open scene
/// takes fewer steps.
inline constexpr double diffusion = 0.38;

// With corrections: fronts, and a correction each time what is missing is to fall by
// e^(1 / corrections), which takes as long as so many fronts. Of the Cornell box at 16 to 64 cells
// and four scenes at 32, on 2026-11-30.
inline constexpr double fronts = 10;
inline constexpr double corrections = 1.3;
inline constexpr double correction_fronts = 5;

// Of the cells of a gather, at most a share is solved, and so many a patch: `solved_patch`, and
// `solved_tolerance` over the tolerance, which counts as `least_tolerance` below that.
inline constexpr double solved_share = 0.8;
inline constexpr double solved_patch = 0.24;
inline constexpr double solved_tolerance = 0.045;
inline constexpr double least_tolerance = 0.01;

/// Patches of a sweep that are brighter than its limit: one in so many.
inline constexpr double patches_a_peak = 3;

namespace error {

/// Of the shipped Cornell box at 32 cells: what a bake goes by that has no pilot.
inline constexpr Pilot cornell_box{{0.197, 0.035}, {0.022, 0.0095}};
inline constexpr Pilot cornell_box_once{{0.25, 0.046}, {0.016, 0.0071}}; ///< after one reflection

// What solvers add to what the pilot tells; the squares of all terms sum.
inline constexpr double lpv = 0.7;

/// Of all that go by patches. The median is half of it; but whoever chooses by a model chooses
/// where it says too little.
inline constexpr double surfaces = 0.012;

inline constexpr double sn_peaks = 0.55;      ///< of what the clusters of its brightest light lose
inline constexpr double sn_directions = 0.19; ///< over the root of their number

inline constexpr double gather_tolerance = 0.032; ///< with 1, rising with the power below
inline constexpr double gather_power = 1.5;

/// So many times what is typical is told: no less than what is measured, in nine of ten bakes.
inline constexpr double margin = 1.35;

/// A scene of which more_clusters lose more than this is beyond what a pilot tells.
inline constexpr double most_lost_clusters = 0.15;

} // namespace error

} // namespace lpvbake::solver::models
