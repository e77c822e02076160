// OpenEXR flipbooks: z slices left to right, then down, one file a texture, with a JSON sidecar.
#pragma once

#include "io/vdb.h"

#include <optional>
#include <string_view>

namespace lpvbake {

/// What the pictures hold. The last three hold nothing but light: no occlusion, no validity.
enum class Packing {
    band, ///< one RGB file a coefficient
    /// RGBA files for each colour channel: the coefficients 1, y, z, x (with ShConvention::unity x,
    /// y, z, 1), of order 2 also xy, yz, z2, xz, and for all colours together one RGB file of x2y2.
    channel,
    /// Order 1 of ShConvention::unity as VRC Light Volumes take it (LV_SampleLightVolumeTex of
    /// LightVolumes.cginc at 3cefcb7), in RGBA files 0 to 2: colours of 1 and red z; colours of x
    /// and green z; colours of y and blue z.
    vrc,
    /// Irradiance over pi on the six sides of a cube, as Bevy takes it (bevy_pbr's
    /// irradiance_volume.wgsl at 00620e1): one RGB picture of x times 2 y times 3 z texels, +x
    /// before -x along y, then y and z behind along z. It cannot be read back.
    cube,
    /// The atlas of three.js r187's LightProbeGridWebGL (shader chunk lightprobes_pars_fragment):
    /// canonical coefficients of orders 0 to 2, colour by colour, four to an RGBA texel, in seven
    /// blocks along z, each between copies of its outermost slices.
    atlas,
};

const char* name_of(Packing packing);
std::optional<Packing> packing_named(std::string_view name);

struct Pictures {
    Packing packing = Packing::band;
    int columns = 0; ///< tiles a row; 0: so that the picture is nearly square
    /// For programs that take every tile for a slice: only numbers of columns that divide the
    /// number of slices.
    bool no_empty_tiles = false;
};

/// Writes STEM_sh_l0.exr, ... (band) or STEM_r.exr, STEM_g.exr, STEM_b.exr (channel; of order 2
/// also STEM_r2.exr, STEM_g2.exr, STEM_b2.exr and STEM_sh_l2_x2y2.exr), the occlusion
/// as STEM_occlusion.exr (RGBA = 1, y, z, x), the validity as STEM_validity.exr (Y), the walls as
/// STEM_wall_0.exr, ... (RGB = x, y, z), and STEM.json;
/// or STEM_0.exr to STEM_2.exr (vrc), STEM_cube.exr, STEM_atlas.exr.
/// `path` is STEM.exr. Texel (x, y) of tile t, counted from the picture's top left, is cell
/// (x, y, t); tiles beyond the last slice are zero. Each file is atomic, none takes its name before
/// all are on the disk, and the sidecar comes last.
///
/// The sidecar (numbers round-trip exactly):
///
///     {
///       "format": "lpvbake flipbook", "version": 1,
///       "grid": { "dims": [x, y, z], "origin": [x, y, z] (metres), "cell": metres },
///       "layout": { "columns": tiles a row, "rows": rows, "tile": [width, height], "slices": z,
///                   "padding": slices at either end of each block (atlas alone) },
///       "packing": "band", ..., "precision": "float" | "half", "sh_order": 0 to 4,
///       "convention": "radiance", ..., "direction": "incident" | "travel", "axes": "gltf", ...,
///       "probe_position": "center",
///       "files": [ { "file": name beside the sidecar, "quantity": what it holds, "units": unit,
///                    "channels": [what each of its channels holds: "sh_l0.r", "occlusion_l1_y",
///                                 "validity", "wall_0.x", ...], or of atlas and cube
///                    "blocks": [the same of each block, "" for nothing] }, ... ],
///       "metadata": { volume.metadata, "tool" added where it is missing }
///     }
///
/// The header of every EXR repeats lattice, layout, metadata and the facts of its file as lpv:*
/// strings.
/// Throws Error: file; failure (a value is not finite); unsupported (packing and encoding have no
/// form for the order or for each other, or the picture would have more than 16384 texels a side).
WriteReport write_exr(const std::string& path, const Volume& volume, Precision precision,
                      const Pictures& pictures = {}, const Encoding& encoding = {});

/// Reads what write_exr made, through its sidecar (STEM.json; STEM.exr and every picture name the
/// same). Throws Error (file, invalid, memory; unsupported: Packing::cube).
Volume read_exr(const std::string& path);

} // namespace lpvbake
