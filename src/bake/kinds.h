// The solvers that there are.
#pragma once

#include "solver/solver.h"

namespace lpvbake::bake {

/// All kinds of solvers, the one that is taken unless something speaks against it first.
solver::SolverKinds solver_kinds();

/// The kind of that name; null if there is none.
const solver::SolverKind* find_solver(std::string_view name,
                                      solver::SolverKinds kinds = solver_kinds());

} // namespace lpvbake::bake
