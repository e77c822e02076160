// What the rest of the program knows of the lpv solver.
#pragma once

#include "solver/solver.h"

namespace lpvbake::solver::lpv {

extern const SolverKind lpv_kind;

} // namespace lpvbake::solver::lpv
