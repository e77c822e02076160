// OpenEXR flipbooks: z slices left to right, then down, one file a texture, with a JSON sidecar.
#pragma once

#include "io/vdb.h"

namespace lpvbake {

/// One RGB file a coefficient, or RGBA files for each colour channel: the coefficients 1, y, z, x
/// (with ShConvention::unity x, y, z, 1), of order 2 also xy, yz, z2, xz, and for all colours
/// together one RGB file of x2y2.
enum class Packing { band, channel };

/// Writes STEM_sh_l0.exr, ... (band) or STEM_r.exr, STEM_g.exr, STEM_b.exr (channel; of order 2
/// also STEM_r2.exr, STEM_g2.exr, STEM_b2.exr and STEM_sh_l2_x2y2.exr), the occlusion
/// as STEM_occlusion.exr (RGBA = 1, y, z, x), the validity as STEM_validity.exr (Y), and STEM.json.
/// `path` is STEM.exr. Texel (x, y) of tile t, counted from the picture's top left, is cell
/// (x, y, t); tiles beyond the last slice are zero. Each file is atomic, none takes its name before
/// all are on the disk, and the sidecar comes last.
///
/// The sidecar (numbers round-trip exactly):
///
///     {
///       "format": "lpvbake flipbook", "version": 1,
///       "grid": { "dims": [x, y, z], "origin": [x, y, z] (metres), "cell": metres },
///       "layout": { "columns": tiles a row, "rows": rows, "tile": [width, height], "slices": z },
///       "packing": "band" | "channel", "precision": "float" | "half", "sh_order": 0 to 4,
///       "convention": "radiance", ..., "direction": "incident" | "travel", "axes": "gltf", ...,
///       "probe_position": "center",
///       "files": [ { "file": name beside the sidecar, "quantity": what it holds, "units": unit,
///                    "channels": [what each of its channels holds: "sh_l0.r", "occlusion_l1_y",
///                                 "validity", ...] }, ... ],
///       "metadata": { volume.metadata, "tool" added where it is missing }
///     }
///
/// The header of every EXR repeats lattice, layout, metadata and the facts of its file as lpv:*
/// strings.
/// `columns` is the number of tiles a row; 0: so that the picture is nearly square.
/// Throws Error: file; failure (a value is not finite); unsupported (packing or encoding have no
/// form for the order, or the picture would have more than 16384 texels a side).
WriteReport write_exr(const std::string& path, const Volume& volume, Precision precision,
                      Packing packing, const Encoding& encoding = {}, int columns = 0);

/// Reads what write_exr made, through its sidecar (STEM.json; STEM.exr and every picture name the
/// same). Throws
/// Error (file, invalid, memory).
Volume read_exr(const std::string& path);

} // namespace lpvbake
