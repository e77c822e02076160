// What the rest of the program knows of the gather solver.
#pragma once

#include "solver/solver.h"

namespace lpvbake {

extern const SolverKind gather_kind;

} // namespace lpvbake
