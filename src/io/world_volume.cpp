#include "io/world_volume.h"

#include "io/atomic_file.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "machine.h"
#include "quoted.h"
#include "text.h"
#include "volume/grids.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

/// Of the lattice whose cell 0 begins at the world's origin.
glm::ivec3 cells_of(const std::string& path, glm::dvec3 corner, double cell) {
    const glm::dvec3 cells = corner / cell;
    for (int axis = 0; axis < 3; ++axis)
        if (!(std::abs(cells[axis]) < 1e9
              && std::abs(cells[axis] - std::round(cells[axis])) < 1e-3))
            reject(path, "has a row whose \"bounds\" lie on no cells; plan it again");
    return glm::ivec3(glm::round(cells));
}

bool overlap(glm::ivec3 begin, glm::ivec3 end, glm::ivec3 other_begin, glm::ivec3 other_end) {
    return glm::all(glm::lessThan(begin, other_end)) && glm::all(glm::lessThan(other_begin, end));
}

bool contains(glm::ivec3 begin, glm::ivec3 end, glm::ivec3 cell) {
    return glm::all(glm::lessThanEqual(begin, cell)) && glm::all(glm::lessThan(cell, end));
}

/// Tiles by their column, of which those of a plan stand at multiples of their size.
using Columns = std::map<std::pair<int, int>, std::vector<std::size_t>>;

/// Throws Error (invalid) unless the tiles are those of one lattice, each cell of one.
void check_tiles(const std::string& path, const std::vector<WorldVolume::Tile>& tiles, int size) {
    Columns columns;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
        const glm::ivec3 begin = tiles[i].begin, dims = tiles[i].end - begin;
        if (dims.x != size || dims.z != size || dims.y < 1 || dims.y > size || begin.x % size != 0
            || begin.z % size != 0)
            reject(path, "has a row whose \"bounds\" are those of no tile; plan it again");
        columns[{begin.z / size, begin.x / size}].push_back(i);
    }
    for (auto& [place, column] : columns) {
        std::ranges::sort(column, {}, [&](std::size_t i) { return tiles[i].begin.y; });
        for (std::size_t i = 1; i < column.size(); ++i)
            if (tiles[column[i]].begin.y < tiles[column[i - 1]].end.y)
                reject(path, "has rows of a scenario that overlap; plan it again");
    }
}

/// Floats of a cell.
std::size_t width_of(const Volume& volume) {
    std::size_t width = 0;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        width += std::size_t(grid.kind->width());
    return width;
}

/// Gives `to` the grids of `from`, all 0.
void set_grids_like(const Volume& from, Volume& to) {
    for (const GridKind* kind : volume::grid_kinds())
        if (const std::size_t count = volume::grids_of(from, *kind).size())
            volume::set_grids(to, *kind, int(count));
}

void copy_cells(const Volume& from, glm::ivec3 at, const std::vector<uint8_t>& share, Volume& to) {
    const std::vector<volume::ConstGridView> sources = volume::grids_of(from);
    const std::vector<volume::GridView> targets = volume::grids_of(to);
    for (std::size_t i = 0; i < from.grid.size(); ++i) {
        const glm::ivec3 cell = at + from.grid.cell_at(i);
        if (!share[i] || !to.grid.contains(cell))
            continue;
        const std::size_t own = to.grid.index(cell);
        for (std::size_t k = 0; k < sources.size(); ++k) {
            const auto width = std::size_t(sources[k].kind->width());
            std::copy_n(sources[k].data + i * width, width, targets[k].data + own * width);
        }
    }
}

bool has_same_grids(const Volume& a, const Volume& b) {
    return std::ranges::equal(volume::grids_of(a), volume::grids_of(b), {},
                              &volume::ConstGridView::name, &volume::ConstGridView::name);
}

} // namespace

std::string WorldVolume::title_of(const Tile& tile) const {
    return format("row %zu (%s, %s)", tile.row, scenario.c_str(),
                  fs::path(tile.file).filename().c_str());
}

WorldVolume world_volume(const std::string& path, const World& world, const std::string& scenario) {
    std::string names;
    for (const World::Scenario& each : world.scenarios)
        names += (names.empty() ? "" : ", ") + printable(each.name);
    if (scenario.empty() && world.scenarios.size() != 1)
        throw Error(ErrorKind::argument,
                    path + ": has several lightings; name one by `scenario`: " + names);
    if (!scenario.empty()
        && std::ranges::count(world.scenarios, scenario, &World::Scenario::name) == 0)
        throw Error(ErrorKind::argument,
                    path + ": has no `scenario` " + printable(scenario) + ", but " + names);
    WorldVolume volume{path, scenario.empty() ? world.scenarios.front().name : scenario, {}, {}};
    glm::ivec3 lo(std::numeric_limits<int>::max()), hi(std::numeric_limits<int>::min());
    for (std::size_t i = 0; i < world.rows.size(); ++i) {
        const World::Row& row = world.rows[i];
        if (row.scenario != volume.scenario)
            continue;
        const WorldVolume::Tile& tile = volume.tiles.emplace_back(
            WorldVolume::Tile{i, row.file, row.hash, cells_of(path, row.bounds.lo, world.cell),
                              cells_of(path, row.bounds.hi, world.cell)});
        lo = glm::min(lo, tile.begin);
        hi = glm::max(hi, tile.end);
    }
    if (volume.tiles.empty())
        reject(path,
               "has no rows of the scenario " + printable(volume.scenario) + "; plan it again");
    check_tiles(path, volume.tiles, world.tile);
    const glm::i64vec3 dims = glm::i64vec3(hi) - glm::i64vec3(lo) + int64_t(2);
    if (std::max({dims.x, dims.y, dims.z}) > std::numeric_limits<int>::max())
        reject(path, "has more cells along an axis than 2^31 - 1; plan it again");
    volume.grid = {glm::dvec3(lo - 1) * world.cell, world.cell, glm::ivec3(dims)};
    for (WorldVolume::Tile& tile : volume.tiles) {
        tile.begin -= lo - 1;
        tile.end -= lo - 1;
    }
    return volume;
}

TileShares::TileShares(const WorldVolume& volume) : volume_(volume), near_(volume.tiles.size()) {
    // In grid cells tiles begin a layer in from a multiple of their size along x and z.
    const int size = volume.tiles.front().end.x - volume.tiles.front().begin.x;
    Columns columns;
    const auto place = [&](const WorldVolume::Tile& tile) {
        return std::pair((tile.begin.z - 1) / size, (tile.begin.x - 1) / size);
    };
    for (std::size_t i = 0; i < volume.tiles.size(); ++i)
        columns[place(volume.tiles[i])].push_back(i);
    for (std::size_t i = 0; i < volume.tiles.size(); ++i) {
        const WorldVolume::Tile& tile = volume.tiles[i];
        const auto [z, x] = place(tile);
        for (const auto& [dz, dx] : {std::pair(-1, -1),
                                     {-1, 0},
                                     {-1, 1},
                                     {0, -1},
                                     {0, 0},
                                     {0, 1},
                                     {1, -1},
                                     {1, 0},
                                     {1, 1}})
            if (const auto column = columns.find({z + dz, x + dx}); column != columns.end())
                for (const std::size_t j : column->second)
                    if (j != i
                        && overlap(tile.begin - 1, tile.end + 1, volume.tiles[j].begin - 1,
                                   volume.tiles[j].end + 1))
                        near_[i].push_back(j);
    }
}

std::vector<uint8_t> TileShares::of(std::size_t tile) const {
    const WorldVolume::Tile& own = volume_.tiles[tile];
    const Grid file{{}, 1, own.end - own.begin + 2};
    std::vector<uint8_t> share(file.size(), 1);
    for (std::size_t i = 0; i < share.size(); ++i) {
        const glm::ivec3 cell = own.begin - 1 + file.cell_at(i);
        if (contains(own.begin, own.end, cell))
            continue;
        share[i] = std::ranges::none_of(near_[tile], [&](std::size_t j) {
            const WorldVolume::Tile& other = volume_.tiles[j];
            return contains(other.begin, other.end, cell)
                   || (j < tile && contains(other.begin - 1, other.end + 1, cell));
        });
    }
    return share;
}

std::vector<std::size_t> TileShares::tiles_in(glm::ivec3 begin, glm::ivec3 end) const {
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < volume_.tiles.size(); ++i) {
        const WorldVolume::Tile& tile = volume_.tiles[i];
        bool has_some = overlap(begin, end, tile.begin, tile.end);
        if (!has_some && overlap(begin, end, tile.begin - 1, tile.end + 1)) {
            const Grid file{{}, 1, tile.end - tile.begin + 2};
            const std::vector<uint8_t> share = of(i);
            for (std::size_t k = 0; k < share.size() && !has_some; ++k)
                has_some = share[k] && contains(begin, end, tile.begin - 1 + file.cell_at(k));
        }
        if (has_some)
            found.push_back(i);
    }
    return found;
}

bool is_there(const std::string& file) {
    const VolumeFormat* format = volume_format(file);
    fs::path read = file;
    if (format && format->sidecar[0] != '\0') // the textures have other names
        read.replace_extension(format->sidecar);
    return fs::exists(read);
}

void require(const WorldVolume& volume, const WorldVolume::Tile& tile) {
    if (!is_there(tile.file))
        throw Error(ErrorKind::file, volume.path + ": " + volume.title_of(tile)
                                         + " is missing; bake it with lpvbake world `rows` "
                                         + std::to_string(tile.row));
}

void check_tile(const WorldVolume& volume, const WorldVolume::Tile& tile, const Volume& header) {
    const auto hash = header.metadata.find("bake_hash");
    const Grid& grid = header.grid;
    const glm::dvec3 origin = volume.grid.origin + volume.grid.cell * glm::dvec3(tile.begin - 1);
    if (hash == header.metadata.end() || hash->second != tile.hash
        || grid.dims != tile.end - tile.begin + 2 || grid.is_turned()
        || !(std::abs(grid.cell - volume.grid.cell) < 1e-6 * volume.grid.cell)
        || !(glm::length(grid.origin - origin) < 1e-3 * volume.grid.cell))
        reject(volume.path, volume.title_of(tile)
                                + " is of another scene, other options or another version; "
                                  "bake it with lpvbake world `rows` "
                                + std::to_string(tile.row)
                                + ", or plan the world again where the scene was edited");
}

void CommonFacts::add(const WorldVolume& volume, const WorldVolume::Tile& tile,
                      const Volume& header) {
    if (!common_) {
        common_.emplace();
        common_->sh_order = header.sh_order;
        common_->metadata = header.metadata;
        return;
    }
    const auto& first = common_->metadata;
    const auto a = first.find("tracer"), b = header.metadata.find("tracer");
    if (header.sh_order != common_->sh_order || (a == first.end()) != (b == header.metadata.end())
        || (a != first.end() && a->second != b->second))
        reject(volume.path,
               volume.title_of(tile) + " was baked in another way than the first row: "
                   + (header.sh_order != common_->sh_order
                          ? "they differ in the order of the harmonics"
                          : "their rays were traced by "
                                + (b == header.metadata.end() ? std::string("?")
                                                              : printable(b->second))
                                + " and "
                                + (a == first.end() ? std::string("?") : printable(a->second)))
                   + "; bake all rows with one `isa` and `rays`");
    std::erase_if(common_->metadata, [&](const auto& fact) {
        const auto other = header.metadata.find(fact.first);
        return other == header.metadata.end() || other->second != fact.second;
    });
}

Volume CommonFacts::header(const WorldVolume& volume) const {
    Volume header = *common_;
    // Of a row alone, though there may be but one.
    for (const char* fact :
         {"bake_hash", "scene_hash", "settings", "output_settings", "surroundings", "exposure"})
        header.metadata.erase(fact);
    header.metadata["world"] = fs::path(volume.path).filename().string();
    header.metadata["scenario"] = volume.scenario;
    return header;
}

Volume read_cells(const WorldVolume& volume, glm::ivec3 begin, glm::ivec3 end,
                  uint64_t most_bytes) {
    const TileShares shares(volume);
    CommonFacts facts;
    Volume cells;
    cells.grid = {volume.grid.origin + volume.grid.cell * glm::dvec3(begin), volume.grid.cell,
                  end - begin};
    bool is_first = true;
    for (const std::size_t i : shares.tiles_in(begin, end)) {
        const WorldVolume::Tile& tile = volume.tiles[i];
        require(volume, tile);
        const Volume own = read_volume(tile.file, volume::grid_kinds());
        check_tile(volume, tile, own);
        facts.add(volume, tile, own);
        if (is_first) {
            const glm::dvec3 dims(cells.grid.dims);
            const double count = dims.x * dims.y * dims.z;
            const double bytes = count * double(width_of(own)) * sizeof(float);
            if (bytes > double(most_bytes) || count > std::numeric_limits<int32_t>::max())
                throw Error(
                    ErrorKind::memory,
                    format("%s: %d x %d x %d cells take %s of memory with those between the "
                           "tiles, more than %s; allow more with `max_memory`, or take less "
                           "of the world",
                           volume.path.c_str(), cells.grid.dims.x, cells.grid.dims.y,
                           cells.grid.dims.z, memory_text(bytes).c_str(),
                           memory_text(double(most_bytes)).c_str()));
            set_grids_like(own, cells);
            is_first = false;
        }
        if (!has_same_grids(own, cells))
            reject(volume.path, volume.title_of(tile) + " has other grids than the first row");
        copy_cells(own, tile.begin - 1 - begin, shares.of(i), cells);
    }
    if (is_first)
        reject(volume.path, "has no tile there");
    const Volume header = facts.header(volume);
    cells.sh_order = header.sh_order;
    cells.metadata = header.metadata;
    return cells;
}

bool can_export(const WorldVolume& volume) {
    return std::ranges::all_of(volume.tiles, [](const WorldVolume::Tile& tile) {
        return volume_format(tile.file) == &vdb_format;
    });
}

} // namespace lpvbake::io
