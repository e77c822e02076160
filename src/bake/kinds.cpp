#include "bake/kinds.h"

#include "solver/gather/kind.h"
#include "solver/lpv/kind.h"
#include "solver/sn/kind.h"

#include <algorithm>

namespace lpvbake {

SolverKinds solver_kinds() {
    // Where rooms lie behind rooms, clusters see too little of each other: gather loses up to 12 %
    // of the light there, which sn does not.
    static constexpr const SolverKind* kinds[] = {&sn_kind, &gather_kind, &lpv_kind};
    return kinds;
}

const SolverKind* find_solver(std::string_view name, SolverKinds kinds) {
    const auto found = std::ranges::find(kinds, name, &SolverKind::name);
    return found == kinds.end() ? nullptr : *found;
}

} // namespace lpvbake
