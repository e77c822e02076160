// lpvbake world: a world in tiles and lightings, as rows that any scheduler hands out.

#include "io/world.h"

#include "bake.h"
#include "bake/choose.h"
#include "bake/facts.h"
#include "commands.h"
#include "gpu/gpu.h"
#include "io/glb.h"
#include "io/io.h"
#include "io/tres.h"
#include "io/world_volume.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "read_light.h"
#include "report/seams.h"
#include "scene/scene_hash.h"
#include "scene/surroundings.h"
#include "terminal.h"
#include "text.h"
#include "unchanged.h"
#include "volume/tiles.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/world.txt.h"
    ;

constexpr const char* end_of_name = io::end_of_world;

struct PlanOptions {
    std::string file, output, kind = ".vdb";
    std::optional<double> cell, surroundings;
    int tile = 64;
    std::vector<io::World::Scenario> scenarios;
    std::vector<std::pair<std::size_t, std::size_t>> rows; ///< first and last
    bool check = false;
    Format format = Format::text;
};

/// Words as a shell parts them, by blanks and quotes.
std::vector<std::string> words_in(const std::string& text) {
    std::vector<std::string> words;
    bool inside = false;
    char quote = 0;
    for (const char c : text) {
        if (quote ? c == quote : c == '"' || c == '\'') {
            quote = quote ? 0 : c;
            if (quote && !inside)
                words.emplace_back();
            inside = true;
        } else if (!quote && c == ' ') {
            inside = false;
        } else {
            if (!inside)
                words.emplace_back();
            inside = true;
            words.back() += c;
        }
    }
    if (quote)
        options::refuse(text, "has a quote without its other");
    return words;
}

/// "noon:--sun '#ffffff,1000,60,0'".
io::World::Scenario parse_scenario(const std::string& text) {
    const std::size_t colon = text.find(':');
    io::World::Scenario scenario{text.substr(0, colon), {}};
    if (!bake::is_layer_name(scenario.name))
        options::refuse(text,
                        "is not NAME:OPTIONS, where NAME has letters, digits, dots, dashes and "
                        "underscores, and OPTIONS are of lpvbake bake");
    if (colon != text.npos)
        scenario.options = words_in(text.substr(colon + 1));
    return scenario;
}

std::vector<std::pair<std::size_t, std::size_t>> parse_rows(const std::string& text) {
    std::vector<std::pair<std::size_t, std::size_t>> rows;
    for (const std::string& part : options::split(text, ',')) {
        const std::size_t dash = part.find('-');
        const std::string ends[]{part.substr(0, dash),
                                 dash == part.npos ? part : part.substr(dash + 1)};
        for (const std::string& end : ends)
            if (end.empty() || end.size() > 9 || end.find_first_not_of("0123456789") != end.npos)
                options::refuse(text, "is no list of rows, as 0-9,12");
        const auto first = options::parse_number(ends[0]), last = options::parse_number(ends[1]);
        if (*last < *first)
            options::refuse(text, "has " + part + ", which ends before it begins");
        rows.emplace_back(std::size_t(*first), std::size_t(*last));
    }
    return rows;
}

/// What `lpvbake bake` is told of a row.
struct RowBake {
    BakeOptions bake;
    options::Options table;
};

/// As --bounds takes it. Hashes of rows have it among their options.
std::string text_of(const Bounds& box) {
    const auto& [lo, hi] = box;
    return format("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g", lo.x, lo.y, lo.z, hi.x, hi.y, hi.z);
}

std::vector<std::string> words_of(const io::World& world, const io::World::Scenario& scenario,
                                  const Bounds& bounds, const std::string& file) {
    std::vector<std::string> words{
        world.scene,
        format("--cell-size=%.17g", world.cell),
        "--bounds=" + text_of(bounds),
        "--margin=1",
        format("--surroundings=%.17g", world.surroundings),
        "--output=" + file,
    };
    words.insert(words.end(), scenario.options.begin(), scenario.options.end());
    return words;
}

/// Throws Error (argument) where the scenario's options do not fit a row.
std::unique_ptr<RowBake> row_bake(const io::World& world, const io::World::Scenario& scenario,
                                  const Bounds& bounds, const std::string& file) {
    auto row = std::make_unique<RowBake>();
    add_bake_options(row->table, row->bake);
    BakeOptions& bake = row->bake;
    try {
        options::take_words("bake", words_of(world, scenario, bounds, file), row->table);
        if (bake.outputs.paths.size() != 1)
            throw Error(ErrorKind::argument, "a row has one output, which the plan names");
        for (const char* name : {"dry-run", "layers", "adaptive", "shard", "lit", "depfile",
                                 "print-config", "format", "verify", "progress"})
            if (const options::Option* option = row->table.find(name); option && option->is_set())
                throw Error(ErrorKind::argument, "--" + std::string(name) + " is not for rows");
    } catch (const Error& error) {
        throw Error(error.kind, "scenario " + scenario.name + ": " + error.what());
    }
    bake.any_resolution = false;
    bake.told = false;
    return row;
}

// ---------------------------------------------------------------- the plan

/// What a tile of a scenario takes, by how many triangles count for it, between tiles for which
/// it was planned.
class Cost {
public:
    void add(double triangles, double seconds) { known_[triangles] = seconds; }
    double operator()(double triangles) const {
        const auto above = known_.lower_bound(triangles);
        if (above == known_.end())
            return std::prev(above)->second;
        if (above == known_.begin())
            return above->second;
        const auto below = std::prev(above);
        const double share = (triangles - below->first) / (above->first - below->first);
        return std::lerp(below->second, above->second, share);
    }

private:
    std::map<double, double> known_;
};

/// A tile, and what counts for it.
struct PlannedTile {
    volume::Tile tile;
    std::vector<std::size_t> instances;
    double triangles = 0;
};

std::vector<PlannedTile> plan_tiles(const io::World& world, const Scene& scene,
                                    const scene::Around& around) {
    std::vector<Bounds> lit;
    for (std::size_t i = 0; i < scene.instances.size(); ++i) {
        const Role role = scene.instances[i].role;
        if (role == Role::full || role == Role::receive_only)
            lit.push_back(around.boxes()[i]);
    }
    std::vector<PlannedTile> tiles;
    for (const volume::Tile& tile :
         volume::tiles_around(lit.empty() ? around.boxes() : lit, world.cell, world.tile))
        tiles.push_back({tile, {}, 0});
    tbb::parallel_for(std::size_t(0), tiles.size(), [&](std::size_t i) {
        PlannedTile& planned = tiles[i];
        planned.instances = around({planned.tile.bounds(world.cell), world.surroundings});
        for (const std::size_t instance : planned.instances)
            planned.triangles +=
                double(scene.meshes[std::size_t(scene.instances[instance].mesh)].triangles.size());
    });
    return tiles;
}

/// Plans some of the tiles as a bake does, from those of the fewest triangles to those of most.
Cost cost_of(const RowBake& row, const io::World& world, const Scene& scene,
             const std::vector<PlannedTile>& tiles, const gpu::DeviceInfo& device, Volume& grids) {
    std::vector<const PlannedTile*> by_size;
    for (const PlannedTile& tile : tiles)
        by_size.push_back(&tile);
    std::ranges::stable_sort(by_size, {}, &PlannedTile::triangles);
    const readers::Reader reader = reader_of(*row.bake.outputs.target, row.bake.fit);
    Cost cost;
    constexpr std::size_t samples = 4;
    for (std::size_t i = 0; i <= samples; ++i) {
        const PlannedTile& tile = *by_size[i * (by_size.size() - 1) / samples];
        const Scene near = scene::with_instances(scene, tile.instances);
        bake::BakeSettings base = to_settings(row.bake, reader);
        base.bounds = tile.tile.bounds(world.cell);
        base.rays = bake::Rays::automatic; // of the devices that bake, not of this one
        const bake::SceneFacts facts = bake::survey(near);
        bake::Wish wish = wish_of(row.bake);
        try {
            const bake::Choice choice = bake::choose_settings(facts, base, wish, device);
            cost.add(tile.triangles, choice.plan.seconds);
            grids = bake::grids_of(choice.plan);
        } catch (const Error& error) {
            throw Error(error.kind, tile.tile.name() + ": " + error.what());
        }
    }
    return cost;
}

/// Throws Error (argument) where the options do not fit rows of files of this kind, as each row
/// would.
void check_scenario(const io::World::Scenario& scenario, const RowBake& row,
                    const std::string& kind, const io::World& world, const Scene& scene,
                    const std::vector<PlannedTile>& tiles) {
    BakeOptions o = row.bake;
    const std::string title = "scenario " + scenario.name + ": ";
    if (kind == io::tres_format.extension
        && o.outputs.storage().encoding.convention != volume::ShConvention::godot)
        throw Error(ErrorKind::argument, title + "--kind tres is for Godot; add --target godot");
    if ((o.error || o.bytes) && o.sh_order == 0)
        print_warning(title
                      + "each row chooses its order, and rows of several orders are no one "
                        "volume; add --sh-order");
    if (!o.bytes)
        return;
    const readers::Reader reader = reader_of(*o.outputs.target, o.fit);
    bake::BakeSettings base = to_settings(o, reader);
    base.bounds = std::ranges::max_element(tiles, {}, [](const PlannedTile& planned) {
                      return planned.tile.end.y - planned.tile.begin.y;
                  })->tile.bounds(world.cell);
    try {
        choose_storage(scene, base, wish_of(o), o);
    } catch (const Error& error) {
        throw Error(error.kind, title + error.what());
    }
}

void plan_scenario(const io::World::Scenario& scenario, const std::string& manifest,
                   const std::string& kind, io::World& world) {
    const std::string stem = manifest.substr(0, manifest.size() - std::string(end_of_name).size());
    const auto row = row_bake(world, scenario, {glm::dvec3(0.0), glm::dvec3(1.0)}, stem + kind);
    check_options(row->bake);
    add_suns(row->bake);
    Run run(row->bake, row->bake, {});
    const Scene scene = run.load();
    const scene::Around around(scene);
    const scene::SceneParts parts = scene::parts_of(scene);
    const std::vector<PlannedTile> tiles = plan_tiles(world, scene, around);
    if (tiles.empty())
        throw Error(ErrorKind::invalid, world.scene + ": has no surfaces to bake tiles of");
    check_scenario(scenario, *row, kind, world, scene, tiles);
    const std::vector<gpu::DeviceInfo> devices = gpu::list_devices();
    Volume grids;
    const Cost cost = cost_of(*row, world, scene, tiles,
                              devices.empty() ? gpu::DeviceInfo() : devices.front(), grids);
    options::Option& bounds = *row->table.find("bounds");
    for (const PlannedTile& planned : tiles) {
        io::World::Row& made = world.rows.emplace_back();
        made.tile = planned.tile.name();
        made.scenario = scenario.name;
        made.bounds = planned.tile.bounds(world.cell);
        made.file = stem + "_" + scenario.name + "_" + made.tile + kind;
        bounds.given.clear();
        bounds.take(text_of(made.bounds));
        made.hash = bake_hash(row->bake, row->table, scene,
                              scene::scene_hash(parts, planned.instances), {});
        made.seconds = cost(planned.triangles);
        try {
            made.bytes = io::stored_bytes(row->bake.outputs.storage(), made.file, grids,
                                          planned.tile.end - planned.tile.begin + 2);
        } catch (const Error&) { // of nodes of their own
        }
    }
    run.progress.end();
}

void plan(const PlanOptions& o) {
    if (o.output.empty() || !io::is_world(o.output))
        throw Error(ErrorKind::argument, std::string("no manifest: add -o NAME") + end_of_name
                                             + ", beside which the tiles of the world will lie");
    if (o.file == "-")
        throw Error(
            ErrorKind::argument,
            "standard input can be read but once, and rows each read the scene: give a file");
    if (!o.cell || !o.surroundings)
        throw Error(ErrorKind::argument,
                    "how large cells are, or how far around a tile surfaces count, is missing: add "
                    "--cell-size H and --surroundings R");
    io::World world{LPVBAKE_VERSION, o.file, *o.cell, o.tile, *o.surroundings, o.scenarios, {}};
    if (world.scenarios.empty())
        world.scenarios.push_back({"light", {}});
    std::set<std::string> names;
    for (const io::World::Scenario& scenario : world.scenarios) {
        if (!names.insert(scenario.name).second)
            throw Error(ErrorKind::argument, "--scenario: " + scenario.name + " is there twice");
        plan_scenario(scenario, o.output, o.kind, world);
    }
    const WriteReport::File written = io::write_world(o.output, world);
    double seconds = 0, longest = 0;
    uint64_t bytes = 0;
    for (const io::World::Row& row : world.rows) {
        seconds += row.seconds;
        longest = std::max(longest, row.seconds);
        bytes += row.bytes;
    }
    if (o.format == Format::json) {
        print_json({{"command", "world"},
                    {"version", LPVBAKE_VERSION},
                    {"scene", o.file},
                    {"manifest", written.path},
                    {"rows", world.rows.size()},
                    {"scenarios", world.scenarios.size()},
                    {"seconds", seconds},
                    {"longest", longest},
                    {"bytes", bytes}});
        return;
    }
    std::printf("rows          %zu, of %s\n", world.rows.size(),
                counted(world.scenarios.size(), "lighting").c_str());
    std::printf("time          about %s s in all, %s s of the longest row, without loading and "
                "writing\n",
                two_digits(seconds).c_str(), two_digits(longest).c_str());
    std::printf("bytes         %s of numbers\n", bytes_text(bytes).c_str());
    std::printf("wrote         %s (%s)\n", written.path.c_str(), bytes_text(written.bytes).c_str());
}

// ---------------------------------------------------------------- rows, and whether they are
// there

/// A row's volume, or why the row has to be baked.
struct RowFile {
    std::optional<Volume> volume;
    std::string fault; ///< empty: none
};

RowFile read_row(const io::World::Row& row) {
    try {
        volume::VolumeSet set = read_levels(row.file);
        Volume& volume = set.levels.front();
        const auto hash = volume.metadata.find("bake_hash");
        if (hash == volume.metadata.end() || hash->second != row.hash)
            return {{}, "is of another scene, other options or another version"};
        return {std::move(volume), {}};
    } catch (const Error& error) {
        if (!io::is_there(row.file))
            return {{}, "is missing"};
        std::string why = error.what();
        if (why.starts_with(row.file + ": "))
            why.erase(0, row.file.size() + 2);
        return {{}, why.starts_with("is damaged") ? why : "is damaged: " + why};
    }
}

std::string fault_of(const io::World::Row& row) {
    return read_row(row).fault;
}

std::vector<std::size_t> rows_of(const PlanOptions& o, const io::World& world) {
    std::vector<std::size_t> rows;
    for (const auto& [first, last] : o.rows) {
        if (first >= world.rows.size())
            throw Error(ErrorKind::argument, format("--rows: there is no row %zu; %s has 0 to %zu",
                                                    first, o.file.c_str(), world.rows.size() - 1));
        // The last of equal parts may go beyond the end.
        for (std::size_t row = first; row <= std::min(last, world.rows.size() - 1); ++row)
            if (std::ranges::count(rows, row) == 0)
                rows.push_back(row);
    }
    return rows;
}

std::string title_of(const io::World& world, std::size_t i) {
    const io::World::Row& row = world.rows[i];
    return format("row %zu (%s, %s)", i, row.scenario.c_str(), row.tile.c_str());
}

/// The scene of rows that come one after the other in a lighting.
class RowScene {
public:
    /// Loaded for rows[i] and those after it; null for the last of them, which loads its own.
    const SharedScene* of(const io::World& world, const std::vector<std::size_t>& rows,
                          std::size_t i, const BakeOptions& bake) {
        const std::string& scenario = world.rows[rows[i]].scenario;
        if (scene_ && scenario == scenario_)
            return &*scene_;
        scene_.reset();
        std::vector<scene::Surroundings> boxes;
        for (; i < rows.size() && world.rows[rows[i]].scenario == scenario; ++i)
            boxes.push_back({world.rows[rows[i]].bounds, world.surroundings});
        if (boxes.size() == 1)
            return nullptr;
        scenario_ = scenario;
        return &scene_.emplace(load_shared(bake, boxes));
    }

private:
    std::string scenario_;
    std::optional<SharedScene> scene_;
};

void bake_rows(const PlanOptions& o, const io::World& world) {
    report::Json list = report::Json::array();
    const std::vector<std::size_t> rows = rows_of(o, world);
    RowScene scenes;
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const std::size_t i = rows[k];
        const io::World::Row& row = world.rows[i];
        const auto begin = std::chrono::steady_clock::now();
        const bool made = !fault_of(row).empty();
        if (made) {
            const auto bake = row_bake(world, world.scenario_of(row), row.bounds, row.file);
            try {
                run_bake(bake->bake, bake->table, scenes.of(world, rows, k, bake->bake));
            } catch (const Error& error) {
                throw Error(error.kind, title_of(world, i) + ": " + error.what());
            }
            if (const std::string fault = fault_of(row); !fault.empty())
                throw Error(ErrorKind::invalid, title_of(world, i) + ": " + row.file + " " + fault
                                                    + " than the plan: plan the world again");
        }
        if (o.format == Format::json)
            list.push_back({{"row", i},
                            {"file", row.file},
                            {"made", made},
                            {"seconds", seconds_since(begin)}});
        else
            std::printf("%-13s %s, %.2f s\n", made ? "baked" : "unchanged",
                        (title_of(world, i) + ": " + row.file).c_str(), seconds_since(begin));
        finish_stdout();
    }
    if (o.format == Format::json)
        print_json({{"command", "world"}, {"version", LPVBAKE_VERSION}, {"rows", list}});
}

/// Rows of tiles that touch, a pair each.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(const io::World& world) {
    std::map<std::tuple<std::string, int64_t, int64_t>, std::vector<std::size_t>> columns;
    const double edge = world.cell * world.tile;
    const auto place = [&](const io::World::Row& row, int dx, int dz) {
        return std::tuple(row.scenario, int64_t(std::llround(row.bounds.lo.x / edge)) + dx,
                          int64_t(std::llround(row.bounds.lo.z / edge)) + dz);
    };
    for (std::size_t i = 0; i < world.rows.size(); ++i)
        columns[place(world.rows[i], 0, 0)].push_back(i);
    std::vector<std::pair<std::size_t, std::size_t>> pairs;
    for (std::size_t i = 0; i < world.rows.size(); ++i)
        for (const auto& [dx, dz] : {std::pair(0, 0), {1, 0}, {0, 1}})
            for (const std::size_t j : columns[place(world.rows[i], dx, dz)]) {
                const Bounds &a = world.rows[i].bounds, &b = world.rows[j].bounds;
                if (i != j && (dx + dz > 0 || a.lo.y < b.lo.y) && a.lo.y <= b.hi.y
                    && b.lo.y <= a.hi.y)
                    pairs.emplace_back(i, j);
            }
    return pairs;
}

/// Light and validity of the cells of a volume that a box of the lattice's cells has, and a layer
/// around.
Volume part_of(const Volume& volume, const Bounds& box) {
    const glm::dvec3 half(0.5 * volume.grid.cell);
    const auto cell_at = [&](glm::dvec3 corner) {
        return glm::clamp(glm::ivec3(glm::floor(volume.grid.to_grid(corner))), glm::ivec3(0),
                          volume.grid.dims - 1);
    };
    const glm::ivec3 begin = cell_at(box.lo - half), last = cell_at(box.hi + half);
    Volume part;
    part.grid = volume.grid;
    part.grid.origin = volume.grid.to_world(begin);
    part.grid.dims = last - begin + 1;
    part.sh_order = volume.sh_order;
    part.sh.assign(volume.sh.size(), std::vector<glm::vec3>(part.grid.size()));
    part.validity.resize(volume.validity.empty() ? 0 : part.grid.size());
    for (std::size_t i = 0; i < part.grid.size(); ++i) {
        const std::size_t from = volume.grid.index(begin + part.grid.cell_at(i));
        for (std::size_t k = 0; k < part.sh.size(); ++k)
            part.sh[k][i] = volume.sh[k][from];
        if (!part.validity.empty())
            part.validity[i] = volume.validity[from];
    }
    return part;
}

/// What is wrong with rows, and what neighbours differ by.
struct Checked {
    std::map<std::size_t, std::string> faults;
    report::Seam all, worst;
    std::pair<std::size_t, std::size_t> worst_pair;
};

/// Reads each file once. Of a row that is kept what a later neighbour has too, until that is read:
/// as rows come by z, y and x, of about a layer of tiles.
Checked check_rows(const io::World& world) {
    Checked checked;
    const std::vector<std::pair<std::size_t, std::size_t>> pairs = neighbours(world);
    std::vector<std::vector<std::size_t>> first_of(world.rows.size()), second_of(world.rows.size());
    for (std::size_t pair = 0; pair < pairs.size(); ++pair) {
        first_of[std::min(pairs[pair].first, pairs[pair].second)].push_back(pair);
        second_of[std::max(pairs[pair].first, pairs[pair].second)].push_back(pair);
    }
    std::map<std::size_t, Volume> kept; // of pairs
    std::vector<report::Seam> seams(pairs.size());
    const std::size_t at_once = std::size_t(tbb::this_task_arena::max_concurrency());
    for (std::size_t begin = 0; begin < world.rows.size(); begin += at_once) {
        std::vector<RowFile> files(std::min(at_once, world.rows.size() - begin));
        tbb::parallel_for(std::size_t(0), files.size(),
                          [&](std::size_t i) { files[i] = read_row(world.rows[begin + i]); });
        for (std::size_t i = 0; i < files.size(); ++i) {
            const std::optional<Volume>& own = files[i].volume;
            const std::size_t row = begin + i;
            if (!own)
                checked.faults[row] = files[i].fault;
            for (const std::size_t pair : second_of[row])
                if (const auto other = kept.find(pair); other != kept.end()) {
                    if (own)
                        seams[pair] = pairs[pair].first == row
                                          ? report::seam_between(*own, other->second)
                                          : report::seam_between(other->second, *own);
                    kept.erase(other);
                }
            if (own)
                for (const std::size_t pair : first_of[row])
                    kept.emplace(
                        pair,
                        part_of(
                            *own,
                            world.rows[std::max(pairs[pair].first, pairs[pair].second)].bounds));
        }
    }
    for (std::size_t pair = 0; pair < pairs.size(); ++pair) {
        checked.all += seams[pair];
        if (seams[pair].share() > checked.worst.share()) {
            checked.worst = seams[pair];
            checked.worst_pair = pairs[pair];
        }
    }
    return checked;
}

void check(const PlanOptions& o, const io::World& world) {
    const Checked checked = check_rows(world);
    const auto& [faults, all, worst, worst_pair] = checked;
    if (o.format == Format::json) {
        report::Json wrong = report::Json::array();
        for (const auto& [i, fault] : faults)
            wrong.push_back({{"row", i}, {"file", world.rows[i].file}, {"why", fault}});
        report::Json document{{"command", "world"},
                              {"version", LPVBAKE_VERSION},
                              {"rows", world.rows.size()},
                              {"faults", wrong},
                              {"seams", {{"cells", all.cells}, {"mean", all.share()}}}};
        if (worst.cells > 0)
            document["seams"]["worst"] = {{"share", worst.share()},
                                          {"rows", {worst_pair.first, worst_pair.second}}};
        print_json(document);
    } else {
        for (const auto& [i, fault] : faults)
            std::printf("fault         %s: %s %s\n", title_of(world, i).c_str(),
                        world.rows[i].file.c_str(), fault.c_str());
        std::printf("rows          %zu of %zu are there\n", world.rows.size() - faults.size(),
                    world.rows.size());
        if (all.cells > 0)
            std::printf(
                "seams         %s %% in the mean of %llu shared cells, at most %s %%, of rows "
                "%zu and %zu\n",
                two_digits(100 * all.share()).c_str(), (unsigned long long)all.cells,
                two_digits(100 * worst.share()).c_str(), worst_pair.first, worst_pair.second);
    }
    finish_stdout();
    if (!faults.empty()) {
        const auto& [i, fault] = *faults.begin();
        throw Error(ErrorKind::invalid,
                    title_of(world, i) + ": " + world.rows[i].file + " " + fault
                        + (faults.size() > 1 ? format(", and %zu more", faults.size() - 1) : "")
                        + format("; bake it with --rows %zu", i)
                        + (fault.starts_with("is of another")
                               ? ", or plan the world again where the scene was edited"
                               : ""));
    }
}

void run(const PlanOptions& o) {
    if (!io::is_world(o.file)) {
        if (!o.rows.empty() || o.check)
            throw Error(ErrorKind::argument,
                        "--rows and --check are of a manifest, NAME" + std::string(end_of_name));
        plan(o);
        return;
    }
    if (!o.output.empty() || o.cell || o.surroundings || !o.scenarios.empty())
        throw Error(ErrorKind::argument,
                    o.file + ": is planned; plan the scene again, or give --rows or --check");
    if (o.rows.empty() && !o.check)
        throw Error(ErrorKind::argument, o.file + ": is planned; add --rows 0-9 or --check");
    const io::World world = io::read_world(o.file);
    if (world.program != LPVBAKE_VERSION)
        throw Error(ErrorKind::invalid, o.file + ": is planned by lpvbake "
                                            + printable(world.program) + ", and this is "
                                            + LPVBAKE_VERSION + "; plan the world again");
    if (!o.rows.empty())
        bake_rows(o, world);
    if (o.check)
        check(o, world);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<PlanOptions>();
    PlanOptions& o = *fields;
    options
        .text("file", o.file, "SCENE|WORLD",
              "Scene to plan, a .gltf or .glb, or a plan, NAME.world.json")
        .require();
    options
        .text("-o,--output", o.output, "NAME.world.json",
              "Plan to write; the tiles will lie beside it")
        .keep_to_one_run();
    options.number("--cell-size", o.cell, 1e-6, 1e6, "Edge of the cells, metres; a plan needs it");
    options.number("--tile", o.tile, 8, 1024, "Cells along an edge of a tile, 8 to 1024");
    options.number("--surroundings", o.surroundings, 0, 1e9,
                   "How far around a tile surfaces count, metres, as for bake; a plan needs it");
    options.values(
        "--scenario", o.scenarios, "NAME:OPTIONS", parse_scenario,
        "A lighting: options of lpvbake bake, in one word of the shell; may be repeated");
    options::Choices<std::string> kinds;
    for (const io::VolumeFormat* each : io::volume_formats())
        if (each != &io::glb_format)
            kinds.emplace_back(std::string(each->extension).substr(1), each->extension);
    options.choice("--kind", o.kind, kinds, "Kind of the tiles' files");
    options
        .value("--rows", o.rows, "LIST", parse_rows,
               "Bake rows of a plan, counted from 0, as 0-9,12, of a range those that there are; "
               "rows that are up to date are left as they are")
        .exclude({"check"});
    options.flag("--check", o.check,
                 "Name rows that are missing, damaged or of something else, and measure what "
                 "neighbours differ by in the cells that they share");
    add_format_option(options, o.format);
    return [fields] { run(*fields); };
}

} // namespace

options::Command world_command() {
    return {"world", "Plans a large scene as tiles and lightings, and bakes rows of the plan.",
            manual, declare};
}

} // namespace lpvbake::cmd
