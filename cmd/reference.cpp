// lpvbake reference: the volume that a bake should be, path-traced.

#include "reference/reference.h"

#include "commands.h"
#include "lpvbake/error.h"
#include "read_light.h"
#include "scene/lights.h"
#include "scene_options.h"
#include "text.h"
#include "volume/compare.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/reference.txt.h"
    ;

/// Rays a cell where --rays leaves the number open.
constexpr uint64_t usual_rays = 1024, most_rays = 1 << 20;

struct ReferenceOptions : SceneOptions, RunOptions {
    OutputOptions outputs;
    std::string error_output;
    int sh_order = 1;
    options::Bounces bounces;
    uint64_t rays = 0;
    double noise = 0;
    uint64_t probes = 0;
    uint64_t seed = 1;
    std::optional<double> seconds;
    std::string like;
    std::optional<Grid> like_grid;
};

/// Takes from a volume what is not given: light, bounces, order; and its grid.
void take_after(ReferenceOptions& o, options::Options& options) {
    const Volume volume = read_light(o.like);
    take_light(o.like, volume, options);
    const reference::PathRules rules = rules_of(volume);
    if (options.find("bounces")->given.empty())
        options.find("bounces")->take(rules.bounces ? std::to_string(*rules.bounces) : "inf");
    if (options.find("sh-order")->given.empty())
        options.find("sh-order")->take(std::to_string(volume.sh_order));
    o.no_emitters = o.no_emitters || !rules.emitters;
    o.like_grid = volume.grid;
}

reference::ReferenceSettings to_settings(const ReferenceOptions& o) {
    reference::ReferenceSettings settings;
    settings.paths.bounces = o.bounces.most;
    settings.paths.emitters = !o.no_emitters;
    settings.sh_order = o.sh_order;
    settings.rays = o.rays > 0 ? o.rays : o.noise > 0 || o.seconds ? most_rays : usual_rays;
    settings.seconds = o.seconds.value_or(0);
    settings.noise = o.noise;
    settings.seed = o.seed;
    settings.probes = o.probes;
    settings.isa = o.isa;
    return settings;
}

void print_result(const ReferenceOptions& o, const Scene& scene,
                  const reference::Reference& reference, const std::vector<Written>& outputs,
                  const Run& run) {
    const Volume& volume = reference.volume;
    const double seconds = run.seconds();
    if (o.format == Format::json) {
        print_json(
            {{"command", "reference"},
             {"version", LPVBAKE_VERSION},
             {"scene", o.scene},
             {"triangles", scene::triangle_count(scene)},
             {"isa", visibility::name_of(visibility::available(o.isa))},
             {"grid", report::grid_json(volume.grid)},
             {"sh_order", volume.sh_order},
             {"bounces", o.bounces.most ? report::Json(*o.bounces.most) : report::Json(nullptr)},
             {"seed", o.seed},
             {"probes", reference.probes},
             {"rays", reference.rays},
             {"noise", reference.noise},
             {"standard_error", reference.standard_error},
             {"traced", reference.traced},
             {"outputs", outputs_json(outputs)},
             {"stages", stages_json(run.stages)},
             {"seconds", seconds},
             {"peak_memory", peak_memory()},
             {"warnings", run.progress.warnings()}});
        return;
    }
    print_grid(volume.grid);
    std::printf("light         %s\n", volume.metadata.at("content").c_str());
    std::printf("rays          %llu from each of %s, %.4g M in all\n",
                static_cast<unsigned long long>(reference.rays),
                counted(reference.probes, "cell").c_str(), 1e-6 * double(reference.traced));
    std::printf("noise         %.3g %% of the mean irradiance\n", 100 * reference.noise);
    print_stages(run.stages);
    print_total(seconds);
    print_outputs(outputs);
}

void run(const ReferenceOptions& o, const std::string& settings) {
    std::vector<std::string> outputs = o.outputs.paths;
    if (!o.error_output.empty())
        outputs.push_back(o.error_output);
    check_paths("reference", o, o, outputs);
    (void)o.outputs.storage(); // what it refuses
    if (o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "no output: add -o FILE" + io::format_list(" or -o FILE"));
    (void)visibility::available(o.isa);
    tell("settings: " + settings);
    Run run(o, o, outputs);
    const Scene scene = run.load();
    run.end_stage("load");
    const std::optional<PackedScene> packed = packed_for(o.outputs.paths, o.scene, o.load);

    if (scene::triangle_count(scene) == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to light");
    const Bounds box = o.box_in(scene).value_or(bounds_of(scene));
    const Grid grid =
        o.like_grid ? *o.like_grid : volume::fit_grid(box.lo, box.hi, o.grid_settings());
    reference::Reference reference =
        reference::make_reference(scene, grid, to_settings(o), run.progress);
    std::optional<ErrorKind> ended;
    if (reference.interrupted)
        ended = forget_signal();
    run.warn(reference.warnings);
    if (volume::total_energy(reference.volume) == 0.0)
        run.warn(std::vector{about(scene.path, scene::why_dark(scene))});
    run.end_stage("trace");

    fill_metadata(o, scene, settings, reference.volume);
    fill_metadata(o, scene, settings, reference.error);
    std::vector<Written> written =
        write_outputs(o.outputs, o.outputs.paths, reference.volume, run.progress, packed);
    if (!o.error_output.empty())
        std::ranges::move(write_outputs(o.outputs, {o.error_output}, reference.error, run.progress),
                          std::back_inserter(written));
    run.end_stage("write");
    run.progress.end();
    print_result(o, scene, reference, written, run);
    finish_stdout();
    if (ended)
        throw Error(*ended, format("interrupted at a noise of %.3g %%; the files are whole",
                                   100 * reference.noise));
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<ReferenceOptions>();
    ReferenceOptions& o = *fields;
    add_scene_option(options, o);
    options.texts("-o,--output", o.outputs.paths, "FILE", outputs_help()).keep_to_one_run();
    options
        .text("-e,--error-output", o.error_output, "FILE",
              "Volume of the standard errors to write, " + io::format_list())
        .keep_to_one_run();
    options
        .text("--like", o.like, "VOLUME",
              "Take the volume's grid, and what of light, bounces and order is not given")
        .exclude({"resolution", "cell-size", "bounds", "margin"})
        .keep_to_one_run();
    add_grid_options(options, o);
    add_light_options(options, o);
    add_static_option(options, o);

    options.group("Paths");
    options
        .choice("--sh-order", o.sh_order, options::Choices<int>{{"1", 1}, {"2", 2}, {"4", 4}},
                "Highest band of the spherical harmonics")
        .record();
    options
        .value("--bounces", o.bounces, "N|inf", options::parse_bounces,
               "Reflections of light at most, 0 to 10000, or all", "1")
        .record();
    options
        .number("--rays", o.rays, 0, 1e9,
                "Rays from each cell, rounded up to a multiple of 64; at most so many with "
                "--noise; 0: 1024, with --noise 1048576")
        .record();
    options::Option& noise = options.share("--noise", o.noise, 1e-6, 1,
                                           "Trace until the noise of irradiance is at most this");
    noise.usual.clear();
    noise.record(options::Recorded::if_changed);
    options.value("--time-budget", o.seconds, "TIME", options::parse_seconds,
                  "Time that the paths may take, as 2min; how many there are is then the clock's");
    options
        .number("--probes", o.probes, 0, 2147483647,
                "Evaluate only so many of the cells outside geometry; 0: all cells")
        .record();
    options.number("--seed", o.seed, 0, 4294967295, "Another one gives an independent estimate")
        .record();
    add_output_options(options, o.outputs);
    add_run_options(options, o);
    add_isa_option(options, o);
    return [fields, &options] {
        if (!fields->like.empty())
            take_after(*fields, options);
        run(*fields, options.recorded());
    };
}

} // namespace

options::Command reference_command() {
    return {"reference", "Path-traces the volume that a bake of the same options should be.",
            manual, declare};
}

} // namespace lpvbake::cmd
