// A report as a table for people, and as CSV and JSON.
#pragma once

#include "report/report.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>

namespace lpvbake::report {

/// The readers whose error a table for people has: Unreal and Godot read as Unity does.
inline constexpr const char* told_readers[] = {"unity", "threejs", "vrc", "bevy"};
/// RowResult::shown of one, as a percentage; "-" without.
std::string shown_text(const RowResult& row, std::string_view reader);

/// Columns for a terminal, scene by scene: grids with their floors, bakes, peers, and what follows.
std::string report_text(const Report& report);

/// One line a bake, a peer and a floor, with a header (RFC 4180, but lines end in \n). Numbers as
/// %.9g, infinite ones as inf; what a line does not have is empty.
std::string report_csv(const Report& report);

/// What `lpvbake report --help` documents; infinite numbers are null.
nlohmann::ordered_json report_json(const Report& report);

/// "12.3 %", with three digits.
std::string percent(double share);

/// "0.0123", seconds with three digits.
std::string seconds_text(double seconds);

/// "32 x 32 x 32".
std::string dims_text(const Grid& grid);

} // namespace lpvbake::report
