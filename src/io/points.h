// Files of points, and of the light at them.
#pragma once

#include "lpvbake/file.h"
#include "volume/points.h"

#include <string>

namespace lpvbake::io {

/// Reads points by the file's suffix:
///
///     .json  {"points": [[x, y, z], ...], "normals": [[x, y, z], ...]}; normals may be left out
///     .csv   lines x,y,z or x,y,z,nx,ny,nz, below a line of these names or none
///     .npy   an array of shape (n, 3) or (n, 6), of '<f4' or '<f8', in C's order; or, of a
///            picture's texels, (height, width, 3) or (height, width, 6)
///
/// Metres in the scene's axes; normals become unit ones. Takes 36 bytes a point, whatever the size
/// of the file. Throws Error (argument: another suffix; file; invalid, and names the place: what is
/// no finite number, no point, more than volume::most_points, normals that are not one a point or
/// have no direction).
volume::Points read_points(const std::string& path);

/// ".json, .csv, .npy": the suffixes of read_points.
std::string point_format_list();
/// Of write_points.
std::string lit_point_format_list();
/// Whether write_points has a form for the suffix.
bool is_lit_point_format(const std::string& path);

/// Writes what is known of all points, in their order, by the file's suffix:
///
///     .json  {"format": "lpvbake points", "version": 1, "sh_order": n, "convention": "radiance",
///             "metadata": {...}, "points": [{"position": [x, y, z], "sh": [[r, g, b], ...],
///             "validity": 0 or 1, "backs": share, "sky": [4 coefficients]; with normals also
///             "normal": [x, y, z], "irradiance": [r, g, b]}, ...]}
///
///     .npy   a structured array of the same fields, "sh" of shape (coefficients, 3); of a
///            picture's texels (height, width) of them
///
///     .exr   a picture of float channels: with normals R, G and B (the irradiance), and layers
///            sh_l0.R, sh_l0.G, ..., validity, backs and sky.0 to sky.3; metadata as "lpv:..."
///            strings. Texel by texel, those of a list one below the other.
///
/// Numbers as floats need them. Throws Error (argument: another suffix; file, io).
WriteReport write_points(const std::string& path, const volume::LitPoints& lit);

} // namespace lpvbake::io
