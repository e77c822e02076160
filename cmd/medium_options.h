// Air, as bake and render are told of it.
#pragma once

#include "medium/medium.h"
#include "options/option.h"

#include <nlohmann/json_fwd.hpp>

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::cmd {

struct MediumOptions {
    std::optional<medium::Medium> medium; ///< without density and box
    std::string density;                  ///< FILE.vdb or FILE.vdb:GRID; empty: none
    std::optional<Bounds> bounds;
};

/// The group Air: --medium, --medium-density and --medium-bounds.
void add_medium_options(options::Options& options, MediumOptions& o, const std::string& help);

/// The file of the density; empty where there is none.
std::string density_file(const MediumOptions& o);

/// The medium in its box: that which is given, that of the density, or the scene's. None where none
/// is asked for. Throws Error as io::read_density and medium::check_medium do.
std::optional<medium::Medium> medium_of(const MediumOptions& o, const Scene& scene,
                                        std::vector<std::string>& warnings);

/// As JSON has it: "scatter" and "absorb" (RGB, a metre), "g", "height" ([H0, H] or null) and
/// "density" (its file, or null).
nlohmann::ordered_json medium_json(const medium::Medium& air, const std::string& density);

} // namespace lpvbake::cmd
