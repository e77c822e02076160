// Volume files, told apart by their extension: .vdb (OpenVDB), .nvdb (NanoVDB), .exr (flipbooks in
// OpenEXR, with a sidecar .json), .ktx2 and .dds (3D textures, the latter with a sidecar
// .dds.json), .glb (glTF, in its scene), .tres (probes of Godot's LightmapGI).
#pragma once

#include "lpvbake/export.h"
#include "lpvbake/volume.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake {

struct PackedScene; // lpvbake/pack.h

enum class Precision {
    full,
    half,
    /// Three colours of one exponent in 32 bits, where a texture holds light that has no sign; half
    /// in all others. Of .ktx2, .dds and .glb alone.
    rgb9e5,
    /// The mean as rgb9e5, all other coefficients over it in 8 bits each, between bounds that the
    /// description of the files has; what is no light is half. Of .ktx2 and .dds alone.
    unorm8,
    /// Blocks of 4 x 4 texels of GPUs: a mean in BC6H, all coefficients over it in BC7, each
    /// between bounds; what is no light is half. Of .ktx2 and .dds alone.
    bc6h,
};

/// What packing adds to the error of a volume: relative L1 of irradiance, packed against not.
struct PackingError {
    double cells = 0;    ///< at valid cells, as `lpvbake diff` has it
    double filtered = 0; ///< in the middle between eight valid ones, by a texture unit's filter
};

/// What became of a request that could not be met to the letter.
struct WriteReport {
    struct File {
        std::string path;
        uint64_t bytes = 0;
    };
    /// Such as: half asked for, but values exceed 65504, wrote float.
    std::vector<std::string> warnings;
    std::vector<File> files;
    Precision precision = Precision::full; ///< that of the files
    std::optional<PackingError> packing;   ///< of precisions that store light over its mean
    /// Of an EXR: tiles a row and rows; else 0.
    int columns = 0, rows = 0;

    uint64_t bytes() const {
        uint64_t sum = 0;
        for (const File& file : files)
            sum += file.bytes;
        return sum;
    }
};

/// Programs that volumes can be written for: generic, blender, houdini, unity, unreal, godot,
/// threejs, vrc, bevy.
LPVBAKE_API std::vector<const char*> target_names();

/// Writes a volume as a program wants it: convention, axes, packing and precision (unless that is
/// given), cells inside geometry filled where it reads those, and what it must be told in a file
/// beside it. A .glb gets the scene too, where one is given. Files are there whole or not at all.
/// Throws Error: argument (no such target or extension; names those that are known), file,
/// unsupported (no form for such a volume).
LPVBAKE_API WriteReport write_volume(const std::string& path, Volume volume,
                                     const std::string& target = "generic",
                                     std::optional<Precision> precision = std::nullopt,
                                     const PackedScene* scene = nullptr);

/// Reads what was written, by its own name or that of its sidecar, back to canonical coefficients
/// and glTF's axes, whatever the convention of the file. Throws Error: argument (unknown
/// extension), file, invalid, memory, unsupported (a packing that cannot be read back).
LPVBAKE_API Volume read_volume(const std::string& path);

} // namespace lpvbake
