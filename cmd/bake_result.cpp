#include "bake_result.h"

#include "bake/bake.h"
#include "bake/bricks.h"
#include "io/bricks.h"
#include "io/levels.h"
#include "layer_files.h"
#include "options/wording.h"
#include "report/describe.h"
#include "text.h"
#include "verification.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace lpvbake::cmd {
namespace {

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
                          {"rays", bake::name_of(choice.plan.settings.rays)},
                          {"grid", report::grid_json(grid)},
                          {"dry_run", o.dry_run},
                          {"choice", chosen}};
    if (choice.plan.settings.points > 0)
        document["points"] = choice.plan.settings.points;
    if (const auto& shard = choice.plan.settings.shard)
        document["shard"] = {{"index", shard->index},
                             {"count", shard->count},
                             {"z", {choice.plan.slab->begin, choice.plan.slab->end - 1}}};
    if (o.nests())
        for (const Grid& each : bake::grids_in(choice.plan))
            document["levels"].push_back(report::grid_json(each));
    const std::vector<volume::VolumeBox>& boxes = choice.plan.settings.volumes;
    const std::vector<Grid> grids = bake::grids_in(choice.plan);
    for (std::size_t i = 0; i < boxes.size(); ++i) {
        document["volumes"].push_back({{"name", boxes[i].place.name},
                                       {"priority", boxes[i].place.priority},
                                       {"falloff", boxes[i].place.falloff},
                                       {"grid", report::grid_json(grids[i])}});
    }
    if (const auto& layers = choice.plan.settings.layers; !layers.empty())
        document["layers"] = report::Json::parse(io::text_of(entries_of(layers, "")));
    if (const auto& own = choice.plan.layers_grid)
        document["layers_grid"] = report::grid_json(*own);
    if (const auto& bricks = choice.plan.bricks) {
        for (int level = 0; level < bricks->levels.count; ++level)
            document["levels"].push_back(report::grid_json(bricks->levels.lattice(level)));
        document["bricks"] = {{"expected", bricks->expected}};
    }
    if (const auto& air = choice.plan.settings.medium) {
        document["medium"] = medium_json(*air, o.medium.density);
        document["medium"]["box"] = {air->box.lo.x, air->box.lo.y, air->box.lo.z,
                                     air->box.hi.x, air->box.hi.y, air->box.hi.z};
        report::Json& times = document["medium"]["scattering"] = nullptr;
        if (const auto& scattering = choice.plan.settings.scattering)
            times = scattering->times ? report::Json(*scattering->times) : report::Json("inf");
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

void print_volume(const volume::Place& place, const Grid& grid) {
    const glm::dvec3 lo = grid.origin, hi = grid.to_world(glm::dvec3(grid.dims));
    std::printf("volume        %s, %d x %d x %d cells of %.4g m from (%.5g, %.5g, %.5g) to (%.5g, "
                "%.5g, %.5g), %zu in all%s\n",
                place.name.c_str(), grid.dims.x, grid.dims.y, grid.dims.z, grid.cell, lo.x, lo.y,
                lo.z, hi.x, hi.y, hi.z, grid.size(), turn_text(grid).c_str());
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
    const std::vector<volume::Place> places = places_of(plan.settings.volumes);
    for (const std::string& path : o.outputs.paths)
        for (std::size_t level = 0; level < grids.size() && grids.size() > 1; ++level) {
            try {
                const uint64_t bytes = io::stored_bytes(o.outputs.storage(), path,
                                                        bake::grids_of(plan), grids[level].dims);
                std::printf("bytes         %s of numbers in %s\n", bytes_text(bytes).c_str(),
                            io::member_path(path, places, level).c_str());
            } catch (const Error&) { // of nodes of their own
            }
        }
}

/// What a bake is expected to take, and of whom.
std::string time_text(const bake::BakePlan& plan, const gpu::DeviceInfo& device) {
    return two_digits(plan.seconds) + " s on " + counted(uint64_t(plan.threads), "CPU thread")
           + (device.type == "cpu" ? "" : " and " + device.name);
}

/// Of the process, with what it has taken so far to load the scene and to open the device.
uint64_t host_bytes(const bake::BakePlan& plan) {
    return plan.host_bytes + peak_memory();
}

/// What a scheduler may be asked for: a quarter more memory than is expected; and, for loading,
/// writing and slower machines, three times the time and a minute.
struct Hints {
    uint64_t memory_mib = 0, minutes = 0;
};

Hints hints_of(const bake::BakePlan& plan, const gpu::DeviceInfo& device) {
    const uint64_t bytes = host_bytes(plan) + (device.type == "cpu" ? plan.device_bytes : 0);
    constexpr uint64_t step = 64;
    return {(uint64_t(1.25 * double(bytes)) / (step << 20) + 1) * step,
            uint64_t(std::ceil(3 * plan.seconds / 60)) + 1};
}

void print_head(const gpu::DeviceInfo& device, const bake::Choice& choice,
                const std::optional<bake::Storage>& storage) {
    std::printf("device        %s\n", device.name.c_str());
    if (const uint64_t points = choice.plan.settings.points)
        std::printf("points        %llu, surfaces in patches of at most %.4g m\n",
                    (unsigned long long)points, choice.plan.grid.cell);
    else if (choice.plan.bricks)
        print_brick_plan(*choice.plan.bricks);
    else if (const auto& boxes = choice.plan.settings.volumes; !boxes.empty())
        for (std::size_t i = 0; i < boxes.size(); ++i)
            print_volume(boxes[i].place, bake::grids_in(choice.plan)[i]);
    else if (const std::vector<Grid> grids = bake::grids_in(choice.plan); grids.size() > 1)
        for (std::size_t i = 0; i < grids.size(); ++i)
            print_level(i, grids[i]);
    else
        print_grid(choice.plan.grid);
    for (const bake::Layer& layer : choice.plan.settings.layers)
        std::printf("layer         %s (%s)\n", layer.name.c_str(), layer.kind.c_str());
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
            for (const bake::Layer& layer : plan.settings.layers)
                output.files.push_back({io::layer_path(path, layer.name), 0});
            if (!plan.settings.layers.empty())
                output.files.push_back({io::layer_manifest_path(path), 0});
            continue;
        }
        if (plan.bricks) {
            for (const std::string& file : io::brick_files(
                     path, std::size_t(plan.bricks->levels.count), bake::grids_of(plan)))
                output.files.push_back({file, 0});
            continue;
        }
        if (o.shard) {
            output.files.push_back({path, 0});
            continue;
        }
        const std::size_t levels = 1 + plan.coarser.size();
        const std::vector<volume::Place> places = places_of(plan.settings.volumes);
        const auto add_set = [&](const std::string& set, const Volume& grids) {
            for (std::size_t level = 0; level < levels; ++level)
                for (const std::string& file :
                     io::files_for(o.outputs.storage(), io::member_path(set, places, level), grids))
                    output.files.push_back({file, 0});
            if (levels > 1 || !places.empty())
                output.files.push_back({io::manifest_path(set, !places.empty()), 0});
        };
        add_set(path, bake::grids_of(plan));
        const std::vector<bake::Layer>& layers = plan.settings.layers;
        if (plan.layers_grid)
            add_set(io::layers_whole_path(path), bake::grids_of(plan));
        for (const bake::Layer& layer : layers)
            add_set(io::layer_path(path, layer.name), bake::grids_of(plan, layer));
        if (!layers.empty())
            output.files.push_back({io::layer_manifest_path(path), 0});
    }
    return outputs;
}

} // namespace

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
        const Hints hints = hints_of(plan, device);
        document["hints"] = {{"memory_mib", hints.memory_mib},
                             {"minutes", hints.minutes},
                             {"threads", plan.threads}};
        document["device_bytes"] = plan.device_bytes;
        document["host_bytes"] = host_bytes(plan);
        print_json(document);
        return;
    }
    print_head(device, choice, storage);
    std::printf("scene         %s\n", counted(plan.triangles, "triangle").c_str());
    std::printf("memory        %s on the device, about %s beside it\n",
                bytes_text(plan.device_bytes).c_str(), bytes_text(host_bytes(plan)).c_str());
    std::printf("time          about %s, without loading and writing\n",
                time_text(plan, device).c_str());
    const Hints hints = hints_of(plan, device);
    std::printf("hints         --mem=%lluM --time=%llu --cpus-per-task=%d (Slurm)\n",
                (unsigned long long)hints.memory_mib, (unsigned long long)hints.minutes,
                plan.threads);
    print_stages(plan.stages);
    for (const solver::SkippedStage& skipped : plan.skipped)
        std::printf("skipped       %s: %s\n", skipped.name.c_str(),
                    options::in_options(skipped.why).c_str());
    print_bytes(o, plan);
    for (const Written& output : planned_outputs(o, plan))
        for (const WriteReport::File& file : output.files)
            std::printf("writes        %s\n", file.path.c_str());
}

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, const BakeResult& result,
                  const Run& run) {
    if (!o.told)
        return;
    const double seconds = run.seconds();
    const std::string reader = reader_of(*o.outputs.target, o.fit).name;
    const bake::BakePlan& plan = result.choice.plan;
    if (o.format == Format::json) {
        const Grid grid = result.bricks   ? result.bricks->set.finest()
                          : result.volume ? result.volume->grid
                                          : plan.grid;
        report::Json document =
            describe(o, device, result.choice, result.storage, plan.triangles, grid);
        if (result.bricks) {
            document["bricks"]["count"] = result.bricks->set.levels.size();
            document["bricks"]["samples"] = result.bricks->samples;
            document["bricks"]["error"] = result.bricks->error;
        }
        if (const auto& suns = result.suns)
            document["suns_held_out"] = {
                {"mean", suns->mean}, {"worst", suns->worst}, {"hour", suns->hour}};
        document["outputs"] = outputs_json(result.outputs);
        document["stages"] = stages_json(run.stages);
        document["warnings"] = run.progress.warnings();
        if (result.volume)
            add_fit(*result.volume, document);
        if (result.verified)
            document["verified"] = verified_json(*result.verified, reader);
        document["seconds"] = seconds;
        document["peak_memory"] = peak_memory();
        print_json(document);
        return;
    }
    print_head(device, result.choice, result.storage);
    print_stages(run.stages);
    print_total(seconds);
    if (result.verified)
        print_verified(*result.verified, reader);
    if (const auto& suns = result.suns)
        std::printf(
            "suns          each is %s %% off what the two around it make of it in the mean, "
            "at most %s %%, at %s; half-way between suns it is a quarter to a half of that\n",
            two_digits(100 * suns->mean).c_str(), two_digits(100 * suns->worst).c_str(),
            scene::clock_text(suns->hour).c_str());
    print_outputs(result.outputs);
}
} // namespace lpvbake::cmd
