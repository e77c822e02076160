// The export of a world: all tiles as one OpenVDB file, grid by grid.
#include "io/atomic_file.h"
#include "io/layout.h"
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

/// A file of the tiles, and what told it.
struct Source {
    const WorldVolume::Tile* tile;
    std::string uuid;
    bool half = false; ///< its values are
};

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
        each_active(from, [this](const Coord& at, const auto& value) { put(at, value); });
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
                const openvdb::GridBase::Ptr& from, const std::string& name, GridType& to) {
    const auto grid = from ? openvdb::gridPtrCast<GridType>(from) : nullptr;
    if (!grid)
        reject(tile.file, "has no grid " + name + ", or one of another type");
    check_within(*grid, tile.end - tile.begin + 2, tile.file);
    return TileCopy<GridType>(tile, share, to)(*grid);
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
            const auto name = &volume::ConstGridView::name;
            std::vector<volume::ConstGridView> grids = grids_in(file.content, header.sh_order);
            if (grids_.empty())
                grids_ = std::move(grids);
            else if (!std::ranges::equal(grids, grids_, {}, name, name))
                reject(volume.path, volume.title_of(tile) + " has other grids than the first row");
            const auto precision =
                file.content.metadata->getMetadata<openvdb::StringMetadata>("lpv:precision");
            sources_.push_back({&tile, file.uuid, precision && precision->value() == "half"});
        }
        header_ = facts.header(volume);
        header_.grid = volume.grid;
    }

    int sh_order() const { return header_.sh_order; }
    std::size_t count() const { return grids_.size(); }
    openvdb::MetaMap metadata() const { return file_metadata(header_, {}, half_); }

    openvdb::GridBase::Ptr grid(std::size_t i, Progress& progress) const {
        if (grids_[i].kind->width() == 1)
            return grid_of<openvdb::FloatGrid>(i, progress);
        return grid_of<openvdb::Vec3SGrid>(i, progress);
    }

private:
    template <class GridType>
    typename GridType::Ptr grid_of(std::size_t i, Progress& progress) const {
        const volume::ConstGridView& view = grids_[i];
        const std::string name = view.name();
        auto grid = GridType::create();
        float largest = 0;
        for (std::size_t k = 0; k < sources_.size(); ++k) {
            progress.advance(i * sources_.size() + k);
            const Source& source = sources_[k];
            const std::vector<uint8_t> share = shares_.of(k);
            const openvdb::GridBase::Ptr from =
                open_vdb(source.tile->file, source.uuid).content.grid(name);
            const float own = copy_tile<GridType>(*source.tile, share, from, name, *grid);
            if (!std::isfinite(own))
                reject(source.tile->file, "grid " + name + " has a value that is not finite");
            check_half(own > half_max && !source.half, name, own);
            largest = std::max(largest, own);
        }
        check_half(view.kind == &volume::light_kind() && view.k == 0 && largest > 0
                       && largest < half_min,
                   name, largest);
        grid->tree().prune();
        describe_grid(name, volume_.grid, false, view.kind == &density_kind, *grid);
        insert_facts(*view.kind, header_, {}, half_, *grid);
        return grid;
    }

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
    std::vector<Source> sources_;              ///< of each tile
    std::vector<volume::ConstGridView> grids_; ///< that each has, without values
    Volume header_;                            ///< without grids
};

} // namespace

WorldExport export_world(const WorldVolume& volume, const std::string& path, Precision precision,
                         Progress& progress) {
    initialise_vdb();
    const Export world(volume, precision == Precision::half);
    WorldExport made{{}, world.sh_order()};
    made.report.precision = precision;
    progress.begin("export", world.count() * volume.tiles.size());
    try {
        made.report.files.push_back(
            write_grids(path, world.metadata(), world.count(), 1,
                        [&](std::size_t i) { return world.grid(i, progress); }));
    } catch (const openvdb::Exception& error) {
        reject(volume.path, one_line(error.what()));
    }
    return made;
}

} // namespace lpvbake::io
