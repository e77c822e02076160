#include "suite.h"

#include "error.h"
#include "text.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace lpvbake {

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

void run_suite(const SuiteRun& run, const RunOptions& o) {
    const auto begin = std::chrono::steady_clock::now();
    const Suite suite = load_suite(run.suite);
    const auto thread_limit = limit_threads(o.threads);
    const ImageModulePreload preload = preload_image_module();
    watch_signals();
    TerminalProgress progress(o.progress);
    const gpu::Device device({o.device, false});

    Table table;
    for (const SuiteCase& each : suite.cases)
        table.name = std::max(table.name, int(each.name.size()));
    const bool text = o.format == Format::text;
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
