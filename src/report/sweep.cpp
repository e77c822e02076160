#include "report/sweep.h"

#include "error.h"

#include <algorithm>
#include <charconv>
#include <functional>
#include <optional>

namespace lpvbake {
namespace {

/// What takes a value in; false if it is none of the option's.
using Set = std::function<bool(const std::string&, BakeSettings&)>;

struct Option {
    const char* name;
    const char* values; ///< for people
    Set set;
};

template <class Number>
std::optional<Number> number_in(const std::string& text, Number lo, Number hi) {
    Number value{};
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc() || stop != end || !(value >= lo && value <= hi))
        return std::nullopt;
    return value;
}

/// A number that `member` of the settings takes.
template <class Number, class Member>
Set number(Number lo, Number hi, Member member) {
    return [=](const std::string& text, BakeSettings& settings) {
        const std::optional<Number> value = number_in(text, lo, hi);
        if (value)
            member(settings) = *value;
        return value.has_value();
    };
}

bool set_occlusion(const std::string& text, BakeSettings& settings) {
    constexpr std::pair<const char*, Occlusion> modes[] = {
        {"none", Occlusion::none}, {"sh", Occlusion::sh}, {"face", Occlusion::face}};
    for (const auto& [name, mode] : modes)
        if (text == name) {
            settings.lpv.occlusion = mode;
            return true;
        }
    return false;
}

bool set_solver(const std::string& text, BakeSettings& settings) {
    for (const Solver solver : {Solver::lpv, Solver::sn, Solver::gather})
        if (text == name_of(solver)) {
            settings.solver = solver;
            settings.bounces = default_bounces(solver);
            return true;
        }
    return false;
}

bool set_bounces(const std::string& text, BakeSettings& settings) {
    const std::optional<int> bounces = number_in(text, 0, 10'000);
    settings.bounces = bounces;
    return bounces || text == "inf";
}

bool set_quality_by_name(const std::string& text, BakeSettings& settings) {
    constexpr std::pair<const char*, Quality> qualities[] = {
        {"fast", Quality::fast}, {"balanced", Quality::balanced}, {"accurate", Quality::accurate}};
    for (const auto& [name, quality] : qualities)
        if (text == name) {
            set_quality(quality, settings);
            return true;
        }
    return false;
}

const std::vector<Option>& options() {
    static const std::vector<Option> all = {
        {"solver", "lpv, sn, gather", set_solver},
        {"bounces", "whole numbers from 0 to 10000, inf", set_bounces},
        {"quality", "fast, balanced, accurate", set_quality_by_name},
        {"directions", "whole numbers from 48 to 384",
         number(48, 384, [](BakeSettings& s) -> int& { return s.sn.directions; })},
        {"sh-order", "1, 2, 4",
         number(1, 4,
                [](BakeSettings& s) -> int& {
                    return s.solver == Solver::sn ? s.sn.order : s.gather.order;
                })},
        {"vpls", "whole numbers from 16 to 1000000",
         number(16, 1'000'000, [](BakeSettings& s) -> int& { return s.gather.vpls; })},
        {"rsm-samples", "whole numbers from 0 to 65536",
         number(0, 65536, [](BakeSettings& s) -> int& { return s.rsm_samples; })},
        {"resolution", "whole numbers from 3 to 65536",
         number(3, 65536, [](BakeSettings& s) -> int& { return s.grid.resolution; })},
        {"occlusion", "none, sh, face", set_occlusion},
        {"iterations", "whole numbers from 0 to 1000000",
         number(0, 1'000'000, [](BakeSettings& s) -> int& { return s.lpv.iterations; })},
        {"tolerance", "numbers from 1e-7 to 1",
         number(1e-7f, 1.0f,
                [](BakeSettings& s) -> float& {
                    return s.solver == Solver::lpv ? s.lpv.tolerance : s.gather.tolerance;
                })},
        {"rsm-size", "whole numbers from 0 to 16384",
         number(0, 16384, [](BakeSettings& s) -> int& { return s.rsm_size; })},
        {"rsm-kernel", "whole numbers from 1 to 64",
         number(1, 64, [](BakeSettings& s) -> int& { return s.rsm_kernel; })},
    };
    return all;
}

void apply(const std::string& name, const std::string& value, BakeSettings& settings) {
    for (const Option& option : options())
        if (name == option.name) {
            if (!option.set(value, settings))
                throw Error(ExitCode::usage,
                            name + ": '" + value + "' is none of its values, " + option.values);
            return;
        }
    std::string known;
    for (const Option& option : options())
        known += (known.empty() ? "" : ", ") + std::string(option.name);
    throw Error(ExitCode::usage, "a sweep cannot set '" + name + "'; it can set " + known);
}

/// What bake's --solver auto makes of options without a solver: the first that has one of them;
/// null where that leaves it open.
const char* implied_solver(const std::vector<std::pair<std::string, std::string>>& options) {
    constexpr std::pair<const char*, const char*> owners[] = {
        {"solver", nullptr},   {"rsm-samples", "gather"}, {"vpls", "gather"},
        {"directions", "sn"},  {"occlusion", "lpv"},      {"iterations", "lpv"},
        {"rsm-kernel", "lpv"}, {"rsm-size", "lpv"},       {"tolerance", "gather"}};
    for (const auto& [name, solver] : owners)
        for (const auto& [option, value] : options)
            if (option == name)
                return solver;
    return nullptr;
}

} // namespace

std::vector<std::string> sweep_options() {
    std::vector<std::string> names;
    for (const Option& option : options())
        names.push_back(option.name);
    return names;
}

void check_sweep_value(const std::string& option, const std::string& value) {
    BakeSettings scratch;
    apply(option, value, scratch);
}

std::vector<Sweep> default_sweeps() {
    return {
        {{"solver", {"lpv"}},
         {"resolution", {"16", "32", "64"}},
         {"occlusion", {"none", "sh", "face"}}},
        {{"solver", {"sn", "gather"}},
         {"bounces", {"1"}},
         {"resolution", {"16", "32", "64"}},
         {"quality", {"fast", "balanced", "accurate"}}},
        {{"solver", {"lpv"}},
         {"resolution", {"32"}},
         {"occlusion", {"face"}},
         {"iterations", {"16"}}},
        {{"solver", {"lpv"}},
         {"resolution", {"32"}},
         {"occlusion", {"face"}},
         {"rsm-size", {"128"}}},
    };
}

std::vector<SweepRow> sweep_rows(const std::vector<Sweep>& sweeps, const BakeSettings& base) {
    std::vector<SweepRow> rows;
    for (const Sweep& sweep : sweeps) {
        std::size_t count = 1;
        for (std::size_t i = 0; i < sweep.size(); ++i) {
            if (sweep[i].values.empty())
                throw Error(ExitCode::usage, sweep[i].option + ": no values");
            for (std::size_t j = 0; j < i; ++j)
                if (sweep[i].option == sweep[j].option)
                    throw Error(ExitCode::usage, sweep[i].option + " is set twice");
            count *= sweep[i].values.size();
            if (rows.size() + count > most_rows)
                throw Error(ExitCode::usage, "a sweep of more than " + std::to_string(most_rows)
                                                 + " rows; give fewer values");
        }
        for (std::size_t n = 0; n < count; ++n) {
            SweepRow row{base, {}};
            std::size_t left = n;
            for (std::size_t i = sweep.size(); i-- > 0; left /= sweep[i].values.size())
                row.options.insert(
                    row.options.begin(),
                    {sweep[i].option, sweep[i].values[left % sweep[i].values.size()]});
            if (const char* solver = implied_solver(row.options))
                apply("solver", solver, row.settings);
            for (const auto& [option, value] : row.options)
                apply(option, value, row.settings);
            if (std::ranges::none_of(
                    rows, [&](const SweepRow& other) { return other.options == row.options; }))
                rows.push_back(std::move(row));
        }
    }
    return rows;
}

} // namespace lpvbake
