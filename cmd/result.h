// Parts of what commands print when they are done.
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/volume.h"
#include "report/json.h"
#include "solver/stages.h"

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// The process's largest resident memory so far, bytes.
uint64_t peak_memory();

double seconds_since(std::chrono::steady_clock::time_point begin);

/// A size for people, such as "1.5 MiB".
std::string bytes_text(uint64_t bytes);

/// ", turned by 30 degrees about (0, 1, 0)"; nothing of most.
std::string turn_text(const Grid& grid);
void print_grid(const Grid& grid);

/// Index, name, type, uuid, driver and api.
report::Json device_json(const gpu::DeviceInfo& device);

/// Details are left out where there are none.
report::Json stages_json(const std::vector<StageReport>& stages);
void print_stages(const std::vector<StageReport>& stages);

/// The line below the stages.
void print_total(double seconds);

/// Adds what metadata tell of a fit, as "fit"; nothing where there is none.
void add_fit(const Volume& volume, report::Json& document);

/// To standard output, once.
void print_json(const report::Json& document);
bool is_json_printed();
void print_text(const std::string& text);

} // namespace lpvbake::cmd
