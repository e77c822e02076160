#include "report/search.h"

#include "bake/bake.h"
#include "bake/pilot.h"
#include "lpvbake/error.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <tuple>

namespace lpvbake::report {
namespace {

/// What misses the goal by a larger factor, as far as is known, is not tried.
constexpr double far_off = 1.5;

/// By which factor numbers miss the goal; up to 1 they keep it.
double miss(const Goal& goal, double error, double seconds) {
    return std::max(goal.error ? error / *goal.error : 0.0,
                    goal.seconds ? seconds / *goal.seconds : 0.0);
}

/// Of its own, beside that of the bands.
double solver_error(const Search& search, const SweepRow& row) {
    const bake::BakeSettings& settings = row.settings;
    return settings.solver.kind().expected_error(settings.solver,
                                                 bake::pilot_for(settings, search.pilot));
}

struct Expected {
    double error, seconds;
};

/// What a candidate is expected to be in the light of what was tried.
Expected expected(const Search& search, const SearchResult& result, std::size_t i) {
    const Candidate& candidate = search.candidates[i];
    if (result.truth.rays == 0)
        return {candidate.error, candidate.seconds};
    const solver::SolverSettings& solver = candidate.row.settings.solver;
    double own = solver_error(search, candidate.row), seconds = candidate.seconds, width = 1;
    bool alike = false; // the same solver was tried: the last one says most
    for (const Trial& trial : result.trials) {
        const SweepRow& tried = search.candidates[trial.candidate].row;
        const bool same = &tried.settings.solver.kind() == &solver.kind();
        if (same)
            own = solver_error(search, candidate.row) * trial.projected.relative_l1
                  / solver_error(search, tried);
        if (same || !alike)
            seconds = candidate.seconds * trial.seconds.median
                      / search.candidates[trial.candidate].seconds;
        alike = alike || same;
        if (trial.error.error > 0)
            width = trial.error.high / trial.error.error;
    }
    const double bands = result.floor[floor_index(solver.order())].relative_l1;
    return {width * std::hypot(own, bands), seconds};
}

/// What to try next: of those that are expected to keep the goal the cheapest, one above order 2,
/// whose files are larger and few can read, after all others; without an error in the goal the most
/// accurate. Else what misses it by least. None where all that is left is far off.
std::optional<std::size_t> next_candidate(const Search& search, const SearchResult& result) {
    std::optional<std::size_t> best;
    std::tuple<double, bool, double> best_rank;
    for (std::size_t i = 0; i < search.candidates.size(); ++i) {
        if (std::ranges::count(result.trials, i, &Trial::candidate) > 0)
            continue;
        const Expected of = expected(search, result, i);
        const std::tuple rank{std::max(1.0, miss(search.goal, of.error, of.seconds)),
                              search.candidates[i].row.settings.solver.order() > 2,
                              search.goal.error ? of.seconds : of.error};
        if (!best || rank < best_rank) {
            best = i;
            best_rank = rank;
        }
    }
    const bool hopeless = std::get<0>(best_rank) > far_off && !result.trials.empty();
    return hopeless ? std::nullopt : best;
}

MeasuredError measured(const std::vector<glm::dvec3>& estimate, const Truth& truth,
                       std::size_t cells, uint64_t seed) {
    const std::size_t normals = truth.irradiance.size() / cells;
    std::vector<VerifiedPoint> points(cells);
    for (std::size_t i = 0; i < truth.irradiance.size(); ++i) {
        VerifiedPoint& point = points[i / normals];
        for (int c = 0; c < 3; ++c) {
            const double off = std::abs(estimate[i][c] - truth.irradiance[i][c]);
            const double sure = off / truth.error[i][c]; // not finite without noise
            point.wrong += off;
            point.agreed += sure < 8 ? off * (1 - std::exp(-0.5 * sure * sure)) : off;
            point.true_ += truth.irradiance[i][c];
            point.noise += truth.error[i][c];
        }
    }
    return measured_error(points, seed);
}

/// Bakes; again only where the error is kept, for the time.
Trial try_candidate(const Scene& scene, const Search& search, std::size_t i, const Truth& truth,
                    const ReportSettings& settings, const gpu::Device& device, Progress& progress) {
    Trial trial;
    trial.candidate = i;
    std::vector<double> seconds;
    for (int repeat = 0; repeat < settings.repeats; ++repeat) {
        const auto begin = std::chrono::steady_clock::now();
        const bake::BakePlan plan =
            bake::plan_bake(bake::survey(scene), search.candidates[i].row.settings, device.info());
        const Baked baked = bake::bake(scene, plan, device, progress);
        seconds.push_back(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
        if (repeat > 0)
            continue;
        const auto sh = coefficients_at(baked.volume, search.drawn.cells);
        const int order = baked.volume.sh_order;
        const CellErrors errors = errors_at_cells(sh, order, truth);
        trial.field = errors.error;
        trial.projected = errors.projected;
        trial.error =
            measured(irradiance_of(sh, order), truth, search.drawn.cells.size(), settings.seed);
        trial.warnings = baked.warnings;
        if (search.goal.error && trial.error.high > *search.goal.error)
            break;
    }
    trial.seconds = timing_of(seconds);
    return trial;
}

bool find_axis(const Sweep& sweep, const std::string& option) {
    return std::ranges::find(sweep, option, &SweepAxis::option) != sweep.end();
}

/// Those that are listed, else those that have all options that are listed.
std::vector<const solver::SolverKind*> solvers_of(const Sweep& given, solver::SolverKinds kinds) {
    std::vector<const solver::SolverKind*> solvers;
    const std::vector<std::string> common = sweep_options(solver::SolverKinds());
    for (const solver::SolverKind* kind : kinds)
        if (std::ranges::all_of(given, [&](const SweepAxis& axis) {
                return axis.option == "solver" ? std::ranges::count(axis.values, kind->name) > 0
                                               : std::ranges::count(common, axis.option) > 0
                                                     || solver::find_parameter(*kind, axis.option);
            }))
            solvers.push_back(kind);
    if (solvers.empty())
        throw Error(ErrorKind::argument, "no solver has all the options that are given");
    return solvers;
}

/// What bake is told to take a rung: a quality, and what it has otherwise.
Sweep axes_of(const solver::SolverKind& kind, const solver::Rung& rung) {
    const solver::Rung* preset = nullptr; // which lights surfaces as well, if there is any
    for (const solver::Rung& other : kind.ladder)
        if (other.preset
            && (!preset || preset->lighting_rays < rung.lighting_rays
                || (rung.preset && other.preset == rung.preset)))
            preset = &other;
    Sweep sweep;
    if (preset)
        sweep.push_back({"quality", {solver::quality_names[std::size_t(*preset->preset)]}});
    for (const solver::ParameterValue& value : rung.values) {
        const auto is_preset = [&](const solver::ParameterValue& other) {
            return other.parameter && std::string_view(other.parameter) == value.parameter
                   && other.value == value.value;
        };
        if (value.parameter && !(preset && std::ranges::any_of(preset->values, is_preset)))
            sweep.push_back({value.parameter,
                             {solver::value_text(*solver::find_parameter(kind, value.parameter),
                                                 value.value)}});
    }
    return sweep;
}

} // namespace

std::vector<SweepRow> candidate_rows(const Sweep& given, const Goal& goal,
                                     const bake::BakeSettings& base, solver::SolverKinds kinds) {
    for (const SweepAxis& axis : given)
        if (axis.option != "solver" && axis.values.size() != 1)
            throw Error(ErrorKind::argument,
                        axis.option + ": takes one value where an error or a time is wanted");
    const std::vector<const solver::SolverKind*> solvers = solvers_of(given, kinds);
    const std::optional<int> reflections = solvers.front()->default_bounces;
    std::vector<Sweep> sweeps;
    for (const solver::SolverKind* kind : solvers)
        for (const solver::Rung& rung : kind->ladder) {
            Sweep sweep{{"solver", {kind->name}}};
            for (SweepAxis& axis : axes_of(*kind, rung))
                if (!find_axis(given, axis.option))
                    sweep.push_back(std::move(axis));
            std::ranges::copy_if(given, std::back_inserter(sweep),
                                 [](const SweepAxis& axis) { return axis.option != "solver"; });
            if (kind->default_bounces != reflections && !find_axis(given, "bounces"))
                sweep.push_back({"bounces", {reflections ? std::to_string(*reflections) : "inf"}});
            SweepAxis orders{"sh-order", {}};
            for (const int order : kind->orders)
                if (order == 2 || (order == 4 && goal.error))
                    orders.values.push_back(std::to_string(order));
            if (!orders.values.empty() && !find_axis(given, "sh-order"))
                sweep.push_back(std::move(orders));
            sweeps.push_back(std::move(sweep));
        }
    return sweep_rows(sweeps, base, kinds);
}

Search begin_search(const Scene& scene, const std::vector<SweepRow>& rows, const Goal& goal,
                    const ReportSettings& settings, const gpu::Device& device, Progress& progress) {
    Search search;
    search.goal = goal;
    std::optional<Error> refused;
    const bake::SceneFacts facts = bake::survey(scene);
    if (goal.error)
        search.pilot = bake::run_pilot(
            scene, bake::plan_pilot(facts, rows.front().settings, device.info()), device, progress);
    for (const SweepRow& row : rows)
        try {
            const bake::BakePlan plan = bake::plan_bake(facts, row.settings, device.info());
            search.grid = plan.grid;
            search.rules = field_rules(row.settings);
            search.candidates.push_back(
                {row, bake::expected_error(row.settings, search.pilot), plan.seconds, {}});
        } catch (const Error& error) {
            if (error.kind != ErrorKind::memory)
                throw;
            refused = error;
        }
    if (search.candidates.empty())
        throw refused.value();
    search.drawn = draw_cells(scene, search.grid, settings.probes, settings.seed);
    search.truth_seconds =
        truth_cost(scene, search.drawn, search.rules, settings.truth, progress).seconds;

    const std::size_t first = next_candidate(search, {}).value();
    search.least_seconds =
        search.truth_seconds + settings.repeats * search.candidates[first].seconds;
    std::vector<double> others;
    for (std::size_t i = 0; i < search.candidates.size(); ++i)
        if (const double seconds = search.candidates[i].seconds;
            i != first && (!goal.seconds || seconds <= far_off * *goal.seconds))
            others.push_back(seconds);
    std::ranges::sort(others, std::greater<>());
    others.resize(std::min(others.size(), most_trials - 1));
    search.most_seconds = std::accumulate(others.begin(), others.end(), search.least_seconds);
    return search;
}

SearchResult search(const Scene& scene, const Search& search, const ReportSettings& settings,
                    const gpu::Device& device, Progress& progress) {
    SearchResult result;
    result.truth = trace_truth(scene, search.drawn, search.rules, settings.truth, progress);
    for (std::size_t i = 0; i < floor_orders.size(); ++i)
        result.floor[i] = error_at_cells(result.truth.sh, floor_orders[i], result.truth.sh,
                                         result.truth.irradiance);
    double least = HUGE_VAL;
    while (!result.found && result.trials.size() < most_trials) {
        const std::optional<std::size_t> next = next_candidate(search, result);
        if (!next)
            break;
        result.trials.push_back(
            try_candidate(scene, search, *next, result.truth, settings, device, progress));
        const Trial& trial = result.trials.back();
        const double off = miss(search.goal, trial.error.high, trial.seconds.median);
        result.found = off <= 1;
        if (off < least) {
            least = off;
            result.best = result.trials.size() - 1;
        }
    }
    return result;
}

} // namespace lpvbake::report
