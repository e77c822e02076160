#include "report/baseline.h"

#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "text.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <filesystem>

namespace lpvbake::report {
namespace {

constexpr uint64_t most_bytes = 64 << 20;
constexpr double anyway = 5e-4;

void set(BaselineRow& row, const std::string& name, double value) {
    if (std::isfinite(value))
        row[name] = value;
}

/// How bad a number is: 0 is best.
double badness(const std::string& name, double value) {
    return name == "energy" ? std::abs(value - 1) : value;
}

} // namespace

Baseline baseline_of(const Report& report) {
    Baseline baseline;
    for (const SceneReport& scene : report.scenes)
        for (const RowResult& result : scene.rows) {
            const std::string name = std::filesystem::path(scene.path).filename().string();
            BaselineRow& row = baseline[name + ": " + row_name(result.row)];
            set(row, "error", result.error.relative_l1);
            set(row, "projected", result.projected.relative_l1);
            set(row, "energy", result.error.energy_ratio);
            if (result.surface)
                set(row, "surface", result.surface->relative_l1);
            for (const ReaderError& shown : result.shown)
                set(row, shown.reader, shown.error.relative_l1);
            set(row, "seconds", result.seconds.median);
        }
    return baseline;
}

Baseline baseline_of(const std::vector<SuiteRow>& rows) {
    Baseline baseline;
    for (const SuiteRow& result : rows) {
        if (!result.measured)
            continue;
        BaselineRow& row = baseline[result.name + ": " + result.solver];
        for (const auto& [name, value] : {std::pair{"error", result.error},
                                          {"energy", result.energy},
                                          {"leak", result.leak},
                                          {"same", result.same}})
            if (value)
                set(row, name, *value);
        set(row, "negative", result.negative);
        set(row, "seconds", result.seconds);
    }
    return baseline;
}

Baseline load_baseline(const std::string& path) {
    const auto invalid = [&](const std::string& why) {
        return Error(ErrorKind::invalid, path + ": " + why + "; write it anew with the program");
    };
    const std::string text = io::read_file(path, most_bytes);
    const auto document = nlohmann::json::parse(text, nullptr, false);
    if (!document.is_object() || !document.contains("rows") || !document["rows"].is_object())
        throw invalid("is no baseline, {\"rows\": {NAME: {NUMBER: VALUE}}}");
    Baseline baseline;
    for (const auto& [name, numbers] : document["rows"].items()) {
        if (!numbers.is_object())
            throw invalid("\"" + name + "\" holds no numbers");
        BaselineRow& row = baseline[name];
        for (const auto& [number, value] : numbers.items()) {
            if (!value.is_number())
                throw invalid("\"" + name + "\": \"" + number + "\" is no number");
            row[number] = value.get<double>();
        }
    }
    return baseline;
}

void save_baseline(const std::string& path, const Baseline& baseline) {
    std::string text = "{\"rows\": {\n";
    for (const auto& [name, numbers] : baseline) {
        nlohmann::ordered_json row(nlohmann::json::value_t::object);
        for (const auto& [number, value] : numbers)
            row[number] = std::stod(format("%.6g", value)); // more than anybody compares
        text += nlohmann::json(name).dump() + ": " + row.dump()
                + (name == baseline.rbegin()->first ? "\n" : ",\n");
    }
    io::AtomicFile file(path);
    file.write(text + "}}\n");
    file.seal();
    file.publish();
}

BaselineComparison compare_baselines(const Baseline& kept, const Baseline& now,
                                     const BaselineSlack& slack) {
    BaselineComparison result;
    for (const auto& [name, numbers] : now) {
        const auto row = kept.find(name);
        if (row == kept.end()) {
            ++result.added;
            continue;
        }
        ++result.compared;
        for (const auto& [number, value] : row->second) {
            const bool is_time = number == "seconds";
            if (is_time && !slack.seconds)
                continue;
            const auto own = numbers.find(number);
            const double may = badness(number, value);
            if (own == numbers.end())
                result.worse.push_back(
                    format("%s: %s was %.4g, and is gone", name.c_str(), number.c_str(), value));
            else if (badness(number, own->second)
                     > may * (1 + (is_time ? *slack.seconds : slack.errors)) + anyway)
                result.worse.push_back(format("%s: %s is %.4g, was %.4g", name.c_str(),
                                              number.c_str(), own->second, value));
        }
    }
    return result;
}

} // namespace lpvbake::report
