// Cells of a lattice that is there in parts.
#pragma once

#include "lpvbake/progress.h"
#include "solver/gather/packets.h"
#include "solver/solver.h"

namespace lpvbake::solver::gather {

/// Solves the blocks as GatherProgram::gather_blocks says, a few at a time.
void solve_blocks(std::span<const Block> blocks, std::span<const surface::Patch> patches,
                  const Surroundings& world, PacketSolver& solver, Progress& progress,
                  GatherReport& report, Laps& laps);

} // namespace lpvbake::solver::gather
