// lpvbake/bake.h over the driver.
#include "bake/bake.h"
#include "bake/pilot.h"
#include "io/target.h"
#include "lpvbake/error.h"
#include "readers/readers.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::bake {
namespace {

std::string names_of(const std::vector<const solver::SolverKind*>& kinds) {
    std::string names;
    for (const solver::SolverKind* kind : kinds)
        names += (names.empty() ? "" : ", ") + std::string(kind->name);
    return names;
}

/// Whether the kind has the parameter, and what that needs is asked for.
bool takes(const solver::SolverKind& kind, const std::string& name, const BakeRequest& request) {
    const solver::Parameter* parameter = solver::find_parameter(kind, name);
    if (!parameter || !parameter->needs)
        return parameter != nullptr;
    const auto needed = request.parameters.find(parameter->needs);
    return needed != request.parameters.end() && needed->second != "0";
}

/// The kinds that have all that is asked of a solver, best first.
std::vector<const solver::SolverKind*> kinds_for(const BakeRequest& request) {
    std::vector<const solver::SolverKind*> kinds(solver_kinds().begin(), solver_kinds().end());
    const auto keep = [&](const std::string& what, const auto& has) {
        const std::string before = names_of(kinds);
        std::erase_if(kinds, [&](const solver::SolverKind* kind) { return !has(*kind); });
        if (kinds.empty())
            throw Error(ErrorKind::argument, what + ": not of " + before);
    };
    if (!request.solver.empty())
        keep("`solver` " + request.solver,
             [&](const solver::SolverKind& kind) { return kind.name == request.solver; });
    for (const auto& given : request.parameters)
        keep(given.first,
             [&](const solver::SolverKind& kind) { return takes(kind, given.first, request); });
    if (request.sh_order)
        keep("`sh_order` " + std::to_string(*request.sh_order),
             [&](const solver::SolverKind& kind) {
                 return std::ranges::count(kind.orders, *request.sh_order) > 0;
             });
    return kinds;
}

double checked(const char* setting, double value) {
    if (!(value > 0 && std::isfinite(value)))
        throw Error(ErrorKind::argument, std::string(setting) + " has to be above 0");
    return value;
}

Wish wish_of(const BakeRequest& request) {
    Wish wish;
    wish.solvers = kinds_for(request);
    wish.order = request.sh_order;
    if (request.error)
        wish.error = checked("`error`", *request.error);
    if (request.time_budget)
        wish.seconds = checked("`time_budget`", *request.time_budget);
    for (const auto& [name, text] : request.parameters) {
        const solver::Parameter& parameter = *solver::find_parameter(*wish.solvers.front(), name);
        const std::optional<double> value = solver::parse_value(parameter, text);
        if (!value)
            throw Error(ErrorKind::argument, name + ": '" + text + "' is none of its values, "
                                                 + solver::values_of(parameter));
        wish.given.push_back({parameter.name, *value});
    }
    return wish;
}

BakeSettings settings_of(const BakeRequest& request, const solver::SolverKind& kind) {
    if (request.bounces && *request.bounces < 0)
        throw Error(ErrorKind::argument, "`bounces` is below 0");
    if (request.cell_size == 0 && request.resolution < 3)
        throw Error(ErrorKind::argument, "`resolution` is below 3");
    BakeSettings settings(kind);
    settings.grid = {request.resolution, request.cell_size,
                     request.margin.value_or(volume::usual_margin(request.bounds.has_value()))};
    settings.bounds = request.bounds;
    settings.emitters = request.emitters;
    if (request.bounces)
        settings.bounces = request.bounces;
    if (!request.fit.empty()) {
        settings.fit = readers::reader_named(request.fit == "generic" ? "lpvbake" : request.fit);
        if (!settings.fit)
            throw Error(ErrorKind::argument, "`fit` " + request.fit + ": there is no such target");
        if (const io::Target* target = io::target_named(request.fit))
            settings.dering = target->dering; // as the program does for its files
    }
    if (!request.isa.empty()) {
        const std::optional<visibility::Isa> isa = visibility::isa_named(request.isa);
        if (!isa)
            throw Error(ErrorKind::argument, "`isa` " + request.isa + ": there is no such set");
        settings.isa = *isa;
    }
    if (!request.rays.empty()) {
        const std::optional<Rays> rays = rays_named(request.rays);
        if (!rays)
            throw Error(ErrorKind::argument,
                        "`rays` " + request.rays + ": nobody of that name traces");
        settings.rays = *rays;
    }
    return settings;
}

/// By the Cornell box, without a pilot.
Choice choose(const Scene& scene, const BakeRequest& request, const gpu::DeviceInfo& device) {
    scene::check_scene(scene);
    const Wish wish = wish_of(request);
    return choose_settings(survey(scene), settings_of(request, *wish.solvers.front()), wish,
                           device);
}

/// With one where an error is wanted.
Choice choose(const Scene& scene, const BakeRequest& request, const gpu::Device& device,
              Progress& progress) {
    scene::check_scene(scene);
    Wish wish = wish_of(request);
    const BakeSettings settings = settings_of(request, *wish.solvers.front());
    const SceneFacts facts = survey(scene);
    add_pilot(scene, facts, settings, device, progress, wish);
    return choose_settings(facts, settings, wish, device.info());
}

} // namespace

} // namespace lpvbake::bake

namespace lpvbake {

namespace {

BakeForecast forecast_of(const bake::Choice& choice) {
    const bake::BakePlan& plan = choice.plan;
    BakeForecast forecast{plan.grid,         choice.text,     choice.error,   plan.seconds,
                          plan.device_bytes, plan.host_bytes, choice.warnings};
    forecast.warnings.insert(forecast.warnings.end(), plan.warnings.begin(), plan.warnings.end());
    return forecast;
}

} // namespace

BakeForecast forecast(const Scene& scene, const BakeRequest& request,
                      const gpu::DeviceInfo& device) {
    return forecast_of(bake::choose(scene, request, device));
}

BakeForecast forecast(const Scene& scene, const BakeRequest& request, const gpu::Device& device) {
    Progress silent;
    return forecast_of(bake::choose(scene, request, device, silent));
}

Baked bake_volume(const Scene& scene, const BakeRequest& request, const gpu::Device& device,
                  Progress& progress) {
    const bake::Choice choice = bake::choose(scene, request, device, progress);
    Baked baked = bake::bake(scene, choice.plan, device, progress);
    baked.warnings.insert(baked.warnings.begin(), choice.warnings.begin(), choice.warnings.end());
    baked.volume.metadata["tool"] = "lpvbake " LPVBAKE_VERSION;
    baked.volume.metadata["choice"] = choice.text;
    return baked;
}

Baked bake_volume(const Scene& scene, const BakeRequest& request, const gpu::Device& device) {
    Progress silent;
    return bake_volume(scene, request, device, silent);
}

} // namespace lpvbake
