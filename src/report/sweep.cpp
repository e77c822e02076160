#include "report/sweep.h"

#include "lpvbake/error.h"

#include <algorithm>
#include <optional>

namespace lpvbake::report {
namespace {

constexpr solver::Parameter bounces{
    .name = "bounces", .kind = solver::ValueKind::whole, .hi = 10'000};
constexpr solver::Parameter sh_order{
    .name = "sh-order", .kind = solver::ValueKind::whole, .lo = 1, .hi = 4};
constexpr solver::Parameter resolution{
    .name = "resolution", .kind = solver::ValueKind::whole, .lo = 3, .hi = 65536};
constexpr solver::Parameter quality{
    .name = "quality", .kind = solver::ValueKind::choice, .choices = solver::quality_names};

[[noreturn]] void refuse(const std::string& option, const std::string& value,
                         const std::string& values) {
    throw Error(ErrorKind::argument, option + ": '" + value + "' is none of its values, " + values);
}

double value_in(const solver::Parameter& parameter, const std::string& value) {
    const std::optional<double> number = solver::parse_value(parameter, value);
    if (!number)
        refuse(parameter.name, value, solver::values_of(parameter));
    return *number;
}

void set_solver(const std::string& value, solver::SolverKinds kinds, bake::BakeSettings& settings) {
    const solver::SolverKind* kind = bake::find_solver(value, kinds);
    if (!kind) {
        std::string names;
        for (const solver::SolverKind* each : kinds)
            names += (names.empty() ? "" : ", ") + std::string(each->name);
        refuse("solver", value, names);
    }
    if (&settings.solver.kind() != kind)
        settings.solver = solver::SolverSettings(*kind);
    settings.bounces = kind->default_bounces;
}

/// Sets a parameter of the settings' solver. What some solver has and this one has not is left
/// alone, so that a sweep may run over solvers.
void set_parameter(const std::string& name, const std::string& value, solver::SolverKinds kinds,
                   bake::BakeSettings& settings) {
    if (const solver::Parameter* own = solver::find_parameter(settings.solver.kind(), name)) {
        settings.solver.set(name, value_in(*own, value));
        return;
    }
    const solver::Parameter* others = nullptr;
    for (const solver::SolverKind* kind : kinds)
        if (const solver::Parameter* parameter = solver::find_parameter(*kind, name)) {
            if (solver::parse_value(*parameter, value))
                return;
            others = parameter;
        }
    if (others)
        refuse(name, value, solver::values_of(*others));
    std::string known;
    for (const std::string& option : sweep_options(kinds))
        known += (known.empty() ? "" : ", ") + option;
    throw Error(ErrorKind::argument, "a sweep cannot set '" + name + "'; it can set " + known);
}

void apply(const std::string& name, const std::string& value, solver::SolverKinds kinds,
           bake::BakeSettings& settings) {
    if (name == "solver")
        set_solver(value, kinds, settings);
    else if (name == bounces.name && value == "inf")
        settings.bounces.reset();
    else if (name == bounces.name && !solver::parse_value(bounces, value))
        refuse(name, value, solver::values_of(bounces) + ", inf");
    else if (name == bounces.name)
        settings.bounces = int(value_in(bounces, value));
    else if (name == quality.name)
        settings.solver.set(solver::Quality(int(value_in(quality, value))));
    else if (name == sh_order.name)
        settings.solver.set_order(int(value_in(sh_order, value)));
    else if (name == resolution.name)
        settings.grid.resolution = int(value_in(resolution, value));
    else
        set_parameter(name, value, kinds, settings);
}

/// Whether a sweep has nothing to tell them apart by.
bool are_same(const bake::BakeSettings& a, const bake::BakeSettings& b) {
    return &a.solver.kind() == &b.solver.kind() && a.solver.order() == b.solver.order()
           && a.solver.lighting_rays() == b.solver.lighting_rays() && a.bounces == b.bounces
           && a.grid.resolution == b.grid.resolution
           && std::ranges::all_of(a.solver.kind().parameters, [&](const solver::Parameter& each) {
                  return a.solver[each.name] == b.solver[each.name];
              });
}

/// False for a parameter that another kind of solver has, or that needs what is not set.
bool means_something(const std::string& name, const solver::SolverSettings& solver,
                     solver::SolverKinds kinds) {
    if (name == quality.name)
        return std::ranges::count_if(
                   solver.kind().ladder,
                   [](const solver::Rung& rung) { return rung.preset.has_value(); })
               > 1;
    if (const solver::Parameter* own = solver::find_parameter(solver.kind(), name))
        return !own->needs || solver[own->needs] > 0;
    return std::ranges::none_of(kinds, [&](const solver::SolverKind* kind) {
        return solver::find_parameter(*kind, name) != nullptr;
    });
}

/// What bake's --solver auto makes of options without a solver: the first that has them; null where
/// that leaves it open.
const solver::SolverKind*
implied_solver(const std::vector<std::pair<std::string, std::string>>& options,
               solver::SolverKinds kinds) {
    std::vector<const solver::SolverKind*> left(kinds.begin(), kinds.end());
    const auto is_above_0 = [&](const char* name) {
        return std::ranges::any_of(options, [&](const auto& option) {
            return option.first == name && option.second != "0";
        });
    };
    for (const auto& [option, value] : options) {
        std::vector<const solver::SolverKind*> with;
        for (const solver::SolverKind* kind : left)
            if (const solver::Parameter* parameter = solver::find_parameter(*kind, option))
                if (!parameter->needs || is_above_0(parameter->needs))
                    with.push_back(kind);
        if (!with.empty())
            left = with;
    }
    return left.size() < kinds.size() ? left.front() : nullptr;
}

} // namespace

std::string row_name(const SweepRow& row) {
    std::string name;
    for (const auto& [option, value] : row.options) {
        const bool plain = option == "solver" || option == "resolution" || option == "occlusion";
        name += (name.empty() ? "" : " ") + (plain ? value : option + "=" + value);
    }
    return name.empty() ? "what bake takes" : name;
}

std::vector<std::string> sweep_options(solver::SolverKinds kinds) {
    std::vector<std::string> names{"solver", bounces.name, quality.name, sh_order.name,
                                   resolution.name};
    for (const solver::SolverKind* kind : kinds)
        for (const solver::Parameter& parameter : kind->parameters)
            if (std::ranges::find(names, parameter.name) == names.end())
                names.push_back(parameter.name);
    return names;
}

void check_sweep_value(const std::string& option, const std::string& value,
                       solver::SolverKinds kinds) {
    // Of any solver.
    bake::BakeSettings scratch;
    for (const solver::SolverKind* kind : kinds)
        if (solver::find_parameter(*kind, option)) {
            scratch.solver = solver::SolverSettings(*kind);
            if (solver::parse_value(*solver::find_parameter(*kind, option), value))
                return;
        }
    apply(option, value, kinds, scratch);
}

std::vector<Sweep> default_sweeps() {
    return {
        {}, // what bake takes
        {{"solver", {"lpv"}},
         {"bounces", {"inf"}},
         {"resolution", {"16", "32", "64"}},
         {"occlusion", {"none", "sh", "face"}}},
        {{"solver", {"sn", "gather"}},
         {"resolution", {"16", "32", "64"}},
         {"quality", {"fast", "balanced", "accurate"}}},
        {{"solver", {"lpv"}},
         {"bounces", {"inf"}},
         {"resolution", {"32"}},
         {"occlusion", {"face"}},
         {"iterations", {"16"}}},
        {{"solver", {"lpv"}},
         {"bounces", {"inf"}},
         {"resolution", {"32"}},
         {"occlusion", {"face"}},
         {"rsm-size", {"128"}}},
    };
}

std::vector<SweepRow> sweep_rows(const std::vector<Sweep>& sweeps, const bake::BakeSettings& base,
                                 solver::SolverKinds kinds) {
    std::vector<SweepRow> rows;
    for (const Sweep& sweep : sweeps) {
        std::size_t count = 1;
        for (std::size_t i = 0; i < sweep.size(); ++i) {
            if (sweep[i].values.empty())
                throw Error(ErrorKind::argument, sweep[i].option + ": no values");
            for (std::size_t j = 0; j < i; ++j)
                if (sweep[i].option == sweep[j].option)
                    throw Error(ErrorKind::argument, sweep[i].option + " is set twice");
            count *= sweep[i].values.size();
            if (rows.size() + count > most_rows)
                throw Error(ErrorKind::argument, "a sweep of more than " + std::to_string(most_rows)
                                                     + " rows; give fewer values");
        }
        for (std::size_t n = 0; n < count; ++n) {
            SweepRow row{base, {}};
            std::size_t left = n;
            for (std::size_t i = sweep.size(); i-- > 0; left /= sweep[i].values.size())
                row.options.insert(
                    row.options.begin(),
                    {sweep[i].option, sweep[i].values[left % sweep[i].values.size()]});
            const auto solver = std::ranges::find(row.options, "solver",
                                                  [](const auto& option) { return option.first; });
            if (solver != row.options.end())
                set_solver(solver->second, kinds, row.settings);
            else if (const solver::SolverKind* kind = implied_solver(row.options, kinds))
                set_solver(kind->name, kinds, row.settings);
            for (const auto& [option, value] : row.options)
                if (option != "solver")
                    apply(option, value, kinds, row.settings);
            std::erase_if(row.options, [&](const auto& option) {
                return !means_something(option.first, row.settings.solver, kinds);
            });
            if (std::ranges::none_of(rows, [&](const SweepRow& other) {
                    return other.options == row.options
                           || (other.options.empty() && are_same(other.settings, row.settings));
                }))
                rows.push_back(std::move(row));
        }
    }
    return rows;
}

} // namespace lpvbake::report
