// What the rest of the program knows of the sn solver.
#pragma once

#include "solver/solver.h"

namespace lpvbake::solver::sn {

extern const SolverKind sn_kind;

} // namespace lpvbake::solver::sn
