// What a solver is: the interface that a bake runs it by, and the row that says all else of it.
//
// A new solver is a folder here with a `const SolverKind`, and an entry in the list of
// bake/kinds.cpp. A new parameter of one solver is a row of its kind's parameters. Neither needs
// anything else: settings, choice, plan, sweeps, suites and the command line go by the kinds.
#pragma once

#include "solver/parameter.h"
#include "solver/pilot.h"
#include "solver/stages.h"
#include "volume/grid.h"
#include "volume/slab.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lpvbake {

struct Scene;
struct Volume;
namespace gpu {
class Device;
}
namespace scene {
struct Frame;
struct LightLayer;
} // namespace scene
namespace surface {
struct LitSurfaces;
}
namespace volume {
struct Adjustment;
}
namespace visibility {
class Visibility;
}

} // namespace lpvbake

namespace lpvbake::solver {

struct SolverKind;
class Solver;

/// Reflective shadow maps that bring the first reflection of punctual lights.
struct ReflectiveMaps {
    int count = 0; ///< 0: none is drawn
    int size = 0;  ///< texels along a side
};

/// What every solver works on.
struct Inputs {
    const Scene& scene; ///< with its lights and its sky
    const gpu::Device& device;
    const Grid& grid;
    const scene::Frame& frame; ///< the grid's
    const visibility::Visibility& visibility;
    /// All surfaces, lit as the bake wants it, but for what `maps` bring; null where the maps alone
    /// hold all light.
    const surface::LitSurfaces* lit;
    ReflectiveMaps maps;
    std::span<const volume::Adjustment> adjust = {}; ///< of validity
    std::span<const scene::LightLayer> layers = {};  ///< those of `lit`
    /// Of nested grids of a kind with Nesting::coupled: the inputs of the finest, whose frame has
    /// the levels around it, and the solvers of those around this one, the next first, which have
    /// solved theirs. `lit` is in the finest's frame, and with its inputs alone.
    const Inputs* finest = nullptr;
    std::span<const std::unique_ptr<Solver>> around = {};
    /// Solved alone, of kinds with SolverKind::shard_layers; none: all of the grid is.
    std::optional<volume::Slab> slab = {};
    cache::Cache* cache = nullptr; ///< keeps what geometry alone decides; null: nothing does
};

/// A cube of a lattice, of which places may be missing, as in a part of a brick that none fills.
struct Block {
    static constexpr int edge = 16; ///< steps; places stand at both ends
    static constexpr uint32_t known = ~0u;
    struct Place {
        uint16_t at;   ///< in the cube, x fastest
        uint32_t cell; ///< of the volume; known: it is not solved, and tells what is seen around it
    };

    glm::vec3 first;           ///< the place in its lowest corner, frame units
    float step = 1;            ///< from place to place, frame units
    std::vector<Place> places; ///< all that are valid
    /// Some of these, solved once more by other draws of what they look at, for cells of their own:
    /// what they differ by is noise.
    std::vector<Place> again;
};

/// A solver, being compiled for a device, a grid and settings.
class Solver {
public:
    virtual ~Solver() = default;
    /// Fills Volume::sh, sh_order and validity, and occlusion where the solver knows it, and adds
    /// metadata of its own; the grid is there, and becomes that of Inputs::slab, if there is one,
    /// in whose cells the bits are the same as without. Tells `stages` what it does, and warns
    /// there. The same bits for any number of threads. Throws Error (memory, device), and whatever
    /// the progress throws.
    virtual void solve(const Inputs& inputs, Stages& stages, Volume& volume) = 0;
    /// The same, and Volume::sh and sh_order of each of Inputs::layers, to which the grid is given:
    /// linear in the layers' weights, since all that is decided is decided by the light as a whole,
    /// whose volume has the same bits as without them. Of a kind with such SolverKind::layers
    /// alone.
    virtual void solve_layers(const Inputs& inputs, Stages& stages, Volume& volume,
                              std::span<Volume> layers);
    /// The same, but for the validity, which is there, at places (frame units) instead of the
    /// grid's cells: the volume has a cell for each, in a row, and so has that of each layer, if
    /// there are any. Of a kind with SolverKind::at_places alone.
    virtual void solve_at(std::span<const glm::vec3> places, const Inputs& inputs, Stages& stages,
                          Volume& volume, std::span<Volume> layers);
    /// The same at the places of blocks, of one step: the volume has a cell for each that is
    /// solved, in a row, and each stands in one block.
    virtual void solve_blocks(std::span<const Block> blocks, const Inputs& inputs, Stages& stages,
                              Volume& volume);
};

/// How much time is given for how little error, in the words of --quality.
enum class Quality { fast, balanced, accurate };
inline constexpr std::array<const char*, 3> quality_names{"fast", "balanced", "accurate"};

/// A step between fast and accurate: what a solver, and the lighting before it, are told.
struct Rung {
    std::optional<Quality> preset; ///< which quality this is; none: only choose_settings takes it
    uint64_t lighting_rays = 0;    ///< LightingSettings::rays
    /// Of the same parameters on each rung of a ladder.
    std::array<ParameterValue, 4> values{};
};

/// Settings of a solver of one kind: the harmonics' order, and a value for each parameter. There is
/// always one that can be solved: what is set is rounded to it.
class SolverSettings {
public:
    /// Order 2, or the highest below; Quality::balanced, all other parameters at their defaults.
    explicit SolverSettings(const SolverKind& kind);

    const SolverKind& kind() const { return *kind_; }
    /// Highest band of the harmonics.
    int order() const { return order_; }
    /// The highest of SolverKind::orders up to `wanted`; the lowest where that is above.
    void set_order(int wanted);
    /// LightingSettings::rays.
    uint64_t lighting_rays() const { return lighting_rays_; }
    void set_lighting_rays(uint64_t rays) { lighting_rays_ = rays; }

    /// The value of a parameter, which the kind must have (Error, usage, otherwise).
    double operator[](std::string_view parameter) const;
    /// Throws Error (argument) where the kind has no such parameter, or that no such value.
    void set(std::string_view parameter, double value);
    /// Sets what the rung says.
    void set(const Rung& rung);
    /// The rung of this quality; does nothing where the kind has none.
    void set(Quality quality);

private:
    const SolverKind* kind_;
    int order_ = 0;
    uint64_t lighting_rays_ = 0;
    std::vector<double> values_; ///< in the order of SolverKind::parameters
};

/// What a solver is going to work on, as it is known before it does.
struct Workload {
    Grid grid;
    double patches = 0; ///< about
    bool lit = false;   ///< Inputs::lit is there
    ReflectiveMaps maps;
    uint64_t places = 0;                   ///< that are given; 0: it is the grid's cells
    bool blocks = false;                   ///< these stand in blocks
    bool gpu = false;                      ///< the device is one
    uint64_t layers = 0;                   ///< Inputs::layers
    std::optional<volume::Slab> slab = {}; ///< Inputs::slab
    bool two_sided = true;                 ///< patches may send light from both sides
};

/// What a solver is going to cost.
struct Cost {
    std::vector<StageReport> stages; ///< in their order, seconds on two threads
    std::vector<SkippedStage> skipped;
    uint64_t host_bytes = 0; ///< beside surfaces and volume
};

/// How a kind solves nested grids.
enum class Nesting {
    none,        ///< it cannot
    independent, ///< each by itself
    coupled, ///< from the outermost in: finer ones take light from those around (Inputs::around)
};

/// Which layers of the light a kind can solve.
enum class Layering {
    none,
    of_lights, ///< parts of the scene's light, of one grid
    any,       ///< skies beside it, too (scene::LightLayer::beyond)
    of_parts,  ///< and parts of the light of these, to any order (LightLayer::part, order)
};

/// A kind of solver: all that the rest of the program knows of it. Functions may not be null.
struct SolverKind {
    const char* name; ///< unique
    const char* help; ///< how light gets from the surfaces to the cells, in a phrase
    /// Highest bands of the harmonics that it can give, rising.
    std::span<const int> orders;
    /// Reflections unless they are said; none: all.
    std::optional<int> default_bounces;
    bool at_places = false; ///< it can solve given places, not only a grid
    Layering layers = Layering::none;
    Nesting nesting = Nesting::none;
    bool in_air = false; ///< it can solve where Visibility::air() takes and sends light
    std::span<const Parameter> parameters;
    /// From the fastest to the most accurate, at least one. One is Quality::balanced, or else the
    /// first stands for it.
    std::span<const Rung> ladder;
    /// Texels along a side of the reflective shadow maps from which it takes the first reflection
    /// of punctual lights, so that it needs lit surfaces for all other light alone; 0: it has no
    /// use for maps, and needs the surfaces for all light.
    int (*map_size)(const Grid& grid, const SolverSettings& settings);
    /// Relative L1 of irradiance that it typically adds, beside what the harmonics' order loses, in
    /// a scene of which the pilot tells so much: the squares of both sum.
    double (*expected_error)(const SolverSettings& settings, const Pilot& pilot);
    /// Layers of cells along z that Inputs::slab keeps together: it begins at a multiple of that;
    /// 0: it can solve none. Null: nor can it with any settings.
    int (*shard_layers)(const SolverSettings& settings) = nullptr;
    /// Peak of its device memory, bytes.
    uint64_t (*device_bytes)(const Grid& grid, const SolverSettings& settings, uint64_t layers);
    Cost (*cost)(const Workload& work, const SolverSettings& settings);
    /// Begins to compile it, on another thread: what the rest of a bake does meanwhile takes time,
    /// too. `device` and `grid` outlive the result.
    std::unique_ptr<Solver> (*make)(const gpu::Device& device, const Grid& grid,
                                    const SolverSettings& settings);
};

using SolverKinds = std::span<const SolverKind* const>;

/// The parameter of that name; null if the kind has none.
const Parameter* find_parameter(const SolverKind& kind, std::string_view name);

/// Whether a rung of its ladder sets the parameter: then it is part of what is chosen and told.
bool is_on_ladder(const SolverKind& kind, std::string_view parameter);

} // namespace lpvbake::solver
