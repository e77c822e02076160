#include "suite.h"

#include "lpvbake/error.h"
#include "options/wording.h"
#include "report/suite_table.h"
#include "text.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace lpvbake::cmd {
namespace {

report::SuiteRow worded(report::SuiteRow row) {
    for (std::string& failure : row.failures)
        failure = options::in_options(failure);
    return row;
}

} // namespace

void run_suite(const SuiteRun& run, const RunOptions& o) {
    check_baseline(run.baseline);
    const auto begin = std::chrono::steady_clock::now();
    const report::Suite suite = report::load_suite(run.suite);
    limit_threads(o.threads);
    const image::ImageModulePreload preload = image::preload_image_module();
    watch_signals();
    TerminalProgress progress(o.progress);
    const gpu::Device device({o.device, false});

    std::size_t width = 4;
    for (const report::SuiteCase& each : suite.cases)
        width = std::max(width, each.name.size());
    const bool text = o.format == Format::text;
    bool headed = false;
    const auto show = [&](const report::SuiteRow& row) {
        progress.erase();
        if (!text)
            return;
        if (!std::exchange(headed, true))
            print_text(report::suite_head(width));
        print_text(report::suite_line(worded(row), width));
        std::fflush(stdout);
    };
    std::vector<report::SuiteRow> rows =
        report::run_suite(suite, run.selection, report::suite_solvers(device), progress, show);
    std::ranges::transform(rows, rows.begin(), worded);
    progress.end();

    const auto fails = [](const report::SuiteRow& row) { return !row.failures.empty(); };
    const auto failed = std::ranges::count_if(rows, fails);
    if (!text) {
        report::Json document{{"command", "report"},
                              {"version", LPVBAKE_VERSION},
                              {"suite", run.suite},
                              {"device", device.info().name},
                              {"rows", report::Json::array()},
                              {"failed", failed},
                              {"seconds", seconds_since(begin)}};
        for (const report::SuiteRow& row : rows)
            document["rows"].push_back(report::suite_row_json(row));
        print_json(document);
    }
    finish_stdout();
    const std::string worse = judge_by_baseline(run.baseline, report::baseline_of(rows));
    if (failed > 0) {
        const report::SuiteRow& first = *std::ranges::find_if(rows, fails);
        throw Error(ErrorKind::difference,
                    format("%s: %td of %s failed, the first is %s by %s: %s", run.suite.c_str(),
                           failed, counted(rows.size(), "row").c_str(), first.name.c_str(),
                           first.solver.c_str(), report::failures_text(first).c_str()));
    }
    if (!worse.empty())
        throw Error(ErrorKind::difference, worse);
}

} // namespace lpvbake::cmd
