// Which cells lie outside geometry, as a stage of its own.
#pragma once

#include "solver/solver.h"

#include <span>
#include <string>

namespace lpvbake::solver {

/// Traces Volume::validity.
void find_validity(const Inputs& inputs, Stages& stages, Volume& volume);

/// What it costs, seconds, by two threads.
double validity_seconds(const Grid& grid);

/// "93.8 % of the cells outside geometry".
std::string outside_geometry(std::span<const float> validity);

} // namespace lpvbake::solver
