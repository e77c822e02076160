#include "bake/choose.h"

#include "lpvbake/error.h"
#include "solver/models.h"
#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::bake {
namespace {

/// What is not chosen: of `base` where that is of the same kind.
solver::SolverSettings starting_point(const solver::SolverKind& kind,
                                      const solver::SolverSettings& base) {
    return &base.kind() == &kind ? base : solver::SolverSettings(kind);
}

void set_given(const Wish& wish, solver::SolverSettings& settings) {
    for (const solver::ParameterValue& each : wish.given)
        if (solver::find_parameter(settings.kind(), each.parameter))
            settings.set(each.parameter, each.value);
}

/// Solver, order, and the parameters that its ladder sets.
std::string text_of(const solver::SolverSettings& settings) {
    std::string text = format("%s, order %d", settings.kind().name, settings.order());
    for (const solver::Parameter& parameter : settings.kind().parameters)
        if (solver::is_on_ladder(settings.kind(), parameter.name)) {
            const double number = settings[parameter.name];
            const std::string value = parameter.kind == solver::ValueKind::real
                                          ? format("%.3g", number)
                                          : solver::value_text(parameter, number);
            text += *parameter.unit ? ", " + value + " " + parameter.unit
                                    : std::string(", ") + parameter.name + " " + value;
        }
    return text;
}

} // namespace

bool is_foretold(const solver::Pilot& pilot) {
    return pilot.clusters[1] <= solver::models::error::most_lost_clusters;
}

const solver::Pilot& pilot_for(const BakeSettings& settings,
                               const std::optional<solver::Pilot>& pilot) {
    namespace error = solver::models::error;
    const bool once = settings.bounces && *settings.bounces <= 1;
    return pilot ? *pilot : once ? error::cornell_box_once : error::cornell_box;
}

double expected_error(const BakeSettings& settings, const std::optional<solver::Pilot>& pilot,
                      int kept_order) {
    const solver::Pilot& light = pilot_for(settings, pilot);
    const solver::SolverSettings& solver = settings.solver;
    return solver::models::error::margin
           * std::hypot(solver::lost_bands(light, std::min(solver.order(), kept_order)),
                        solver.kind().expected_error(solver, light));
}

bool Choice::foretold() const {
    return !pilot || is_foretold(*pilot);
}

Choice choose_settings(const SceneFacts& scene, const BakeSettings& base, const Wish& wish,
                       const gpu::DeviceInfo& device) {
    std::vector<Choice> choices;
    const auto consider = [&](solver::SolverSettings solver, int order) {
        BakeSettings settings = base;
        set_given(wish, solver);
        solver.set_order(order);
        settings.solver = solver;
        Choice& choice = choices.emplace_back();
        choice.plan = plan_bake(scene, settings, device);
        choice.error = expected_error(settings, wish.pilot, wish.kept_order);
        choice.pilot = wish.pilot;
        choice.text = text_of(solver);
    };
    if (!wish.error && !wish.seconds) {
        consider(starting_point(*wish.solvers.front(), base.solver), wish.order.value_or(2));
        return choices.front();
    }

    const auto accurate = [&](const Choice& c) { return !wish.error || c.error <= *wish.error; };
    const auto fast = [&](const Choice& c) {
        return !wish.seconds || wish.pilot_seconds + c.plan.seconds <= *wish.seconds;
    };
    const auto both = [&](const Choice& c) { return accurate(c) && fast(c); };
    // Order 4 makes files that are larger and that few can read: where the error needs it.
    std::vector<int> orders{wish.order.value_or(2)};
    if (!wish.order && wish.error && wish.kept_order >= 4)
        orders.push_back(4);
    std::optional<Error> refused;
    for (const int order : orders) {
        if (std::ranges::any_of(choices, both))
            break;
        for (const solver::SolverKind* kind : wish.solvers) {
            if (order > kind->orders.back() && order > (wish.order ? 0 : 2))
                continue;
            for (const solver::Rung& rung : kind->ladder)
                try {
                    solver::SolverSettings solver = starting_point(*kind, base.solver);
                    solver.set(rung);
                    consider(solver, order);
                } catch (const Error& error) {
                    if (error.kind != ErrorKind::memory)
                        throw;
                    refused = error;
                }
        }
    }
    if (choices.empty())
        throw refused.value();

    const auto by_time = [](const Choice& a, const Choice& b) {
        return std::pair(a.plan.seconds, a.error) < std::pair(b.plan.seconds, b.error);
    };
    const auto by_error = [](const Choice& a, const Choice& b) {
        return std::pair(a.error, a.plan.seconds) < std::pair(b.error, b.plan.seconds);
    };
    const auto best = [&](const auto& allowed, const auto& order) {
        std::vector<Choice> left;
        std::ranges::copy_if(choices, std::back_inserter(left), allowed);
        return *std::ranges::min_element(left, order);
    };
    Choice choice =
        std::ranges::any_of(choices, both) ? wish.error ? best(both, by_time) : best(both, by_error)
        : std::ranges::any_of(choices, fast) ? best(fast, by_error)
                                             : best([](const Choice&) { return true; }, by_time);
    const auto warn = [&](const std::string& text) {
        choice.warnings.push_back(about(scene.path, text));
    };
    if (!choice.foretold())
        warn("what a pilot sees of its light is too uneven to foretell the error of a bake: it can "
             "only be measured");
    else if (!accurate(choice))
        warn(format("`error` %.3g %%: about %s %% is expected, the least%s; taken is %s",
                    100 * *wish.error, two_digits(100 * choice.error).c_str(),
                    wish.seconds ? " in that time" : "", choice.text.c_str()));
    if (!fast(choice))
        warn(format("`time_budget` %.3g s: the fastest takes about %s s%s; taken is %s",
                    *wish.seconds, two_digits(wish.pilot_seconds + choice.plan.seconds).c_str(),
                    wish.pilot ? " with the pilot" : "", choice.text.c_str()));
    return choice;
}

} // namespace lpvbake::bake
