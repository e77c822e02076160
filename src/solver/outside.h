// Which cells lie outside geometry, as a stage of its own.
#pragma once

#include "solver/solver.h"

#include <span>
#include <string>

namespace lpvbake::solver {

/// Traces Volume::validity.
void find_validity(const Inputs& inputs, Stages& stages, Volume& volume);

/// After a slab of the grid is solved: leaves the volume its grid and validity.
void keep_slab(const Inputs& inputs, Volume& volume);

/// The lattice of the cells that are solved for a slab, with `halo` layers on either side, or of
/// all of the grid; and the memory of what is kept for it besides: the validity of the whole grid,
/// where surfaces are there, and the light around the slab, of harmonics to `order`.
Grid solved_grid(const Workload& work, int halo);
uint64_t beside_slab_bytes(const Workload& work, int halo, int order);

/// What it costs, seconds, by two threads.
double validity_seconds(const Grid& grid);

/// "93.8 % of the cells outside geometry".
std::string outside_geometry(std::span<const float> validity);

} // namespace lpvbake::solver
