#include "bake/bake.h"

#include "bake/air.h"
#include "bake/cached.h"
#include "bake/direct.h"
#include "bake/lighting.h"
#include "bake/local_transfer.h"
#include "bake/scattering.h"
#include "bake/surface_fit.h"
#include "surface/lit_surfaces.h"
#include "text.h"
#include "visibility/visibility.h"
#include "volume/convention.h"
#include "volume/light_content.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <tuple>

namespace lpvbake::bake {
namespace {

std::string share_with_walls(const std::vector<std::vector<glm::vec3>>& walls) {
    const auto without = std::ranges::count(walls[0], glm::vec3(0.0f));
    return format("beside %.1f %% of the cells",
                  100.0 * (1.0 - double(without) / double(walls[0].size())));
}

/// The scene as it is, or turned into the axes of boxes: about the origin of the plan's frame,
/// which stays its own.
struct Axes {
    const Scene& scene;
    const visibility::Visibility& visibility;
    std::vector<volume::Adjustment> adjust;
    std::vector<scene::LightLayer> layers;
};

/// A grid, and the scene in units of its cells, in its axes.
struct Level {
    const Axes& axes;
    const Grid& grid;
    Grid upright; ///< where it is in those
    scene::Frame frame;
    visibility::Visibility visibility;

    Level(const Axes& in, const Grid& of, const scene::Frame& whole)
        : axes(in),
          grid(of),
          upright(upright_in(of, whole.origin)),
          frame(scene::frame_of(upright)),
          visibility(in.visibility.in_frame(whole, frame)) {}

    /// What is turned is in none.
    cache::Cache* cache(const BakePlan& plan) const {
        return grid.is_turned() ? nullptr : plan.settings.cache;
    }

    static Grid upright_in(Grid grid, glm::dvec3 about) {
        if (grid.is_turned())
            grid.origin = about + glm::conjugate(grid.turn) * (grid.origin - about);
        grid.turn = Grid().turn;
        return grid;
    }
};

/// The surfaces as they are lit, in the frame of one level after the other.
struct Surfaces {
    surface::LitSurfaces lit;
    scene::Frame frame;

    void move_to(const Level& level) {
        lit = surface::in_frame(std::move(lit), frame, level.frame, level.visibility);
        frame = level.frame;
    }
};

/// Where walls ask for more than the reader can be made to show, and by which grid it could.
void warn_of_contested(const Contested& contested, const BakePlan& plan, const Grid& grid,
                       solver::Stages& stages) {
    if (contested.share <= contested_most)
        return;
    const glm::ivec3 dims = grid.dims;
    const double cells = std::max({dims.x, dims.y, dims.z}) * grid.cell / contested.cell;
    const std::string finer =
        !plan.settings.volumes.empty() ? format("a `volume` of %.4g m cells", contested.cell)
        : !plan.coarser.empty() && !plan.settings.levels.front().made
            ? format("a `level` of %.4g m cells", contested.cell)
        : plan.settings.grid.cell > 0
            ? format("`cell_size` %.4g", contested.cell * plan.grid.cell / grid.cell)
            : format("`resolution` %.0f", std::ceil(cells));
    const glm::dvec3 at = contested.worst;
    stages.warn(format("%s reads places that walls part from the same cells, and shows %s %% of "
                       "the light on surfaces wrong by it, most at %.4g,%.4g,%.4g; from %s on it "
                       "should be less than %.0f %%",
                       plan.settings.fit->name, two_digits(100 * contested.share).c_str(), at.x,
                       at.y, at.z, finer.c_str(), 100 * contested_most));
}

/// Where maps hold some of the light, surfaces are lit anew for all of it.
void fit_volume(const BakePlan& plan, const Level& level, Surfaces& surfaces,
                solver::Stages& stages, Volume& volume) {
    const readers::Reader& reader = *plan.settings.fit;
    const Scene& turned = level.axes.scene;
    stages.begin("fit");
    surface::LitSurfaces all;
    const bool anew = !plan.lit || plan.maps.count > 0;
    if (anew) {
        surface::LightingSettings lighting = lighting_of(plan);
        lighting.maps = false;
        lighting.cache = nullptr; // its frame is another one
        all = surface::light_surfaces(turned, level.visibility, level.frame, lighting,
                                      stages.progress());
    } else {
        surfaces.move_to(level);
    }
    SurfaceFitSettings settings;
    settings.dering = plan.settings.dering;
    settings.statics = beam_settings(plan.settings.direct);
    const SurfaceFit fit =
        fit_to_surfaces(turned, anew ? all : surfaces.lit, scene::frame_of(level.grid),
                        plan.emitters, reader, settings, volume, stages.progress());
    if (fit.fit.points == 0) {
        stages.end("no light arrives on surfaces of the grid");
        stages.warn(format("no light arrives on surfaces of the grid: nothing is fitted to what %s "
                           "shows",
                           reader.name));
        return;
    }
    stages.end(format("%s on surfaces: %.3g %% wrong, energy %.3f, %s %% in the dark (%.3g %%, "
                      "%.3f, %s %% before), %s",
                      reader.name, 100 * fit.after.relative, fit.after.energy,
                      two_digits(100 * fit.after.leak).c_str(), 100 * fit.before.relative,
                      fit.before.energy, two_digits(100 * fit.before.leak).c_str(),
                      counted(fit.fit.points, "point").c_str()));
    warn_of_contested(fit.contested, plan, level.grid, stages);
    if (fit.fit.share == 0)
        stages.warn(format("no fit brings what %s shows on surfaces nearer to their light: the "
                           "volume is as with `fit` none",
                           reader.name));
}

void find_walls_of(const Level& level, const BakePlan& plan, solver::Stages& stages,
                   Volume& volume) {
    stages.begin("walls");
    volume.walls = find_walls(level.visibility, level.frame, volume,
                              plan.slab ? plan.slab->begin : 0, level.cache(plan));
    stages.end(share_with_walls(volume.walls));
}

/// What is told of a level that is solved and has its walls.
void finish_level(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                  const Level& level, Surfaces& surfaces, solver::Stages& stages, Volume& volume) {
    add_air(level.axes.scene, plan, level.visibility, level.frame, stages, volume);
    add_direct(level.axes.scene, plan, level.visibility, level.frame, stages, volume);
    add_local_transfer(level.axes.scene, plan, level.visibility, level.frame, stages, volume);
    volume.grid = plan.slab ? volume::grid_of(*plan.slab, level.grid) : level.grid;
    if (volume.grid.is_turned())
        volume::turn_directions(glm::mat3_cast(volume.grid.turn), volume);
    if (plan.settings.fit)
        fit_volume(plan, level, surfaces, stages, volume);
    volume::adjust_intensity(plan.settings.adjust, volume);
    if (!plan.settings.adjust.empty())
        volume.metadata["adjust"] = volume::text_of(plan.settings.adjust);
    describe_light(scene, plan, device, level.visibility, volume);
    describe_local_transfer(scene, plan, volume);
}

/// What of a layer is told.
void finish_layer(const BakePlan& plan, const Layer& layer, const Volume& whole, Volume& volume) {
    volume.grid = whole.grid;
    volume.validity = whole.validity;
    volume.occlusion = whole.occlusion;
    if (volume.grid.is_turned())
        volume::turn_directions(glm::mat3_cast(volume.grid.turn), volume);
    volume::adjust_intensity(plan.settings.adjust, volume);
    describe_layer(plan, layer, whole, volume);
}

/// The layers as they are in axes that world axes are turned into.
std::vector<scene::LightLayer> turned(std::vector<scene::LightLayer> layers,
                                      const glm::mat3& rotation) {
    for (scene::LightLayer& layer : layers)
        if (layer.beyond)
            layer.beyond = [of = layer.beyond, back = glm::transpose(rotation)](glm::vec3 towards) {
                return of(back * towards);
            };
    return layers;
}

/// The scene in the axes of boxes of one turn.
struct TurnedScene {
    glm::dquat turn;
    Scene scene;
    visibility::Visibility visibility;
    Axes axes;

    TurnedScene(const Axes& world, const BakePlan& plan, const gpu::Device& device,
                glm::dquat box_turn)
        : turn(box_turn),
          scene(scene::turned(world.scene, back(), plan.frame.origin)),
          visibility(open_visibility(scene, plan, device)),
          axes{scene, visibility, world.adjust, turned(world.layers, glm::mat3(back()))} {
        for (volume::Adjustment& box : axes.adjust) {
            box.turn = turn;
            box.about = plan.frame.origin;
        }
    }
    glm::dmat3 back() const { return glm::mat3_cast(glm::conjugate(turn)); }
};

/// In which order grids are solved: of coupled ones the outermost first; else those of one turn one
/// after the other.
std::vector<std::size_t> order_of(const std::vector<Solved>& grids, bool coupled) {
    std::vector<std::size_t> order(grids.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    if (coupled)
        std::ranges::reverse(order);
    else
        std::ranges::stable_sort(order, {}, [&](std::size_t i) {
            const glm::dquat& turn = grids[i].grid.turn;
            return std::tuple(grids[i].grid.is_turned(), turn.x, turn.y, turn.z, turn.w);
        });
    return order;
}

} // namespace

BakedLevels bake_levels(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                        Progress& progress) {
    BakedLevels baked;
    baked.warnings = plan.warnings;
    solver::Stages stages(progress, baked.warnings, scene.path, plan.settings.cache);

    const solver::SolverKind& kind = plan.settings.solver.kind();
    warn_of_empty(plan.settings.adjust, grids_in(plan), stages);
    const std::vector<Solved> grids = solved_in(plan);
    const bool coupled = kind.nesting == solver::Nesting::coupled && !plan.coarser.empty();
    const std::vector<std::size_t> order = order_of(grids, coupled);
    std::vector<std::unique_ptr<solver::Solver>> solvers(grids.size());
    const auto make = [&](std::size_t l) {
        solvers[l] = kind.make(device, grids[l].grid, plan.settings.solver);
    };
    // It is compiled while surfaces are lit; what each has on the device is there one at a time.
    for (const std::size_t l : order)
        if (coupled || l == order.front())
            make(l);

    const std::shared_ptr<medium::LitAir> air = air_in(plan);
    const visibility::Visibility visibility = open_scene(scene, plan, device, stages).in_air(air);
    const Axes world{scene, visibility, plan.settings.adjust, layers_in(plan)};
    Surfaces surfaces{light_scene(scene, plan, visibility, stages, world.layers), plan.frame};
    const surface::LitSurfaces* lit = plan.lit ? &surfaces.lit : nullptr;
    // What moves from one volume to the next would carry the rounding of all before.
    std::optional<Surfaces> unmoved;
    if (!plan.settings.volumes.empty())
        unmoved = surfaces;
    const solver::Inputs whole{scene,      device, plan.grid, plan.frame,
                               visibility, lit,    plan.maps, plan.settings.adjust};
    std::unique_ptr<TurnedScene> turned; // that of the box before

    baked.levels.resize(grids.size());
    baked.layers.resize(grids.size());
    for (const std::size_t l : order) {
        const Grid& grid = grids[l].grid;
        if (!solvers[l])
            make(l);
        if (grid.is_turned() && !(turned && turned->turn == grid.turn)) {
            stages.set_of("");
            stages.begin("turn");
            turned.reset();
            turned = std::make_unique<TurnedScene>(world, plan, device, grid.turn);
            stages.end("the scene into a box's axes");
        }
        if (const std::string of = of_level(l, plan); !of.empty())
            stages.set_of(of);
        const Level level(grid.is_turned() ? turned->axes : world, grid, plan.frame);
        if (unmoved)
            surfaces = *unmoved;
        if (grid.is_turned())
            surfaces.lit = surface::turned(std::move(surfaces.lit), glm::mat3(turned->back()),
                                           turned->visibility);
        if (!coupled)
            surfaces.move_to(level);
        Volume& volume = baked.levels[l];
        volume.grid = level.upright;
        solver::Inputs inputs{level.axes.scene, device,           level.upright,
                              level.frame,      level.visibility, coupled ? nullptr : lit,
                              plan.maps,        level.axes.adjust};
        if (coupled) {
            inputs.finest = &whole;
            inputs.around = std::span(solvers).subspan(l + 1);
        }
        std::vector<Volume>& layers = baked.layers[l];
        layers.resize(grids[l].layers);
        for (Volume& layer : layers)
            layer.grid = level.upright;
        inputs.layers = std::span(level.axes.layers).first(layers.size());
        inputs.slab = plan.slab;
        inputs.cache = level.cache(plan);
        if (layers.empty())
            solvers[l]->solve(inputs, stages, volume);
        else
            solvers[l]->solve_layers(inputs, stages, volume, layers);
        find_walls_of(level, plan, stages, volume);
        if (air)
            add_scattered(inputs, plan, *solvers[l], *air, stages, volume);
        if (!coupled)
            solvers[l].reset();
        finish_level(scene, plan, device, level, surfaces, stages, volume);
        for (std::size_t layer = 0; layer < layers.size(); ++layer)
            finish_layer(plan, plan.settings.layers[layer], volume, layers[layer]);
    }
    if (plan.layers_grid) {
        baked.layers_whole = std::move(baked.levels.back());
        baked.levels.pop_back();
        baked.layers.erase(baked.layers.begin(), baked.layers.end() - 1);
    }
    if (!plan.settings.local_transfer.object && !plan.slab)
        warn_of_dark(scene, baked.levels, stages);
    baked.stages = stages.reports();
    return baked;
}

Baked bake(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
           Progress& progress) {
    BakedLevels baked = bake_levels(scene, plan, device, progress);
    return {std::move(baked.levels.front()), std::move(baked.stages), std::move(baked.warnings)};
}

} // namespace lpvbake::bake
