// What the rest of the program knows of the gather solver.
#pragma once

#include "solver/solver.h"

namespace lpvbake::solver::gather {

extern const SolverKind gather_kind;

} // namespace lpvbake::solver::gather
