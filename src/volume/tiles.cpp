#include "volume/tiles.h"

#include "lpvbake/error.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace lpvbake::volume {
namespace {

constexpr int step = 8; ///< of where a column ends, cells

int64_t floor_to(int64_t value, int64_t multiple) {
    const int64_t rest = value % multiple;
    return value - (rest < 0 ? rest + multiple : rest);
}

/// In cells; at least one.
struct Cells {
    glm::i64vec3 begin, end;
};

Cells cells_of(const Bounds& box, double cell) {
    const glm::dvec3 begin = glm::floor(box.lo / cell), end = glm::ceil(box.hi / cell);
    if (glm::any(glm::lessThan(begin, glm::dvec3(-1e8)))
        || glm::any(glm::greaterThan(end, glm::dvec3(1e8))))
        throw Error(
            ErrorKind::argument,
            format("`cell_size` %.6g: the world is more than 1e8 cells from its origin; use "
                   "larger cells",
                   cell));
    return {glm::i64vec3(begin), glm::i64vec3(glm::max(end, begin + 1.0))};
}

} // namespace

std::string Tile::name() const {
    return format("x%d_y%d_z%d", at.x, at.y, at.z);
}

std::vector<Tile> tiles_around(std::span<const Bounds> boxes, double cell, int size) {
    std::map<std::pair<int64_t, int64_t>, std::vector<Cells>> columns; // by z and x, in tiles
    std::size_t entries = 0;
    const auto refuse = [&] {
        throw Error(
            ErrorKind::argument,
            format("`cell_size` %.6g: tiles of %d cells are more than %zu; use larger ones, "
                   "or `exclude` what is far away",
                   cell, size, most_tiles));
    };
    for (const Bounds& box : boxes) {
        if (box.empty())
            continue;
        const Cells cells = cells_of(box, cell);
        for (int64_t z = floor_to(cells.begin.z, size) / size; z * size < cells.end.z; ++z)
            for (int64_t x = floor_to(cells.begin.x, size) / size; x * size < cells.end.x; ++x) {
                columns[{z, x}].push_back(cells);
                if (++entries > 64 * most_tiles || columns.size() > most_tiles)
                    refuse();
            }
    }
    std::vector<Tile> tiles;
    for (const auto& [place, inside] : columns) {
        int64_t low = inside.front().begin.y, high = inside.front().end.y;
        for (const Cells& cells : inside) {
            low = std::min(low, cells.begin.y);
            high = std::max(high, cells.end.y);
        }
        low = floor_to(low, step);
        high = -floor_to(-high, step);
        for (int64_t y = 0; low + y * size < high; ++y) {
            const int64_t begin = low + y * size, end = std::min(high, begin + size);
            if (std::ranges::none_of(inside, [&](const Cells& cells) {
                    return cells.begin.y < end && begin < cells.end.y;
                }))
                continue;
            const glm::i64vec3 at(place.second, y, place.first);
            tiles.push_back({glm::ivec3(at), glm::ivec3(at.x * size, begin, at.z * size),
                             glm::ivec3((at.x + 1) * size, end, (at.z + 1) * size)});
            if (tiles.size() > most_tiles)
                refuse();
        }
    }
    std::ranges::sort(tiles, {},
                      [](const Tile& tile) { return std::tuple(tile.at.z, tile.at.y, tile.at.x); });
    return tiles;
}

} // namespace lpvbake::volume
