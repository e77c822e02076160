#include "io/vdb_grids.h"

#include "io/atomic_file.h"
#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

namespace lpvbake::io {
namespace {

using openvdb::Coord;

openvdb::math::Transform::Ptr transform_of(const Grid& grid, bool corner_index) {
    const glm::dvec3 first = corner_index ? grid.origin : grid.center({0, 0, 0});
    if (grid.is_turned()) {
        openvdb::math::Mat4d affine = openvdb::math::Mat4d::identity(); // of row vectors
        for (int axis = 0; axis < 3; ++axis) {
            glm::dvec3 edge(0);
            edge[axis] = grid.cell;
            edge = grid.turn * edge;
            affine.setRow(axis, {edge.x, edge.y, edge.z, 0});
        }
        affine.setTranslation({first.x, first.y, first.z});
        return openvdb::math::Transform::createLinearTransform(affine);
    }
    auto transform = openvdb::math::Transform::createLinearTransform(grid.cell);
    transform->postTranslate({first.x, first.y, first.z});
    return transform;
}

/// The leaf of the cells from `first` on, without any if none of them is active; of 512 equal ones
/// a tile.
template <typename Leaf>
struct LeafOrTile {
    std::unique_ptr<Leaf> leaf;
    std::optional<typename Leaf::ValueType> tile;
};

template <typename Leaf, typename Value>
LeafOrTile<Leaf> make_leaf(const Grid& lattice, const std::vector<uint8_t>& active,
                           const Value& value, glm::ivec3 first) {
    const glm::ivec3 dims = glm::min(glm::ivec3(Leaf::DIM), lattice.dims - first);
    typename Leaf::NodeMaskType on;
    auto leaf = std::make_unique<Leaf>(Coord(first.x, first.y, first.z));
    auto* const values = leaf->buffer().data();
    for (int z = 0; z < dims.z; ++z)
        for (int y = 0; y < dims.y; ++y) {
            const size_t row = lattice.index(first + glm::ivec3(0, y, z));
            for (int x = 0; x < dims.x; ++x)
                if (active[row + size_t(x)]) {
                    const openvdb::Index at = Leaf::coordToOffset(Coord(x, y, z));
                    on.setOn(at);
                    values[at] = value(row + size_t(x));
                }
        }
    if (on.isOff())
        return {};
    if (on.isOn()
        && std::all_of(values, values + Leaf::SIZE, [&](const auto& v) { return v == values[0]; }))
        return {nullptr, values[0]};
    leaf->setValueMask(on);
    return {std::move(leaf), std::nullopt};
}

/// The cells that are active, by all threads. Uniform leaves become tiles.
template <typename GridType, typename Value>
void add_leaves(const Grid& lattice, const std::vector<uint8_t>& active, const Value& value,
                GridType& grid) {
    using Leaf = typename GridType::TreeType::LeafNodeType;
    const Grid leaves{{}, 1, (lattice.dims + (int(Leaf::DIM) - 1)) / int(Leaf::DIM)};
    std::vector<LeafOrTile<Leaf>> made(leaves.size());
    const auto first = [&](size_t i) { return int(Leaf::DIM) * leaves.cell_at(i); };
    tbb::parallel_for(size_t(0), made.size(), [&](size_t i) {
        made[i] = make_leaf<Leaf>(lattice, active, value, first(i));
    });
    for (size_t i = 0; i < made.size(); ++i) {
        if (made[i].leaf)
            grid.tree().addLeaf(made[i].leaf.release());
        if (const auto& tile = made[i].tile) {
            const glm::ivec3 at = first(i);
            grid.tree().addTile(Leaf::LEVEL + 1, Coord(at.x, at.y, at.z), *tile, true);
        }
    }
}

/// Fills a grid with value(cell) where active. Uniform blocks become tiles, which cost nothing.
template <typename GridType, typename Value>
typename GridType::Ptr make_grid(const Grid& lattice, const std::vector<uint8_t>& active,
                                 const BrickPlaces* bricks, const Value& value) {
    auto grid = GridType::create();
    if (bricks) {
        auto accessor = grid->getAccessor();
        size_t i = 0;
        for (int z = 0; z < lattice.dims.z; ++z)
            for (int y = 0; y < lattice.dims.y; ++y)
                for (int x = 0; x < lattice.dims.x; ++x, ++i)
                    if (const auto at = bricks->of_cell({x, y, z}))
                        accessor.setValueOn(Coord(at->x, at->y, at->z), value(i));
    } else {
        add_leaves(lattice, active, value, *grid);
    }
    grid->tree().prune();
    return grid;
}

} // namespace

const GridKind density_kind{.name = "density",
                            .quantity = {"mean luminance over all directions", "cd/m^2"}};

std::optional<glm::ivec3> BrickPlaces::of_cell(glm::ivec3 cell) const {
    constexpr int edge = volume::brick_edge;
    const volume::BrickStack stack(first.size());
    const std::size_t brick = Grid{{}, 1, stack.slots}.index(cell / edge);
    return brick < first.size() ? std::optional(first[brick] + cell % edge) : std::nullopt;
}

void initialise_vdb() {
    static std::once_flag once;
    std::call_once(once, [] { openvdb::initialize(); });
}

std::vector<volume::ConstGridView> grids_to_write(const Stored& stored) {
    std::vector<volume::ConstGridView> views = volume::grids_of(stored.volume());
    views.push_back({&density_kind, 0, stored.density().data(), stored.density().size()});
    return views;
}

std::vector<uint8_t> active_cells(const Volume& volume) {
    std::vector<uint8_t> active(volume.grid.size());
    const std::vector<volume::ConstGridView> grids = volume::grids_of(volume);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, active.size()), [&](const auto& cells) {
        for (const volume::ConstGridView& grid : grids)
            if (grid.kind->width() == 1)
                for (size_t i = cells.begin(); i < cells.end(); ++i)
                    active[i] |= grid.data[i] != 0;
            else
                for (size_t i = cells.begin(); i < cells.end(); ++i) {
                    const float* const value = grid.data + 3 * i;
                    active[i] |= int(value[0] != 0) | int(value[1] != 0) | int(value[2] != 0);
                }
    });
    return active;
}

openvdb::GridBase::Ptr make_grid(const volume::ConstGridView& view, const Stored& stored,
                                 const std::vector<uint8_t>& active, const BrickPlaces* bricks) {
    const Grid& lattice = stored.volume().grid;
    openvdb::GridBase::Ptr grid;
    if (view.kind->width() == 1)
        grid = make_grid<openvdb::FloatGrid>(lattice, active, bricks,
                                             [&](size_t i) { return view.data[i]; });
    else
        grid = make_grid<openvdb::Vec3SGrid>(
            lattice, active, bricks, [&](size_t i) { return openvdb::Vec3s(view.data + 3 * i); });
    describe_grid(view.name(), bricks ? bricks->lattice : lattice, stored.encoding().corner_index,
                  view.kind == &density_kind, *grid);
    return grid;
}

void describe_grid(const std::string& name, const Grid& lattice, bool corner_index, bool fog,
                   openvdb::GridBase& grid) {
    grid.setName(name);
    grid.setTransform(transform_of(lattice, corner_index));
    grid.setVectorType(openvdb::VEC_INVARIANT); // colours do not turn with the transform
    grid.setGridClass(fog ? openvdb::GRID_FOG_VOLUME : openvdb::GRID_UNKNOWN);
}

std::vector<volume::ConstGridView> grids_in(const VdbContent& content, int order) {
    std::vector<volume::ConstGridView> grids;
    for (const GridKind* kind : volume::grid_kinds()) {
        const int most = kind == &volume::light_kind() ? volume::sh_count(order) : kind->most;
        for (int k = 0; k < most && content.has(volume::grid_name(*kind, k)); ++k)
            grids.push_back({kind, k});
    }
    grids.push_back({&density_kind});
    return grids;
}

void check_within(const openvdb::GridBase& grid, glm::ivec3 dims, const std::string& path) {
    const openvdb::CoordBBox whole(Coord(0), Coord(dims.x - 1, dims.y - 1, dims.z - 1));
    const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
    if (!active.empty() && !whole.isInside(active))
        reject(path, "grid " + grid.getName() + " has values outside lpv:grid_dims");
}

} // namespace lpvbake::io
