// The field of a scene's light as the operators of a volume carry it.
#pragma once

#include "scene/frame.h"
#include "transfer/propagation.h"

namespace lpvbake::transfer {

struct RelightSettings {
    bool emitters = true; ///< emissive surfaces give light
    PropagationSettings propagation;
};

/// Whether the volume has operators, and how far they reach.
bool has_operators(const Volume& volume);

/// Replaces the field of a volume that has its operators by that of the scene's light, to order 1:
/// of punctual lights after one reflection or more, by beams (medium/beams.h), of emitters that
/// near surfaces are, and of the sky from beyond the lattice. Its metadata say so. `frame` is that
/// of the volume's grid. Throws Error (unsupported: the lattice is turned), and
/// whatever `progress` throws.
Propagated relight(const Scene& scene, const visibility::Visibility& visibility,
                   const scene::Frame& frame, const RelightSettings& settings, Volume& volume,
                   Progress& progress);

} // namespace lpvbake::transfer
