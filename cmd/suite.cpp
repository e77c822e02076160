#include "suite.h"

#include "lpvbake/error.h"
#include "options/wording.h"
#include "report/suite_table.h"
#include "text.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace lpvbake {
namespace {

SuiteRow worded(SuiteRow row) {
    for (std::string& failure : row.failures)
        failure = in_options(failure);
    return row;
}

} // namespace

void run_suite(const SuiteRun& run, const RunOptions& o) {
    check_baseline(run.baseline);
    const auto begin = std::chrono::steady_clock::now();
    const Suite suite = load_suite(run.suite);
    const auto thread_limit = limit_threads(o.threads);
    const ImageModulePreload preload = preload_image_module();
    watch_signals();
    TerminalProgress progress(o.progress);
    const gpu::Device device({o.device, false});

    std::size_t width = 4;
    for (const SuiteCase& each : suite.cases)
        width = std::max(width, each.name.size());
    const bool text = o.format == Format::text;
    bool headed = false;
    const auto show = [&](const SuiteRow& row) {
        progress.clear();
        if (!text)
            return;
        if (!std::exchange(headed, true))
            print_text(suite_head(width));
        print_text(suite_line(worded(row), width));
        std::fflush(stdout);
    };
    std::vector<SuiteRow> rows =
        run_suite(suite, run.selection, suite_solvers(device), progress, show);
    std::ranges::transform(rows, rows.begin(), worded);
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
            document["rows"].push_back(suite_row_json(row));
        print_json(document);
    }
    finish_stdout();
    const std::string worse = judge_by_baseline(run.baseline, baseline_of(rows));
    if (failed > 0) {
        const SuiteRow& first = *std::ranges::find_if(rows, fails);
        throw Error(ErrorKind::difference,
                    format("%s: %td of %s failed, the first is %s by %s: %s", run.suite.c_str(),
                           failed, counted(rows.size(), "row").c_str(), first.name.c_str(),
                           first.solver.c_str(), failures_text(first).c_str()));
    }
    if (!worse.empty())
        throw Error(ErrorKind::difference, worse);
}

} // namespace lpvbake
