// lpvbake bake: from a glTF file to volume files.

#include "bake/bake.h"

#include "background.h"
#include "bake/bricks.h"
#include "bake/pilot.h"
#include "bake/points.h"
#include "bake/storage.h"
#include "commands.h"
#include "io/boxes.h"
#include "io/bricks.h"
#include "io/levels.h"
#include "io/points.h"
#include "lpvbake/error.h"
#include "options/wording.h"
#include "readers/readers.h"
#include "render/display.h"
#include "report/describe.h"
#include "report/measure.h"
#include "scene/sky.h"
#include "scene_options.h"
#include "text.h"
#include "verification.h"
#include "volume/dilate.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cstdio>
#include <future>
#include <map>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/bake.txt.h"
    ;

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
    std::optional<uint64_t> verify;      ///< points
    std::optional<uint64_t> bytes;       ///< of each output
    bool any_resolution = true;          ///< with `bytes`
    std::string at;                      ///< file of points; empty: a grid is baked
    std::vector<volume::LevelBox> level; ///< of nested ones each
    std::optional<int> levels;           ///< around `focus`
    std::optional<Bounds> focus;
    std::string adjust;                 ///< file of boxes
    std::optional<glm::dvec2> adaptive; ///< finest and coarsest cells of bricks, metres
    std::optional<uint64_t> max_size;   ///< of bricks, bytes

    bool nests() const { return !level.empty() || levels; }
};

/// "FINE..COARSE".
glm::dvec2 parse_adaptive(const std::string& text) {
    const std::size_t dots = text.find("..");
    const auto fine =
        dots == std::string::npos ? std::nullopt : options::parse_number(text.substr(0, dots));
    const auto coarse = fine ? options::parse_number(text.substr(dots + 2)) : std::nullopt;
    if (!coarse || !(*fine > 0) || !(*coarse > 0))
        options::refuse(text, "is not FINE..COARSE, cells in metres");
    return {*fine, *coarse};
}

/// Of --adaptive, where neither error nor size is given.
constexpr double usual_brick_error = 0.02;

/// "X0,Y0,Z0,X1,Y1,Z1:CELL".
volume::LevelBox parse_level(const std::string& text) {
    const std::size_t colon = text.rfind(':');
    const auto cell =
        colon == std::string::npos ? std::nullopt : options::parse_number(text.substr(colon + 1));
    if (!cell || !(*cell > 0))
        options::refuse(text, "is not X0,Y0,Z0,X1,Y1,Z1:CELL, in metres");
    const Bounds box = options::parse_bounds(text.substr(0, colon));
    return {box.lo, box.hi, *cell};
}

// ---------------------------------------------------------------- options of solvers

/// "sn", "sn or gather".
std::string names_of(const std::vector<const solver::SolverKind*>& solvers,
                     const char* last = " or ") {
    std::string names;
    for (const solver::SolverKind* solver : solvers)
        names += (names.empty() ? "" : last) + std::string(solver->name);
    return names;
}

std::vector<const solver::SolverKind*> solvers_with(const auto& has) {
    std::vector<const solver::SolverKind*> solvers;
    std::ranges::copy_if(bake::solver_kinds(), std::back_inserter(solvers),
                         [&](const solver::SolverKind* kind) { return has(*kind); });
    return solvers;
}

/// Whether a quality makes a difference.
bool has_presets(const solver::SolverKind& kind) {
    return std::ranges::count_if(kind.ladder,
                                 [](const solver::Rung& rung) { return bool(rung.preset); })
           > 1;
}

/// The solvers for which the parameter, beside the others that are given, means something.
std::vector<const solver::SolverKind*> solvers_with_parameter(const BakeOptions& o,
                                                              const std::string& name) {
    return solvers_with([&](const solver::SolverKind& kind) {
        const solver::Parameter* own = solver::find_parameter(kind, name);
        if (!own || !own->needs)
            return own != nullptr;
        const auto needed = o.parameters.find(own->needs);
        return needed != o.parameters.end() && needed->second > 0;
    });
}

/// The solvers that may be taken, best first: --solver, or those that have all options that are
/// given. Throws Error (argument) that names the option that none of them has.
std::vector<const solver::SolverKind*> solvers_of(const BakeOptions& o) {
    std::vector<const solver::SolverKind*> solvers =
        o.solver ? std::vector{o.solver} : bake::Wish().solvers;
    std::string why = o.solver ? std::string("--solver ") + o.solver->name : "";
    const auto keep = [&](const std::string& option,
                          const std::vector<const solver::SolverKind*>& with) {
        std::vector<const solver::SolverKind*> left = solvers;
        std::erase_if(left, [&](const solver::SolverKind* solver) {
            return !std::ranges::count(with, solver);
        });
        if (left.empty())
            throw Error(ErrorKind::argument, "--" + option + " is an option of " + names_of(with)
                                                 + ", not of " + names_of(solvers) + " (" + why
                                                 + ")");
        if (left.size() < solvers.size())
            why = "--" + option;
        solvers = left;
    };
    if (!o.at.empty())
        keep("at", solvers_with([](const solver::SolverKind& kind) { return kind.at_places; }));
    if (o.adaptive)
        keep("adaptive",
             solvers_with([](const solver::SolverKind& kind) { return kind.at_places; }));
    if (o.nests())
        keep(o.levels ? "levels" : "level", solvers_with([](const solver::SolverKind& kind) {
                 return kind.nesting != solver::Nesting::none;
             }));
    if (o.quality)
        keep("quality", solvers_with(has_presets));
    for (const auto& [name, value] : o.parameters)
        keep(name, solvers_with_parameter(o, name));
    if (o.sh_order > 0)
        keep("sh-order " + std::to_string(o.sh_order),
             solvers_with([&](const solver::SolverKind& kind) {
                 return std::ranges::count(kind.orders, o.sh_order) > 0;
             }));
    return solvers;
}

/// A row for each parameter of a solver; those that several have share one.
void add_parameters(options::Options& options, BakeOptions& o) {
    std::vector<std::string> names;
    for (const solver::SolverKind* kind : bake::solver_kinds())
        for (const solver::Parameter& parameter : kind->parameters)
            if (std::ranges::find(names, parameter.name) == names.end())
                names.push_back(parameter.name);
    for (const std::string& name : names) {
        std::string help, ranges;
        std::vector<const solver::Parameter*> all;
        for (const solver::SolverKind* kind : bake::solver_kinds()) {
            const solver::Parameter* own = solver::find_parameter(*kind, name);
            if (!own)
                continue;
            const bool again = !all.empty() && std::string(own->help) == all.back()->help;
            all.push_back(own);
            std::string whose = kind->name;
            if (own->needs)
                whose += " with --" + std::string(own->needs);
            const std::string usual = " (" + solver::value_text(*own, own->usual) + ")";
            help += again ? "" : (help.empty() ? "" : "; ") + whose + ": " + own->help + usual;
            if (again) // "gather with --rsm-samples, lpv: ..."
                help.insert(help.rfind(all.front()->help) - 2, ", " + whose);
        }
        const bool is_choice = all.front()->kind == solver::ValueKind::choice;
        std::string type = all.front()->kind == solver::ValueKind::whole ? "N" : "X";
        if (is_choice) {
            type.clear();
            for (const char* choice : all.front()->choices)
                type.append(type.empty() ? "" : "|").append(choice);
        }
        options::Option& option = options.add("--" + name, type, help);
        option.quoted = is_choice;
        option.read = [&o, name, all](const std::string& text) {
            for (const solver::Parameter* each : all)
                if (const std::optional<double> value = solver::parse_value(*each, text)) {
                    o.parameters[name] = *value;
                    return solver::value_text(*each, *value);
                }
            options::refuse(text, "is none of its values, " + solver::values_of(*all.front()));
        };
        option.implies(solver::value_text(*all.front(), all.front()->usual))
            .record(options::Recorded::if_changed);
    }
}

// ---------------------------------------------------------------- what is wanted

/// All that can be known to be wrong before any work is done.
void check_options(const BakeOptions& o) {
    check_paths("bake", o, o, o.outputs.paths, o.at);
    if (o.outputs.paths.empty() && !o.dry_run)
        throw Error(ErrorKind::argument,
                    o.at.empty() ? "no output: add -o FILE" + io::format_list(" or -o FILE")
                                 : "no output: add -o FILE, " + io::lit_point_format_list());
    if (o.bytes && o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "--bytes is of outputs: add -o FILE");
    const solver::SolverKind& solver = *solvers_of(o).front();
    for (const auto& [name, value] : o.parameters)
        if (const solver::Parameter* own = solver::find_parameter(solver, name);
            own && !solver::is_value(*own, value))
            throw Error(ErrorKind::argument, "--" + name + ": the " + solver.name + " solver takes "
                                                 + solver::values_of(*own));
    check_fit(o.outputs, o.fit, o.sh_order);
    if (!o.adjust.empty())
        check_files({o.adjust}, {}, o.outputs.paths);
    if (o.adaptive)
        check_brick_outputs(o.outputs);
    if (o.nests() || o.adaptive)
        check_level_outputs(o.outputs.paths, inputs_of(o, o));
    if (o.levels && o.grid.cell == 0)
        throw Error(ErrorKind::argument, "--levels: how large the finest cells are is missing: add "
                                         "--cell-size H");
}

/// What nested grids are asked for by; nothing where there is but one.
std::vector<volume::LevelBox> levels_of(const BakeOptions& o, const Scene& scene) {
    if (!o.levels)
        return o.level;
    const std::optional<Bounds> given = o.box_in(scene);
    const Bounds box = given.value_or(bounds_of(scene));
    volume::GridSettings settings = o.grid_settings();
    settings.cell *= std::exp2(*o.levels - 1);
    // Samples on the faces of a box that is given, and around the scene as one grid has them.
    const double out = (settings.margin - (given ? 0.0 : 0.5)) * settings.cell;
    return volume::levels_around({o.focus->lo, o.focus->hi, o.grid.cell}, box.lo - out,
                                 box.hi + out, std::size_t(*o.levels));
}

/// All but what choose_settings chooses; refers to the reader.
bake::BakeSettings to_settings(const BakeOptions& o, const readers::Reader& reader) {
    bake::BakeSettings settings(*solvers_of(o).front());
    settings.grid = o.grid_settings();
    settings.emitters = !o.no_emitters;
    settings.solver.set(o.quality.value_or(solver::Quality::balanced));
    if (o.bounces)
        settings.bounces = o.bounces->most;
    if (fits(o.outputs, o.fit))
        settings.fit = &reader;
    settings.dering = o.outputs.storage().dering;
    settings.isa = o.isa;
    if (!o.adjust.empty())
        settings.adjust = io::read_adjustments(o.adjust);
    if (o.adaptive)
        settings.adaptive = {o.adaptive->x, o.adaptive->y,
                             o.error.value_or(o.max_size ? 0.0 : usual_brick_error), o.max_size,
                             o.outputs.storage().precision == Precision::half ? 2 : 4};
    return settings;
}

bake::Wish wish_of(const BakeOptions& o) {
    bake::Wish wish;
    wish.solvers = solvers_of(o);
    if (o.sh_order > 0)
        wish.order = o.sh_order;
    else if (o.fit.evaluation != readers::Evaluation::linear)
        wish.order = 1;
    const io::Target storage = o.outputs.storage();
    wish.kept_order =
        std::min(storage.highest_order, volume::highest_order(storage.encoding.convention));
    if (!o.adaptive) // then it is the bricks'
        wish.error = o.error;
    wish.seconds = o.seconds;
    for (const auto& [name, value] : o.parameters)
        wish.given.push_back({name.c_str(), value});
    return wish;
}

// ---------------------------------------------------------------- the result

/// The document of --format json, as far as a dry run shares it.
report::Json describe(const BakeOptions& o, const gpu::DeviceInfo& device,
                      const bake::Choice& choice, const std::optional<bake::Storage>& storage,
                      uint64_t triangles, const Grid& grid) {
    report::Json chosen{{"solver", choice.solver().kind().name},
                        {"sh_order", choice.solver().order()},
                        {"text", choice.text},
                        {"error", choice.foretold() ? report::Json(choice.error) : report::Json()},
                        {"seconds", choice.plan.seconds}};
    for (const solver::Parameter& parameter : choice.solver().kind().parameters)
        if (solver::is_on_ladder(choice.solver().kind(), parameter.name)) {
            const double value = choice.solver()[parameter.name];
            chosen[parameter.name] = parameter.kind == solver::ValueKind::whole
                                         ? report::Json(int64_t(value))
                                         : report::Json(value);
        }
    if (const std::optional<solver::Pilot>& pilot = choice.pilot)
        chosen["pilot"] = {{"bands", pilot->bands}, {"clusters", pilot->clusters}};
    report::Json document{{"command", "bake"},
                          {"version", LPVBAKE_VERSION},
                          {"scene", o.scene},
                          {"triangles", triangles},
                          {"device", device_json(device)},
                          {"isa", visibility::name_of(choice.plan.settings.isa)},
                          {"grid", report::grid_json(grid)},
                          {"dry_run", o.dry_run},
                          {"choice", chosen}};
    if (choice.plan.settings.points > 0)
        document["points"] = choice.plan.settings.points;
    if (o.nests())
        for (const Grid& each : bake::grids_in(choice.plan))
            document["levels"].push_back(report::grid_json(each));
    if (const auto& bricks = choice.plan.bricks) {
        for (int level = 0; level < bricks->levels.count; ++level)
            document["levels"].push_back(report::grid_json(bricks->levels.lattice(level)));
        document["bricks"] = {{"expected", bricks->expected}};
    }
    if (storage)
        document["storage"] = {{"sh_order", storage->order},
                               {"resolution", storage->resolution},
                               {"precision", io::name_of(storage->precision)},
                               {"bytes", storage->bytes},
                               {"error", storage->error},
                               {"text", storage->text}};
    return document;
}

void print_level(std::size_t level, const Grid& grid) {
    const glm::dvec3 lo = grid.center(glm::ivec3(0)), hi = grid.center(grid.dims - 1);
    std::printf(
        "level %zu       %d x %d x %d samples every %.4g m from (%.5g, %.5g, %.5g) to (%.5g, "
        "%.5g, %.5g), %zu in all\n",
        level, grid.dims.x, grid.dims.y, grid.dims.z, grid.cell, lo.x, lo.y, lo.z, hi.x, hi.y, hi.z,
        grid.size());
}

void print_brick_plan(const bake::BrickPlan& bricks) {
    const Grid fine = bricks.levels.finest, coarse = bricks.levels.lattice(bricks.levels.count - 1);
    const glm::dvec3 lo = fine.center(glm::ivec3(0)), hi = fine.center(fine.dims - 1);
    std::printf(
        "bricks        of 8 x 8 x 8 cells, %s of %.4g to %.4g m, from (%.5g, %.5g, %.5g) to "
        "(%.5g, %.5g, %.5g)\n",
        counted(uint64_t(bricks.levels.count), "level").c_str(), fine.cell, coarse.cell, lo.x, lo.y,
        lo.z, hi.x, hi.y, hi.z);
}

/// How large the numbers of each level are in a file, where that is known.
void print_bytes(const BakeOptions& o, const bake::BakePlan& plan) {
    if (plan.bricks) {
        const uint64_t numbers = bake::brick_numbers(plan.settings.solver.order());
        std::printf("bytes         about %s of numbers in each output: %llu bricks before they are "
                    "trimmed\n",
                    bytes_text(std::min(plan.bricks->expected, plan.bricks->most) * numbers
                               * uint64_t(plan.settings.adaptive->number_bytes))
                        .c_str(),
                    (unsigned long long)plan.bricks->expected);
        return;
    }
    const std::vector<Grid> grids = bake::grids_in(plan);
    for (const std::string& path : o.outputs.paths)
        for (std::size_t level = 0; level < grids.size() && grids.size() > 1; ++level) {
            try {
                const uint64_t bytes = io::stored_bytes(o.outputs.storage(), path,
                                                        bake::grids_of(plan), grids[level].dims);
                std::printf("bytes         %s of numbers in %s\n", bytes_text(bytes).c_str(),
                            io::level_path(path, level).c_str());
            } catch (const Error&) { // of nodes of their own
            }
        }
}

/// What a bake is expected to take, and of whom.
std::string time_text(const bake::BakePlan& plan, const gpu::DeviceInfo& device) {
    return two_digits(plan.seconds) + " s on " + counted(uint64_t(plan.threads), "CPU thread")
           + (device.type == "cpu" ? "" : " and " + device.name);
}

void print_head(const gpu::DeviceInfo& device, const bake::Choice& choice,
                const std::optional<bake::Storage>& storage) {
    std::printf("device        %s\n", device.name.c_str());
    if (const uint64_t points = choice.plan.settings.points)
        std::printf("points        %llu, surfaces in patches of at most %.4g m\n",
                    (unsigned long long)points, choice.plan.grid.cell);
    else if (choice.plan.bricks)
        print_brick_plan(*choice.plan.bricks);
    else if (const std::vector<Grid> grids = bake::grids_in(choice.plan); grids.size() > 1)
        for (std::size_t i = 0; i < grids.size(); ++i)
            print_level(i, grids[i]);
    else
        print_grid(choice.plan.grid);
    const std::string error =
        choice.foretold() ? format("up to %s %% error%s", two_digits(100 * choice.error).c_str(),
                                   choice.pilot ? "" : " in a Cornell box")
                          : "an error that cannot be foretold";
    std::printf("choice        %s: %s, about %s\n", choice.text.c_str(), error.c_str(),
                time_text(choice.plan, device).c_str());
    if (storage)
        std::printf("storage       %s: %s of numbers, with the bake's and that of cells about %s "
                    "%% error in a Cornell box\n",
                    storage->text.c_str(), bytes_text(storage->bytes).c_str(),
                    two_digits(100 * storage->error).c_str());
}

/// The files that the bake will leave.
std::vector<Written> planned_outputs(const BakeOptions& o, const bake::BakePlan& plan) {
    std::vector<Written> outputs;
    for (const std::string& path : o.outputs.paths) {
        Written& output = outputs.emplace_back(Written{path, {}});
        if (!o.at.empty()) {
            output.files.push_back({path, 0});
            continue;
        }
        if (plan.bricks) {
            for (const std::string& file : io::brick_files(
                     path, std::size_t(plan.bricks->levels.count), bake::grids_of(plan)))
                output.files.push_back({file, 0});
            continue;
        }
        const std::size_t levels = 1 + plan.coarser.size();
        for (std::size_t level = 0; level < levels; ++level)
            for (const std::string& file : io::files_for(
                     o.outputs.storage(), io::level_path(path, level), bake::grids_of(plan)))
                output.files.push_back({file, 0});
        if (levels > 1)
            output.files.push_back({io::manifest_path(path), 0});
    }
    return outputs;
}

void print_plan(const BakeOptions& o, const gpu::DeviceInfo& device, const bake::Choice& choice,
                const std::optional<bake::Storage>& storage,
                const std::vector<std::string>& warnings) {
    const bake::BakePlan& plan = choice.plan;
    if (o.format == Format::json) {
        report::Json document = describe(o, device, choice, storage, plan.triangles, plan.grid);
        document["outputs"] = planned_json(planned_outputs(o, plan));
        document["stages"] = stages_json(plan.stages);
        document["warnings"] = warnings;
        document["seconds"] = plan.seconds;
        document["skipped"] = report::Json::array();
        for (const solver::SkippedStage& skipped : plan.skipped)
            document["skipped"].push_back(
                {{"name", skipped.name}, {"why", options::in_options(skipped.why)}});
        document["rsm"] = {{"maps", plan.maps.count}, {"size", plan.maps.size}};
        document["device_bytes"] = plan.device_bytes;
        document["host_bytes"] = plan.host_bytes;
        print_json(document);
        return;
    }
    print_head(device, choice, storage);
    std::printf("scene         %s\n", counted(plan.triangles, "triangle").c_str());
    std::printf("memory        %s on the device, about %s beside it\n",
                bytes_text(plan.device_bytes).c_str(), bytes_text(plan.host_bytes).c_str());
    std::printf("time          about %s, without loading and writing\n",
                time_text(plan, device).c_str());
    print_stages(plan.stages);
    for (const solver::SkippedStage& skipped : plan.skipped)
        std::printf("skipped       %s: %s\n", skipped.name.c_str(),
                    options::in_options(skipped.why).c_str());
    print_bytes(o, plan);
    for (const Written& output : planned_outputs(o, plan))
        for (const WriteReport::File& file : output.files)
            std::printf("writes        %s\n", file.path.c_str());
}

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, const bake::Choice& choice,
                  const std::optional<bake::Storage>& storage, const Volume& volume,
                  const std::optional<report::Verified>& verified,
                  const std::vector<Written>& outputs, const Run& run,
                  const bake::BakedBricks* bricks = nullptr) {
    const double seconds = run.seconds();
    const std::string reader = reader_of(*o.outputs.target, o.fit).name;
    if (o.format == Format::json) {
        report::Json document =
            describe(o, device, choice, storage, choice.plan.triangles, volume.grid);
        if (bricks) {
            document["bricks"]["count"] = bricks->set.levels.size();
            document["bricks"]["samples"] = bricks->samples;
            document["bricks"]["error"] = bricks->error;
        }
        document["outputs"] = outputs_json(outputs);
        document["stages"] = stages_json(run.stages);
        document["warnings"] = run.progress.warnings();
        add_fit(volume, document);
        if (verified)
            document["verified"] = verified_json(*verified, reader);
        document["seconds"] = seconds;
        document["peak_memory"] = peak_memory();
        print_json(document);
        return;
    }
    print_head(device, choice, storage);
    print_stages(run.stages);
    print_total(seconds);
    if (verified)
        print_verified(*verified, reader);
    print_outputs(outputs);
}

// ---------------------------------------------------------------- running

/// What a program that shows the scene beside the volume has to know: its lights, the mean of its
/// sky, nits, and an exposure for both.
void add_light(const Scene& scene, Volume& volume) {
    const glm::dvec3 sky = scene::sky_mean(scene.sky, -1, 1, 0, 2 * glm::pi<double>());
    volume.metadata["lights"] =
        report::lights_json(scene).dump(-1, ' ', false, report::Json::error_handler_t::replace);
    volume.metadata["sky"] = format("%.6g,%.6g,%.6g", sky.r, sky.g, sky.b);
    volume.metadata["exposure"] = format("%.1f", render::automatic_exposure(volume));
}

/// A bake, and how wrong it is.
struct Attempt {
    bake::Choice choice;
    volume::VolumeSet set; ///< mostly of one level
    std::optional<report::Verified> verified;
};

Attempt attempt(const BakeOptions& o, const Scene& scene, bake::Choice choice,
                const readers::Reader& reader, const gpu::Device& device, Run& run) {
    Attempt made{std::move(choice), {}, {}};
    tell("choice: " + made.choice.text);
    bake::BakedLevels baked = bake::bake_levels(scene, made.choice.plan, device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    made.set.levels = std::move(baked.levels);
    if (o.fit.dilate > 0) {
        run.begin_stage();
        std::size_t filled = 0;
        for (Volume& level : made.set.levels) {
            filled += volume::dilate(level, o.fit.dilate);
            level.metadata["dilate"] = std::to_string(o.fit.dilate);
        }
        run.end_stage("dilate", counted(filled, "cell") + " inside geometry filled");
    }
    if (o.verify) {
        run.begin_stage();
        report::VerifySettings settings;
        settings.points = *o.verify;
        settings.isa = o.isa;
        made.verified =
            report::verify(scene, made.set, report::field_rules(made.choice.plan.settings), reader,
                           settings, run.progress);
        for (Volume& level : made.set.levels)
            add_verified(*made.verified, level);
        run.end_stage("verify", "cells " + error_text(made.verified->cells) + ", surfaces "
                                    + error_text(made.verified->surfaces));
    }
    return made;
}

/// Bakes, and where an error is wanted and measured, bakes on until it is reached or no settings
/// promise less.
Attempt bake_until(const BakeOptions& o, const Scene& scene, const bake::SceneFacts& facts,
                   const bake::BakeSettings& base, bake::Wish wish, bake::Choice choice,
                   const readers::Reader& reader, const gpu::Device& device, Run& run) {
    constexpr int most_attempts = 4;
    for (int i = 1;; ++i) {
        Attempt made = attempt(o, scene, std::move(choice), reader, device, run);
        if (!made.verified || !o.error)
            return made;
        const report::MeasuredError& error =
            wished_error(*made.verified, made.choice.plan.settings.fit != nullptr);
        if (error.points == 0 || error.high <= *o.error)
            return made;
        const char* why = "four bakes did not reach it";
        if (i < most_attempts) {
            wish.error = *wish.error * std::clamp(*o.error / error.high, 0.25, 0.8);
            choice = bake::choose_settings(facts, base, wish, device.info());
            if (choice.text != made.choice.text)
                continue;
            why = "no settings are expected to err less";
        }
        run.warn({format("the error is measured as %s, not below the %.3g %% that are wanted, and "
                         "%s; a higher `resolution` or more bands may reach it",
                         error_text(error).c_str(), 100 * *o.error, why)});
        return made;
    }
}

/// Bakes at points, writes and tells of it.
void run_at(const BakeOptions& o, const std::string& settings, const Scene& scene,
            volume::Points points, const bake::Choice& choice, gpu::Device& device, Run& run) {
    bake::BakedPoints baked =
        bake::bake_points(scene, choice.plan, std::move(points), device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    baked.lit.light.metadata["choice"] = choice.text;
    fill_metadata(o, scene, settings, baked.lit.light);
    run.begin_stage();
    std::vector<Written> written;
    run.progress.begin("write", o.outputs.paths.size());
    for (const std::string& path : o.outputs.paths) {
        written.push_back({path, io::write_points(path, baked.lit).files});
        tell("wrote " + path);
    }
    run.end_stage("write", counted(written.size(), "output"));
    device.check_validation();
    run.progress.end();
    baked.lit.light.grid = choice.plan.grid;
    print_result(o, device.info(), choice, {}, baked.lit.light, {}, written, run);
}

/// Bakes bricks, writes and tells of them.
void run_bricks(const BakeOptions& o, const std::string& settings, const Scene& scene,
                const bake::Choice& choice, gpu::Device& device, Run& run) {
    tell("choice: " + choice.text);
    bake::BakedBricks baked = bake::bake_bricks(scene, choice.plan, device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    Volume& first = baked.set.levels.front();
    first.metadata["choice"] = choice.text;
    first.metadata["bricks_error"] = format("%.6g", baked.error);
    fill_metadata(o, scene, settings, first);
    add_light(scene, first);
    baked.set.levels.back().metadata = first.metadata;
    run.begin_stage();
    const std::vector<Written> written =
        write_levels(o.outputs, o.outputs.paths, baked.set, run.progress);
    run.end_stage("write", counted(written.size(), "output"));
    device.check_validation();
    run.progress.end();
    Volume finest;
    finest.grid = baked.set.finest();
    print_result(o, device.info(), choice, {}, finest, {}, written, run, &baked);
}

/// Sets what of the options --bytes chooses.
bake::Storage choose_storage(const Scene& scene, const bake::BakeSettings& base,
                             const bake::Wish& wish, BakeOptions& o) {
    bake::StorageWish storage{*o.bytes, o.outputs.paths, o.outputs.storage(), o.outputs.precision,
                              {},       o.any_resolution};
    const solver::SolverKind& kind = *wish.solvers.front();
    if (wish.order)
        storage.orders = {*wish.order};
    else
        std::ranges::copy_if(kind.orders, std::back_inserter(storage.orders), [&](int order) {
            return order != 3 && order <= wish.kept_order; // band 3 lights no surface
        });
    const auto with_order = [&](int order) {
        bake::BakeSettings settings = base;
        settings.solver = solver::SolverSettings(kind);
        settings.solver.set_order(order);
        return settings;
    };
    const auto grids = [&](int order) {
        bake::BakePlan plan;
        plan.settings = with_order(order);
        return bake::grids_of(plan);
    };
    const bake::Storage chosen = bake::choose_storage(
        base.bounds.value_or(bounds_of(scene)), base.grid, storage, grids,
        [&](int order) { return bake::expected_error(with_order(order), {}, wish.kept_order); });
    o.outputs.precision = chosen.precision;
    return chosen;
}

void run(BakeOptions o, const std::string& settings) {
    check_options(o);
    const readers::Reader reader = reader_of(*o.outputs.target, o.fit);
    tell("settings: " + settings);
    bake::BakeSettings base = to_settings(o, reader);
    bake::Wish wish = wish_of(o);
    Run run(o, o, o.outputs.paths);
    volume::Points points;
    if (!o.at.empty())
        points = io::read_points(o.at);
    base.points = points.positions.size();
    auto opening = std::async(in_background(), [&o] {
        return std::make_unique<gpu::Device>(gpu::DeviceOptions{o.device, o.validation});
    });
    const Scene scene = run.load();
    run.end_stage("load", counted(scene::triangle_count(scene), "triangle") + ", "
                              + counted(scene.lights.size(), "light"));
    const std::optional<PackedScene> packed = packed_for(o.outputs.paths, o.scene, o.load);
    stop_if_signalled();
    const std::unique_ptr<gpu::Device> device = opening.get();
    tell("device: " + device->info().name + ", " + device->info().driver);
    run.end_stage("open", "the device, opened while the scene was loaded");

    base.bounds = o.box_in(scene);
    base.levels = levels_of(o, scene);
    std::optional<bake::Storage> storage;
    if (o.bytes) {
        storage = choose_storage(scene, base, wish, o);
        base.grid.resolution = storage->resolution;
        wish.order = storage->order;
        tell("storage: " + storage->text);
    }
    const bake::SceneFacts facts = bake::survey(scene);
    if (wish.error && base.points == 0) {
        bake::add_pilot(scene, facts, base, *device, run.progress, wish);
        run.end_stage("pilot", "what bands and clusters lose of this scene's light");
    }
    bake::Choice choice = bake::choose_settings(facts, base, wish, device->info());
    run.warn(choice.warnings);
    if (o.dry_run) {
        tell("choice: " + choice.text);
        run.warn(choice.plan.warnings);
        run.progress.end();
        print_plan(o, device->info(), choice, storage, run.progress.warnings());
        return;
    }

    if (!o.at.empty()) {
        run_at(o, settings, scene, std::move(points), choice, *device, run);
        return;
    }
    if (o.adaptive) {
        run_bricks(o, settings, scene, choice, *device, run);
        return;
    }
    Attempt made = bake_until(o, scene, facts, base, wish, std::move(choice), reader, *device, run);
    Volume all; // what is true of all levels
    all.metadata["choice"] = made.choice.text;
    if (storage)
        all.metadata["storage"] = storage->text;
    fill_metadata(o, scene, settings, all);
    for (Volume& level : made.set.levels) {
        level.metadata.insert(all.metadata.begin(), all.metadata.end());
        add_light(scene, level);
    }

    run.begin_stage();
    const std::vector<Written> written =
        write_levels(o.outputs, o.outputs.paths, made.set, run.progress, packed);
    run.end_stage("write", counted(written.size(), "output"));
    device->check_validation();
    run.progress.end();
    print_result(o, device->info(), made.choice, storage, made.set.levels.front(), made.verified,
                 written, run);
}

void add_solver_options(options::Options& options, BakeOptions& o) {
    options.group("Solver");
    options::Choices<const solver::SolverKind*> solvers{{"auto", nullptr}};
    std::string help;
    for (const solver::SolverKind* kind : bake::solver_kinds()) {
        solvers.emplace_back(kind->name, kind);
        help += std::string(kind->name) + ": " + kind->help + "; ";
    }
    options
        .choice("--solver", o.solver, solvers,
                help + "auto: by what is wanted (--error, --time-budget) and given, else "
                    + bake::solver_kinds().front()->name)
        .record();
    options
        .share("--error", o.error, 1e-6, 1, "Error of irradiance that is wanted at most; see below")
        .implies("0.04")
        .record(options::Recorded::if_changed);
    options
        .value("--time-budget", o.seconds, "TIME", options::parse_seconds,
               "Time that a bake may take, as 2s, 500ms or 1.5min (--time is the animation's)")
        .implies("2s")
        .record(options::Recorded::if_changed);
    options
        .value("--bounces", o.bounces, "N|inf", options::parse_bounces,
               "Reflections of light at most, 0 to 10000, or all; default: 1 for lpv, inf for the "
               "others")
        .implies("inf")
        .record(options::Recorded::if_changed);
    options
        .number("--sh-order", o.sh_order, 0, 4,
                "Highest band of the spherical harmonics; 0: 1 for lpv, 2 for the others")
        .record();
    options
        .choice("--quality", o.quality,
                options::choices_named<solver::Quality>(solver::quality_names),
                names_of(solvers_with(has_presets), " and ")
                    + ": time against error (directions, clusters, rays, tolerance); default: "
                      "balanced")
        .implies("balanced")
        .exclude({"error", "time-budget"})
        .record(options::Recorded::if_changed);
    add_parameters(options, o);
}

void add_level_options(options::Options& options, BakeOptions& o) {
    options
        .values("--level", o.level, "X0,Y0,Z0,X1,Y1,Z1:CELL", parse_level,
                "Box, metres, with cells of this size; repeated: nested levels of one scene, cells "
                "powers of two of the finest, into a file each; see below")
        .exclude({"resolution", "cell-size", "bounds", "margin", "levels", "focus", "at", "bytes",
                  "rsm-samples"})
        .record(options::Recorded::if_changed);
    options
        .number("--levels", o.levels, 2, double(volume::most_levels),
                "Nested levels around --focus: cells of --cell-size there, then twice as large in "
                "boxes twice as large, the last over all of the scene or --bounds")
        .exclude({"at", "bytes", "rsm-samples"})
        .need("focus")
        .record(options::Recorded::if_changed);
    options
        .value("--focus", o.focus, "X0,Y0,Z0,X1,Y1,Z1", options::parse_bounds,
               "Box of the finest of --levels, metres")
        .need("levels")
        .record(options::Recorded::if_changed);
    options
        .value("--adaptive", o.adaptive, "FINE..COARSE", parse_adaptive,
               "Bricks of 8 x 8 x 8 cells, small where geometry stands and light changes: cells of "
               "FINE to COARSE metres, a power of two apart, in all of the scene or --bounds; into "
                   + io::brick_format_list()
                   + "; --error: what reading between them may lose, of "
                     "all irradiance, default 2 %; see below")
        .exclude({"resolution", "cell-size",  "margin",     "level",         "levels",
                  "focus",      "at",         "bytes",      "verify",        "rsm-samples",
                  "rsm-size",   "tolerance",  "target",     "sh-convention", "axes",
                  "packing",    "dering",     "l1-scale",   "exr-columns",   "dilate",
                  "fit",        "evaluation", "time-budget"})
        .record(options::Recorded::if_changed);
    options
        .value(
            "--max-size", o.max_size, "SIZE", options::parse_bytes,
            "Leave no more bricks of --adaptive than whose numbers fit into SIZE, as 64M, in each "
            "output: those that cost the least error go first")
        .need("adaptive")
        .record(options::Recorded::if_changed);
}

void add_adjust_option(options::Options& options, BakeOptions& o) {
    options
        .text("--adjust", o.adjust, "FILE",
              "JSON file of boxes whose cells are valid or not whatever geometry says, or whose "
              "light is multiplied; see below")
        .exclude({"at", "adaptive"})
        .record(options::Recorded::if_changed);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<BakeOptions>();
    BakeOptions& o = *fields;
    add_scene_option(options, o);
    options.texts("-o,--output", o.outputs.paths, "FILE", outputs_help()).keep_to_one_run();
    add_grid_options(options, o);
    options
        .text("--at", o.at, "FILE",
              "Bake the light at the points of a file (" + io::point_format_list()
                  + ") instead of a grid, into " + io::lit_point_format_list()
                  + "; --cell-size is how large patches of surfaces are at most then; see below")
        .exclude({"resolution", "bounds",        "margin",   "level",     "levels",
                  "focus",      "rsm-samples",   "rsm-size", "tolerance", "target",
                  "precision",  "sh-convention", "axes",     "packing",   "dering",
                  "l1-scale",   "exr-columns",   "dilate",   "fit",       "evaluation",
                  "verify",     "bytes"})
        .keep_to_one_run();
    add_level_options(options, o);
    add_adjust_option(options, o);
    add_light_options(options, o);
    add_solver_options(options, o);
    add_output_options(options, o.outputs);
    options
        .value(
            "--bytes", o.bytes, "SIZE", options::parse_bytes,
            "Of the order, resolution and precision that are not given, take those with the least "
            "expected error whose numbers fit into SIZE, as 8M, in each output; see below")
        .implies("8M")
        .record(options::Recorded::if_changed);
    options
        .number("--dilate", o.fit.dilate, 0, 1024,
                "Rings of cells inside geometry to fill from cells around them; the validity "
                "stays as it is")
        .record();
    options
        .choice(
            "--fit", o.fit.fit, options::Choices<bool>{{"none", false}, {"surfaces", true}},
            "surfaces: values with which the target's program shows on surfaces the light that "
            "arrives there, though it reads cells beyond walls; generic: our own sampler. none: "
            "the field at the cells' centres. Default: surfaces for programs that shade surfaces "
            "by the volume, none for generic, blender and houdini, and with --dilate")
        .implies([&o] { return fits(o.outputs, o.fit) ? "surfaces" : "none"; })
        .record(options::Recorded::if_changed);
    add_evaluation_option(options, o.fit);
    options
        .number(
            "--verify", o.verify, 2, 1e6,
            "Measure the error in this scene: by paths at N places, half of them cells, half on "
            "surfaces; with --error bake on until the measured one is below it")
        .bare("256");
    add_device_option(options, o);
    options.flag("--validation", o.validation,
                 "Load Vulkan's validation layer; messages are errors");
    add_isa_option(options, o);
    add_dry_run_option(options, o,
                       "Print grid, memory, the files that will exist and an estimate of the time");
    add_run_options(options, o);
    return [fields, &options] {
        fields->any_resolution =
            !options.find("resolution")->is_given() && !options.find("cell-size")->is_given();
        // Whatever their order, the files are the same.
        std::ranges::sort(options.find("level")->given);
        run(*fields, options.recorded());
    };
}

} // namespace

options::Command bake_command() {
    return {"bake", "Bakes the light that a scene's surfaces send on into volume files.", manual,
            declare};
}

} // namespace lpvbake::cmd
