// A world's plan where a volume belongs: the tiles of one of its lightings.
#pragma once

#include "io/world_volume.h"
#include "options/option.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::cmd {

struct WorldOptions {
    std::string scenario;                    ///< empty: the only one
    uint64_t max_memory = uint64_t{4} << 30; ///< bytes of cells
};
void add_scenario_option(options::Options& options, WorldOptions& o);
/// --max-memory, of commands that load no scene.
void add_cells_option(options::Options& options, WorldOptions& o);

/// Throws Error (argument) where a scenario is named, but none of the files is a plan.
void check_scenario(const WorldOptions& o, const std::vector<std::string>& files);

/// Throws Error as io::read_world and io::world_volume.
io::WorldVolume open_world(const std::string& path, const WorldOptions& o);
/// All of it. Throws Error as io::read_cells.
Volume read_world(const std::string& path, const WorldOptions& o);

/// Order and metadata of all, by the first tile that is there, without cells. Throws Error: file
/// (none is there), and as read_volume.
Volume header_of(const io::WorldVolume& world);

/// The plan, and the files of its tiles.
std::vector<std::string> files_of(const io::WorldVolume& world);

} // namespace lpvbake::cmd
