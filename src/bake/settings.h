// What a bake can be told.
#pragma once

#include "bake/kinds.h"
#include "bake/layers.h"
#include "bake/lit_file.h"
#include "bake/rays.h"
#include "medium/lamp_radius.h"
#include "medium/medium.h"
#include "scene/scene.h"
#include "visibility/isa.h"
#include "volume/adjust.h"
#include "volume/grid.h"
#include "volume/levels.h"
#include "volume/slab.h"

#include <optional>

namespace lpvbake {
namespace readers {
struct Reader;
}
namespace cache {
class Cache;
}
} // namespace lpvbake

namespace lpvbake::bake {

/// Bricks instead of a grid (volume/bricks.h).
struct AdaptiveSettings {
    double fine = 0, coarse = 0;  ///< cells of the finest and the coarsest level, metres
    double error = 0;             ///< volume::TrimGoal::error
    std::optional<uint64_t> size; ///< bytes of all their numbers at most
    int number_bytes = 4;         ///< of a number
};

/// What is kept of the light that punctual lights send straight to cells, apart from the field;
/// that of static ones is in the field.
struct DirectSettings {
    bool visibility = false; ///< a grid a light
    bool sh = false;         ///< that of all lights together, to the field's order
    bool channels = false;   ///< `visibility` in four grids, shadow_0 to shadow_3
    bool shaft = false;      ///< of all lights the largest share that comes through holes
    int beams = 4;           ///< medium::BeamSettings::per_cell
    double sun_angle = 0;    ///< medium::BeamSettings::sun_angle
    std::vector<medium::LampRadius> lamp_radii = {}; ///< of point and spot lights
    double shaft_closing = 1; ///< metres: half of what a hole is narrower than

    bool any() const { return visibility || sh || channels || shaft; }
};

inline constexpr int most_layers_level = 4;

/// Operators of local radiance transfer beside the field (transfer/local.h).
struct LocalTransferSettings {
    bool wanted = false;
    bool object = false; ///< the scene is one object in an empty world: it may be without light
    double radius = 0;   ///< metres, in which surfaces are near; 0: transfer::hop_length cells

    double radius_of(double cell) const; ///< in a grid of such cells
};

/// How often light is scattered in a medium.
struct Scattering {
    std::optional<int> times; ///< at most; none: until next to nothing is missing
};

/// Defaults are those of the program: sn, order 2, all reflections.
struct BakeSettings {
    BakeSettings() : BakeSettings(*solver_kinds().front()) {}
    explicit BakeSettings(const solver::SolverKind& kind)
        : solver(kind),
          bounces(kind.default_bounces) {}

    solver::SolverSettings solver;
    volume::GridSettings grid;
    std::optional<Bounds> bounds; ///< what the grid is fitted to; none: the scene's bounds
    /// Of one grid's field alone, by a solver with SolverKind::shard_layers, the layers that are
    /// baked; none: all.
    std::optional<volume::Shard> shard;
    bool surfaces_alone = false; ///< they are lit, and nothing else is done
    std::string lit;             ///< file of surfaces that are lit already; empty: none
    LitOrigin lit_origin = {};   ///< of those, without its tracer
    /// Nested grids instead (volume/levels.h), by a solver of lit surfaces and without its
    /// reflective shadow maps; empty: one grid, by the two above.
    std::vector<volume::LevelBox> levels;
    /// Or grids beside each other, by such a solver.
    std::vector<volume::VolumeBox> volumes;
    /// By a solver that is SolverKind::at_places, in `bounds`, or a cell around the scene.
    std::optional<AdaptiveSettings> adaptive;
    bool emitters = true;       ///< emissive surfaces give light
    std::optional<int> bounces; ///< reflections at most; none: all
    /// Whose picture of the surfaces the volume is fitted to (bake/surface_fit.h); null: nobody's,
    /// it is the field at the cells' centres.
    const readers::Reader* fit = nullptr;
    bool dering = true;                   ///< before it is fitted (bake/surface_fit.h)
    DirectSettings direct;                ///< of one grid or of levels
    std::optional<medium::Medium> medium; ///< of them, too, and not of turned grids
    /// The field is that in the medium, of one grid by a solver of SolverKind::in_air; none: it is
    /// as without it.
    std::optional<Scattering> scattering;
    LocalTransferSettings local_transfer;   ///< of grids
    std::vector<volume::Adjustment> adjust; ///< of validity, and of what is fitted
    /// Of the light, by a solver that has SolverKind::layers, in grids, levels or volumes of what
    /// is not fitted.
    std::vector<Layer> layers;
    int layers_level = 0; ///< in cells 2^N times as large, of one grid; 0: in those of the volume
    uint64_t points = 0;  ///< that are given instead of the grid's cells (bake/points.h); 0: none
    visibility::Isa isa = visibility::Isa::automatic; ///< that rays are traced with
    Rays rays = Rays::automatic;                      ///< who traces them
    cache::Cache* cache = nullptr; ///< keeps what the next bake may need as well; null: nothing
};

} // namespace lpvbake::bake
