#include "report/suite.h"

#include "bake/bake.h"
#include "colour/colour.h"
#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "reference/sampler.h"
#include "text.h"
#include "visibility/validity.h"
#include "volume/compare.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>

namespace lpvbake::report {
namespace {

/// A field may call so large a share of the probes invalid: centres that lie on a surface.
constexpr double most_missing = 0.02;

/// True unless the cell's centre lies on a surface: `lpv` leaves such cells out.
bool is_clear(const visibility::Visibility& visibility, glm::ivec3 cell) {
    return visibility.capture(cell).point == glm::vec3(cell) + 0.5f;
}

double mean_luminance(const Volume& volume, std::span<const size_t> cells) {
    double sum = 0.0;
    for (const size_t cell : cells)
        sum += glm::dot(glm::dvec3(volume.sh[0][cell]), colour::rec709_luminance);
    return cells.empty() ? 0.0 : sum / double(cells.size());
}

uint64_t count_not_finite(const Volume& volume) {
    uint64_t count = 0;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        for (const float value : grid.values())
            count += !std::isfinite(value);
    return count;
}

/// See SuiteRow::same. Throws Error (invalid) where the two lattices have different dims.
double distance_between(const Volume& baked, const Volume& other, double scale) {
    if (baked.grid.dims != other.grid.dims)
        throw Error(ErrorKind::invalid,
                    format("same: its grid of %d x %d x %d cells is not the other case's, "
                           "%d x %d x %d",
                           baked.grid.dims.x, baked.grid.dims.y, baked.grid.dims.z,
                           other.grid.dims.x, other.grid.dims.y, other.grid.dims.z));
    Volume moved = other;
    moved.grid = baked.grid;
    for (auto& grid : moved.sh)
        for (glm::vec3& c : grid)
            c = glm::vec3(glm::dvec3(c) * scale);
    const volume::Comparison c = volume::compare(baked, moved, {});
    return std::max(c.relative_l1,
                    double(c.valid_only_a + c.valid_only_b) / double(baked.grid.size()));
}

/// All cells of a dark region count, else as many as there are probes.
SuiteCells choose_cells(const SuiteCase& c, const visibility::Visibility& visibility,
                        const Grid& grid) {
    const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
    std::vector<size_t> valid, inside;
    for (size_t i = 0; i < validity.size(); ++i)
        if (validity[i] > 0.0f && is_clear(visibility, grid.cell_at(i))) {
            valid.push_back(i);
            const glm::dvec3 p = grid.center(grid.cell_at(i));
            if (c.region && glm::all(glm::greaterThanEqual(p, c.region->box.lo))
                && glm::all(glm::lessThanEqual(p, c.region->box.hi)))
                inside.push_back(i);
        }
    if (valid.empty())
        throw Error(ErrorKind::invalid, "no cell of the grid has its centre outside geometry");
    if (c.region && inside.empty())
        throw Error(ErrorKind::invalid, "no cell outside geometry lies in the region");
    return {reference::sample_cells(std::move(valid), c.options.probes, 1),
            c.region && c.region->dark
                ? inside
                : reference::sample_cells(std::move(inside), c.options.probes, 1)};
}

/// A case's scene, and what its fields are judged by: made once for all solvers.
struct Ground {
    Ground(const SuiteCase& c, Scene loaded) : of(&c), scene(std::move(loaded)) {}

    /// Where a field of this grid is looked at, and the truth there; made anew for another grid.
    void find_truth_on(const Grid& other, Progress& progress) {
        if (visibility && grid == other)
            return;
        visibility.reset(); // what is left of a failure is no truth
        auto seen = std::make_unique<visibility::Visibility>(scene, scene::frame_of(other));
        cells = choose_cells(*of, *seen, other);
        truth = find_truth(of->truth, scene, *seen, other, wanted(),
                           SuiteTracing{of->options.bounces, of->options.rays, of->options.noise},
                           progress);
        grid = other;
        visibility = std::move(seen);
    }

    const SuiteCase* of;
    Scene scene;
    Grid grid;
    std::unique_ptr<visibility::Visibility> visibility;
    SuiteCells cells;
    TruthField truth;

private:
    std::vector<size_t> wanted() const {
        if (!of->region || of->region->dark)
            return cells.probes;
        std::vector<size_t> both;
        std::ranges::set_union(cells.probes, cells.region, std::back_inserter(both));
        return both;
    }
};

/// Bakes cases with solvers, and judges them; quickest where rows of a case follow each other.
class Runner {
public:
    Runner(const Suite& suite, Progress& progress) : suite_(suite), progress_(progress) {}

    SuiteRow run(const SuiteCase& c, const SuiteSolver& solver) {
        SuiteRow row;
        try {
            if (!ground_ || ground_->of != &c)
                ground_ = std::make_unique<Ground>(c, load(c));
            const Baked& baked = field(c, solver, ground_->scene);
            ground_->find_truth_on(baked.volume.grid, progress_);
            const Volume* other = nullptr;
            if (c.same_as) {
                const SuiteCase& twin =
                    *std::ranges::find(suite_.cases, c.same_as->name, &SuiteCase::name);
                const bool is_there = baked_.contains({twin.name, solver.name});
                other = &field(twin, solver, is_there ? Scene() : load(twin)).volume;
            }
            row = judge(c, c.limits.at(solver.name), baked.volume, ground_->truth, ground_->cells,
                        other);
            row.seconds = baked.seconds;
            if (std::ranges::none_of(suite_.cases, [&](const SuiteCase& each) {
                    return each.same_as && each.same_as->name == c.name;
                }))
                baked_.erase({c.name, solver.name}); // nobody asks for it again
        } catch (const Error& error) {
            if (error.kind == ErrorKind::interrupted || error.kind == ErrorKind::terminated
                || error.kind == ErrorKind::device)
                throw;
            row.failures.push_back(error.what());
        } catch (const std::bad_alloc&) {
            row.failures.push_back("out of memory");
        }
        row.name = c.name;
        row.solver = solver.name;
        return row;
    }

private:
    struct Baked {
        Volume volume;
        double seconds = 0;
    };

    static Scene load(const SuiteCase& c) {
        MaterialRules rules;
        rules.max_albedo = float(c.options.max_albedo);
        return load_gltf(c.scene, {.rules = rules});
    }

    /// `scene` is the case's; it is not looked at where the field is there.
    const Baked& field(const SuiteCase& c, const SuiteSolver& solver, const Scene& scene) {
        const auto [found, is_new] = baked_.try_emplace({c.name, solver.name});
        if (is_new) {
            try {
                const auto begin = std::chrono::steady_clock::now();
                found->second.volume = solver.bake(scene, c.options, progress_);
                found->second.seconds =
                    std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
            } catch (...) {
                baked_.erase(found);
                throw;
            }
        }
        return found->second;
    }

    const Suite& suite_;
    Progress& progress_;
    std::unique_ptr<Ground> ground_;
    std::map<std::pair<std::string, std::string>, Baked> baked_;
};

/// Fails the row where the value is too large; NaN is.
void hold_most(SuiteRow& row, const char* what, double value, double most) {
    if (!(value <= most))
        row.failures.push_back(format("%s is %.4g, at most %.4g", what, value, most));
}

void hold_within(SuiteRow& row, const char* what, double value, SuiteRange range) {
    if (value < range.lo)
        row.failures.push_back(format("%s is %.4g, at least %.4g", what, value, range.lo));
    else
        hold_most(row, what, value, range.hi);
}

} // namespace

std::vector<SuiteSolver> suite_solvers(const gpu::Device& device, solver::SolverKinds kinds) {
    const auto settings_of = [](const solver::SolverKind& kind, const SuiteOptions& o) {
        bake::BakeSettings settings(kind);
        settings.bounces = o.bounces;
        settings.grid.resolution = o.resolution;
        settings.grid.margin = o.margin;
        settings.bounds = o.bounds;
        if (solver::find_parameter(kind, "iterations"))
            settings.solver.set("iterations", o.iterations);
        return settings;
    };
    std::vector<SuiteSolver> solvers;
    for (const solver::SolverKind* kind : kinds)
        solvers.push_back(
            {kind->name, [&device, settings_of, kind](const Scene& scene, const SuiteOptions& o,
                                                      Progress& progress) {
                 const bake::BakePlan plan =
                     bake::plan_bake(bake::survey(scene), settings_of(*kind, o), device.info());
                 return bake::bake(scene, plan, device, progress).volume;
             }});
    return solvers;
}

SuiteRow judge(const SuiteCase& c, const SuiteLimits& limits, const Volume& baked,
               const TruthField& truth, const SuiteCells& cells, const Volume* other) {
    SuiteRow row;
    row.noise = truth.noise;
    row.not_finite = count_not_finite(baked);
    if (row.not_finite > 0) {
        row.failures.push_back("NaN or infinite: " + counted(uint64_t(row.not_finite), "number"));
        return row;
    }
    const auto missing = double(
        std::ranges::count_if(cells.probes, [&](size_t cell) { return !baked.is_valid(cell); }));
    if (missing > most_missing * double(cells.probes.size()))
        row.failures.push_back(format("%.0f of %zu cells outside geometry are called invalid",
                                      missing, cells.probes.size()));

    row.measured = true;
    Volume expected = truth.volume;
    expected.validity.assign(expected.grid.size(), 0.0f);
    for (const size_t cell : cells.probes)
        expected.validity[cell] = 1.0f;
    const volume::Comparison comparison = volume::compare(baked, expected, {});
    row.negative =
        comparison.samples > 0 ? double(comparison.negative_a) / double(comparison.samples) : 0.0;
    if (!std::holds_alternative<NoTruth>(c.truth)) {
        row.error = comparison.relative_l1;
        row.energy = comparison.energy_ratio;
        if (c.region)
            row.leak = mean_luminance(baked, cells.region)
                       / mean_luminance(truth.volume, c.region->dark ? cells.probes : cells.region);
    }
    if (other)
        row.same = distance_between(baked, *other, c.same_as->scale);

    if (row.error && limits.error)
        hold_most(row, "error", *row.error, *limits.error);
    if (row.energy && limits.energy)
        hold_within(row, "energy", *row.energy, *limits.energy);
    if (row.leak && limits.leak)
        hold_within(row, "leak", *row.leak, *limits.leak);
    if (limits.negative)
        hold_most(row, "negative", row.negative, *limits.negative);
    if (row.same && limits.same)
        hold_most(row, "same", *row.same, *limits.same);
    return row;
}

std::vector<SuiteRow> run_suite(const Suite& suite, const SuiteSelection& selection,
                                const std::vector<SuiteSolver>& solvers, Progress& progress,
                                const std::function<void(const SuiteRow&)>& done) {
    const auto wants = [](const std::vector<std::string>& names, const std::string& name) {
        return names.empty() || std::ranges::find(names, name) != names.end();
    };
    for (const std::string& name : selection.cases)
        if (std::ranges::find(suite.cases, name, &SuiteCase::name) == suite.cases.end())
            throw Error(ErrorKind::argument, suite.path + ": there is no case \"" + name + "\"");
    for (const std::string& name : selection.solvers)
        if (std::ranges::find(solvers, name, &SuiteSolver::name) == solvers.end())
            throw Error(ErrorKind::argument, "there is no solver \"" + name + "\"");
    Runner runner(suite, progress);
    std::vector<SuiteRow> rows;
    for (const SuiteCase& c : suite.cases)
        for (const SuiteSolver& solver : solvers)
            if (c.limits.contains(solver.name) && wants(selection.cases, c.name)
                && wants(selection.solvers, solver.name) && (c.cheap || !selection.cheap)) {
                rows.push_back(runner.run(c, solver));
                done(rows.back());
            }
    if (rows.empty())
        throw Error(ErrorKind::argument, suite.path + ": no case is selected");
    return rows;
}

} // namespace lpvbake::report
