// A volume fitted to what a program shows of it: from lit surfaces to points, and to values.
#pragma once

#include "bake/contested.h"
#include "medium/beams.h"
#include "surface/side_points.h"

namespace lpvbake::bake {

struct SurfaceFitSettings {
    double density = 4;             ///< points a face of a cell, on each side of a surface
    uint64_t most_points = 1 << 20; ///< where surfaces are many, each stands for more of them
    /// In all, 16 to 64 from each point; shared with the points around it (surface/shared_rays.h).
    /// Their noise is noise of the result, but the less the more cells a wall has.
    uint64_t rays = 1 << 21;
    readers::FitSettings solve;
    /// Rings of cells inside geometry that are filled before, to be held to; see volume/dilate.h.
    int dilate = 2;
    /// Cells are held to values without negative irradiance, where the reader would show it; the
    /// fit may ask for some again, of what stands behind a thin wall.
    bool dering = true;
    uint64_t checks = 500; ///< other points, at which the error is told
    int check_rays = 1024;
    medium::BeamSettings statics = {}; ///< how large static lights are
};

struct SurfaceFit {
    readers::FitReport fit;
    /// At points that the fit has not seen.
    readers::SurfaceError before, after;
    Contested contested; ///< of fit_to_surfaces alone
};

/// What a fit goes by, and other points at which it is checked.
struct SurfacePoints {
    std::vector<readers::FitPoint> points, checks;
};

int rays_a_point(const SurfaceFitSettings& settings, double points);

/// All points, by area and by how open they are (readers::openness_weight), and what arrives there,
/// lux; nothing where `irradiance` is empty.
std::vector<readers::FitPoint> weighed_points(const scene::Frame& frame,
                                              const surface::SidePoints& sides,
                                              std::span<const glm::vec3> irradiance);

/// Whether light arrives at any of the points.
bool any_light(std::span<const readers::FitPoint> points);

/// Points of all sides of the surfaces. `lit` as irradiance_at wants it.
std::vector<readers::FitPoint> fit_points(const Scene& scene, const surface::LitSurfaces& lit,
                                          const scene::Frame& frame, bool emitters,
                                          const SurfaceFitSettings& settings, Progress& progress);

/// Fits the volume to a reader by points, and adds the metadata fit (the reader's name), fit_error,
/// fit_energy, fit_leak (SurfaceFit::after, of `checks`), fit_moved, and fit_worst, fit_worst_at
/// (readers::WorstPlace, of `points`); fit_evaluation (its name) where the reader is not linear.
SurfaceFit fit_to_points(const readers::Reader& reader, std::span<const readers::FitPoint> points,
                         std::span<const readers::FitPoint> checks,
                         const SurfaceFitSettings& settings, Volume& volume);

/// Fits the volume to a reader by points of the scene's lit surfaces; metadata fit_contested and
/// fit_cell tell of SurfaceFit::contested. Where no light arrives on any
/// surface of the grid the volume stays as it is, and FitReport::points is 0. Of a turned grid the
/// scene, its light and the frame, which begins where the grid does, are in the grid's axes. Throws
/// whatever `progress` throws.
SurfaceFit fit_to_surfaces(const Scene& scene, const surface::LitSurfaces& lit,
                           const scene::Frame& frame, bool emitters, const readers::Reader& reader,
                           const SurfaceFitSettings& settings, Volume& volume, Progress& progress);

} // namespace lpvbake::bake
