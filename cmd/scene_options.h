// The options of every command that computes light: what is lit, on which grid, into which files.
#pragma once

#include "image/image.h"
#include "io/target.h"
#include "lpvbake/pack.h"
#include "options/option.h"
#include "readers/readers.h"
#include "result.h"
#include "scene/scene.h"
#include "scene/surroundings.h"
#include "selection.h"
#include "terminal.h"
#include "visibility/isa.h"
#include "volume/grid.h"
#include "volume/levels.h"

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace lpvbake::cmd {

/// FILE[,SCALE] of --sky.
struct SkyPicture {
    std::string path;
    double scale = 1;
};

/// FILE[,SCALE] or COLOUR,NITS, as --sky has it; never nothing. Refuses all else.
using SkyOption = std::variant<std::monostate, Sky, SkyPicture>;
SkyOption parse_sky_option(const std::string& text);

/// A box, or that of all nodes whose names fit a pattern; or nothing.
using BoxOption = std::variant<std::monostate, Bounds, std::string>;
/// Six numbers, or what is no list of numbers.
BoxOption parse_box(const std::string& text);
/// None: nothing is given. Throws Error (argument) where no node fits what `option` says.
std::optional<Bounds> box_in(const BoxOption& box, const char* option, const Scene& scene);

/// What is lit, and by what.
struct SceneOptions {
    std::string scene;
    LoadSettings load;
    volume::GridSettings grid;
    std::optional<int> margin; ///< none: as usual
    BoxOption bounds;          ///< nothing: the scene's
    std::vector<Light> suns, points;
    std::vector<std::string> light_files;
    std::vector<LightScale> light_scales;
    std::vector<std::string> statics; ///< patterns of names
    SkyOption sky;
    double sky_rotation = 0;
    bool no_scene_lights = false;
    bool no_emitters = false;
    double max_albedo = 0.95;

    bool default_light = false;

    const SkyPicture* sky_picture() const { return std::get_if<SkyPicture>(&sky); }
    /// With the margin.
    volume::GridSettings grid_settings() const;
    /// What the grid is fitted to; none: all of the scene. Throws Error (argument).
    std::optional<Bounds> box_in(const Scene& in) const;
};

/// What of the scene's file is taken, and how strictly it is read.
void add_load_options(options::Options& options, LoadSettings& load);
void add_bounds_options(options::Options& options, SceneOptions& o);
void add_grid_options(options::Options& options, SceneOptions& o);
/// The positional `scene`.
void add_scene_option(options::Options& options, SceneOptions& o);
/// Begins with add_load_options.
void add_light_options(options::Options& options, SceneOptions& o);

/// --static, after add_light_options.
void add_static_option(options::Options& options, SceneOptions& o);

/// Lights of options and files, and what there is to say of the files.
struct GivenLights {
    std::vector<Light> lights;
    std::vector<std::string> warnings;
};

/// Throws Error as load_lights does; for a warning, too, where they are errors.
GivenLights command_line_lights(const SceneOptions& o);
/// Loads the scene by its rules and adds `given`. Throws Error.
/// With boxes as scene::gltf::load_near does for these.
Scene load_scene(const SceneOptions& o, const GivenLights& given,
                 std::span<const scene::Surroundings> boxes = {});
/// True if the file or the options mention images, which then have to be decoded. A guess to gain
/// time by.
bool mentions_images(const SceneOptions& o);

/// Volumes to write.
struct OutputOptions {
    std::vector<std::string> paths;
    const io::Target* target = io::target_named("generic");
    // As the target has it unless given.
    std::optional<Precision> precision;
    std::optional<volume::ShConvention> convention;
    std::optional<volume::Axes> axes;
    std::optional<io::Packing> packing;
    std::optional<bool> dering;
    double l1_scale = 1; ///< of vrc
    int columns = 0;     ///< 0: nearly square

    /// How they are stored.
    io::Target storage() const;
};
void add_output_options(options::Options& options, OutputOptions& o);

/// What is done to cells for those who read them on surfaces.
struct FitOptions {
    std::optional<bool> fit; ///< none: as the target is read
    int dilate = 0;
    readers::Evaluation evaluation = readers::Evaluation::linear;
};
void add_evaluation_option(options::Options& options, FitOptions& o);

/// Whether volumes are fitted: programs that cells are filled for shade surfaces by them, the
/// others show the field.
bool fits(const OutputOptions& o, const FitOptions& fit);
/// Whose picture of surfaces the target's files are for: its program's; of none in particular our
/// own sampler's.
readers::Reader reader_of(const io::Target& target, const FitOptions& fit);
/// Throws Error (argument) where these options contradict each other, the target, or the order that
/// is asked for (0: none).
void check_fit(const OutputOptions& o, const FitOptions& fit, int order);

enum class Format { text, json };
/// --format, and how much is said beside the result: -q and -v.
void add_format_option(options::Options& options, Format& format);

/// How a command that computes runs and reports.
struct RunOptions {
    std::string device;
    bool validation = false;
    visibility::Isa isa = visibility::Isa::automatic;
    bool dry_run = false;
    int threads = 0;
    Format format = Format::text;
    ProgressStyle progress = ProgressStyle::automatic;
    std::vector<std::string> configs;
    bool print_config = false;
};
/// Opens the group.
void add_device_option(options::Options& options, RunOptions& o);
void add_isa_option(options::Options& options, RunOptions& o);
void add_dry_run_option(options::Options& options, RunOptions& o, const char* help);
void add_run_options(options::Options& options, RunOptions& o);

/// A volume or a picture that was written.
struct Written {
    std::string path; ///< as it was asked for
    std::vector<WriteReport::File> files;
    std::optional<PackingError> packing = {};
};
report::Json outputs_json(const std::vector<Written>& outputs);
/// What a dry run says of them: without bytes.
report::Json planned_json(const std::vector<Written>& outputs);
void print_outputs(const std::vector<Written>& outputs);

/// The files that these options read.
std::vector<std::string> inputs_of(const SceneOptions& scene, const RunOptions& run);

/// Throws Error (argument) for an output that is given twice, or would replace what is read; a
/// volume may be several files. `pictures`: outputs are no volumes.
void check_files(const std::vector<std::string>& inputs, const std::vector<std::string>& volumes,
                 const std::vector<std::string>& outputs, bool pictures = false);

/// All that can be known to be wrong before any work is done: no scene, an output that is no
/// volume, and what check_files finds. Throws Error (argument).
/// With a file of points the outputs are light at these; parts may have any name but that of
/// another kind of volume file.
void check_paths(const char* command, const SceneOptions& scene, const RunOptions& run,
                 const std::vector<std::string>& outputs, const std::string& points = "",
                 bool parts = false);

/// Makes and removes a file beside each output, so that work does not end with nowhere to go.
/// Throws Error (file).
void probe_outputs(const std::vector<std::string>& outputs);

/// Throws Error (file) unless the scene can be read.
void probe_scene(const SceneOptions& o);

/// Adds tool, scene, scene hash and the settings that shape the result to what a solver wrote.
void fill_metadata(const SceneOptions& o, const Scene& scene, const std::string& settings,
                   Volume& volume);

/// What -o writes, for help.
std::string outputs_help();

/// The scene that a .glb among the outputs gets the volume into; none: there is no such output.
/// Throws Error: unsupported (the scene has a volume), and as pack_gltf.
std::optional<PackedScene> packed_for(const std::vector<std::string>& outputs,
                                      const std::string& scene, const LoadSettings& load);

/// Writes a volume to all paths, one after the other, and tells of warnings. Its grids are gone
/// then; lattice, order and metadata stay.
std::vector<Written> write_outputs(const OutputOptions& o, const std::vector<std::string>& paths,
                                   Volume& volume, TerminalProgress& progress,
                                   const std::optional<PackedScene>& scene = {});
/// The same of levels, and their manifests; of one level it is write_outputs. Metadata `level` and
/// `level_set` say which of which manifest a file is.
std::vector<Written> write_levels(const OutputOptions& o, const std::vector<std::string>& paths,
                                  volume::VolumeSet& set, TerminalProgress& progress,
                                  const std::optional<PackedScene>& scene = {});
/// Throws Error (argument) for outputs, or forms of them, that bricks have not.
void check_brick_outputs(const OutputOptions& o);
/// Throws Error (argument) for outputs that have no form for levels, or whose files would be each
/// other's or an input.
void check_level_outputs(const std::vector<std::string>& paths,
                         const std::vector<std::string>& inputs,
                         const std::vector<volume::Place>& places = {});

/// Bounds the process's threads, from now on; 0: one a core. Before any thread starts that would
/// read the environment.
void limit_threads(int threads);

/// What all commands that compute have in common: they look first whether scene and outputs are
/// within reach, then load, and tell how far they are and how long each stage took.
class Run {
public:
    /// Throws Error (file; invalid: a light file).
    Run(const SceneOptions& scene, const RunOptions& run, const std::vector<std::string>& outputs);

    /// Loads the scene, or what may count for one of the boxes, and prints its warnings. Throws
    /// Error.
    Scene load(std::span<const scene::Surroundings> boxes = {});
    /// Ends a stage, which began where the last one ended.
    void end_stage(const char* name, const std::string& detail = "");
    /// Where the next stage begins, but for what end_stage tells of.
    void begin_stage() { lap_ = std::chrono::steady_clock::now(); }
    void warn(const std::vector<std::string>& warnings);
    double seconds() const { return seconds_since(begin_); }

    std::vector<StageReport> stages;
    TerminalProgress progress;

private:
    std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now(), lap_ = begin_;
    const SceneOptions& scene_;
    GivenLights lights_;
    image::ImageModulePreload preload_;
};

} // namespace lpvbake::cmd
