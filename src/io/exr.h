// OpenEXR flipbooks: z slices left to right, then down, one file a texture, with a JSON sidecar.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

extern const VolumeFormat exr_format;

/// Writes STEM_sh_l0.exr, ... (band) or STEM_r.exr, STEM_g.exr, STEM_b.exr (channel; of order 2
/// also STEM_r2.exr, STEM_g2.exr, STEM_b2.exr and STEM_sh_l2_x2y2.exr), every other kind of grids
/// (see grids.h) of three floats a cell in a picture each, STEM_wall_0.exr, ... (RGB = x, y, z),
/// and of one float up to four in a picture, STEM_occlusion.exr (RGBA = 1, y, z, x),
/// STEM_validity.exr (Y); and STEM.json; or STEM_0.exr to STEM_2.exr (vrc), STEM_cube.exr,
/// STEM_atlas.exr. `path` is STEM.exr. Texel (x, y) of tile t, counted from the picture's top left,
/// is cell (x, y, t); tiles beyond the last slice are zero. Each file is atomic, none takes its
/// name before all are on the disk, and the sidecar comes last.
///
/// The sidecar is the description (described.h, "format": "lpvbake flipbook"), with the layout of
/// the pictures and the metadata.
///
/// The header of every EXR repeats lattice, layout, metadata and the facts of its file as lpv:*
/// strings.
/// Throws Error: file; failure (a value is not finite); unsupported (packing and encoding have no
/// form for the order or for each other, or the picture would have more than 16384 texels a side).
WriteReport write_exr(const std::string& path, const Stored& stored, Precision precision,
                      const Pictures& pictures);

/// Reads what write_exr made, through its sidecar (STEM.json; STEM.exr and every picture name the
/// same). Throws Error (file, invalid, memory; unsupported: Packing::cube).
Volume read_exr(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

} // namespace lpvbake::io
