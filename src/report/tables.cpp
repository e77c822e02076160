#include "report/tables.h"

#include "io/target.h"
#include "readers/readers.h"
#include "report/json.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace lpvbake::report {
namespace {

// ---------------------------------------------------------------- text

/// Columns as wide as their longest cell; the first is flush left.
std::string aligned(const std::vector<std::vector<std::string>>& lines, std::size_t left) {
    std::vector<std::size_t> widths;
    for (const auto& line : lines) {
        widths.resize(std::max(widths.size(), line.size()));
        for (std::size_t c = 0; c < line.size(); ++c)
            widths[c] = std::max(widths[c], line[c].size());
    }
    std::string text;
    for (const auto& line : lines) {
        std::string row;
        for (std::size_t c = 0; c < line.size(); ++c) {
            const std::string pad(widths[c] - line[c].size(), ' ');
            const bool flush_left = c < left || c + 1 == widths.size();
            row += (c ? "  " : "") + (flush_left ? line[c] + pad : pad + line[c]);
        }
        row.erase(row.find_last_not_of(' ') + 1);
        text += row + '\n';
    }
    return text;
}

std::string spread(const Timing& t) {
    return format("%.0f %%", t.median > 0 ? 50 * (t.max - t.min) / t.median : 0.0);
}

// ---------------------------------------------------------------- CSV

std::string csv_field(const std::string& text) {
    if (text.find_first_of(",\"\n\r") == std::string::npos)
        return text;
    std::string quoted = "\"";
    for (const char c : text)
        quoted += c == '"' ? "\"\"" : std::string(1, c);
    return quoted += '"';
}

std::string number(double value) {
    return format("%.9g", value);
}

/// The fields of one line, by name; what is not set is empty.
class Line {
public:
    explicit Line(const std::vector<std::string>& columns)
        : columns_(columns),
          fields_(columns.size()) {}
    void set(const std::string& column, const std::string& field) {
        const auto found = std::ranges::find(columns_, column);
        fields_[std::size_t(found - columns_.begin())] = field;
    }
    void set(const std::string& column, double value) { set(column, number(value)); }
    void set(const char* prefix, const FieldError& error) {
        set(prefix + std::string("_l1"), error.relative_l1);
        set(prefix + std::string("_rms"), error.relative_rms);
        set(prefix + std::string("_energy_ratio"), error.energy_ratio);
    }
    std::string text() const {
        std::string line;
        for (std::size_t i = 0; i < fields_.size(); ++i)
            line.append(i ? "," : "").append(csv_field(fields_[i]));
        return line + '\n';
    }

private:
    const std::vector<std::string>& columns_;
    std::vector<std::string> fields_;
};

std::vector<std::string> csv_columns(const Report& report) {
    std::vector<std::string> columns = {
        "scene",       "kind",   "name",     "cells_x", "cells_y", "cells_z",     "cell_m",
        "valid_cells", "probes", "sh_order", "rays",    "seconds", "seconds_min", "seconds_max"};
    for (const char* error : {"true", "projected", "surface"})
        for (const char* measure : {"_l1", "_rms", "_energy_ratio"})
            columns.push_back(error + std::string(measure));
    for (const readers::Reader& reader : readers::all_readers())
        if (io::target_named(reader.name))
            for (const char* measure : {"_l1", "_rms", "_energy_ratio"})
                columns.push_back(std::string(reader.name) + measure);
    for (const char* name :
         {"negative", "reference_noise", "front", "peer", "peer_factor", "sharing",
          "sharing_factor", "rays_per_second", "embree_rays_per_second"})
        columns.push_back(name);
    std::vector<std::string> stages;
    for (const SceneReport& scene : report.scenes)
        for (const RowResult& row : scene.rows)
            for (const StageTiming& stage : row.stages)
                if (std::ranges::find(stages, stage.name) == stages.end())
                    stages.push_back(stage.name);
    for (const std::string& stage : stages)
        columns.push_back("stage_" + stage);
    columns.push_back("command");
    return columns;
}

const char* kind_name(EqualError::Kind kind) {
    return kind == EqualError::Kind::crosses  ? "crosses"
           : kind == EqualError::Kind::beyond ? "beyond"
                                              : "already";
}

// ---------------------------------------------------------------- JSON

Json finite(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json to_json(const FieldError& error) {
    return {{"relative_l1", finite(error.relative_l1)},
            {"relative_rms", finite(error.relative_rms)},
            {"energy_ratio", finite(error.energy_ratio)},
            {"negative", error.negative}};
}

Json to_json(const std::optional<FieldError>& error) {
    return error ? to_json(*error) : Json(nullptr);
}

Json to_json(const Timing& t) {
    return {{"median", t.median}, {"min", t.min}, {"max", t.max}};
}

Json to_json(const PeerPoint& point) {
    Json json{{"rays", point.rays},
              {"seconds", to_json(point.seconds)},
              {"measured_seconds", point.measured},
              {"rays_per_second", point.rays_per_second},
              {"embree_rays_per_second", point.embree_rays_per_second > 0
                                             ? Json(point.embree_rays_per_second)
                                             : Json(nullptr)},
              {"orders", Json::array()}};
    for (std::size_t i = 0; i < floor_orders.size(); ++i)
        json["orders"].push_back({{"sh_order", floor_orders[i]},
                                  {"error", to_json(point.error[i])},
                                  {"projected", to_json(point.projected[i])}});
    return json;
}

Json to_json(const std::optional<EqualError>& equal) {
    return equal ? Json{{"relation", kind_name(equal->kind)}, {"factor", finite(equal->factor)}}
                 : Json(nullptr);
}

/// A grid, and what is true on it.
Json to_json(const Grid& grid, uint64_t valid, uint64_t probes, const Json& reference,
             const std::array<FieldError, 3>& floor) {
    Json json{
        {"dims", vector_json(grid.dims)}, {"cell", grid.cell}, {"origin", vector_json(grid.origin)},
        {"valid_cells", valid},           {"probes", probes},  {"reference", reference},
        {"floors", Json::array()}};
    for (std::size_t i = 0; i < floor_orders.size(); ++i) {
        json["floors"].push_back({{"sh_order", floor_orders[i]}});
        json["floors"].back().update(to_json(floor[i]));
    }
    return json;
}

Json to_json(const GridResult& grid) {
    Json json = to_json(grid.grid, grid.valid, grid.probes,
                        {{"noise", grid.noise},
                         {"rays", grid.rays},
                         {"converged", grid.converged},
                         {"seconds", grid.seconds}},
                        grid.floor);
    json["peer"] = Json::array();
    json["peer_sharing_bounces"] = Json::array();
    for (const PeerPoint& point : grid.peer)
        json["peer"].push_back(to_json(point));
    for (const PeerPoint& point : grid.sharing)
        json["peer_sharing_bounces"].push_back(to_json(point));
    return json;
}

Json to_json(const RowResult& row) {
    Json json{{"name", row_name(row.row)},
              {"options", Json::object()},
              {"command", row.command},
              {"grid", row.grid},
              {"sh_order", row.sh_order},
              {"seconds", to_json(row.seconds)},
              {"stages", Json::array()},
              {"error", to_json(row.error)},
              {"projected", to_json(row.projected)},
              {"surface", to_json(row.surface)},
              {"readers", Json::object()},
              {"front", row.front},
              {"peer", to_json(row.peer)},
              {"peer_sharing_bounces", to_json(row.sharing)},
              {"warnings", row.warnings}};
    for (const ReaderError& shown : row.shown)
        json["readers"][shown.reader] = to_json(shown.error);
    for (const auto& [option, value] : row.row.options)
        json["options"][option] = value;
    for (const StageTiming& stage : row.stages)
        json["stages"].push_back(
            {{"name", stage.name}, {"seconds", to_json(stage.seconds)}, {"detail", stage.detail}});
    return json;
}

} // namespace

std::string percent(double share) {
    return std::isfinite(share) ? format("%.3g %%", 100 * share) : "inf";
}

std::string seconds_text(double seconds) {
    return format(seconds < 1e-3 ? "%.2e" : "%.3g", seconds);
}

std::string dims_text(const Grid& grid) {
    return format("%d x %d x %d", grid.dims.x, grid.dims.y, grid.dims.z);
}

std::string shown_text(const RowResult& row, std::string_view reader) {
    const auto found = std::ranges::find(row.shown, reader, &ReaderError::reader);
    return found != row.shown.end() ? percent(found->error.relative_l1) : "-";
}

std::string report_text(const Report& report) {
    std::string text =
        "device        " + report.device + '\n' + format("threads       %u\n", report.threads);
    for (const SceneReport& scene : report.scenes) {
        text += "scene         " + scene.path + '\n';
        for (const GridResult& grid : scene.grids)
            text += format("grid          %s cells of %.4g m, %llu of %llu valid ones measured, "
                           "noise of the reference %s after %llu rays\n",
                           dims_text(grid.grid).c_str(), grid.grid.cell,
                           static_cast<unsigned long long>(grid.probes),
                           static_cast<unsigned long long>(grid.valid), percent(grid.noise).c_str(),
                           static_cast<unsigned long long>(grid.rays));
        text += format("surfaces      %s, noise of the reference %s after %llu rays\n\n",
                       counted(scene.surface_points, "point").c_str(),
                       percent(scene.surface_noise).c_str(),
                       static_cast<unsigned long long>(scene.surface_rays));

        std::vector<std::vector<std::string>> lines = {
            {"bake", "seconds", "+-", "error", "same SH", "energy", "surface"}};
        lines[0].insert(lines[0].end(), std::begin(told_readers), std::end(told_readers));
        lines[0].push_back("");
        for (const RowResult& row : scene.rows) {
            lines.push_back({(row.front ? "* " : "  ") + row_name(row.row),
                             seconds_text(row.seconds.median), spread(row.seconds),
                             percent(row.error.relative_l1), percent(row.projected.relative_l1),
                             format("%.3g", row.error.energy_ratio),
                             row.surface ? percent(row.surface->relative_l1) : "-"});
            for (const char* reader : told_readers)
                lines.back().push_back(shown_text(row, reader));
            lines.back().push_back(ratio_text(row));
        }
        text += aligned(lines, 1) + '\n';

        lines = {{"grid", "path-traced", "seconds", "error L1", "same SH", "error L2", "same SH",
                  "Mrays/s", "Embree"}};
        for (const GridResult& grid : scene.grids) {
            const auto add = [&](const PeerPoint& point, const char* kind) {
                lines.push_back(
                    {dims_text(grid.grid),
                     format("%llu rays%s", static_cast<unsigned long long>(point.rays), kind),
                     seconds_text(point.seconds.median), percent(point.error[0].relative_l1),
                     percent(point.projected[0].relative_l1), percent(point.error[1].relative_l1),
                     percent(point.projected[1].relative_l1),
                     format("%.3g", 1e-6 * point.rays_per_second),
                     point.embree_rays_per_second > 0
                         ? format("%.3g", 1e-6 * point.embree_rays_per_second)
                         : "-"});
            };
            for (const PeerPoint& point : grid.peer)
                add(point, "");
            for (const PeerPoint& point : grid.sharing)
                add(point, ", sharing bounces");
            lines.push_back({dims_text(grid.grid), "exact", "", percent(grid.floor[0].relative_l1),
                             "0 %", percent(grid.floor[1].relative_l1), "0 %", "", ""});
        }
        text += aligned(lines, 1) + '\n';
        for (const std::string& verdict : verdicts(scene))
            text += verdict + '\n';
    }
    return text;
}

std::string report_csv(const Report& report) {
    const std::vector<std::string> columns = csv_columns(report);
    std::string text;
    for (const std::string& column : columns)
        text += (text.empty() ? "" : ",") + column;
    text += '\n';
    for (const SceneReport& scene : report.scenes) {
        const auto line_on = [&](const GridResult& grid, const char* kind) {
            Line line(columns);
            line.set("scene", scene.path);
            line.set("kind", kind);
            line.set("cells_x", grid.grid.dims.x);
            line.set("cells_y", grid.grid.dims.y);
            line.set("cells_z", grid.grid.dims.z);
            line.set("cell_m", grid.grid.cell);
            line.set("valid_cells", double(grid.valid));
            line.set("probes", double(grid.probes));
            line.set("reference_noise", grid.noise);
            return line;
        };
        for (const RowResult& row : scene.rows) {
            Line line = line_on(scene.grids[row.grid], "bake");
            line.set("name", row_name(row.row));
            line.set("sh_order", row.sh_order);
            line.set("seconds", row.seconds.median);
            line.set("seconds_min", row.seconds.min);
            line.set("seconds_max", row.seconds.max);
            line.set("true", row.error);
            line.set("projected", row.projected);
            if (row.surface)
                line.set("surface", *row.surface);
            for (const ReaderError& shown : row.shown)
                line.set(shown.reader, shown.error);
            line.set("negative", double(row.error.negative));
            line.set("front", row.front ? "1" : "0");
            if (row.peer) {
                line.set("peer", kind_name(row.peer->kind));
                line.set("peer_factor", row.peer->factor);
            }
            if (row.sharing) {
                line.set("sharing", kind_name(row.sharing->kind));
                line.set("sharing_factor", row.sharing->factor);
            }
            for (const StageTiming& stage : row.stages)
                line.set("stage_" + stage.name, stage.seconds.median);
            line.set("command", row.command);
            text += line.text();
        }
        for (const GridResult& grid : scene.grids)
            for (std::size_t i = 0; i < floor_orders.size(); ++i) {
                const auto add = [&](const PeerPoint& point, const char* kind, const char* name) {
                    Line line = line_on(grid, kind);
                    line.set("name",
                             format("%s %llu", name, static_cast<unsigned long long>(point.rays)));
                    line.set("sh_order", floor_orders[i]);
                    line.set("rays", double(point.rays));
                    line.set("seconds", point.seconds.median);
                    line.set("seconds_min", point.seconds.min);
                    line.set("seconds_max", point.seconds.max);
                    line.set("true", point.error[i]);
                    line.set("projected", point.projected[i]);
                    line.set("negative", double(point.error[i].negative));
                    line.set("rays_per_second", point.rays_per_second);
                    if (point.embree_rays_per_second > 0)
                        line.set("embree_rays_per_second", point.embree_rays_per_second);
                    text += line.text();
                };
                for (const PeerPoint& point : grid.peer)
                    add(point, "peer", "path-traced");
                for (const PeerPoint& point : grid.sharing)
                    add(point, "sharing", "path-traced, sharing bounces,");
                Line line = line_on(grid, "floor");
                line.set("name", format("exact, SH L%d", floor_orders[i]));
                line.set("sh_order", floor_orders[i]);
                line.set("rays", double(grid.rays));
                line.set("true", grid.floor[i]);
                line.set("negative", double(grid.floor[i].negative));
                text += line.text();
            }
    }
    return text;
}

nlohmann::ordered_json report_json(const Report& report) {
    Json document{{"command", "report"},
                  {"version", LPVBAKE_VERSION},
                  {"device", report.device},
                  {"threads", report.threads},
                  {"repeats", report.settings.repeats},
                  {"seed", report.settings.seed},
                  {"scenes", Json::array()},
                  {"seconds", report.seconds}};
    for (const SceneReport& scene : report.scenes) {
        Json json{{"scene", scene.path},
                  {"triangles", scene.triangles},
                  {"grids", Json::array()},
                  {"rows", Json::array()},
                  {"surfaces",
                   {{"points", scene.surface_points},
                    {"noise", scene.surface_noise},
                    {"rays", scene.surface_rays}}},
                  {"verdicts", verdicts(scene)},
                  {"warnings", scene.warnings}};
        for (const GridResult& grid : scene.grids)
            json["grids"].push_back(to_json(grid));
        for (const RowResult& row : scene.rows)
            json["rows"].push_back(to_json(row));
        document["scenes"].push_back(json);
    }
    return document;
}

std::string rough(double number) {
    return format(number < 10 ? "%.2g" : "%.0f", number);
}

nlohmann::ordered_json measured_json(const MeasuredError& error) {
    if (error.points == 0)
        return nullptr;
    return {{"error", error.error},
            {"low", error.low},
            {"high", error.high},
            {"points", error.points},
            {"noise", error.noise}};
}

std::string expected_text(const Search& search) {
    return format("about %s to %s s in all: %s s for the reference, the rest for one to %zu of %zu "
                  "settings",
                  rough(search.least_seconds).c_str(), rough(search.most_seconds).c_str(),
                  rough(search.truth_seconds).c_str(),
                  std::min(most_trials, search.candidates.size()), search.candidates.size());
}

namespace {

/// "error 5 %, time 10 s".
std::string goal_text(const Goal& goal) {
    std::string text;
    if (goal.error)
        text = "error " + percent(*goal.error);
    if (goal.seconds)
        text += (text.empty() ? "" : ", ") + format("time %.3g s", *goal.seconds);
    return text;
}

/// "3.9 % (3.7 to 4.1), 2.4 s".
std::string trial_text(const Trial& trial) {
    return format("%.3g %% (%.3g to %.3g), %s s", 100 * trial.error.error, 100 * trial.error.low,
                  100 * trial.error.high, seconds_text(trial.seconds.median).c_str());
}

/// What of the goal a trial misses; empty: nothing.
std::string missed_text(const Trial& trial, const Goal& goal) {
    const bool wrong = goal.error && trial.error.high > *goal.error;
    const bool slow = goal.seconds && trial.seconds.median > *goal.seconds;
    return wrong && slow ? "too wrong and too slow" : wrong ? "too wrong" : slow ? "too slow" : "";
}

Json to_json(const Trial& trial, const Search& search) {
    const Candidate& candidate = search.candidates[trial.candidate];
    Json json{{"name", row_name(candidate.row)},
              {"options", Json::object()},
              {"command", candidate.command},
              {"sh_order", candidate.row.settings.solver.order()},
              {"expected", {{"error", candidate.error}, {"seconds", candidate.seconds}}},
              {"seconds", to_json(trial.seconds)},
              {"error", measured_json(trial.error)},
              {"field", to_json(trial.field)},
              {"projected", to_json(trial.projected)},
              {"missed", missed_text(trial, search.goal)},
              {"warnings", trial.warnings}};
    for (const auto& [option, value] : candidate.row.options)
        json["options"][option] = value;
    return json;
}

} // namespace

std::string search_text(const SearchedScene& scene) {
    const Search& search = scene.search;
    const SearchResult& result = scene.result;
    std::string text = format(
        "reference     %zu of %llu cells of %.4g m, noise %s after %llu rays; bands up to order 2 "
        "cost %s, up to order 4 %s\n",
        search.drawn.cells.size(), static_cast<unsigned long long>(search.drawn.valid),
        search.grid.cell, percent(result.truth.noise).c_str(),
        static_cast<unsigned long long>(result.truth.rays),
        percent(result.floor[1].relative_l1).c_str(), percent(result.floor[2].relative_l1).c_str());
    for (const Trial& trial : result.trials) {
        const std::string missed = missed_text(trial, search.goal);
        text += format("tried         %s: %s%s%s\n",
                       row_name(search.candidates[trial.candidate].row).c_str(),
                       trial_text(trial).c_str(), missed.empty() ? "" : ", ", missed.c_str());
    }
    if (result.found) {
        const Trial& best = result.trials[result.best];
        for (const std::string& warning : best.warnings)
            text += "warning       " + warning + '\n';
        text += search.candidates[best.candidate].command + '\n';
    }
    return text;
}

std::string nearest_text(const SearchedScene& scene) {
    const Trial& best = scene.result.trials[scene.result.best];
    return scene.path
           + format(": none of %s tried is known to keep %s; nearest comes, with %s: ",
                    counted(scene.result.trials.size(), "setting").c_str(),
                    goal_text(scene.search.goal).c_str(), trial_text(best).c_str())
           + scene.search.candidates[best.candidate].command;
}

nlohmann::ordered_json goal_json(const Goal& goal) {
    return {{"error", goal.error ? Json(*goal.error) : Json(nullptr)},
            {"seconds", goal.seconds ? Json(*goal.seconds) : Json(nullptr)}};
}

nlohmann::ordered_json search_json(const SearchedScene& scene) {
    const Search& search = scene.search;
    const SearchResult& result = scene.result;
    Json json{{"scene", scene.path},
              {"triangles", scene.triangles},
              {"grid", to_json(search.grid, search.drawn.valid, search.drawn.cells.size(),
                               {{"noise", result.truth.noise},
                                {"rays", result.truth.rays},
                                {"converged", result.truth.converged},
                                {"seconds", result.truth.seconds}},
                               result.floor)},
              {"expected_seconds", {search.least_seconds, search.most_seconds}},
              {"tried", Json::array()},
              {"found", result.found},
              {"best", result.best},
              {"command", search.candidates[result.trials[result.best].candidate].command}};
    for (const Trial& trial : result.trials)
        json["tried"].push_back(to_json(trial, search));
    return json;
}

nlohmann::ordered_json search_plan_json(const SearchedScene& scene) {
    const Search& search = scene.search;
    Json rows = Json::array();
    for (const Candidate& candidate : search.candidates)
        rows.push_back({{"name", row_name(candidate.row)},
                        {"command", candidate.command},
                        {"dims", vector_json(search.grid.dims)},
                        {"seconds", candidate.seconds},
                        {"error", candidate.error}});
    return {{"scene", scene.path},
            {"rows", rows},
            {"expected_seconds", {search.least_seconds, search.most_seconds}}};
}

std::string search_plan_text(const SearchedScene& scene) {
    std::string text;
    for (const Candidate& candidate : scene.search.candidates)
        text += format("candidate     %s: expected %s, %s s\n", row_name(candidate.row).c_str(),
                       percent(candidate.error).c_str(), seconds_text(candidate.seconds).c_str());
    return text;
}

} // namespace lpvbake::report
