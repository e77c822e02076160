// Densities of OpenVDB files, as simulations write smoke and clouds.
#pragma once

#include "volume/density.h"

#include <string>
#include <vector>

namespace lpvbake::io {

/// Reads a float grid: of that name; of an empty one `density`, or the only grid there is. Its
/// transform is any affine map, in metres, in the scene's axes; a voxel is around its index. What
/// is not active is 0, and what is below 0 is taken as 0, with a warning. The file is another
/// program's: OpenVDB trusts what it reads. Throws Error that names file and grid: file; invalid
/// (no OpenVDB file, no such grid, no active voxel, nothing above 0, a value that is not finite, a
/// transform that is flat); unsupported (values that are no floats, signed distances, a transform
/// that is not affine); memory.
volume::Density read_density(const std::string& path, const std::string& grid,
                             std::vector<std::string>& warnings);

} // namespace lpvbake::io
