#include "bake/kinds.h"

#include "solver/gather/kind.h"
#include "solver/lpv/kind.h"
#include "solver/sn/kind.h"

#include <algorithm>

namespace lpvbake::bake {

solver::SolverKinds solver_kinds() {
    // Where rooms lie behind rooms, clusters see too little of each other: gather loses up to 12 %
    // of the light there, which sn does not.
    static constexpr const solver::SolverKind* kinds[] = {
        &solver::sn::sn_kind, &solver::gather::gather_kind, &solver::lpv::lpv_kind};
    return kinds;
}

const solver::SolverKind* find_solver(std::string_view name, solver::SolverKinds kinds) {
    const auto found = std::ranges::find(kinds, name, &solver::SolverKind::name);
    return found == kinds.end() ? nullptr : *found;
}

} // namespace lpvbake::bake
