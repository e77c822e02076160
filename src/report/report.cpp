#include "report/report.h"

#include "bake/bake.h"
#include "bake/surface_fit.h"
#include "io/target.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "reference/peer.h"
#include "reference/sampler.h"
#include "report/cells.h"
#include "report/slices.h"
#include "report/views.h"
#include "surface/lit_surfaces.h"
#include "text.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numbers>
#include <set>

namespace lpvbake::report {
namespace {

using Clock = std::chrono::steady_clock;

double since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Passes progress on with a title before each stage's name.
class Titled : public Progress {
public:
    Titled(Progress& outer, std::string title) : outer_(outer), title_(std::move(title)) {}
    void begin(std::string_view stage, uint64_t steps) override {
        outer_.begin(title_ + std::string(stage), steps);
    }
    void advance(uint64_t done) override { outer_.advance(done); }

private:
    Progress& outer_;
    std::string title_;
};

/// Rays of the peer, from each probe.
constexpr uint32_t peer_rays_each[] = {16, 64, 256, 1024, 4096};

/// Surface points and what truly arrives there.
struct SurfaceTruth {
    std::vector<FrontPoint> points;
    Truth truth;
};

SurfaceTruth trace_surfaces(const Scene& scene, const Grid& grid, const Bounds& box,
                            const reference::PathRules& rules, const ReportSettings& settings,
                            Progress& progress) {
    const Place place(scene, grid);
    SurfaceTruth surfaces;
    surfaces.points = draw_surface_points(scene, place.visibility, place.frame, box,
                                          settings.probes, settings.seed);
    std::vector<glm::vec3> points;
    std::vector<glm::dvec3> normals;
    for (const FrontPoint& point : surfaces.points) {
        points.push_back(lifted(point, place.frame));
        normals.push_back(point.normal);
    }
    if (points.empty())
        return surfaces;
    surfaces.truth = trace_truth(scene, place.visibility, place.frame, points, normals, rules,
                                 settings.truth, progress);
    // Where no light arrives at all, such as below what stands on a floor, nothing is read.
    std::size_t lit = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        if (surfaces.truth.irradiance[i] != glm::dvec3(0.0)) {
            surfaces.points[lit] = surfaces.points[i];
            surfaces.truth.irradiance[lit++] = surfaces.truth.irradiance[i];
        }
    surfaces.points.resize(lit);
    surfaces.truth.irradiance.resize(lit);
    return surfaces;
}

/// The reference at the probes of a grid, kept while its rows are baked.
struct GridTruth {
    DrawnCells drawn;
    Truth truth;
    LayerChoice layer;
    std::map<int, Volume> layers; ///< by SH order
    uint64_t layer_rays = 0;
};

FieldError surface_error(const readers::Reader& reader, const Volume& volume,
                         const SurfaceTruth& surfaces) {
    std::vector<glm::dvec3> estimate;
    for (const FrontPoint& point : surfaces.points)
        estimate.push_back(readers::irradiance(reader, volume, point.position, point.normal));
    return error_of(estimate, surfaces.truth.irradiance);
}

/// The points that bakes on a grid fit to, by the rays that their surfaces are lit by; none where
/// no light arrives.
class FitPoints {
public:
    FitPoints(const Scene& scene, const Place& place) : scene_(scene), place_(place) {}

    std::span<const readers::FitPoint> of(const bake::BakePlan& plan, Progress& progress) {
        surface::LightingSettings lighting = bake::lighting_of(plan);
        lighting.maps = false;
        const auto [found, added] = points_.try_emplace(lighting.rays);
        if (added) {
            const surface::LitSurfaces lit = surface::light_surfaces(
                scene_, place_.visibility, place_.frame, lighting, progress);
            auto points = bake::fit_points(scene_, lit, place_.frame, plan.emitters, {}, progress);
            if (bake::any_light(points))
                found->second = std::move(points);
        }
        return found->second;
    }

private:
    const Scene& scene_;
    const Place& place_;
    std::map<uint64_t, std::vector<readers::FitPoint>> points_;
};

/// Of the volume as each program's target writes it; one copy at a time.
std::vector<ReaderError> shown_errors(const Volume& volume,
                                      std::span<const readers::FitPoint> points,
                                      const SurfaceTruth& surfaces) {
    std::vector<ReaderError> shown;
    for (const readers::Reader& reader : readers::all_readers()) {
        const io::Target* target = io::target_named(reader.name);
        if (!target)
            continue;
        const auto alike = std::ranges::find_if(shown, [&](const ReaderError& other) {
            return readers::read_alike(reader, *readers::reader_named(other.reader))
                   && io::target_named(other.reader)->dilate == target->dilate;
        });
        if (alike != shown.end()) {
            shown.push_back({reader.name, FieldError(alike->error)});
            continue;
        }
        shown.push_back(
            {reader.name, surface_error(reader, written_for(reader, volume, points), surfaces)});
    }
    return shown;
}

/// Rays a second that Embree alone makes of those that the peer traces, a million of them at most:
/// the median of `repeats`.
double embree_rate(const Scene& scene, const Place& place, std::span<const glm::vec3> points,
                   const reference::PeerSettings& settings, uint64_t traced, int repeats) {
    const std::size_t stride = std::size_t(traced / (uint64_t(1) << 20)) + 1;
    std::vector<glm::vec3> some;
    for (std::size_t i = 0; i < points.size(); i += stride)
        some.push_back(points[i]);
    const visibility::PackedRays packed =
        reference::peer_rays(scene, place.visibility, place.frame, some, settings);
    std::vector<double> seconds;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        const Clock::time_point begin = Clock::now();
        packed.trace(place.visibility);
        seconds.push_back(since(begin));
    }
    const double median = timing_of(seconds).median;
    return median > 0 ? double(packed.size()) / median : 0;
}

/// Light between surfaces as the bakes of a grid solve it, for probes to look up.
struct SharedBounces {
    surface::LitSurfaces lit;
    std::vector<glm::vec3> irradiance; ///< a side: all but the direct light of punctual lights, lux
    double seconds = 0;

    SharedBounces(const Scene& scene, const Place& place, const reference::PathRules& rules) {
        const Clock::time_point begin = Clock::now();
        surface::LightingSettings settings;
        settings.bounces = rules.bounces;
        settings.emitters = rules.emitters;
        settings.maps = true;
        Progress silent;
        lit = surface::light_surfaces(scene, place.visibility, place.frame, settings, silent);
        irradiance.assign(lit.luminance.size(), glm::vec3(0.0f));
        for (std::size_t side = 0; side < irradiance.size(); ++side) {
            const surface::Patch& patch = lit.patches[side / 2];
            const glm::vec3 own = rules.emitters ? patch.sent() : glm::vec3(0.0f);
            for (int c = 0; c < 3; ++c)
                if (patch.albedo[c] > 0.0f)
                    irradiance[side][c] = std::max(0.0f, lit.luminance[side][c] - own[c])
                                          * float(std::numbers::pi) / patch.albedo[c];
        }
        seconds = since(begin);
    }

    /// As IndirectLookup.
    void operator()(std::span<const visibility::Hit> hits, std::span<glm::vec3> result) const {
        for (std::size_t i = 0; i < hits.size(); ++i) {
            visibility::Hit hit = hits[i];
            glm::vec2 weights;
            const uint32_t patch = lit.tree.find(hit, weights);
            if (patch == surface::PatchTree::none)
                continue;
            const glm::vec3 towards = hit.normal;
            hit.normal = lit.patches[patch].normal;
            const bool back = glm::dot(hit.normal, towards) < 0.0f;
            if (!lit.patches[patch].crossed
                || lit.side(hit, -towards) != surface::LitSurfaces::no_side)
                result[i] = irradiance[2 * patch + (back ? 1 : 0)];
        }
    }
};

/// Path-traced probes at the same cells. `setup` seconds come once, whatever the number of cells.
/// With `indirect` paths end at their first hit.
std::vector<PeerPoint> trace_peers(const Scene& scene, const Place& place, const GridResult& grid,
                                   std::span<const glm::vec3> points, double setup,
                                   const Truth& truth, const reference::IndirectLookup& indirect,
                                   const ReportSettings& settings, Progress& progress) {
    std::vector<PeerPoint> curve;
    progress.begin("", std::size(peer_rays_each) * std::size_t(settings.repeats));
    uint64_t done = 0;
    for (const uint32_t rays : peer_rays_each) {
        reference::PeerSettings peer;
        peer.paths = grid.rules;
        peer.sh_order = truth_order;
        peer.rays = rays;
        peer.seed = reference::join_bits(settings.seed, 1);
        peer.indirect = indirect;
        PeerPoint point;
        point.rays = rays;
        std::vector<std::vector<glm::vec3>> sh;
        uint64_t traced = 0;
        std::vector<double> seconds, measured;
        for (int repeat = 0; repeat < settings.repeats; ++repeat) {
            progress.advance(done++);
            const Clock::time_point begin = Clock::now();
            reference::PeerField field =
                reference::trace_peer(scene, place.visibility, place.frame, points, peer);
            sh = std::move(field.sh);
            traced = field.traced;
            measured.push_back(since(begin));
            seconds.push_back(setup + measured.back() * double(grid.valid) / double(grid.probes));
        }
        point.seconds = timing_of(seconds);
        point.measured = timing_of(measured).median;
        point.rays_per_second = double(traced) / point.measured;
        point.embree_rays_per_second =
            embree_rate(scene, place, points, peer, traced, settings.repeats);
        for (std::size_t i = 0; i < floor_orders.size(); ++i) {
            const CellErrors errors = errors_at_cells(sh, floor_orders[i], truth);
            point.error[i] = errors.error;
            point.projected[i] = errors.projected;
        }
        curve.push_back(point);
    }
    return curve;
}

/// Whether light is reflected more than once, so that probes may look up what surfaces share.
bool shares_bounces(const GridResult& grid) {
    return grid.rules.bounces != 0 && grid.rules.bounces != 1;
}

GridTruth trace_grid(const Scene& scene, GridResult& grid, const std::set<int>& orders,
                     const ReportSettings& settings, Progress& progress) {
    GridTruth kept;
    kept.drawn = draw_cells(scene, grid.grid, settings.probes, settings.seed);
    const Place& place = *kept.drawn.place;
    const double setup = kept.drawn.setup;
    grid.valid = kept.drawn.valid;
    grid.probes = kept.drawn.cells.size();
    kept.truth = trace_truth(scene, kept.drawn, grid.rules, settings.truth, progress);
    grid.noise = kept.truth.noise;
    grid.rays = kept.truth.rays;
    grid.converged = kept.truth.converged;
    grid.seconds = kept.truth.seconds;
    for (std::size_t i = 0; i < floor_orders.size(); ++i)
        grid.floor[i] =
            error_at_cells(kept.truth.sh, floor_orders[i], kept.truth.sh, kept.truth.irradiance);
    if (settings.peer) {
        Titled peer(progress, "peer ");
        grid.peer = trace_peers(scene, place, grid, kept.drawn.points, setup, kept.truth, {},
                                settings, peer);
        if (shares_bounces(grid)) {
            const SharedBounces bounces(scene, place, grid.rules);
            grid.sharing =
                trace_peers(scene, place, grid, kept.drawn.points, setup + bounces.seconds,
                            kept.truth, std::cref(bounces), settings, peer);
        }
    }
    if (settings.slices) {
        Titled slice(progress, "slice ");
        kept.layer = shown_layer(grid.grid);
        for (const int order : orders)
            if (auto layer =
                    trace_layer(scene, place.visibility, grid.grid, kept.drawn.validity, kept.layer,
                                order, grid.rules, settings.seed, kept.layer_rays, slice))
                kept.layers.emplace(order, std::move(*layer));
    }
    return kept;
}

/// Bakes `repeats` times, planning included; fills in the times and returns the last volume, and
/// its plan.
Volume bake_row(const Scene& scene, int repeats, const gpu::Device& device, RowResult& row,
                bake::BakePlan& plan, Progress& progress) {
    std::vector<double> seconds;
    std::vector<std::vector<double>> stages;
    Baked baked;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        const Clock::time_point begin = Clock::now();
        plan = bake::plan_bake(bake::survey(scene), row.row.settings, device.info());
        baked = bake::bake(scene, plan, device, progress);
        seconds.push_back(since(begin));
        stages.resize(baked.stages.size());
        for (std::size_t i = 0; i < stages.size(); ++i)
            stages[i].push_back(baked.stages[i].seconds);
    }
    row.seconds = timing_of(seconds);
    for (std::size_t i = 0; i < stages.size(); ++i)
        row.stages.push_back({baked.stages[i].name, timing_of(stages[i]), baked.stages[i].detail});
    row.warnings = baked.warnings;
    row.sh_order = baked.volume.sh_order;
    return std::move(baked.volume);
}

void measure_row(const Volume& volume, const GridTruth& truth, const SurfaceTruth& surfaces,
                 std::span<const readers::FitPoint> points, RowResult& row) {
    const CellErrors errors =
        errors_at_cells(coefficients_at(volume, truth.drawn.cells), volume.sh_order, truth.truth);
    row.error = errors.error;
    row.projected = errors.projected;
    if (!surfaces.points.empty()) {
        row.surface = surface_error(*readers::reader_named("lpvbake"), volume, surfaces);
        row.shown = shown_errors(volume, points, surfaces);
    }
}

/// The bake that surfaces show best, and what it is of.
struct BestOnSurfaces {
    double error = HUGE_VAL;
    Volume volume;
    bake::BakePlan plan;
    std::size_t row = 0;

    /// Takes the volume of a row that is better.
    void offer(Volume&& other, const bake::BakePlan& other_plan, const SceneReport& report,
               std::size_t i) {
        const std::optional<FieldError>& surface = report.rows[i].surface;
        if (!surface || !(surface->relative_l1 < error))
            return;
        error = surface->relative_l1;
        volume = std::move(other);
        plan = other_plan;
        row = i;
    }
};

Views views_of(const Scene& scene, const BestOnSurfaces& best, const reference::PathRules& rules,
               const SurfaceTruth& surfaces, const gpu::Device& device, Progress& progress) {
    const Place place(scene, best.plan.grid);
    FitPoints fit_points(scene, place);
    std::span<const readers::FitPoint> points;
    if (!best.volume.metadata.contains("fit"))
        points = fit_points.of(best.plan, progress);
    Views views = draw_views(
        scene, place.visibility, place.frame, rules, device, best.volume, points,
        [&](const readers::Reader& reader, const Volume& volume) {
            return surface_error(reader, volume, surfaces);
        },
        progress);
    views.row = best.row;
    return views;
}

/// Rows without results, and the grids that they are baked on.
void list_rows(const Scene& scene, const std::vector<SweepRow>& rows, const gpu::Device& device,
               SceneReport& report) {
    const bake::SceneFacts facts = bake::survey(scene);
    for (const SweepRow& row : rows) {
        const bake::BakePlan plan = bake::plan_bake(facts, row.settings, device.info());
        RowResult result;
        result.row = row;
        const reference::PathRules rules = field_rules(row.settings);
        const auto same = [&](const GridResult& g) {
            return g.grid == plan.grid && g.rules == rules;
        };
        const auto found = std::ranges::find_if(report.grids, same);
        result.grid = std::size_t(found - report.grids.begin());
        if (found == report.grids.end()) {
            report.grids.emplace_back();
            report.grids.back().grid = plan.grid;
            report.grids.back().rules = rules;
        }
        report.rows.push_back(std::move(result));
    }
}

/// Compares rows with each other and with the peer.
void rank(SceneReport& report) {
    std::vector<SpeedError> points;
    for (const RowResult& row : report.rows)
        points.push_back({row.seconds.median, row.error.relative_l1});
    const std::vector<bool> front = pareto_front(points);
    for (std::size_t i = 0; i < report.rows.size(); ++i) {
        RowResult& row = report.rows[i];
        row.front = front[i];
        const auto against = [&](const std::vector<PeerPoint>& peer) {
            std::vector<SpeedError> curve;
            for (const PeerPoint& point : peer)
                curve.push_back(
                    {point.seconds.median, point.projected[floor_index(row.sh_order)].relative_l1});
            return at_equal_error({row.seconds.median, row.projected.relative_l1}, curve);
        };
        row.peer = against(report.grids[row.grid].peer);
        row.sharing = against(report.grids[row.grid].sharing);
    }
}

} // namespace

Timing timing_of(std::vector<double> seconds) {
    std::ranges::sort(seconds);
    const std::size_t n = seconds.size();
    return {0.5 * (seconds[(n - 1) / 2] + seconds[n / 2]), seconds.front(), seconds.back()};
}

std::size_t floor_index(int order) {
    std::size_t i = 0;
    while (i + 1 < floor_orders.size() && floor_orders[i] < order)
        ++i;
    return i;
}

SceneReport measure_scene(const Scene& scene, const std::vector<SweepRow>& rows,
                          const ReportSettings& settings, const gpu::Device& device,
                          Progress& progress) {
    if (settings.peer)
        reference::check_peer(scene);
    SceneReport report;
    report.path = scene.path;
    report.triangles = scene::triangle_count(scene);
    report.warnings = scene.warnings;
    list_rows(scene, rows, device, report);
    if (report.rows.empty())
        return report;

    // Single precision is finest in the frame of the smallest cells.
    const auto finest =
        std::ranges::min_element(report.grids, {}, [](const GridResult& g) { return g.grid.cell; });
    Titled on_surfaces(progress, "surfaces: ");
    std::vector<std::pair<reference::PathRules, SurfaceTruth>> surfaces;
    for (const GridResult& grid : report.grids)
        if (std::ranges::none_of(surfaces, [&](const auto& s) { return s.first == grid.rules; }))
            surfaces.emplace_back(grid.rules,
                                  trace_surfaces(scene, finest->grid,
                                                 rows[0].settings.bounds.value_or(bounds_of(scene)),
                                                 grid.rules, settings, on_surfaces));
    report.surface_points = surfaces[0].second.points.size();
    report.surface_noise = surfaces[0].second.truth.noise;
    report.surface_rays = surfaces[0].second.truth.rays;

    const auto on_rules = [&](const reference::PathRules& rules) -> const SurfaceTruth& {
        return std::ranges::find_if(surfaces, [&](const auto& s) { return s.first == rules; })
            ->second;
    };
    BestOnSurfaces best_shown;
    std::size_t done = 0;
    for (std::size_t g = 0; g < report.grids.size(); ++g) {
        GridResult& grid = report.grids[g];
        std::set<int> orders;
        for (const RowResult& row : report.rows)
            if (row.grid == g)
                orders.insert(row.row.settings.solver.order());
        const SurfaceTruth& on_them = on_rules(grid.rules);
        Titled on_grid(progress, format("grid %zu/%zu: ", g + 1, report.grids.size()));
        const GridTruth truth = trace_grid(scene, grid, orders, settings, on_grid);
        if (!grid.converged)
            report.warnings.push_back(about(
                scene.path,
                format("the reference's noise on the grid of %d x %d x %d is still %.3g %%; raise "
                       "`rays`",
                       grid.grid.dims.x, grid.grid.dims.y, grid.grid.dims.z, 100 * grid.noise)));
        FitPoints fit_points(scene, *truth.drawn.place);
        std::optional<Volume> best;
        std::size_t best_row = 0;
        for (std::size_t i = 0; i < report.rows.size(); ++i) {
            RowResult& row = report.rows[i];
            if (row.grid != g)
                continue;
            Titled on_row(progress, format("row %zu/%zu: ", ++done, report.rows.size()));
            bake::BakePlan plan;
            Volume volume = bake_row(scene, settings.repeats, device, row, plan, on_row);
            std::span<const readers::FitPoint> points;
            if (!on_them.points.empty() && !volume.metadata.contains("fit"))
                points = fit_points.of(plan, on_row);
            measure_row(volume, truth, on_them, points, row);
            if (truth.layers.contains(row.sh_order)
                && (!best || row.error.relative_l1 < report.rows[best_row].error.relative_l1)) {
                best = layer_of(volume, truth.layer);
                best_row = i;
            }
            if (settings.views)
                best_shown.offer(std::move(volume), plan, report, i);
        }
        if (best) {
            grid.slices = draw_slices(*best, truth.layers.at(best->sh_order), truth.layer);
            grid.slices->index = truth.layer.index;
            grid.slices->row = best_row;
            grid.slices->rays = truth.layer_rays;
        }
    }
    if (std::isfinite(best_shown.error)) {
        const reference::PathRules& rules = report.grids[report.rows[best_shown.row].grid].rules;
        Titled on_views(progress, "views: ");
        report.views = views_of(scene, best_shown, rules, on_rules(rules), device, on_views);
    }
    rank(report);
    return report;
}

double expected_seconds(const Scene& scene, const std::vector<SweepRow>& rows,
                        const ReportSettings& settings, const gpu::Device& device,
                        Progress& progress) {
    SceneReport report;
    list_rows(scene, rows, device, report);
    if (report.rows.empty())
        return 0;
    double seconds = 0;
    const bake::SceneFacts facts = bake::survey(scene);
    for (const SweepRow& row : rows)
        seconds += settings.repeats * bake::plan_bake(facts, row.settings, device.info()).seconds;
    const DrawnCells drawn =
        draw_cells(scene, report.grids[0].grid, settings.probes, settings.seed);
    const TruthCost truth =
        truth_cost(scene, drawn, report.grids[0].rules, settings.truth, progress);
    std::vector<reference::PathRules> rules; // each of which has a truth on surfaces, too
    for (const GridResult& grid : report.grids) {
        if (std::ranges::find(rules, grid.rules) == rules.end())
            rules.push_back(grid.rules);
        if (settings.peer)
            for (const uint32_t rays : peer_rays_each)
                seconds += settings.repeats * double(rays) * double(drawn.cells.size()) * truth.path
                           * (shares_bounces(grid) ? 2 : 1);
    }
    return seconds + double(report.grids.size() + rules.size()) * truth.seconds;
}

namespace {

std::string equal_error_text(const char* who, const EqualError& equal) {
    switch (equal.kind) {
    case EqualError::Kind::crosses:
        return format("%s needs %.2g x as long", who, equal.factor);
    case EqualError::Kind::beyond:
        return format("%s needs over %.2g x as long", who, equal.factor);
    case EqualError::Kind::already:
        return format("%s is better at its fewest rays, in %.2g %s", who, equal.factor,
                      equal.factor <= 1 ? "of the time" : "x the time");
    }
    return "";
}

} // namespace

std::string ratio_text(const RowResult& row) {
    if (!row.peer)
        return "no peer";
    return equal_error_text("peer", *row.peer)
           + (row.sharing ? "; " + equal_error_text("sharing bounces it", *row.sharing) : "");
}

std::vector<std::string> verdicts(const SceneReport& scene) {
    struct Tally {
        int rows = 0, won = 0, lost = 0;
    };
    std::map<std::string, Tally> tallies; // by solver
    for (const RowResult& row : scene.rows) {
        if (!row.peer)
            continue;
        Tally& tally = tallies[row.row.settings.solver.kind().name];
        ++tally.rows;
        if (row.peer->factor <= 1)
            ++tally.lost;
        else if (row.peer->kind != EqualError::Kind::already)
            ++tally.won;
    }
    std::vector<std::string> all;
    for (const auto& [solver, tally] : tallies) {
        const int worse = tally.rows - tally.won - tally.lost;
        std::string text = solver + ": ";
        if (tally.lost == tally.rows)
            text += "loses everywhere: path-traced probes are as accurate in less time";
        else if (tally.won == tally.rows)
            text += "wins everywhere: path-traced probes need longer for the same error";
        else
            text += format("at the same error path-traced probes need longer in %s and less "
                           "time in %d; in %d they are more accurate at their fewest rays already, "
                           "but need longer for these",
                           counted(tally.won, "row").c_str(), tally.lost, worse);
        all.push_back(text + " (" + counted(tally.rows, "row") + ").");
    }
    return all;
}

} // namespace lpvbake::report
