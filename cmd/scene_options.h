// The options of every command that computes light: what is lit, on which grid, into which files.
#pragma once

#include "command_line.h"
#include "io/io.h"
#include "result.h"
#include "scene/gltf/load.h"
#include "scene/scene.h"
#include "terminal.h"
#include "volume/grid.h"

#include <tbb/global_control.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake {

/// What of the scene's file is taken, and how strictly it is read.
struct LoadOptions {
    std::string scene_name;
    std::string animation;
    std::string time; ///< seconds; empty: not given
    std::string variant;
    bool strict = false;
    bool allow_external = false;
    std::string max_memory = "4G";
};
void add_load_options(OptionList& list, LoadOptions& o);
/// Throws Error (argument).
LoadSettings load_settings(const LoadOptions& o);

/// Scene, grid and light as given.
struct SceneOptions {
    std::string scene;
    LoadOptions load;
    int resolution = 32;
    double cell_size = 0;
    std::string bounds;
    int margin = 1;
    std::vector<std::string> suns;
    std::vector<std::string> points;
    std::vector<std::string> light_files;
    std::string sky;
    double sky_rotation = 0;
    bool no_scene_lights = false;
    bool no_emitters = false;
    double max_albedo = 0.95;
    std::string metallic = "reflect";
    std::string backfaces = "block";
};

/// Returns --resolution, which `settle` needs.
CLI::Option* add_grid_options(OptionList& list, SceneOptions& o);
CLI::Option* add_bounces_option(OptionList& list, std::string& bounces);
/// None: "inf".
std::optional<int> bounces_of(const std::string& option);
/// Begins with add_load_options.
void add_light_options(OptionList& list, SceneOptions& o);

/// Applies the file `config` unless it is empty. --resolution and --cell-size replace each other:
/// one on the command line takes the place of the other in the file. Returns true if both were
/// given in the same place. Throws Error (file, argument).
bool settle(CLI::App& app, const CLI::Option& resolution, const std::string& config,
            SceneOptions& o);

/// In the order of --help. Options at "not given" (no bounds, no cell size) are left out.
void append_grid_settings(const SceneOptions& o, std::vector<Setting>& settings);
void append_light_settings(const SceneOptions& o, std::vector<Setting>& settings);

GridSettings grid_settings(const SceneOptions& o);
/// --bounds, none if not given. Throws Error (argument).
std::optional<Bounds> grid_bounds(const SceneOptions& o);
/// Throws Error, as the parsers of lights and of the sky do.
std::vector<Light> command_line_lights(const SceneOptions& o);
/// Loads the scene by its rules and adds `lights`. Throws Error.
Scene load_scene(const SceneOptions& o, const std::vector<Light>& lights);
/// True if the file or the options mention images, which then have to be decoded. A guess to gain
/// time by.
bool mentions_images(const SceneOptions& o);

/// Volumes to write. What is empty is as the target has it.
struct OutputOptions {
    std::vector<std::string> paths;
    std::string target = "generic";
    std::string precision;
    std::string sh_convention;
    std::string axes;
    std::string exr_packing;
    int exr_columns = 0; ///< 0: nearly square
};
void add_output_options(OptionList& list, OutputOptions& o);
/// The same as settings, but for the paths.
void append_output_settings(const OutputOptions& o, std::vector<Setting>& settings);

/// How a command that computes runs and reports.
struct RunOptions {
    int threads = 0;
    std::string format = "text";
    std::string progress = "auto";
    bool print_config = false;
    std::string config;
};
/// Goes on with the group that is open.
void add_run_options(OptionList& list, RunOptions& o);

struct Written {
    std::string path; ///< as it was asked for
    std::vector<WriteReport::File> files;

    Json json() const;
    void print() const;
};

/// All that can be known to be wrong before any work is done: no scene, an output that is no
/// volume, is given twice or would replace a light file. Throws Error (argument).
void check_paths(const char* command, const SceneOptions& scene,
                 const std::vector<std::string>& outputs);

/// Makes and removes a file beside each output, so that work does not end with nowhere to go.
/// Throws Error (file).
void probe_outputs(const std::vector<std::string>& outputs);

/// Throws Error (file) unless the scene can be read.
void probe_scene(const SceneOptions& o);

/// Adds tool, scene, scene hash and the settings that shape the result to what a solver wrote.
void fill_metadata(const SceneOptions& o, const Scene& scene, const std::vector<Setting>& settings,
                   Volume& volume);

/// What -o writes, for help.
std::string outputs_help();

/// Writes a volume to all paths, one after the other, and tells of warnings. Its grids are gone
/// then; lattice, order and metadata stay.
std::vector<Written> write_outputs(const OutputOptions& o, const std::vector<std::string>& paths,
                                   Volume& volume, TerminalProgress& progress);

/// Bounds the process's threads while the result lives; 0: one a core, null. Before any thread
/// starts that would read the environment.
std::unique_ptr<tbb::global_control> limit_threads(int threads);

} // namespace lpvbake
