// OpenVDB files. The only header that the rest sees; OpenVDB itself stays in vdb.cpp.
#pragma once

#include "io/format.h"
#include "volume/bricks.h"

#include <optional>

namespace lpvbake::io {

extern const VolumeFormat vdb_format;

/// Which part of a lattice the bricks stand on that a volume holds as volume::stacked() puts them.
struct BrickPlaces {
    Grid lattice;
    std::vector<glm::ivec3> first; ///< of each brick the first sample

    /// Where a cell of that volume lies; none of those that are left over.
    std::optional<glm::ivec3> of_cell(glm::ivec3 cell) const;
};

/// Writes each grid of the volume (see grids.h) as Vec3S or float, by its width: sh_l0, sh_l1_y,
/// ... (coefficients as the encoding has them, by default canonical, cd/m^2), occlusion_l0, ...,
/// validity, wall_0, ... (cells, in the axes of the file), and density (float; luminance of the
/// mean over all directions, cd/m^2, for viewers), all with one transform (index i at the centre of
/// cell i, metres; see Encoding::corner_index). Grid by grid: one more is in memory at a time.
///
/// Metadata, of the file and of each grid: lpv:convention, lpv:direction, lpv:axes,
/// lpv:probe_position, lpv:index_position (text), lpv:grid_dims (vec3i), lpv:grid_origin (vec3d,
/// metres), lpv:cell_size (double, metres), lpv:sh_order (int32); of each grid lpv:quantity and
/// lpv:units; of the file lpv:precision and volume.metadata, with lpv:tool added where it is
/// missing.
///
/// Cells that are valid or have any value that is not zero are active in every grid, the others
/// inactive everywhere. The bytes depend on the content alone: OpenVDB's random UUID is replaced by
/// a hash of everything else in the file. Atomic. Throws Error: failure (a value is not finite),
/// unsupported (the encoding has no form for the order), file. Of bricks the lattice is that of
/// `bricks`, and all of their samples are active.
WriteReport write_vdb(const std::string& path, const Stored& stored, Precision precision,
                      const BrickPlaces* bricks = nullptr);

/// Reads a file that write_vdb made (in full or half, whatever its encoding: the result is
/// canonical). Grids of other kinds are left out. A file that was changed since, by accident or by
/// another program, is told by its hash. Throws Error (file, invalid, memory) that names the
/// file and the grid.
Volume read_vdb(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());
/// The same of bricks, as write_vdb takes them. Throws Error (invalid) for another lattice, too.
Volume read_vdb(const std::string& path, const BrickPlaces& bricks);

} // namespace lpvbake::io
