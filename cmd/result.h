// Parts of what commands print when they are done.
#pragma once

#include "volume/grid.h"

#include <nlohmann/json.hpp>

#include <chrono>
#include <cstdint>
#include <string>

namespace lpvbake {

using Json = nlohmann::ordered_json;

/// The process's largest resident memory so far, bytes.
uint64_t peak_memory();

double seconds_since(std::chrono::steady_clock::time_point begin);

/// A size for people, such as "1.5 MiB".
std::string bytes_text(uint64_t bytes);

/// dims, cell, origin and the number of cells.
Json grid_json(const Grid& grid);

void print_grid(const Grid& grid);

void print_json(const Json& document);

} // namespace lpvbake
