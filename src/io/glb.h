// A light volume in the file of the scene that it lights: the extension EXT_light_volume of binary
// glTF, which EXT_light_volume/README.md specifies.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

extern const VolumeFormat glb_format;

/// Writes Pictures::scene, or an empty one, with the volume: a node that is its box, and its
/// textures as KTX2 behind what the first buffer holds. Throws Error: invalid (the scene is no
/// glTF), unsupported (a convention
/// other than radiance and irradiance, axes other than glTF's, a packing other than band, channel
/// and atlas; a scene that has a volume; more than 4 GiB); and as write_textures.
WriteReport write_glb(const std::string& path, const Stored& stored, Precision precision,
                      const Pictures& pictures);

/// Reads the one volume of a file, whoever wrote it, in the axes of its scene. Its priority and
/// falloff, where they are not 0, become metadata. Throws Error (file, invalid, memory;
/// unsupported: several volumes, cells that are no cubes, a node that turns them by other than
/// quarter turns).
Volume read_glb(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

/// Whether a scene's file holds a light volume. Throws Error (file, invalid) if it is no .glb.
bool has_light_volume(const std::string& path);

/// Throws Error (unsupported), beginning with `place`, for a scene that has a light volume.
void check_has_no_volume(const PackedScene& scene, const std::string& place);

} // namespace lpvbake::io
