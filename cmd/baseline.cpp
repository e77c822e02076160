#include "baseline.h"

#include "lpvbake/error.h"
#include "scene_options.h"
#include "text.h"

#include <cstdio>
#include <filesystem>

namespace lpvbake::cmd {

void check_baseline(const BaselineOptions& o) {
    if (o.update)
        probe_outputs({o.path});
    if (!o.path.empty() && (!o.update || std::filesystem::exists(o.path)))
        report::load_baseline(o.path);
}

std::string judge_by_baseline(const BaselineOptions& o, const report::Baseline& now) {
    if (o.path.empty())
        return {};
    if (o.update) {
        report::Baseline kept;
        if (std::filesystem::exists(o.path))
            kept = report::load_baseline(o.path);
        for (const auto& [name, row] : now)
            kept[name] = row;
        report::save_baseline(o.path, kept);
        return {};
    }
    const report::BaselineComparison result =
        report::compare_baselines(report::load_baseline(o.path), now, o.slack);
    if (result.compared == 0)
        throw Error(ErrorKind::argument, o.path
                                             + ": has none of the rows that were measured; add "
                                               "them with --update-baseline");
    for (const std::string& worse : result.worse)
        std::fprintf(stderr, "lpvbake: worse: %s\n", worse.c_str());
    if (result.worse.empty())
        return {};
    return o.path + ": " + counted(result.worse.size(), "number") + " of "
           + counted(result.compared, "row") + " became worse, the first is "
           + result.worse.front();
}

} // namespace lpvbake::cmd
