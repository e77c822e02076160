// Files of nested levels: one of each, and a manifest that lists them.
//
// STEM.EXTENSION is the finest level, STEM_level1.EXTENSION the next, and so on. STEM.levels.json:
//
//     {"format": "lpvbake levels", "version": 1,
//      "levels": [{"file": of the level, beside the manifest; finest first,
//                  "origin": [x, y, z], "cell": c, "dims": [x, y, z]: its lattice as stored,
//                  "box": [x0, y0, z0, x1, y1, z1]: of its outermost samples}, ...],
//      "blend": volume::VolumeSet::blend, "axes": of these numbers and of the files}
#pragma once

#include "io/target.h"
#include "volume/levels.h"

#include <string>
#include <vector>

namespace lpvbake::io {

std::string level_path(const std::string& path, std::size_t level);
/// Of the volume of this name.
std::string manifest_path(const std::string& path);
/// By the end of its name.
bool is_manifest(const std::string& path);

/// The files of levels that a manifest lists, beside it. Throws as read_levels, but for the levels.
std::vector<std::string> level_files(const std::string& manifest);

/// The manifest of a volume of this name whose levels are written; removes what a former one of the
/// name lists beyond them. Throws Error (file).
WriteReport::File write_manifest(const std::string& path, const std::vector<Grid>& grids,
                                 volume::Axes axes, double blend);

/// Throws Error (invalid), for the manifest `path`, unless a file's volume is of the same bake as
/// the finest level.
void check_alike(const std::string& path, const std::string& file, const Volume& first,
                 const Volume& other);

/// Reads a manifest and the levels, or bricks (io/bricks.h), that it lists. Throws Error: file (the
/// manifest or a level is not there), invalid (what it says is wrong, or levels are of different
/// bakes), and as read_volume.
volume::VolumeSet read_levels(const std::string& path);

} // namespace lpvbake::io
