#include "solver/gather/blocks.h"

#include "solver/gather/cell_zone.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>
#include <memory>
#include <tuple>

namespace lpvbake::solver::gather {
namespace {

static_assert(Block::edge == zone_edge);
constexpr glm::ivec3 block_dims(zone_edge + 1);
constexpr size_t most_zones = 64; ///< at a time: what their places see is kept as long

/// The patches that may cross each block.
class PatchesOf {
public:
    PatchesOf(std::span<const Block> blocks, std::span<const surface::Patch> patches)
        : own_(blocks.size()) {
        if (blocks.empty())
            return;
        const float edge = float(zone_edge) * blocks[0].step;
        const auto cube_of = [&](glm::vec3 place) {
            return glm::ivec3(
                glm::floor(glm::clamp((place - blocks[0].first) / edge, -1e6f, 1e6f)));
        };
        std::map<std::tuple<int, int, int>, uint32_t> by_cube;
        glm::ivec3 least(1 << 30), most(-(1 << 30));
        for (size_t i = 0; i < blocks.size(); ++i) {
            const glm::ivec3 cube = cube_of(blocks[i].first + 0.5f * edge);
            by_cube[{cube.x, cube.y, cube.z}] = uint32_t(i);
            least = glm::min(least, cube);
            most = glm::max(most, cube);
        }
        for (size_t i = 0; i < patches.size(); ++i) {
            const auto [lo, hi] = box_of(patches[i]);
            const glm::ivec3 from = glm::max(cube_of(lo - occupied_slack), least);
            const glm::ivec3 to = glm::min(cube_of(hi + occupied_slack), most);
            for (int z = from.z; z <= to.z; ++z)
                for (int y = from.y; y <= to.y; ++y)
                    for (int x = from.x; x <= to.x; ++x)
                        if (const auto found = by_cube.find({x, y, z}); found != by_cube.end())
                            own_[found->second].push_back(uint32_t(i));
        }
    }

    std::span<const uint32_t> operator[](size_t block) const { return own_[block]; }

private:
    std::vector<std::vector<uint32_t>> own_;
};

/// A block as a zone of cells.
class BlockZone {
public:
    BlockZone(const Surroundings& world, const Block& block,
              std::span<const surface::Patch> patches, std::span<const uint32_t> some,
              uint32_t draw)
        : grid_{{}, 1.0, block_dims},
          occupied_(patches, some, block.first, block.step, block_dims),
          validity_(grid_.size(), 0.0f),
          points_(grid_.size()),
          cells_{grid_, occupied_, validity_, block.first, block.step, draw, points_},
          zone_(world, cells_, glm::ivec3(0), glm::ivec3(zone_edge)) {
        for (const Block::Place& place : block.places) {
            validity_[place.at] = 1.0f;
            points_[place.at] =
                world.visibility.capture_at(cells_.place(grid_.cell_at(place.at))).point;
        }
    }
    BlockZone(const BlockZone&) = delete; // its parts refer to each other

    uint64_t rays() const { return zone_.rays(); }

    /// The cells that are to be solved, with what they see.
    std::vector<Packet> look(std::span<const Block::Place> places) {
        std::vector<std::pair<uint32_t, Block::Place>> wanted;
        for (const Block::Place& place : places)
            if (place.cell != Block::known)
                wanted.push_back({morton(glm::vec3(grid_.cell_at(place.at))), place});
        std::ranges::stable_sort(wanted, {}, &std::pair<uint32_t, Block::Place>::first);
        std::vector<glm::ivec3> cells(wanted.size());
        std::ranges::transform(wanted, cells.begin(),
                               [&](const auto& each) { return grid_.cell_at(each.second.at); });
        zone_.find(cells);
        std::vector<Packet> packets;
        uint32_t eighth = 0;
        for (const auto& [order, place] : wanted) {
            if (packets.empty() || packets.back().cells.size() == lanes || part_of(order) != eighth)
                packets.push_back({&zone_, {}, {}, {}});
            eighth = part_of(order);
            packets.back().cells.push_back(place.cell);
            packets.back().points.push_back(points_[place.at]);
            packets.back().sees.push_back(zone_.sees(grid_.cell_at(place.at)));
        }
        return packets;
    }

private:
    Grid grid_;
    Occupied occupied_;
    std::vector<float> validity_;
    std::vector<glm::vec3> points_;
    Cells cells_;
    CellZone zone_;
};

} // namespace

void solve_blocks(std::span<const Block> blocks, std::span<const surface::Patch> patches,
                  const Surroundings& world, PacketSolver& solver, Progress& progress,
                  GatherReport& report, Laps& laps) {
    const PatchesOf patches_of(blocks, patches);
    progress.begin("gather", blocks.size());
    for (size_t first = 0; first < blocks.size(); first += most_zones) {
        const size_t count = std::min(most_zones, blocks.size() - first);
        // Those of each block, then those of all that are solved again.
        std::vector<std::unique_ptr<BlockZone>> zones(2 * count);
        std::vector<std::vector<Packet>> packets(zones.size());
        tbb::parallel_for(size_t(0), zones.size(), [&](size_t i) {
            const Block& block = blocks[first + i % count];
            const std::vector<Block::Place>& own = i < count ? block.places : block.again;
            if (own.empty())
                return;
            zones[i] = std::make_unique<BlockZone>(world, block, patches,
                                                   patches_of[first + i % count], i >= count);
            packets[i] = zones[i]->look(own);
        });
        std::vector<Packet> all;
        for (size_t i = 0; i < zones.size(); ++i) {
            if (!zones[i])
                continue;
            std::ranges::move(packets[i], std::back_inserter(all));
            report.rays += zones[i]->rays();
        }
        laps.add_to(report.visibility_seconds);
        solver.solve(all, [&] { progress.advance(first); });
    }
}

} // namespace lpvbake::solver::gather
