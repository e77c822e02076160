// Patches cut where a light shows that it ends inside them.
#pragma once

#include "surface/light_map.h"

namespace lpvbake::surface {

/// The light of a side falls on less than this share of its patch, as if it fell there evenly.
bool is_within(const SideFlux& side, const LightMapper& mapper, double share);

/// Where the light of a side falls.
struct NarrowLight {
    uint32_t side;
    glm::vec2 at; ///< its middle: weights of the triangle's second and third corner
    float radius; ///< root mean square, frame units
};

/// The sides of which a light lights less than a half; if they have more than a half of the light
/// of all that lie together with them (together.h): what ends there is no edge of something larger.
std::vector<NarrowLight> find_narrow(const LightMap& map, const LightMapper& mapper);

/// Cuts their patches where the light is, down to the size of what it lights or to an eighth of the
/// edge that patches may have there. New patches follow the others, LitSurfaces::cut_from says
/// which they were part of. Returns how many there are.
size_t cut_to_light(std::span<const NarrowLight> narrow, const LightMapper& mapper,
                    LitSurfaces& lit);

} // namespace lpvbake::surface
