// Lit surfaces as bytes, for bakes that share them.
#pragma once

#include "surface/lit_part.h"

namespace lpvbake::surface {

/// Whether the numbers fit the patches, and a float holds the light of all.
bool is_sound(const LitSurfaces& lit);

/// All of them but which visibility they are of.
void put(LitSurfaces lit, cache::Writer& out);

/// Takes them again, from bytes that anybody may have written; `visibility` is that of the scene in
/// the frame that they were lit in, and outlives them. False where they are none of the scene.
bool get(cache::Reader& in, const Scene& scene, const visibility::Visibility& visibility,
         LitSurfaces& lit);

/// The same of a part; of all but the first its rays alone.
void put(LitPart part, cache::Writer& out);

/// Takes the parts again, in their order, each from its bytes; false where they do not make up one
/// lighting.
bool get(std::span<cache::Reader> in, std::vector<LitPart>& parts);

} // namespace lpvbake::surface
