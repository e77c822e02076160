// Probes of Godot 4's LightmapGI, which light moving objects without a shader of one's own: a
// LightmapGIData as a text resource.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

extern const VolumeFormat tres_format;

/// Writes a probe at the centre of each cell and, so that the box is filled, of each of its faces'
/// cells once more on the face; tetrahedra, six to a brick of eight probes; and the tree of planes
/// that leads to them. Without validity and walls. Throws Error: file; unsupported (a convention
/// other than godot, axes other than glTF's, more than 2^20 cells).
WriteReport write_tres(const std::string& path, const Stored& stored, Precision precision,
                       const Pictures& pictures);

/// Reads what write_tres made, whether Godot has written it again since or not. Throws Error (file,
/// invalid, memory).
Volume read_tres(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

} // namespace lpvbake::io
