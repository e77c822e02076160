// Programs that read volumes: how each wants them stored, and what it must be told to read them.
#pragma once

#include "io/io.h"

#include <array>
#include <span>
#include <string_view>

namespace lpvbake::io {

/// Files that a program wants beside a volume.
enum class Notes {
    none,
    godot,  ///< PICTURE.exr.import of each, for a 3D texture (Godot 4), and STEM.godot.json
    unity,  ///< STEM.unity.json: what to set in the texture importer, and how to read
    unreal, ///< STEM.unreal.json: what to set when a volume texture is made, and how to read
    bevy, ///< STEM.bevy.json: the texture's form and the volume's transform; STEM.scn.ron, a scene
};

/// How a volume is stored for a program.
struct Target {
    const char* name;
    volume::Encoding encoding = {};
    Pictures pictures = {};
    Precision precision = Precision::full;
    int highest_order = 4; ///< bands above it are left out
    /// Rings of cells inside geometry to fill (see volume/dilate.h), for programs that read all
    /// cells around a point, valid or not.
    int dilate = 0;
    /// Its program shows the sum of the bands as it is: cells without negative irradiance are
    /// written (volume/dering.h), unless they were fitted.
    bool dering = false;
    /// What band 1 is multiplied by: metadata `l1_scale`, which read_volume takes back.
    double l1_scale = 1;
    Notes notes = Notes::none;
    std::array<const VolumeFormat*, 3> reads = {}; ///< null alone: any
};

/// In the order of target_names().
std::span<const Target> all_targets();
/// Null for an unknown name.
const Target* target_named(std::string_view name);

/// The target with another precision, and with the packing that is its own where precision has one.
Target with_precision(Target target, Precision precision);

/// Writes a volume as the target wants it, and its notes, which come last. Notes are of formats
/// with pictures alone. A volume that is given up is changed in place; of any other a copy is made
/// where something changes. Throws Error, as write_volume does.
WriteReport write_for(const Target& target, const std::string& path, Volume&& volume);
WriteReport write_for(const Target& target, const std::string& path, const Volume& volume);

/// Bytes of the numbers that write_for stores of a volume of `dims` with these grids, before they
/// are compressed without loss; no header or notes. Throws Error: argument (.tres and .nvdb, whose
/// nodes have a size of their own), and as write_for does for a form that there is not.
uint64_t stored_bytes(const Target& target, const std::string& path, Volume grids, glm::ivec3 dims);

/// The files that write_for makes of a volume with these grids, whatever is in them; as it lists
/// them. Throws Error as write_for does for a form that there is not.
std::vector<std::string> files_for(const Target& target, const std::string& path, Volume grids);

} // namespace lpvbake::io
