#include "suite.h"

#include "error.h"
#include "image/image.h"
#include "result.h"
#include "scene_options.h"
#include "terminal.h"
#include "text.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace lpvbake {

const char suite_manual[] =
    R"(With --suite FILE the cases of that file are run instead, each with every solver that has limits
there, and one table is printed: the relative L1 error of irradiance and the energy against the
truth, the leak, the share of irradiance samples below 0, the distance from the case that has to
look the same, the numbers that are NaN or infinite, the time of the bake, and the verdict. Exit
code 7 if a limit does not hold; NaN and infinity never do. --case and --solver select rows, --cheap
those that take a second. A suite is JSON beside its scenes:
  {"cases": [{"name": "two-rooms", "reason": "light through a door", "scene": "two_rooms.gltf",
    "options": {"resolution": 16, "margin": 1, "bounds": [X0, Y0, Z0, X1, Y1, Z1],
      "bounces": 1 or "inf" (a solver that does fewer is held to its own), "max-albedo": 0.95,
      "iterations": 0, "probes": 300, "rays": 4096, "noise": 0.02 (of the path-traced truth)},
    "truth": "reference" (path-traced), "none",
      {"furnace": {"emission": 1, "albedo": 0.5}} (a closed room that glows) or
      {"polygon": {"corners": [[X, Y, Z], ...], "luminance": 1}} (alone in empty space),
    "region": {"lo": [X, Y, Z], "hi": [X, Y, Z], "dark": false}, where leak is measured: mean
      luminance over the truth's there, or, if dark, over the truth's everywhere,
    "same_as": {"case": NAME, "scale": 1}, whose field times scale must be this one's, cell by cell,
    "limits": {"lpv": {"error": MOST, "energy": [LEAST, MOST], "leak": [LEAST, MOST],
      "negative": MOST, "same": MOST}},
    "cheap": true}]}
name, reason, scene and a limit are needed. Scenes may not leave the suite's folder.
JSON (--format json): {"command": "report", "version", "suite", "device", "rows": [{"case", "solver",
  "measured" (false: the reason is in failures, the numbers mean nothing), "noise" (of the truth),
  "error", "energy", "leak", "negative", "same" (null: not asked for), "not_finite", "seconds",
  "failures": [...]}], "failed" (rows), "seconds"})";

namespace {

Json json_of(const SuiteRow& row) {
    const auto maybe = [](const std::optional<double>& value) {
        return value ? Json(*value) : Json(nullptr);
    };
    return {{"case", row.name},          {"solver", row.solver},
            {"measured", row.measured},  {"noise", row.noise},
            {"error", maybe(row.error)}, {"energy", maybe(row.energy)},
            {"leak", maybe(row.leak)},   {"negative", row.negative},
            {"same", maybe(row.same)},   {"not_finite", row.not_finite},
            {"seconds", row.seconds},    {"failures", row.failures}};
}

std::string joined(const std::vector<std::string>& texts) {
    std::string all;
    for (const std::string& text : texts)
        all += (all.empty() ? "" : "; ") + text;
    return all;
}

struct Table {
    int name = 4, solver = 6; ///< widths

    void print_head() const {
        std::printf("%-*s  %-*s %9s %7s %8s %9s %8s %5s %9s  verdict\n", name, "case", solver,
                    "solver", "error", "energy", "leak", "negative", "same", "NaN", "time");
    }
    void print(const SuiteRow& row) const {
        const auto cell = [&](const std::optional<double>& value, const char* pattern) {
            char text[32] = "-";
            if (value && row.measured)
                std::snprintf(text, sizeof text, pattern, *value);
            return std::string(text);
        };
        const auto percent = [&](const std::optional<double>& value) {
            return cell(value ? std::optional(100.0 * *value) : value, "%.1f %%");
        };
        std::printf("%-*s  %-*s %9s %7s %8s %9s %8s %5llu %7.2f s  %s\n", name, row.name.c_str(),
                    solver, row.solver.c_str(), percent(row.error).c_str(),
                    cell(row.energy, "%.3f").c_str(), cell(row.leak, "%.3g").c_str(),
                    percent(row.negative).c_str(), cell(row.same, "%.2g").c_str(),
                    static_cast<unsigned long long>(row.not_finite), row.seconds,
                    row.failures.empty() ? "ok" : ("FAIL: " + joined(row.failures)).c_str());
        std::fflush(stdout);
    }
};

} // namespace

void run_suite(const SuiteRun& run) {
    const auto begin = std::chrono::steady_clock::now();
    const Suite suite = load_suite(run.suite);
    const auto thread_limit = limit_threads(run.threads);
    const ImageModulePreload preload = preload_image_module();
    watch_signals();
    TerminalProgress progress(progress_style(run.progress));
    const gpu::Device device({run.device, false});

    Table table;
    for (const SuiteCase& each : suite.cases)
        table.name = std::max(table.name, int(each.name.size()));
    const bool text = run.format == "text";
    bool headed = false;
    const auto show = [&](const SuiteRow& row) {
        progress.clear();
        if (!text)
            return;
        if (!std::exchange(headed, true))
            table.print_head();
        table.print(row);
    };
    const std::vector<SuiteRow> rows =
        run_suite(suite, run.selection, suite_solvers(device), progress, show);
    progress.clear();

    const auto fails = [](const SuiteRow& row) { return !row.failures.empty(); };
    const auto failed = std::ranges::count_if(rows, fails);
    if (!text) {
        Json document{{"command", "report"},
                      {"version", LPVBAKE_VERSION},
                      {"suite", run.suite},
                      {"device", device.info().name},
                      {"rows", Json::array()},
                      {"failed", failed},
                      {"seconds", seconds_since(begin)}};
        for (const SuiteRow& row : rows)
            document["rows"].push_back(json_of(row));
        print_json(document);
    }
    finish_stdout();
    if (failed > 0) {
        const SuiteRow& first = *std::ranges::find_if(rows, fails);
        throw Error(ErrorKind::difference,
                    format("%s: %td of %s failed, the first is %s by %s: %s", run.suite.c_str(),
                           failed, counted(rows.size(), "row").c_str(), first.name.c_str(),
                           first.solver.c_str(), joined(first.failures).c_str()));
    }
}

} // namespace lpvbake
