// Cells fitted to a reader, so that it shows on surfaces the light that arrives there.
//
// A reader mixes cells on both sides of a wall. What tells the sides apart are their normals, and
// the coefficients know directions: values can be found with which both sides are shown right.
#pragma once

#include "readers/readers.h"

#include <algorithm>

namespace lpvbake::readers {

/// A point of a surface, and what a reader should show there.
struct FitPoint {
    glm::dvec3 position; ///< metres
    glm::dvec3 normal;   ///< unit, of the side that is seen
    /// The area that it stands for, in faces of cells, times how much it matters (see openness).
    double weight = 1;
    glm::dvec3 irradiance; ///< lux, RGB
};

struct FitSettings {
    int steps = 40; ///< of conjugate gradients, at most; of a cube's sides twice as many
    /// What holds a cell to the values that it had: by how many faces of a surface its error of
    /// irradiance (mean square over normals) counts, for valid cells and for the others.
    double hold_valid = 0.01, hold_other = 0.0005;
    /// What is left of hold_valid in a cell without light; all of it is from a tenth of the cells'
    /// mean on. Where both sides of a wall ask for a change, the dark one gives way, not the air of
    /// the lit one.
    double hold_dark = 0.01;
    /// The brightest points, on which this share of the light falls, count by their error relative
    /// to what the least bright of them has: beside a lamp there is a hundred times the mean in
    /// less than a cell, that no cells can show, and squares would bend all around to it.
    double bright = 0.1;
    double tolerance = 1e-5; ///< the steps end where the gradient has shrunk to this share
};

/// How far what a reader shows is from what arrives, points by their weights.
struct SurfaceError {
    double relative = 0; ///< sum |E - T| / sum T, over RGB
    double energy = 1;   ///< luminance of sum E over that of sum T
    /// Luminance shown at the points where less than 1 % of the mean arrives: its mean over that of
    /// all points. 0 without such points.
    double leak = 0;
};

struct FitReport {
    /// How far irradiance at the valid cells moved: sum of |E - E before| over the sum of E before,
    /// over 26 normals, RGB and cells; of cells that had 1 % of the mean at least.
    double moved = 0;
    /// The same sum of the darker ones, over the same sum of E: what lies behind walls takes part
    /// in showing their fronts, and is no longer dark by itself.
    double moved_dark = 0;
    /// How far the values went of the way to those fitted: where all of it is too far, half or a
    /// quarter (of a linear reader). 0: judges saw no gain, and the volume is what it was.
    double share = 1;
    int steps = 0;
    double residual = 0;    ///< share that is left of the gradient
    std::size_t cells = 0;  ///< that the points are read from; all others keep their values
    std::size_t points = 0; ///< that are read from cells at all
};

/// Where what a reader shows is farthest from what arrives.
struct WorstPlace {
    /// Mean |E - T| of the points that one cell is read at, by their weights in it, over the mean T
    /// of all points, RGB: single points have the noise of their rays.
    double error = 0;
    glm::dvec3 position{0.0}; ///< of these points, by what is wrong at them; metres
};

/// Of the cells that stand for half a face of surface at least; error 0 without any, or light.
WorstPlace worst_place(const Reader& reader, const Volume& volume,
                       std::span<const FitPoint> points);

/// Where the truth is dark, a relative number is infinite, or 0 where nothing is shown either.
SurfaceError error_of(const Reader& reader, const Volume& volume, std::span<const FitPoint> points);

/// Changes the coefficients up to the reader's highest band so that the sum over points of weight
/// times squared error, and over cells of what holds them, is least: linear least squares, solved
/// for each colour by conjugate gradients on the normal equations (Hestenes and Stiefel 1952; the
/// preconditioner has the block of each cell, with more of what holds it) from the values that are
/// there. Cells that are not valid should have been filled before (volume/dilate.h). What the
/// reader clamps is not clamped while it is fitted, but for the sides of a cube, which come out not
/// negative (order 2; CG in rounds between which the bounds are looked at). For a reader that is
/// not linear see readers/fit_nonlinear.h. Costs time and memory in proportion to points and cells;
/// sums have a fixed order, so that the bits do not depend on the number of threads. Other points,
/// `judges`, have to be shown nearer to what arrives there, by more than chance would do, or only
/// part of the way is gone (FitReport::share).
FitReport fit(const Reader& reader, std::span<const FitPoint> points, const FitSettings& settings,
              Volume& volume, std::span<const FitPoint> judges = {});

/// How much a point matters by the share of directions (weighted by their cosines) that are free
/// for a cell from it: crevices, which few see and no cell can tell from what is around them, have
/// little say, and yet some, or they shine by the light of what lies behind them. 0.05 of what is
/// closed, 1 from a half on.
constexpr double openness_weight(double open) {
    constexpr double closed = 0.05;
    return std::min(1.0, closed + (1 - closed) * open / 0.5);
}

} // namespace lpvbake::readers
