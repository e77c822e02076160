// Patches cut where a light shows that it ends inside them.
#pragma once

#include "surface/light_map.h"

namespace lpvbake::surface {

/// The light of a side falls on less than this share of its patch, as if it fell there evenly.
bool is_within(const SideFlux& side, const LightMapper& mapper, double share);

/// Cuts the patches of which a light lights less than a half, where it is, down to the size of what
/// it lights or to an eighth of the edge that patches may have there; if they have more than a half
/// of the light of all that lie together with them (together.h): what ends there is no edge of
/// something larger. New patches follow the others, LitSurfaces::cut_from says which they were
/// part of. Returns how many there are.
size_t cut_to_light(const LightMap& map, const LightMapper& mapper, LitSurfaces& lit);

} // namespace lpvbake::surface
