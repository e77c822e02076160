// lpvbake bake: from a glTF file to volume files.

#include "bake.h"

#include "bake/bake.h"

#include "background.h"
#include "bake/bricks.h"
#include "bake/lighting.h"
#include "bake/local_transfer.h"
#include "bake/pilot.h"
#include "bake/points.h"
#include "bake/scattering.h"
#include "bake/storage.h"
#include "bake_options.h"
#include "bake_result.h"
#include "commands.h"
#include "io/parts.h"
#include "io/points.h"
#include "layer_files.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "render/display.h"
#include "report/describe.h"
#include "report/measure.h"
#include "scene/scene_hash.h"
#include "scene/sky.h"
#include "scene/surroundings.h"
#include "scene_options.h"
#include "text.h"
#include "unchanged.h"
#include "verification.h"
#include "volume/dilate.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <future>
#include <limits>
#include <memory>
#include <utility>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/bake.txt.h"
    ;

const char light_manual[] =
#include "manual/light.txt.h"
    ;

/// What a program that shows the scene beside the volume has to know: its lights and the mean of
/// its sky, nits.
void add_light(const Scene& scene, Volume& volume) {
    const glm::dvec3 sky = scene::sky_mean(scene.sky, -1, 1, 0, 2 * glm::pi<double>());
    volume.metadata["lights"] =
        report::lights_json(scene).dump(-1, ' ', false, report::Json::error_handler_t::replace);
    volume.metadata["sky"] = format("%.6g,%.6g,%.6g", sky.r, sky.g, sky.b);
}

/// Of all cells.
void add_exposure(Volume& volume) {
    volume.metadata["exposure"] = format("%.1f", render::automatic_exposure(volume));
}

/// What of the command line stands in the metadata.
struct Origin {
    std::string settings, output_settings;
    std::string hash;         ///< bake_hash
    std::string surroundings; ///< scene::Surroundings; empty: all of the scene counts
};

void fill_metadata(const BakeOptions& o, const Scene& scene, const Origin& origin, Volume& volume) {
    fill_metadata(o, scene, origin.settings, volume);
    if (!origin.output_settings.empty())
        volume.metadata["output_settings"] = origin.output_settings;
    if (!origin.hash.empty())
        volume.metadata["bake_hash"] = origin.hash;
    if (!origin.surroundings.empty())
        volume.metadata["surroundings"] = origin.surroundings;
}

/// A bake, and how wrong it is.
struct Attempt {
    bake::Choice choice;
    volume::VolumeSet set; ///< mostly of one level
    std::optional<report::Verified> verified;
    LayerSets layers;

    /// What the layers are the light of.
    volume::VolumeSet& layered() { return layers.whole ? *layers.whole : set; }
};

/// Fills cells inside geometry; of layers by the walls of all light. Returns how many.
std::size_t dilate(int rings, Attempt& made) {
    std::size_t filled = 0;
    const auto fill = [&](Volume& volume) {
        const std::size_t cells = volume::dilate(volume, rings);
        volume.metadata["dilate"] = std::to_string(rings);
        return cells;
    };
    for (Volume& level : made.set.levels)
        filled += fill(level);
    if (made.layers.whole)
        std::ranges::for_each(made.layers.whole->levels, fill);
    for (volume::VolumeSet& layer : made.layers.sets)
        for (std::size_t i = 0; i < layer.levels.size(); ++i) {
            std::vector<std::vector<glm::vec3>>& walls = made.layered().levels[i].walls;
            layer.levels[i].walls.swap(walls);
            fill(layer.levels[i]);
            layer.levels[i].walls.swap(walls);
        }
    return filled;
}

/// Of the scene, until it is loaded as many as there may be.
using Triangles = std::atomic<uint64_t>;
constexpr uint64_t unknown = std::numeric_limits<uint64_t>::max();

/// Opens the device, for rays only where the bake may take it for them: a small scene is loaded
/// before that is asked, and a large one takes longer to load than the device to open.
std::unique_ptr<gpu::Device> open_device(const BakeOptions& o, const Triangles& triangles) {
    const bool gathers = std::ranges::count(wish_of(o).solvers, bake::find_solver("gather")) > 0;
    return std::make_unique<gpu::Device>(gpu::DeviceOptions{
        o.device, o.validation, [&](const gpu::DeviceInfo& info) {
            return bake::available(o.rays, info, gathers, triangles) == bake::Rays::device;
        }});
}

Attempt attempt(const BakeOptions& o, const Scene& scene, bake::Choice choice,
                const readers::Reader& reader, const gpu::Device& device, Run& run) {
    Attempt made{std::move(choice), {}, {}, {}};
    tell("choice: " + made.choice.text);
    run.progress.expect(made.choice.plan.stages);
    bake::BakedLevels baked = bake::bake_levels(scene, made.choice.plan, device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    made.set.levels = std::move(baked.levels);
    made.set.places = places_of(made.choice.plan.settings.volumes);
    if (baked.layers_whole) {
        made.layers.whole.emplace();
        made.layers.whole->levels.push_back(std::move(*baked.layers_whole));
    }
    made.layers.sets = sets_of(made.layered(), std::move(baked.layers));
    if (!made.set.places.empty()) {
        volume::order_by_priority(made.set);
        std::ranges::for_each(made.layers.sets, volume::order_by_priority);
    }
    if (o.fit.dilate > 0) {
        run.begin_stage();
        const std::size_t filled = dilate(o.fit.dilate, made);
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

/// Lights the surfaces, writes them and tells of it.
void run_light(const BakeOptions& o, const Scene& scene, const bake::BakePlan& plan,
               const gpu::Device& device, Run& run) {
    if (!plan.lit)
        throw Error(ErrorKind::argument, "with these options no surfaces are lit as a whole: "
                                         "reflective shadow maps hold all light");
    if (o.light_shard && (plan.maps.count > 0 || !plan.settings.layers.empty()))
        throw Error(ErrorKind::argument,
                    "--shard of surfaces is without --rsm-samples and --layers");
    run.progress.expect(plan.stages);
    std::vector<std::string> warnings;
    solver::Stages stages(run.progress, warnings, scene.path, plan.settings.cache);
    const visibility::Visibility visibility =
        bake::open_scene(scene, plan, device, stages).in_air(bake::air_in(plan));
    const bake::LitOrigin origin = bake::lit_origin(plan, visibility);
    std::size_t patches = 0;
    WriteReport::File file;
    if (o.light_shard) {
        surface::LitPart part = bake::light_part(scene, plan, visibility, *o.light_shard, stages);
        patches = part.lit.patches.size();
        file = bake::write_lit_part(o.light_file, origin, std::move(part));
    } else {
        surface::LitSurfaces lit =
            bake::light_scene(scene, plan, visibility, stages, bake::layers_in(plan));
        patches = lit.patches.size();
        file = bake::write_lit(o.light_file, origin, std::move(lit));
    }
    run.warn(warnings);
    run.progress.end();
    if (o.format != Format::json) {
        print_outputs({{file.path, {file}, {}}});
        return;
    }
    report::Json json{{"command", "light"},
                      {"version", LPVBAKE_VERSION},
                      {"scene", o.scene},
                      {"patches", patches},
                      {"outputs", {{{"path", file.path}, {"bytes", file.bytes}}}},
                      {"warnings", run.progress.warnings()},
                      {"seconds", run.seconds()}};
    if (o.light_shard)
        json["shard"] = {{"index", o.light_shard->index}, {"count", o.light_shard->count}};
    print_json(json);
}

/// ", shard 2 of 3: z 16 to 31".
std::string shard_text(const BakeOptions& o, const bake::BakePlan& plan) {
    return o.shard ? format(", shard %d of %d: z %d to %d", o.shard->index, o.shard->count,
                            plan.slab->begin, plan.slab->end - 1)
                   : "";
}

/// Writes what a shard has of the volume.
std::vector<Written> write_parts(const BakeOptions& o, const bake::BakePlan& plan, Volume& volume,
                                 Run& run) {
    std::vector<Written> written;
    run.progress.begin("write", o.outputs.paths.size());
    for (const std::string& path : o.outputs.paths) {
        run.progress.advance(written.size());
        written.push_back(
            {path, io::write_part(path, *o.shard, *plan.slab, plan.grid, volume).files, {}});
        tell("wrote " + path);
    }
    return written;
}

/// Bakes at points, writes and tells of it.
void run_at(const BakeOptions& o, const std::string& settings, const Scene& scene,
            volume::Points points, const bake::Choice& choice, gpu::Device& device, Run& run) {
    run.progress.expect(choice.plan.stages);
    bake::BakedPoints baked =
        bake::bake_points(scene, choice.plan, std::move(points), device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    baked.lit.light.metadata["choice"] = choice.text;
    fill_metadata(o, scene, settings, baked.lit.light);
    const std::vector<bake::Layer>& layers = choice.plan.settings.layers;
    for (Volume& layer : baked.layers)
        layer.metadata.insert(baked.lit.light.metadata.begin(), baked.lit.light.metadata.end());
    if (!layers.empty())
        baked.lit.light.metadata["layers"] = io::text_of(entries_of(layers, ""));
    run.begin_stage();
    run.progress.begin("write", o.outputs.paths.size());
    const std::vector<Written> written =
        write_layers(o.outputs.paths, baked.lit, layers, baked.layers);
    run.end_stage("write", counted(written.size(), "output"));
    device.check_validation();
    run.progress.end();
    print_result(o, device.info(), {choice, written}, run);
}

/// Bakes bricks, writes and tells of them.
void run_bricks(const BakeOptions& o, const Origin& origin, const Scene& scene,
                const bake::Choice& choice, gpu::Device& device, Run& run) {
    tell("choice: " + choice.text);
    run.progress.expect(choice.plan.stages);
    bake::BakedBricks baked = bake::bake_bricks(scene, choice.plan, device, run.progress);
    run.stages.insert(run.stages.end(), baked.stages.begin(), baked.stages.end());
    run.warn(baked.warnings);
    Volume& first = baked.set.levels.front();
    first.metadata["choice"] = choice.text;
    first.metadata["bricks_error"] = format("%.6g", baked.error);
    fill_metadata(o, scene, origin, first);
    add_light(scene, first);
    add_exposure(first);
    baked.set.levels.back().metadata = first.metadata;
    run.begin_stage();
    std::vector<Written> written =
        write_levels(o.outputs, o.outputs.paths, baked.set, run.progress);
    run.end_stage("write", counted(written.size(), "output"));
    device.check_validation();
    run.progress.end();
    BakeResult result{choice, std::move(written)};
    result.bricks = &baked;
    print_result(o, device.info(), result, run);
}

} // namespace

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

namespace {

/// What counts of the scene; `bounds` becomes the box of the bake.
Scene load_for(const BakeOptions& o, const SharedScene* shared, Run& run,
               std::optional<Bounds>& bounds) {
    if (shared) {
        bounds = o.box_in(shared->scene);
        return scene::with_instances(shared->scene, shared->around({*bounds, *o.surroundings}));
    }
    std::vector<scene::Surroundings> boxes; // none where it is named by what is in the scene
    if (const Bounds* box = std::get_if<Bounds>(&o.bounds); box && o.surroundings)
        boxes.push_back({*box, *o.surroundings});
    Scene whole = run.load(boxes);
    bounds = o.box_in(whole);
    return o.surroundings ? scene::within(std::move(whole), {*bounds, *o.surroundings})
                          : std::move(whole);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<BakeOptions>();
    add_bake_options(options, *fields);
    return [fields, &options] {
        fields->any_resolution =
            !options.find("resolution")->is_given() && !options.find("cell-size")->is_given();
        // Whatever their order, the files are the same.
        std::ranges::sort(options.find("level")->given);
        run_bake(*fields, options);
    };
}

/// What of bake's options has no meaning where surfaces are but lit.
constexpr std::array not_of_light{"at",         "adaptive", "lit",   "dry-run", "if-changed",
                                  "if-missing", "depfile",  "bytes", "verify"};

/// The options of bake, since all that decides the light has to be that of the bake.
options::Action declare_light(options::Options& options) {
    const auto fields = std::make_shared<BakeOptions>();
    add_bake_options(options, *fields);
    for (const char* other : not_of_light)
        options.find(other)->listed = false;
    options.find("output")->help = "File of lit surfaces to write, NAME.lit";
    options.find("shard")->help =
        "Light the i-th of N parts of the surfaces into a part, also NAME.lit; lpvbake merge makes "
        "of all what one run would have written; see below";
    return [fields, &options] {
        BakeOptions& o = *fields;
        if (o.outputs.paths.size() != 1 || !o.outputs.paths.front().ends_with(".lit"))
            throw Error(ErrorKind::argument, "one output: add -o NAME.lit");
        for (const char* other : not_of_light)
            if (options.find(other)->is_given())
                throw Error(ErrorKind::argument,
                            std::string("--") + other + " is of bake, not of light");
        std::ranges::sort(options.find("level")->given);
        o.light_file = std::exchange(o.outputs.paths, {}).front();
        o.light_shard = std::exchange(o.shard, {}); // of surfaces, not of layers of cells
        check_files({o.scene}, {}, {o.light_file}, true);
        probe_outputs({o.light_file});
        run_bake(o, options);
    };
}

} // namespace

SharedScene load_shared(BakeOptions o, std::span<const scene::Surroundings> boxes) {
    check_options(o);
    add_suns(o);
    Run run(o, o, {});
    const Triangles triangles = unknown;
    auto opening = std::async(in_background(), [&] { return open_device(o, triangles); });
    Scene scene = run.load(boxes);
    scene::Around around(scene);
    run.progress.end();
    return {std::move(scene), std::move(around), opening.get()};
}

void run_bake(BakeOptions o, const options::Options& options, const SharedScene* shared) {
    Origin origin{options.recorded(), output_settings(options), "", ""};
    check_options(o);
    add_suns(o);
    o.load.boxes = volume_nodes(o);
    const readers::Reader reader = reader_of(*o.outputs.target, o.fit);
    tell("settings: " + origin.settings);
    bake::BakeSettings base = to_settings(o, reader);
    bake::Wish wish = wish_of(o);
    Run run(o, o, o.outputs.paths);
    volume::Points points;
    if (!o.at.empty())
        points = io::read_points(o.at);
    base.points = points.positions.size();
    if (o.if_missing && !is_missing(o, run))
        return;
    Triangles triangles = unknown;
    auto opening = std::async(o.if_changed || shared ? std::launch::deferred : in_background(),
                              [&] { return open_device(o, triangles); });
    std::optional<io::CacheFolder> cache;
    if (!o.cache.empty() && !o.dry_run)
        base.cache = &cache.emplace(o.cache, o.cache_bytes);
    const Scene scene = load_for(o, shared, run, base.bounds);
    triangles = scene::triangle_count(scene);
    run.end_stage("load", counted(triangles, "triangle") + (o.surroundings ? " around" : "") + ", "
                              + counted(scene.lights.size(), "light"));
    check_lamps(o.lamp_radii, scene);
    const std::optional<PackedScene> packed = packed_for(o.outputs.paths, o.scene, o.load);
    if (base.local_transfer.object)
        base.bounds = bake::object_box(base.bounds.value_or(bounds_of(scene)),
                                       base.local_transfer.radius_of(o.grid.cell), o.grid.cell);
    base.levels = levels_of(o, scene);
    std::vector<std::string> air_warnings;
    base.medium = medium_of(o.medium, scene, air_warnings);
    run.warn(air_warnings);
    if (o.surroundings)
        origin.surroundings = scene::text_of({*base.bounds, *o.surroundings});
    base.lit_origin = {LPVBAKE_VERSION, scene::scene_hash(scene), origin.settings, {}};
    if (o.at.empty())
        origin.hash = bake_hash(o, options, scene, scene::scene_hash(scene), packed);
    if (!o.dry_run)
        write_depfile(o, scene);
    if (o.if_changed && !needs_bake(o, origin.hash, !base.levels.empty(), run))
        return;
    stop_if_signalled();
    const std::unique_ptr<gpu::Device> own_device = shared ? nullptr : opening.get();
    gpu::Device* const device = shared ? shared->device.get() : own_device.get();
    tell("device: " + device->info().name + ", " + device->info().driver);
    run.end_stage("open", "the device, opened while the scene was loaded");

    if (o.places()) {
        std::vector<std::string> warnings;
        std::string detail;
        base.volumes = volumes_of(o, scene, warnings, detail);
        run.warn(warnings);
        run.end_stage("volumes", detail.empty() ? counted(base.volumes.size(), "volume") : detail);
    }
    base.layers = layers_of(o, scene, base);
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

    if (!o.light_file.empty()) {
        run_light(o, scene, choice.plan, *device, run);
        return;
    }
    if (!o.at.empty()) {
        run_at(o, origin.settings, scene, std::move(points), choice, *device, run);
        return;
    }
    if (o.adaptive) {
        run_bricks(o, origin, scene, choice, *device, run);
        return;
    }
    Attempt made = bake_until(o, scene, facts, base, wish, std::move(choice), reader, *device, run);
    Volume all; // what is true of all levels
    all.metadata["choice"] = made.choice.text;
    if (storage)
        all.metadata["storage"] = storage->text;
    fill_metadata(o, scene, origin, all);
    const auto describe = [&](Volume& level) {
        level.metadata.insert(all.metadata.begin(), all.metadata.end());
        add_light(scene, level);
        if (!o.shard) // merge knows it
            add_exposure(level);
        if (!base.layers.empty())
            level.metadata["layers"] = io::text_of(entries_of(base.layers, ""));
    };
    std::ranges::for_each(made.set.levels, describe);
    if (made.layers.whole)
        std::ranges::for_each(made.layers.whole->levels, describe);
    const std::optional<bake::HeldOut> suns =
        held_out(base.layers, made.layers.sets, made.layered().levels.front().validity);
    for (volume::VolumeSet& layer : made.layers.sets)
        for (Volume& level : layer.levels)
            level.metadata.insert(all.metadata.begin(), all.metadata.end());

    run.begin_stage();
    std::vector<Written> written =
        o.shard ? write_parts(o, made.choice.plan, made.set.levels.front(), run)
        : base.layers.empty()
            ? write_levels(o.outputs, o.outputs.paths, made.set, run.progress, packed)
            : write_layers(o.outputs, o.outputs.paths, made.set, base.layers, made.layers,
                           run.progress);
    run.end_stage("write", counted(written.size(), "output") + shard_text(o, made.choice.plan));
    device->check_validation();
    run.progress.end();
    BakeResult result{made.choice, std::move(written), &made.set.levels.front(), storage,
                      made.verified};
    result.suns = suns;
    print_result(o, device->info(), result, run);
}

options::Command light_command() {
    return {"light", "Lights a scene's surfaces for the shards of a bake.", light_manual,
            declare_light};
}

options::Command bake_command() {
    return {"bake", "Bakes the light that a scene's surfaces send on into volume files.", manual,
            declare};
}

} // namespace lpvbake::cmd
