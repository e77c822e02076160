#include "solver/solver.h"

#include "lpvbake/error.h"

#include <algorithm>

namespace lpvbake::solver {

const Parameter* find_parameter(const SolverKind& kind, std::string_view name) {
    const auto found = std::ranges::find(kind.parameters, name, &Parameter::name);
    return found == kind.parameters.end() ? nullptr : &*found;
}

void Solver::solve_at(std::span<const glm::vec3>, const Inputs&, Stages&, Volume&,
                      std::span<Volume>) {
    throw Error(ErrorKind::failure, "the solver knows cells of grids alone");
}

void Solver::solve_blocks(std::span<const Block>, const Inputs&, Stages&, Volume&) {
    throw Error(ErrorKind::failure, "the solver knows cells of grids alone");
}

void Solver::solve_layers(const Inputs&, Stages&, Volume&, std::span<Volume>) {
    throw Error(ErrorKind::failure, "the solver knows no layers of light");
}

namespace {

/// Where it stands among the kind's parameters. Throws Error (argument) where it does not.
std::size_t index_of(const SolverKind& kind, std::string_view name) {
    const Parameter* found = find_parameter(kind, name);
    if (!found)
        throw Error(ErrorKind::argument,
                    std::string(kind.name) + " has no parameter '" + std::string(name) + "'");
    return std::size_t(found - kind.parameters.data());
}

} // namespace

SolverSettings::SolverSettings(const SolverKind& kind) : kind_(&kind) {
    for (const Parameter& parameter : kind.parameters)
        values_.push_back(parameter.usual);
    set_order(2);
    set(kind.ladder.front());
    set(Quality::balanced);
}

void SolverSettings::set_order(int wanted) {
    order_ = kind_->orders.front();
    for (const int order : kind_->orders)
        if (order <= wanted)
            order_ = order;
}

double SolverSettings::operator[](std::string_view parameter) const {
    return values_[index_of(*kind_, parameter)];
}

void SolverSettings::set(std::string_view name, double value) {
    const std::size_t index = index_of(*kind_, name);
    const Parameter& parameter = kind_->parameters[index];
    if (!is_value(parameter, value))
        throw Error(ErrorKind::argument, std::string(parameter.name) + " of " + kind_->name
                                             + " takes " + values_of(parameter));
    values_[index] = parameter.round ? parameter.round(value) : value;
}

void SolverSettings::set(const Rung& rung) {
    lighting_rays_ = rung.lighting_rays;
    for (const ParameterValue& each : rung.values)
        if (each.parameter)
            set(each.parameter, each.value);
}

void SolverSettings::set(Quality quality) {
    for (const Rung& rung : kind_->ladder)
        if (rung.preset == quality)
            set(rung);
}

bool is_on_ladder(const SolverKind& kind, std::string_view parameter) {
    return std::ranges::any_of(kind.ladder.front().values, [&](const ParameterValue& each) {
        return each.parameter && each.parameter == parameter;
    });
}

} // namespace lpvbake::solver
