// The stage that adds to a field what air scatters again and again.
#pragma once

#include "bake/plan.h"
#include "medium/lit_air.h"
#include "solver/solver.h"

#include <memory>

namespace lpvbake::bake {

/// The plan's medium as its light passes it; null where the field is to be as without it.
std::shared_ptr<medium::LitAir> air_in(const BakePlan& plan);

/// Adds to a volume of light that air takes from, which has its walls, what air scatters and
/// surfaces then reflect: order by order, each of the one before, by the same solver. `inputs` are
/// those that it was solved by, whose rays pass `air`. Where no number of times is given, until the
/// orders that are left, as the last ones fall off, have less than 0.1 % of what is scattered; or
/// they are added as what the last one falls off to, where that is so sure. Throws Error (invalid)
/// where they do not fall off.
void add_scattered(const solver::Inputs& inputs, const BakePlan& plan, solver::Solver& solver,
                   medium::LitAir& air, solver::Stages& stages, Volume& volume);

} // namespace lpvbake::bake
