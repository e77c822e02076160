// OpenVDB files. The only header that the rest sees; OpenVDB itself stays in vdb.cpp.
#pragma once

#include "volume/convention.h"

#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake {

enum class Precision { full, half };

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
    /// Of an EXR: tiles a row and rows; else 0.
    int columns = 0, rows = 0;

    uint64_t bytes() const {
        uint64_t sum = 0;
        for (const File& file : files)
            sum += file.bytes;
        return sum;
    }
};

/// Writes sh_l0, sh_l1_y, ... (Vec3S, coefficients as `encoding` has them, by default canonical,
/// cd/m^2; all names: coefficient_name in layout.h), occlusion_l0, ..., validity (float),
/// wall_0, ... (Vec3S, cells, in the axes of the file) and density (float; luminance of the mean
/// over all directions, cd/m^2, for viewers), all with one transform (index i at the centre of cell
/// i, metres; see Encoding::corner_index).
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
/// unsupported (the encoding has no form for the order), file.
WriteReport write_vdb(const std::string& path, const Volume& volume, Precision precision,
                      const Encoding& encoding = {});

/// Reads a file that write_vdb made (in full or half, whatever its encoding: the result is
/// canonical); a file that was changed since, by accident
/// or by another program, is told by its hash. Throws Error (file, invalid, memory) that names the
/// file and the grid.
Volume read_vdb(const std::string& path);

} // namespace lpvbake
