// NanoVDB files. NanoVDB itself stays in nvdb.cpp.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

extern const VolumeFormat nvdb_format;

/// Writes the grids of write_vdb, with the same names, transform and active cells, as NanoVDB's
/// float and Vec3f, all in one segment without compression: a grid's bytes may be given to a GPU as
/// they lie in the file. Each has the description (described.h, "format": "lpvbake grids", with
/// "index_position" and the "grids" {name: {"quantity", "units"}}) as blind data of the name
/// "lpvbake". Numbers are full precision; where half is asked for, a warning says so. Grid by grid:
/// one more is in memory at a time, twice. Throws as write_vdb.
WriteReport write_nvdb(const std::string& path, const Stored& stored, Precision precision);

/// Reads what write_nvdb made. Grids of other kinds are left out. Throws Error (file, invalid,
/// memory) that names the file and the grid.
Volume read_nvdb(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

} // namespace lpvbake::io
