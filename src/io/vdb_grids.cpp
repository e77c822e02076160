#include "io/vdb_grids.h"

#include "io/atomic_file.h"
#include "volume/sh.h"

#include <mutex>

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

/// Fills a grid with value(cell) where active. Uniform blocks become tiles, which cost nothing.
template <typename GridType, typename Value>
typename GridType::Ptr make_grid(const Grid& lattice, const std::vector<uint8_t>& active,
                                 const BrickPlaces* bricks, const Value& value) {
    auto grid = GridType::create();
    auto accessor = grid->getAccessor();
    size_t i = 0;
    for (int z = 0; z < lattice.dims.z; ++z)
        for (int y = 0; y < lattice.dims.y; ++y)
            for (int x = 0; x < lattice.dims.x; ++x, ++i) {
                if (!bricks && active[i])
                    accessor.setValueOn(Coord(x, y, z), value(i));
                if (bricks)
                    if (const auto at = bricks->of_cell({x, y, z}))
                        accessor.setValueOn(Coord(at->x, at->y, at->z), value(i));
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
    for (const volume::ConstGridView& grid : volume::grids_of(volume)) {
        const auto width = size_t(grid.kind->width());
        for (size_t i = 0; i < grid.values().size(); ++i)
            active[i / width] |= grid.data[i] != 0;
    }
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
