// Files of nested levels: one of each, and a manifest that lists them.
//
// STEM.EXTENSION is the finest level, STEM_level1.EXTENSION the next, and so on. STEM.levels.json:
//
//     {"format": "lpvbake levels", "version": 1,
//      "levels": [{"file": of the level, beside the manifest; finest first,
//                  "origin": [x, y, z], "cell": c, "dims": [x, y, z]: its lattice as stored,
//                  "box": [x0, y0, z0, x1, y1, z1]: of its outermost samples}, ...],
//      "blend": volume::VolumeSet::blend, "axes": of these numbers and of the files}
//
// Of volumes beside each other STEM_NAME.EXTENSION is each, and STEM.volumes.json
//
//     {"format": "lpvbake volumes", "version": 1,
//      "volumes": [{"name", "file", "origin", "cell", "dims", as above,
//                   "box": [x0, y0, z0, x1, y1, z1]: of its cells, before they are turned about
//                          its lower corner, "origin",
//                   "turn": [x, y, z, w]: Grid::turn, [0, 0, 0, 1] of most,
//                   "priority": whole number, the highest is seen; they come by falling priority,
//                   "falloff": metres inside of the box over which it fades (volume::Place),
//                   "vrc": {"weight", "smooth_blending"}: the same as VRC Light Volumes call it,
//                   "bevy": {"falloff": [x, y, z]}: as bevy's LightProbe, shares of the box,
//                   "threejs": {"priority"}: as LightProbeGridWebGL}, ...],
//      "axes": as above}
#pragma once

#include "io/target.h"
#include "volume/levels.h"

#include <string>
#include <vector>

namespace lpvbake::io {

std::string level_path(const std::string& path, std::size_t level);
/// Of a set: of places, if there are any, else of levels.
std::string member_path(const std::string& path, const std::vector<volume::Place>& places,
                        std::size_t i);
/// Of the volume of this name.
std::string manifest_path(const std::string& path, bool placed = false);
/// By the end of its name.
bool is_manifest(const std::string& path);
/// What a set, of levels or of places, is read by: its manifest, or the one volume.
std::string set_path(const std::string& path, std::size_t levels, bool placed);
/// The name that a set was written by, but for its extension.
std::string set_stem(const std::string& set_path);

/// The files that a manifest lists, beside it. Throws as read_levels, but for the levels.
std::vector<std::string> level_files(const std::string& manifest);

/// The manifest of a volume of this name whose levels, or places, are written; removes what a
/// former one of the name lists beyond them. Throws Error (file).
WriteReport::File write_manifest(const std::string& path, const std::vector<Grid>& grids,
                                 volume::Axes axes, double blend,
                                 const std::vector<volume::Place>& places = {});

/// Throws Error (invalid), for the manifest `path`, unless a file's volume is of the same bake as
/// the first that it lists.
void check_alike(const std::string& path, const std::string& file, const Volume& first,
                 const Volume& other);

/// How many volumes beside each other a program shows at once.
std::size_t most_places(const Target& target);
/// Throws Error (argument) for what a program cannot show: too many volumes, or some that overlap.
void check_places(const Target& target, const std::vector<volume::Place>& places,
                  const std::vector<Grid>& grids);

/// Reads a manifest and the volumes, or bricks (io/bricks.h), that it lists. Throws Error: file
/// (the manifest or a volume is not there), invalid (what it says is wrong, or they are of
/// different bakes), and as read_volume.
volume::VolumeSet read_levels(const std::string& path);

} // namespace lpvbake::io
