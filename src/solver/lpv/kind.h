// What the rest of the program knows of the lpv solver.
#pragma once

#include "solver/solver.h"

namespace lpvbake {

extern const SolverKind lpv_kind;

} // namespace lpvbake
