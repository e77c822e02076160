// Places that are given, instead of a grid's cells.
#pragma once

#include "lpvbake/progress.h"
#include "solver/gather/packets.h"

namespace lpvbake::solver::gather {

/// Solves the places as GatherProgram::gather_at says, by a solver of the volume and the layers.
/// Beside those it takes 24 bytes a place.
void solve_places(std::span<const glm::vec3> places, const Surroundings& world,
                  PacketSolver& solver, Volume& volume, std::span<Volume> layers,
                  Progress& progress, GatherReport& report, Laps& laps);

} // namespace lpvbake::solver::gather
