// The export of a world: all tiles as one OpenVDB file, grid by grid.
#include "io/atomic_file.h"
#include "io/vdb_grids.h"
#include "io/world_volume.h"
#include "lpvbake/error.h"
#include "text.h"
#include "volume/sh.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::io {
namespace {

using openvdb::Coord;

constexpr float half_max = 65504, half_min = 1.0f / 16384;

/// A file of the tiles, and what told it.
struct Source {
    const WorldVolume::Tile* tile;
    std::string uuid;
    bool half = false; ///< its values are
};

struct GridName {
    std::string name;
    volume::Quantity quantity;
    int width = 1;
};

/// As they stand in the file; those that are read and, for viewers, density.
std::vector<GridName> names_in(const VdbContent& content, int order) {
    std::vector<GridName> names;
    for (const GridKind* kind : volume::grid_kinds()) {
        const bool is_light = kind == &volume::light_kind();
        const int most = is_light ? volume::sh_count(order) : kind->most;
        for (int k = 0; k < most && content.has(volume::grid_name(*kind, k)); ++k)
            names.push_back({volume::grid_name(*kind, k),
                             volume::quantity_of(*kind, volume::ShConvention::radiance),
                             kind->width()});
    }
    names.push_back({density_kind.name, density_kind.quantity, 1});
    return names;
}

openvdb::GridBase::Ptr empty_grid(int width) {
    if (width == 1)
        return openvdb::FloatGrid::create();
    return openvdb::Vec3SGrid::create();
}

/// Copies the values that are active and that the volume has from this tile.
template <class GridType>
class TileCopy {
public:
    TileCopy(const WorldVolume::Tile& tile, const std::vector<uint8_t>& share, GridType& to)
        : tile_(tile),
          share_(share),
          file_{{}, 1, tile.end - tile.begin + 2},
          to_(to.getAccessor()) {}

    /// Returns the largest size of a value; infinity where one is not finite.
    float operator()(const GridType& from) {
        for (auto value = from.cbeginValueOn(); value; ++value) {
            openvdb::CoordBBox box;
            value.getBoundingBox(box);
            for (auto at = box.begin(); at; ++at) // of one voxel, or of a block of equal ones
                put(*at, *value);
        }
        return largest_;
    }

private:
    static float size_of(float value) {
        return std::isfinite(value) ? std::abs(value) : std::numeric_limits<float>::infinity();
    }
    static float size_of(const openvdb::Vec3s& value) {
        return std::max({size_of(value.x()), size_of(value.y()), size_of(value.z())});
    }
    void put(const Coord& at, const typename GridType::ValueType& value) {
        const glm::ivec3 cell(at.x(), at.y(), at.z());
        if (!share_[file_.index(cell)])
            return;
        largest_ = std::max(largest_, size_of(value));
        const glm::ivec3 own = tile_.begin - 1 + cell;
        to_.setValueOn(Coord(own.x, own.y, own.z), value);
    }

    const WorldVolume::Tile& tile_;
    const std::vector<uint8_t>& share_;
    Grid file_;
    typename GridType::Accessor to_;
    float largest_ = 0;
};

/// Throws Error (invalid).
template <class GridType>
float copy_tile(const WorldVolume::Tile& tile, const std::vector<uint8_t>& share,
                const openvdb::GridBase::Ptr& from, const std::string& name,
                openvdb::GridBase& to) {
    const auto grid = from ? openvdb::gridPtrCast<GridType>(from) : nullptr;
    if (!grid)
        reject(tile.file, "has no grid " + name + ", or one of another type");
    const glm::ivec3 last = tile.end - tile.begin + 1;
    const openvdb::CoordBBox whole(Coord(0), Coord(last.x, last.y, last.z));
    const openvdb::CoordBBox active = grid->evalActiveVoxelBoundingBox();
    if (!active.empty() && !whole.isInside(active))
        reject(tile.file, "grid " + name + " has values outside lpv:grid_dims");
    return TileCopy<GridType>(tile, share, static_cast<GridType&>(to))(*grid);
}

class Export {
public:
    Export(const WorldVolume& volume, bool as_half)
        : volume_(volume),
          shares_(volume),
          half_(as_half) {
        CommonFacts facts;
        for (const WorldVolume::Tile& tile : volume.tiles) {
            require(volume, tile);
            const OpenVdb file = open_vdb(tile.file);
            const Volume header = volume_of(file.content, tile.file, {});
            check_tile(volume, tile, header);
            check_encoding(tile, file.content);
            facts.add(volume, tile, header);
            std::vector<GridName> names = names_in(file.content, header.sh_order);
            if (names_.empty())
                names_ = std::move(names);
            else if (!std::ranges::equal(names, names_, {}, &GridName::name, &GridName::name))
                reject(volume.path, volume.title_of(tile) + " has other grids than the first row");
            const auto precision =
                file.content.metadata->getMetadata<openvdb::StringMetadata>("lpv:precision");
            sources_.push_back({&tile, file.uuid, precision && precision->value() == "half"});
        }
        header_ = facts.header(volume);
        header_.grid = volume.grid;
    }

    int sh_order() const { return header_.sh_order; }
    std::size_t count() const { return names_.size(); }
    openvdb::MetaMap metadata() const { return file_metadata(header_, {}, half_); }

    openvdb::GridBase::Ptr grid(std::size_t i) const {
        const GridName& name = names_[i];
        openvdb::GridBase::Ptr grid = empty_grid(name.width);
        float largest = 0;
        for (std::size_t k = 0; k < sources_.size(); ++k) {
            const Source& source = sources_[k];
            const std::vector<uint8_t> share = shares_.of(k);
            const openvdb::GridBase::Ptr from =
                open_vdb(source.tile->file, source.uuid).content.grid(name.name);
            const float own =
                name.width == 1
                    ? copy_tile<openvdb::FloatGrid>(*source.tile, share, from, name.name, *grid)
                    : copy_tile<openvdb::Vec3SGrid>(*source.tile, share, from, name.name, *grid);
            if (!std::isfinite(own))
                reject(source.tile->file, "grid " + name.name + " has a value that is not finite");
            check_half(own > half_max && !source.half, name.name, own);
            largest = std::max(largest, own);
        }
        check_half(name.name == volume::grid_name(volume::light_kind(), 0) && largest > 0
                       && largest < half_min,
                   name.name, largest);
        if (name.width == 1)
            static_cast<openvdb::FloatGrid&>(*grid).tree().prune();
        else
            static_cast<openvdb::Vec3SGrid&>(*grid).tree().prune();
        describe_grid(name.name, volume_.grid, false, name.name == density_kind.name, *grid);
        grid->setSaveFloatAsHalf(half_);
        insert_lattice(header_, {}, *grid);
        grid->insertMeta("lpv:quantity", openvdb::StringMetadata(name.quantity.name));
        grid->insertMeta("lpv:units", openvdb::StringMetadata(name.quantity.units));
        return grid;
    }

private:
    /// Values are copied as they are stored.
    void check_encoding(const WorldVolume::Tile& tile, const VdbContent& content) const {
        openvdb::MetaMap usual;
        insert_lattice({}, {}, usual);
        for (const char* fact : {"lpv:convention", "lpv:axes", "lpv:index_position"})
            if (const auto own = (*content.metadata)[fact];
                !own || own->str() != usual[fact]->str() || (*content.metadata)["lpv:l1_scale"])
                throw Error(ErrorKind::unsupported,
                            volume_.path + ": " + volume_.title_of(tile)
                                + " is stored in a convention or with axes of its own, and "
                                  "values are copied as they are; plan rows of canonical "
                                  "coefficients in glTF's axes");
    }
    void check_half(bool misfit, const std::string& name, float value) const {
        if (half_ && misfit)
            throw Error(ErrorKind::unsupported,
                        format("%s: %s reaches %.6g, which half precision has no number for; use "
                               "float",
                               volume_.path.c_str(), name.c_str(), double(value)));
    }

    const WorldVolume& volume_;
    TileShares shares_;
    bool half_;
    std::vector<Source> sources_; ///< of each tile
    std::vector<GridName> names_;
    Volume header_; ///< without grids
};

} // namespace

WorldExport export_world(const WorldVolume& volume, const std::string& path, Precision precision) {
    initialise_vdb();
    const Export world(volume, precision == Precision::half);
    WorldExport made{{}, world.sh_order()};
    made.report.precision = precision;
    try {
        made.report.files.push_back(write_grids(path, world.metadata(), world.count(), 1,
                                                [&](std::size_t i) { return world.grid(i); }));
    } catch (const openvdb::Exception& error) {
        reject(volume.path, one_line(error.what()));
    }
    return made;
}

} // namespace lpvbake::io
