// What surfaces of a role do.
#pragma once

#include "lpvbake/scene.h"

namespace lpvbake::scene {

/// Light does not pass it: it is met by rays.
inline bool blocks(Role role) {
    return role == Role::full || role == Role::cast_only;
}
inline bool reflects(Role role) {
    return role == Role::full;
}
/// Its emission, if it has one, lights others.
inline bool shines(Role role) {
    return role == Role::full || role == Role::lights_only;
}
/// Light is wanted on it: grids are fitted to it, volumes are fitted to it and measured on it, and
/// pictures show it.
inline bool is_asked(Role role) {
    return role == Role::full || role == Role::receive_only;
}

/// "cast-only".
const char* name_of(Role role);

/// Some surface of the scene has a role of this kind.
template <class Kind>
bool any_of_role(const Scene& scene, Kind&& kind) {
    for (const Instance& instance : scene.instances)
        if (kind(instance.role))
            return true;
    return false;
}

} // namespace lpvbake::scene
