#include "io/density.h"

#include "file_error.h"
#include "io/vdb_grids.h"
#include "lpvbake/error.h"
#include "machine.h"
#include "quoted.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace lpvbake::io {
namespace {

/// The grid of that name, or the one that is meant without one.
openvdb::GridBase::Ptr find_grid(openvdb::io::File& file, const std::string& path,
                                 const std::string& wanted) {
    std::vector<std::string> names;
    for (auto name = file.beginName(); name != file.endName(); ++name)
        names.push_back(*name);
    const auto has = [&](const std::string& name) {
        return std::ranges::find(names, name) != names.end();
    };
    std::string list;
    for (const std::string& name : names)
        list += (list.empty() ? "" : ", ") + in_quotes(name);
    if (!wanted.empty() && !has(wanted))
        throw Error(ErrorKind::invalid,
                    path + ": has no grid " + in_quotes(wanted) + "; there are " + list);
    if (!wanted.empty())
        return file.readGrid(wanted);
    if (has("density"))
        return file.readGrid("density");
    if (names.size() != 1)
        throw Error(ErrorKind::invalid, path + ": which grid is the density? there are "
                                            + (names.empty() ? "none" : list) + "; give it as "
                                            + path + ":NAME");
    return file.readGrid(names.front());
}

/// From metres to voxels that begin at `lo`.
glm::dmat4 to_voxels(const openvdb::math::Transform& transform, const openvdb::Coord& lo,
                     const std::string& place) {
    if (!transform.isLinear())
        throw Error(ErrorKind::unsupported,
                    place
                        + ": its transform is no affine map, as of a camera's frustum; resample "
                          "it to even voxels");
    const openvdb::Mat4R map = transform.baseMap()->getAffineMap()->getMat4();
    glm::dmat4 to_metres;
    bool finite = true;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
            to_metres[i][j] = map(i, j);
            finite = finite && std::isfinite(map(i, j));
        }
    const double volume = glm::determinant(glm::dmat3(to_metres));
    if (!finite || !std::isnormal(volume))
        throw Error(ErrorKind::invalid, place + ": its transform is flat, or not finite");
    glm::dmat4 shift(1.0);
    shift[3] = glm::dvec4(0.5 - lo.x(), 0.5 - lo.y(), 0.5 - lo.z(), 1);
    return shift * glm::inverse(to_metres);
}

volume::Density density_of(const openvdb::FloatGrid& grid, const std::string& place,
                           std::vector<std::string>& warnings) {
    if (grid.getGridClass() == openvdb::GRID_LEVEL_SET)
        throw Error(ErrorKind::unsupported,
                    place + ": holds signed distances, not a density; make fog of it");
    const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
    if (box.empty())
        throw Error(ErrorKind::invalid, place + ": has no active voxel");
    volume::Density density;
    density.to_voxels = to_voxels(grid.transform(), box.min(), place);
    const openvdb::Coord dims = box.dim();
    const double count = double(dims.x()) * dims.y() * dims.z();
    if (count > double(1 << 29) || 4 * count > double(machine_memory()))
        throw Error(ErrorKind::memory,
                    place
                        + format(": %d x %d x %d voxels are too many; resample it coarser",
                                 dims.x(), dims.y(), dims.z()));
    density.dims = {dims.x(), dims.y(), dims.z()};
    density.values.assign(std::size_t(count), 0.0f);
    uint64_t negative = 0;
    for (auto active = grid.cbeginValueOn(); active; ++active) {
        const float value = *active;
        openvdb::CoordBBox part;
        active.getBoundingBox(part);
        if (!std::isfinite(value))
            throw Error(ErrorKind::invalid,
                        place
                            + format(": voxel (%d, %d, %d) is not finite", part.min().x(),
                                     part.min().y(), part.min().z()));
        negative += value < 0 ? part.volume() : 0;
        density.most = std::max(density.most, value);
        for (int z = part.min().z(); z <= part.max().z(); ++z)
            for (int y = part.min().y(); y <= part.max().y(); ++y)
                for (int x = part.min().x(); x <= part.max().x(); ++x) {
                    const openvdb::Coord at = openvdb::Coord(x, y, z) - box.min();
                    density.values[std::size_t(at.x())
                                   + std::size_t(dims.x())
                                         * (std::size_t(at.y())
                                            + std::size_t(dims.y()) * std::size_t(at.z()))] =
                        std::max(value, 0.0f);
                }
    }
    if (!(density.most > 0))
        throw Error(ErrorKind::invalid, place + ": has no voxel above 0");
    if (negative > 0)
        warnings.push_back(place + ": " + counted(negative, "voxel") + " below 0 count as 0");
    return density;
}

} // namespace

volume::Density read_density(const std::string& path, const std::string& name,
                             std::vector<std::string>& warnings) {
    initialise_vdb();
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error))
        throw Error(ErrorKind::file, path + ": No such file");
    try {
        openvdb::io::File file(path);
        file.open(/*delayLoad=*/false);
        const openvdb::GridBase::Ptr grid = find_grid(file, path, name);
        const std::string place = path + ": grid " + in_quotes(grid->getName());
        const auto floats = openvdb::gridPtrCast<openvdb::FloatGrid>(grid);
        if (!floats)
            throw Error(ErrorKind::unsupported,
                        place + " holds " + printable(grid->valueType()) + ", not float");
        return density_of(*floats, place, warnings);
    } catch (const openvdb::Exception& failure) {
        // "IoError: ...": a program's name for it says nothing to who runs it.
        std::string_view what = failure.what();
        if (const std::size_t label = what.find("Error: "); label != std::string_view::npos)
            what.remove_prefix(label + 7);
        throw Error(ErrorKind::invalid,
                    path + ": cannot be read as an OpenVDB file: " + printable(what, 300));
    } catch (const std::bad_alloc&) {
        throw Error(ErrorKind::memory, path + ": its grid does not fit this machine's memory");
    }
}

} // namespace lpvbake::io
