// Settings of a bake from the error or the time that is wanted.
#include "bake/bake.h"
#include "error.h"
#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

// Errors are those of the Cornell box with a lamp, relative L1 of irradiance at cells, measured
// against path-traced references; in two rooms with a door they are a third to all of this. After
// one bounce light comes from few places, and bands and places of surfaces matter more.

/// What the bands up to `order` cost, even where they are exact.
double floor_of(int order, bool once) {
    return order < 2   ? (once ? 0.25 : 0.133)
           : order < 4 ? (once ? 0.053 : 0.02)
                       : (once ? 0.015 : 0.008);
}

/// What a solver adds to that; the squares of both sum.
double error_of(const BakeSettings& settings, bool once) {
    switch (settings.solver) {
    case Solver::lpv:
        return once ? 0.95 : 0.8;
    case Solver::sn:
        return std::hypot(0.016, 0.03 * std::pow(48.0 / settings.sn.directions, 1.2));
    case Solver::gather:
        return std::hypot(0.009,
                          std::hypot(0.13 / std::sqrt(double(settings.gather.vpls)),
                                     0.02 * std::pow(double(settings.gather.tolerance), 1.5)));
    }
    return 1.0;
}

/// What a solver can be told, from the fastest to the most accurate; what is fixed stays.
std::vector<BakeSettings> ladder(Solver solver, const BakeSettings& base, const Wish& wish) {
    std::vector<BakeSettings> rungs;
    const auto add = [&](const auto& change) {
        BakeSettings rung = base;
        rung.solver = solver;
        change(rung);
        wish.fixed(rung);
        rungs.push_back(rung);
    };
    switch (solver) {
    case Solver::lpv:
        add([](BakeSettings&) {});
        break;
    case Solver::sn:
        for (const auto& [directions, rays] :
             {std::pair{48, 19}, std::pair{144, 19}, std::pair{240, 21}, std::pair{384, 23}})
            add([&](BakeSettings& rung) {
                rung.sn.directions = directions;
                rung.lighting_rays = uint64_t(1) << rays;
            });
        break;
    case Solver::gather: {
        struct Rung {
            int vpls;
            float tolerance;
            int rays;
        };
        for (const Rung& r : {Rung{48, 0.5f, 19}, Rung{96, 0.5f, 19}, Rung{192, 0.3f, 21},
                              Rung{384, 0.2f, 22}, Rung{768, 0.1f, 23}})
            add([&](BakeSettings& rung) {
                rung.gather.vpls = r.vpls;
                rung.gather.tolerance = r.tolerance;
                rung.lighting_rays = uint64_t(1) << r.rays;
            });
        break;
    }
    }
    return rungs;
}

std::string text_of(const BakeSettings& settings) {
    switch (settings.solver) {
    case Solver::lpv:
        return "lpv, order 1";
    case Solver::sn:
        return format("sn, order %d, %d directions", settings.sn.order, settings.sn.directions);
    case Solver::gather:
        return format("gather, order %d, %d clusters, tolerance %.3g", settings.gather.order,
                      settings.gather.vpls, double(settings.gather.tolerance));
    }
    return {};
}

} // namespace

double expected_error(const BakeSettings& settings) {
    const bool once = settings.bounces && *settings.bounces <= 1;
    return std::hypot(floor_of(sh_order_of(settings), once), error_of(settings, once));
}

Choice choose_settings(const Scene& scene, const BakeSettings& base, const Wish& wish,
                       const gpu::DeviceInfo& device) {
    std::vector<Choice> choices;
    const auto consider = [&](BakeSettings settings, int order) {
        settings.sn.order = settings.gather.order = order;
        const BakePlan plan = plan_bake(scene, settings, device);
        choices.push_back(
            {settings, expected_error(settings), plan.seconds, text_of(settings), {}});
    };
    if (!wish.error && !wish.seconds) {
        BakeSettings settings = base;
        settings.solver = wish.solvers.front();
        wish.fixed(settings);
        consider(settings, wish.order.value_or(2));
        return choices.front();
    }

    const auto accurate = [&](const Choice& c) { return !wish.error || c.error <= *wish.error; };
    const auto fast = [&](const Choice& c) { return !wish.seconds || c.seconds <= *wish.seconds; };
    const auto both = [&](const Choice& c) { return accurate(c) && fast(c); };
    // Order 4 makes files that are larger and that few can read: where the error needs it.
    std::vector<int> orders{wish.order.value_or(2)};
    if (!wish.order && wish.error)
        orders.push_back(4);
    std::optional<Error> refused;
    for (const int order : orders) {
        if (std::ranges::any_of(choices, both))
            break;
        for (const Solver solver : wish.solvers) {
            if (solver == Solver::lpv && order > (wish.order ? 1 : 2))
                continue;
            for (const BakeSettings& rung : ladder(solver, base, wish))
                try {
                    consider(rung, order);
                } catch (const Error& error) {
                    if (error.code != ExitCode::memory)
                        throw;
                    refused = error;
                }
        }
    }
    if (choices.empty())
        throw refused.value();

    const auto by_time = [](const Choice& a, const Choice& b) {
        return std::pair(a.seconds, a.error) < std::pair(b.seconds, b.error);
    };
    const auto by_error = [](const Choice& a, const Choice& b) {
        return std::pair(a.error, a.seconds) < std::pair(b.error, b.seconds);
    };
    const auto best = [&](const auto& allowed, const auto& order) {
        std::vector<Choice> left;
        std::ranges::copy_if(choices, std::back_inserter(left), allowed);
        return *std::ranges::min_element(left, order);
    };
    Choice choice;
    if (std::ranges::any_of(choices, both))
        choice = wish.error ? best(both, by_time) : best(both, by_error);
    else if (std::ranges::any_of(choices, fast))
        choice = best(fast, by_error);
    else
        choice = best([](const Choice&) { return true; }, by_time);
    if (!accurate(choice))
        choice.warnings.push_back(format("--error %.3g %%: about %.2g %% is expected, the least%s; "
                                         "taken is %s",
                                         100 * *wish.error, 100 * choice.error,
                                         wish.seconds ? " in that time" : "", choice.text.c_str()));
    if (!fast(choice))
        choice.warnings.push_back(format("--time-budget %.3g s: the fastest takes about %.2g s; "
                                         "taken is %s",
                                         *wish.seconds, choice.seconds, choice.text.c_str()));
    return choice;
}

} // namespace lpvbake
