// From a scene to bricks (volume/bricks.h): the bake of a grid, but for which samples there are.
#pragma once

#include "bake/bake.h"
#include "volume/levels.h"

namespace lpvbake::bake {

struct BakedBricks {
    volume::VolumeSet set; ///< bricks, stitched
    uint64_t samples = 0;  ///< that were solved
    double error = 0;      ///< volume::Trimmed::error
    std::vector<StageReport> stages;
    std::vector<std::string> warnings; ///< a line each
};

/// Runs the plan, of this scene and of BakeSettings::adaptive, by a solver that is
/// SolverKind::at_places.
///
/// An eighth of a brick becomes a brick of cells half as large where it meets the box that is asked
/// for and where a surface may lie in it, samples differ in validity, or the light in the middle of
/// one of its cells is more than the error off the mean of that cell's corners. Then bricks are
/// trimmed to the error and the size, and stitched. Every sample is solved, those that levels have
/// in common once; those of a brick share what they see (solver::Block). The same bits for any
/// number of threads. Throws Error: memory (bricks become more than the machine holds), and as
/// bake().
BakedBricks bake_bricks(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                        Progress& progress);

} // namespace lpvbake::bake
