// lpvbake verify: how wrong a volume is in its scene.

#include "commands.h"
#include "io/glb.h"
#include "io/io.h"
#include "io/target.h"
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
    std::optional<double> fail;  ///< a share
    std::optional<bool> fail_on; ///< surfaces, or cells; none: as wished_error has it
};

/// Of an error beside a limit: what is so wherever in its interval the truth lies.
enum class Verdict { pass, fail, undecided };

struct VerifyResult {
    volume::VolumeSet levels;
    uint64_t triangles = 0;
    reference::PathRules rules;
    std::string sampler;
    report::Verified verified;
    bool on_surfaces = false; ///< which of its errors is judged
    Verdict verdict = Verdict::pass;

    const report::MeasuredError& judged() const {
        return on_surfaces ? verified.surfaces : verified.cells;
    }
    const char* judged_name() const { return on_surfaces ? "surfaces" : "cells"; }
};

/// Fitted to what a program shows of surfaces, or filled for it.
bool is_for_surfaces(const Volume& volume) {
    const auto name = volume.metadata.find("target");
    const io::Target* target =
        name == volume.metadata.end() ? nullptr : io::target_named(name->second);
    return volume.metadata.contains("fit") || (target && target->dilate > 0);
}

Verdict verdict_of(const VerifyOptions& o, const report::MeasuredError& error) {
    if (!o.fail || error.high <= *o.fail)
        return Verdict::pass;
    return error.low > *o.fail ? Verdict::fail : Verdict::undecided;
}

const char* name_of(Verdict verdict) {
    constexpr const char* names[] = {"pass", "fail", "undecided"};
    return names[int(verdict)];
}

/// "cells 3.3 % (3 to 3.6) <= 8 %".
std::string judgement(const VerifyOptions& o, const VerifyResult& r) {
    constexpr const char* signs[] = {"<=", ">", "around"};
    return format("%s %s %s %.3g %%", r.judged_name(), error_text(r.judged()).c_str(),
                  signs[int(r.verdict)], 100 * *o.fail);
}

void print_result(const VerifyOptions& o, const VerifyResult& r, const Run& run) {
    if (o.format == Format::json) {
        report::Json grids = report::Json::array();
        for (const Grid& grid : r.levels.grids())
            grids.push_back(report::grid_json(grid));
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
             {"judged", r.judged_name()},
             {"result", name_of(r.verdict)},
             {"stages", stages_json(run.stages)},
             {"seconds", run.seconds()},
             {"peak_memory", peak_memory()},
             {"warnings", run.progress.warnings()}});
        return;
    }
    for (const Grid& grid : r.levels.grids())
        print_grid(grid);
    print_stages(run.stages);
    print_total(run.seconds());
    print_verified(r.verified, r.sampler);
    if (o.fail)
        std::printf("result        %s (%s; %s not judged)\n", name_of(r.verdict),
                    judgement(o, r).c_str(), r.on_surfaces ? "cells" : "surfaces");
}

/// Measures, and where that does not decide between pass and fail, at more places, up to
/// `most_times` as many. Throws Error (invalid) where what is judged has no light.
void measure(const VerifyOptions& o, const Scene& scene, const std::optional<Bounds>& box,
             bool for_surfaces, const readers::Reader& sampler, TerminalProgress& progress,
             VerifyResult& result) {
    constexpr uint64_t most_times = 16;
    report::VerifySettings settings = o.settings;
    settings.isa = o.isa;
    settings.box = box;
    for (uint64_t before = 0;; settings.points *= 4) {
        result.verified =
            report::verify(scene, result.levels, result.rules, sampler, settings, progress);
        const report::MeasuredError& usual = wished_error(result.verified, for_surfaces);
        result.on_surfaces = o.fail_on.value_or(&usual == &result.verified.surfaces);
        const report::MeasuredError& error = result.judged();
        if (error.points == 0)
            throw Error(ErrorKind::invalid, o.volume
                                                + ": no light arrives where it was measured in "
                                                + o.scene + "; give the lights of its bake");
        result.verdict = verdict_of(o, error);
        // There may be no more places.
        if (result.verdict != Verdict::undecided || error.points == before
            || settings.points >= most_times * o.settings.points)
            return;
        before = error.points;
        tell(format("undecided at %llu points", (unsigned long long)settings.points));
    }
}

void run(const VerifyOptions& o, const volume::VolumeSet& levels) {
    const Volume& given = levels.levels.front();
    if (is_in_air(given))
        throw Error(ErrorKind::unsupported,
                    o.volume
                        + ": the field is that in a medium (--scattering), and paths know of none; "
                          "verify a bake without it");
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
                        {}};
    result.rules.emitters = result.rules.emitters && !o.no_emitters;
    if (o.bounces)
        result.rules.bounces = o.bounces->most;
    const std::optional<Bounds> box = o.box_in(scene);
    measure(o, scene, box, is_for_surfaces(given), sampler, run.progress, result);
    run.end_stage("verify");
    run.progress.end();
    print_result(o, result, run);
    finish_stdout();
    if (result.verdict == Verdict::fail)
        throw Error(ErrorKind::difference,
                    o.volume + ": the error is above the limit: " + judgement(o, result));
    if (result.verdict == Verdict::undecided)
        throw Error(ErrorKind::difference,
                    o.volume + ": undecided, the limit lies inside the error's interval: "
                        + judgement(o, result)
                        + format("; take more --points than %llu, or another limit",
                                 (unsigned long long)o.settings.points));
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<VerifyOptions>();
    VerifyOptions& o = *fields;
    options.text("volume", o.volume, "VOLUME",
                 "Volume of bake or reference, " + io::format_list(", ", true)
                     + ", the .levels.json of nested ones or of bricks, or the .volumes.json of "
                       "ones beside each other");
    add_scene_option(options, o);
    add_light_options(options, o);
    add_static_option(options, o);

    options.group("Measure");
    options.number("--points", o.settings.points, 2, 1e6,
                   "Places to trace paths at, half of them cells, half on surfaces; with --fail "
                   "more until it is decided, at most 16 times as many");
    options.value("--bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1|NODES", parse_box,
                  "Box of the places, metres, or that of all nodes whose names fit a pattern; "
                  "default: all of the volume");
    options.number("--seed", o.settings.seed, 0, 4294967295, "Draws places and paths");
    options.value("--bounces", o.bounces, "N|inf", options::parse_bounces,
                  "Reflections of light at most; default: those of the volume");
    add_sampler_option(options, o.sampler);
    options.share("--fail", o.fail, 1e-6, 1e3,
                  "Error that is not to be exceeded; else exit code 7; default: none");
    options
        .choice("--fail-on", o.fail_on,
                options::Choices<bool>{{"cells", false}, {"surfaces", true}},
                "Whose error that is; default: of surfaces where the volume is for them, "
                "else of cells")
        .need("fail");
    add_isa_option(options, o);
    add_run_options(options, o);
    return [fields, &options] {
        constexpr const char* usage = "lpvbake verify VOLUME SCENE (see lpvbake verify --help)";
        if (fields->volume.empty())
            throw Error(ErrorKind::argument, std::string("no volume: ") + usage);
        check_order(fields->scene, fields->volume, usage);
        if (fields->scene.empty()) {
            if (io::volume_format(fields->volume) != &io::glb_format)
                throw Error(ErrorKind::argument, std::string("no scene: ") + usage);
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
