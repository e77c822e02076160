// The manifest of a world that is baked in rows: a tile in one of the lightings each.
//
//     {"format": "lpvbake world", "version": 1, "program": version,
//      "scene": path, as it was given, "cell": metres, "tile": cells along an edge,
//      "surroundings": metres,
//      "scenarios": [{"name", "options": [words of lpvbake bake]}, ...],
//      "rows": [{"tile": "x0_y0_z0", "scenario": name,
//                "bounds": [x0, y0, z0, x1, y1, z1], metres,
//                "file": of the volume, beside the manifest,
//                "hash": metadata `bake_hash` of that, which tells whether it is up to date,
//                "seconds", "bytes": what is expected}, ...]}
#pragma once

#include "lpvbake/file.h"
#include "lpvbake/scene.h"

#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake::io {

/// By the end of its name, .world.json.
bool is_world(const std::string& path);
inline constexpr const char* end_of_world = ".world.json";

struct World {
    struct Scenario {
        std::string name;
        std::vector<std::string> options;
    };
    struct Row {
        std::string tile, scenario;
        Bounds bounds;
        std::string file; ///< path
        std::string hash;
        double seconds = 0;
        uint64_t bytes = 0;
    };
    std::string program, scene;
    double cell = 0;
    int tile = 0;
    double surroundings = 0;
    std::vector<Scenario> scenarios;
    std::vector<Row> rows;

    /// Of a row. There is one.
    const Scenario& scenario_of(const Row& row) const;
};

/// Throws Error (file, io).
WriteReport::File write_world(const std::string& path, const World& world);

/// Throws Error: file (it is not there), invalid (what it says is wrong).
World read_world(const std::string& path);

} // namespace lpvbake::io
