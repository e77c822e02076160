#include "io/world.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/io.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"
#include "volume/tiles.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* format_name = "lpvbake world";
constexpr int version = 1;
constexpr uint64_t most_bytes = uint64_t(1) << 30;

template <class T>
T value_in(const std::string& path, const Json& json, const char* name) {
    const auto found = json.is_object() ? json.find(name) : json.end();
    bool fits = json.is_object() && found != json.end();
    if constexpr (std::is_same_v<T, std::string>)
        fits = fits && found->is_string() && !found->template get_ref<const std::string&>().empty();
    else if constexpr (std::is_same_v<T, Json>)
        fits = fits && found->is_array();
    else
        fits = fits && found->is_number() && std::isfinite(found->template get<double>())
               && found->template get<double>() >= 0;
    if (!fits)
        reject(path, std::string("has a place without a right \"") + name + "\"; plan it again");
    return found->template get<T>();
}

World::Row row_in(const std::string& path, const Json& json) {
    World::Row row{value_in<std::string>(path, json, "tile"),
                   value_in<std::string>(path, json, "scenario"),
                   {},
                   value_in<std::string>(path, json, "file"),
                   value_in<std::string>(path, json, "hash"),
                   value_in<double>(path, json, "seconds"),
                   value_in<uint64_t>(path, json, "bytes")};
    if (row.file.find('/') != std::string::npos || !readable_format(row.file))
        reject(path, "lists " + printable(row.file) + ", which is no volume file beside it");
    row.file = (fs::path(path).parent_path() / row.file).string();
    const Json bounds = value_in<Json>(path, json, "bounds");
    for (std::size_t i = 0; i < 6; ++i) {
        if (bounds.size() != 6 || !bounds[i].is_number() || !std::isfinite(bounds[i].get<double>()))
            reject(path, "has a row whose \"bounds\" are not six numbers; plan it again");
        (i < 3 ? row.bounds.lo : row.bounds.hi)[int(i % 3)] = bounds[i].get<double>();
    }
    return row;
}

} // namespace

bool is_world(const std::string& path) {
    return path.ends_with(end_of_world);
}

const World::Scenario& World::scenario_of(const Row& row) const {
    return *std::ranges::find(scenarios, row.scenario, &Scenario::name);
}

WriteReport::File write_world(const std::string& path, const World& world) {
    Json scenarios = Json::array(), rows = Json::array();
    for (const World::Scenario& scenario : world.scenarios)
        scenarios.push_back({{"name", scenario.name}, {"options", scenario.options}});
    for (const World::Row& row : world.rows) {
        const auto& [lo, hi] = row.bounds;
        rows.push_back({{"tile", row.tile},
                        {"scenario", row.scenario},
                        {"bounds", {lo.x, lo.y, lo.z, hi.x, hi.y, hi.z}},
                        {"file", fs::path(row.file).filename().string()},
                        {"hash", row.hash},
                        {"seconds", row.seconds},
                        {"bytes", row.bytes}});
    }
    const Json manifest{{"format", format_name},
                        {"version", version},
                        {"program", world.program},
                        {"scene", world.scene},
                        {"cell", world.cell},
                        {"tile", world.tile},
                        {"surroundings", world.surroundings},
                        {"scenarios", scenarios},
                        {"rows", rows}};
    AtomicFile to(path);
    to.write(text_of(manifest));
    const uint64_t bytes = to.seal();
    to.publish();
    return {path, bytes};
}

World read_world(const std::string& path) {
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    if (!json.is_object() || json.value("format", Json()) != format_name)
        reject(path, "is no manifest of a world, or damaged; plan it again");
    if (json.value("version", Json()) != version)
        reject(path, "has another \"version\" than " + std::to_string(version)
                         + ", which is all that this lpvbake reads");
    World world{value_in<std::string>(path, json, "program"),
                value_in<std::string>(path, json, "scene"),
                value_in<double>(path, json, "cell"),
                value_in<int>(path, json, "tile"),
                value_in<double>(path, json, "surroundings"),
                {},
                {}};
    for (const Json& each : value_in<Json>(path, json, "scenarios")) {
        World::Scenario& scenario = world.scenarios.emplace_back();
        scenario.name = value_in<std::string>(path, each, "name");
        for (const Json& word : value_in<Json>(path, each, "options")) {
            if (!word.is_string())
                reject(path, "has \"options\" that are no words; plan it again");
            scenario.options.push_back(word);
        }
    }
    const Json rows = value_in<Json>(path, json, "rows");
    if (rows.size() > 64 * volume::most_tiles)
        reject(path, "lists too many rows");
    std::set<std::string> files, names;
    for (const World::Scenario& scenario : world.scenarios)
        if (!names.insert(scenario.name).second)
            reject(path, "has two scenarios " + printable(scenario.name) + "; plan it again");
    for (const Json& each : rows) {
        world.rows.push_back(row_in(path, each));
        if (!names.contains(world.rows.back().scenario))
            reject(path, "has a row of no scenario; plan it again");
        if (!files.insert(world.rows.back().file).second)
            reject(path, "lists " + printable(fs::path(world.rows.back().file).filename().string())
                             + " twice; plan it again");
    }
    return world;
}

} // namespace lpvbake::io
