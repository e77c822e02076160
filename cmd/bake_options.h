// The options of `bake`, and what they ask of the driver.
#pragma once

#include "bake/choose.h"
#include "bake/layers.h"
#include "bake/settings.h"
#include "io/cache_folder.h"
#include "io/target.h"
#include "medium_options.h"
#include "options/option.h"
#include "options/values.h"
#include "readers/readers.h"
#include "scene_options.h"
#include "selection.h"
#include "solver/solver.h"
#include "volume/levels.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// --level.
struct LevelOption {
    BoxOption box;
    double cell = 0; ///< metres
};

/// Of --volume.
struct GivenVolume {
    std::string name;
    Bounds box;
    std::optional<double> cell;
};

struct BakeOptions : SceneOptions, RunOptions {
    OutputOptions outputs;
    const solver::SolverKind* solver = nullptr; ///< null: what else is given, and the wish, decide
    std::optional<double> error;                ///< a share
    std::optional<double> seconds;              ///< of a bake
    std::optional<options::Bounces> bounces;    ///< none: the solver's
    int sh_order = 0;                           ///< 0: the solver's
    std::optional<solver::Quality> quality;
    std::map<std::string, double> parameters; ///< of solvers
    FitOptions fit;
    std::optional<uint64_t> verify; ///< points
    std::optional<uint64_t> bytes;  ///< of each output
    bool any_resolution = true;     ///< with `bytes`
    std::string at;                 ///< file of points; empty: a grid is baked
    std::vector<LevelOption> level; ///< of nested ones each
    std::optional<int> levels;      ///< around `focus`
    BoxOption focus;
    std::optional<bake::DirectSettings> direct;
    int beams = bake::DirectSettings().beams;
    double sun_angle = 0; ///< degrees
    std::vector<medium::LampRadius> lamp_radii;
    double shaft_closing = bake::DirectSettings().shaft_closing; ///< metres
    MediumOptions medium;
    std::optional<options::Bounces> scattering; ///< none: the field is as without the medium
    std::optional<bool> local_transfer;         ///< true: of an object
    std::optional<double> radius;               ///< of that, metres
    std::vector<GivenVolume> volume;
    std::string volumes;                ///< a file, "nodes:PATTERN" or "auto"
    std::string adjust;                 ///< file of boxes
    std::optional<glm::dvec2> adaptive; ///< finest and coarsest cells of bricks, metres
    std::optional<uint64_t> max_size;   ///< of bricks, bytes
    std::vector<std::vector<bake::LayerWish>> layers;
    int layers_level = 0;
    std::string lit;        ///< file of surfaces that are lit already; empty: none
    std::string light_file; ///< such a file is written, nothing else; empty: a volume is baked
    std::optional<volume::Shard> light_shard; ///< and of the surfaces this part alone
    std::optional<volume::Shard> shard;       ///< the part of the grid that is baked
    std::optional<double> surroundings; ///< metres around `bounds`; none: all of the scene counts
    bool if_changed = false;
    bool if_missing = false;
    std::string depfile; ///< empty: none
    std::string cache;   ///< folder; empty: nothing is kept
    uint64_t cache_bytes = io::CacheFolder::usual_bytes;
    bake::Rays rays = bake::Rays::automatic;
    bool told = true; ///< the result is printed

    bool nests() const { return !level.empty() || levels; }
    bool places() const { return !volume.empty() || !volumes.empty(); }
};

void add_bake_options(options::Options& options, BakeOptions& o);

/// Whether --volumes names a file.
bool has_volume_file(const BakeOptions& o);
/// The pattern of its nodes; else empty.
std::string volume_nodes(const BakeOptions& o);

/// The files that a bake reads but for what the scene's file names; some may be empty.
std::vector<std::string> inputs_of(const BakeOptions& o);

/// All that can be known to be wrong before any work is done. Throws Error (argument).
void check_options(const BakeOptions& o);

/// What nested grids are asked for by; nothing where there is but one.
std::vector<volume::LevelBox> levels_of(const BakeOptions& o, const Scene& scene);

/// The volumes that are asked for beside each other, where `detail` becomes how those of --volumes
/// auto were found. Throws Error as io::read_boxes, and: argument, for what cannot be or the target
/// has no form for.
std::vector<volume::VolumeBox> volumes_of(const BakeOptions& o, const Scene& scene,
                                          std::vector<std::string>& warnings, std::string& detail);

std::vector<volume::Place> places_of(const std::vector<volume::VolumeBox>& boxes);

/// Adds the suns of --layers to those of --sun.
void add_suns(BakeOptions& o);

/// The layers that are asked for. Throws Error (argument).
std::vector<bake::Layer> layers_of(const BakeOptions& o, const Scene& scene,
                                   const bake::BakeSettings& settings);

/// All but what choose_settings chooses; refers to the reader.
bake::BakeSettings to_settings(const BakeOptions& o, const readers::Reader& reader);

bake::Wish wish_of(const BakeOptions& o);

} // namespace lpvbake::cmd
