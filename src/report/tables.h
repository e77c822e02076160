// A report as a table for people, and as CSV and JSON.
#pragma once

#include "report/report.h"
#include "report/search.h"

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

/// A scene that was searched.
struct SearchedScene {
    std::string path;
    uint64_t triangles = 0;
    Search search;
    SearchResult result;
};
/// "about 35 to 120 s in all: 30 s for the reference, the rest for one to 6 of 16 settings".
std::string expected_text(const Search& search);
/// The candidates with what is expected of them.
std::string search_plan_text(const SearchedScene& scene);
/// What was tried, and where it kept the goal, the command alone in the last line.
std::string search_text(const SearchedScene& scene);
/// One line, where nothing kept the goal: that, and what came nearest.
std::string nearest_text(const SearchedScene& scene);
/// Null where nothing is known.
nlohmann::ordered_json measured_json(const MeasuredError& error);
/// Parts of what `lpvbake report --help` documents for a search, and for its dry run.
nlohmann::ordered_json goal_json(const Goal& goal);
nlohmann::ordered_json search_plan_json(const SearchedScene& scene);
nlohmann::ordered_json search_json(const SearchedScene& scene);

/// "12.3 %", with three digits.
std::string percent(double share);

/// "0.0123", seconds with three digits.
std::string seconds_text(double seconds);

/// Two digits, or those before the point: "2.1", "350".
std::string rough(double number);

/// "32 x 32 x 32".
std::string dims_text(const Grid& grid);

} // namespace lpvbake::report
