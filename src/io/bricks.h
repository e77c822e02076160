// Files of bricks: the kind that io/levels.h lists, of volume::VolumeSet::bricks.
//
// STEM.vdb is the finest level, STEM_level1.vdb the next, and so on: grids that are active where
// the level has bricks. Of formats of pictures and textures STEM_atlas.EXTENSION holds all bricks,
// as volume::stacked() puts them, finest level first, and STEM_bricks.exr which of them is where:
// an RGBA float texel for each brick that level 0 could have, in pictures of layers as flipbooks
// have them, of the atlas' texel that is the first sample of the finest brick there (RGB) and of
// how many cells of level 0 one of its cells is long (A). STEM.levels.json:
//
//     {"format": "lpvbake bricks", "version": 1,
//      "levels": [{"file": of the level, of .vdb alone; finest first,
//                  "origin": [x, y, z], "cell": c, "dims": [x, y, z]: all samples that it could
//                  have, "box": [x0, y0, z0, x1, y1, z1]: of the outermost of them, "bricks": [x,
//                  y, z, x, y, z, ...]: places of its bricks, in bricks}, ...],
//      "edge": 8 cells of a brick, "stitched": true,
//      "atlas": {"file", "slots": [x, y, z]: how many bricks stand along its axes,
//                "index": {"file", "dims": [x, y, z], "columns", "rows"}}, of others than .vdb
//                alone
//      "axes": "gltf"}
#pragma once

#include "io/described.h"
#include "io/levels.h"

namespace lpvbake::io {

inline constexpr const char* bricks_format_name = "lpvbake bricks";

/// Whether bricks can be written to a path of this name: .vdb, and what has pictures or textures.
bool takes_bricks(const std::string& path);
/// ".vdb, .exr, .ktx2 or .dds".
std::string brick_format_list();

/// The files that write_bricks makes of so many levels, with these grids.
std::vector<std::string> brick_files(const std::string& path, std::size_t levels,
                                     const Volume& grids);

/// Writes bricks, last the manifest. Throws Error: file; failure (a value is not finite).
WriteReport write_bricks(const std::string& path, const volume::VolumeSet& set,
                         Precision precision);

/// The files that a manifest of bricks lists. Throws as read_bricks, but for the bricks.
std::vector<std::string> files_of_bricks(const std::string& path, const Json& manifest);

/// Reads the bricks of a manifest. Throws as io::read_levels.
volume::VolumeSet read_bricks(const std::string& path, const Json& manifest);

} // namespace lpvbake::io
