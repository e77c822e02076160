// Lit surfaces as bytes, for bakes that share them.
#pragma once

#include "surface/lit_surfaces.h"

namespace lpvbake::surface {

/// All of them but which visibility they are of.
void put(LitSurfaces lit, cache::Writer& out);

/// Takes them again, from bytes that anybody may have written; `visibility` is that of the scene in
/// the frame that they were lit in, and outlives them. False where they are none of the scene.
bool get(cache::Reader& in, const Scene& scene, const visibility::Visibility& visibility,
         LitSurfaces& lit);

} // namespace lpvbake::surface
