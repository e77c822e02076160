// Surfaces in one place, as the underside of a box and the floor that it stands on: which of them
// is seen. By rounding a ray meets one or the other.
//
// In the place of a surface are those on it and, less than two ray offsets away, those before it.
// On it is what is in the same place (visibility.h), by geometry, which no instruction set rounds
// otherwise. What lies before a surface hides it, if it has but one front. Of those on each other
// one is seen: what has two fronts, else what comes first in the scene. But sheets that turn their
// backs on each other are both seen, as a wall's between two rooms are, unless one is the skin of a
// body that stands on the other: before the front of that, inside of the body, three of five rays
// meet backs.
#pragma once

#include "surface/lit_surfaces.h"

namespace lpvbake::surface {

/// Whether another surface hides an opaque patch.
bool is_hidden(const visibility::Visibility& visibility, const Patch& patch);

/// The side of a patch that is seen in the place of a point of a surface by who looks against
/// `normal`, a unit vector; LitSurfaces::no_side: none.
uint32_t seen_at(const LitSurfaces& lit, glm::vec3 point, glm::vec3 normal);

} // namespace lpvbake::surface
