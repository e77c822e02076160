#include "world_volume.h"

#include "lpvbake/error.h"
#include "read_light.h"

#include <algorithm>

namespace lpvbake::cmd {

void add_scenario_option(options::Options& options, WorldOptions& o) {
    options.text("--scenario", o.scenario, "NAME",
                 "Of a .world.json the lighting that is read; of one alone it need not be said");
}

void add_cells_option(options::Options& options, WorldOptions& o) {
    options.value("--max-memory", o.max_memory, "SIZE", options::parse_bytes,
                  "Memory that the cells of a .world.json may take as one volume", "4G");
}

void check_scenario(const WorldOptions& o, const std::vector<std::string>& files) {
    if (!o.scenario.empty() && std::ranges::none_of(files, io::is_world))
        throw Error(ErrorKind::argument, "--scenario: " + files.front()
                                             + " is no plan of a world, NAME" + io::end_of_world);
}

io::WorldVolume open_world(const std::string& path, const WorldOptions& o) {
    return io::world_volume(path, io::read_world(path), o.scenario);
}

Volume read_world(const std::string& path, const WorldOptions& o) {
    const io::WorldVolume world = open_world(path, o);
    return io::read_cells(world, glm::ivec3(0), world.grid.dims, o.max_memory);
}

Volume header_of(const io::WorldVolume& world) {
    const auto tile = std::ranges::find_if(
        world.tiles, [](const io::WorldVolume::Tile& each) { return io::is_there(each.file); });
    const io::WorldVolume::Tile& first = tile == world.tiles.end() ? world.tiles.front() : *tile;
    io::require(world, first);
    const Volume own = read_light(first.file);
    io::check_tile(world, first, own);
    io::CommonFacts facts;
    facts.add(world, first, own);
    Volume header = facts.header(world);
    header.grid = world.grid;
    return header;
}

std::vector<std::string> files_of(const io::WorldVolume& world) {
    std::vector<std::string> files{world.path};
    for (const io::WorldVolume::Tile& tile : world.tiles)
        files.push_back(tile.file);
    return files;
}

} // namespace lpvbake::cmd
