// lpvbake verify: how wrong a volume is in its scene.

#include "commands.h"
#include "io/glb.h"
#include "io/io.h"
#include "lpvbake/error.h"
#include "read_light.h"
#include "report/describe.h"
#include "scene_options.h"
#include "text.h"
#include "verification.h"

#include <cstdio>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/verify.txt.h"
    ;

struct VerifyOptions : SceneOptions, RunOptions {
    std::string volume;
    const readers::Reader* sampler = nullptr; ///< null: as sampler_for has it
    std::optional<options::Bounces> bounces;  ///< none: the volume's
    report::VerifySettings settings;
    std::optional<double> fail; ///< a share
};

struct VerifyResult {
    volume::VolumeSet levels;
    uint64_t triangles = 0;
    reference::PathRules rules;
    std::string sampler;
    report::Verified verified;
    std::optional<std::string> failure;
};

/// Why the error is not known to be at or below the limit.
std::optional<std::string> failure_of(const VerifyOptions& o, const report::MeasuredError& error) {
    if (!o.fail || error.high <= *o.fail)
        return {};
    return format("the error is %s, %s %.3g %%", error_text(error).c_str(),
                  error.low > *o.fail ? "above" : "and with more `points` may be shown to be below",
                  100 * *o.fail);
}

void print_result(const VerifyOptions& o, const VerifyResult& r, const Run& run) {
    const char* const result = r.failure ? "fail" : "pass";
    if (o.format == Format::json) {
        report::Json grids = report::Json::array();
        for (const Volume& level : r.levels.levels)
            grids.push_back(report::grid_json(level.grid));
        print_json(
            {{"command", "verify"},
             {"version", LPVBAKE_VERSION},
             {"volume", o.volume},
             {"scene", o.scene},
             {"triangles", r.triangles},
             {"grid", grids.front()},
             {"levels", grids},
             {"sh_order", r.levels.levels.front().sh_order},
             {"bounces", r.rules.bounces ? report::Json(*r.rules.bounces) : report::Json(nullptr)},
             {"verified", verified_json(r.verified, r.sampler)},
             {"fail", o.fail ? report::Json(*o.fail) : report::Json(nullptr)},
             {"result", result},
             {"stages", stages_json(run.stages)},
             {"seconds", run.seconds()},
             {"peak_memory", peak_memory()},
             {"warnings", run.progress.warnings()}});
        return;
    }
    for (const Volume& level : r.levels.levels)
        print_grid(level.grid);
    print_stages(run.stages);
    print_total(run.seconds());
    print_verified(r.verified, r.sampler);
    if (o.fail)
        std::printf("result        %s\n", result);
}

void run(const VerifyOptions& o, const volume::VolumeSet& levels) {
    const Volume& given = levels.levels.front();
    Run run(o, o, {});
    const Scene scene = run.load();
    run.end_stage("load");
    if (const auto other = mismatch(o.volume, given, scene))
        run.progress.warn(*other);

    const readers::Reader sampler = sampler_for(o.sampler, given);
    VerifyResult result{filled_for(sampler, levels).value_or(levels),
                        scene::triangle_count(scene),
                        rules_of(given),
                        sampler.name,
                        {},
                        {}};
    result.rules.emitters = result.rules.emitters && !o.no_emitters;
    if (o.bounces)
        result.rules.bounces = o.bounces->most;
    report::VerifySettings settings = o.settings;
    settings.isa = o.isa;
    result.verified =
        report::verify(scene, result.levels, result.rules, sampler, settings, run.progress);
    run.end_stage("verify");
    const report::MeasuredError& error =
        wished_error(result.verified, given.metadata.contains("fit"));
    if (error.points == 0)
        throw Error(ErrorKind::invalid, o.volume + ": no light arrives where it was measured in "
                                            + o.scene + "; give the lights of its bake");
    result.failure = failure_of(o, error);
    run.progress.end();
    print_result(o, result, run);
    finish_stdout();
    if (result.failure)
        throw Error(ErrorKind::difference, o.volume + ": " + *result.failure);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<VerifyOptions>();
    VerifyOptions& o = *fields;
    options
        .text("volume", o.volume, "VOLUME",
              "Volume of bake or reference, " + io::format_list(", ", true)
                  + ", or the .levels.json of nested ones")
        .require();
    add_scene_option(options, o);
    add_light_options(options, o);

    options.group("Measure");
    options.number("--points", o.settings.points, 2, 1e6,
                   "Places to trace paths at, half of them cells, half on surfaces");
    options.number("--seed", o.settings.seed, 0, 4294967295, "Draws places and paths");
    options.value("--bounces", o.bounces, "N|inf", options::parse_bounces,
                  "Reflections of light at most; default: those of the volume");
    add_sampler_option(options, o.sampler);
    options.share("--fail", o.fail, 1e-6, 1e3,
                  "Error that is not to be exceeded; else exit code 7; default: none");
    add_isa_option(options, o);
    add_run_options(options, o);
    return [fields, &options] {
        if (fields->scene.empty()) {
            if (io::volume_format(fields->volume) != &io::glb_format)
                throw Error(ErrorKind::argument,
                            "no scene: lpvbake verify VOLUME SCENE (see lpvbake verify --help)");
            fields->scene = fields->volume;
        }
        const volume::VolumeSet levels = read_levels(fields->volume);
        take_light(fields->volume, levels.levels.front(), options);
        tell("settings: " + options.recorded());
        run(*fields, levels);
    };
}

} // namespace

options::Command verify_command() {
    return {"verify", "Measures how wrong a volume is in its scene, by paths.", manual, declare};
}

} // namespace lpvbake::cmd
