#include "bake/pilot.h"

#include "bake/lighting.h"
#include "mix_word.h"
#include "solver/gather/gather.h"
#include "solver/gather/kind.h"
#include "solver/models.h"
#include "surface/lit_surfaces.h"
#include "visibility/around.h"
#include "visibility/capture.h"
#include "visibility/visibility.h"
#include "volume/compare.h"
#include "volume/sh.h"
#include "volume/volume.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <set>
#include <vector>

namespace lpvbake::bake {
namespace {

constexpr int order = 4;
constexpr int many_clusters = 1536;
constexpr int edge = 8; ///< of a zone, cells: those that `gather` gives the same clusters
constexpr std::size_t most_zones = 64;
constexpr std::size_t most_open = 2048; ///< cells that are looked at by few clusters
constexpr std::size_t most_cells = 256; ///< and by many
/// That it is expected to take of two threads, whatever there are: what is chosen goes by the
/// pilot. Else the Cornell box has to do.
constexpr double most_seconds = 30;
constexpr uint32_t most_rounds = 16; ///< through all zones, a cell in each eighth of each

/// The zones that are looked at, drawn by their number alone.
std::vector<glm::ivec3> draw_zones(glm::ivec3 dims) {
    std::vector<glm::ivec3> zones;
    for (int z = 0; z < dims.z; z += edge)
        for (int y = 0; y < dims.y; y += edge)
            for (int x = 0; x < dims.x; x += edge)
                zones.emplace_back(x, y, z);
    const std::size_t count = std::min(zones.size(), most_zones);
    for (std::size_t i = 0; i < count; ++i)
        std::swap(zones[i], zones[i + mix_word(uint32_t(i)) % (zones.size() - i)]);
    zones.resize(count);
    return zones;
}

/// Centres of a cell in each eighth of each zone; another round draws others.
std::vector<glm::vec3> draw_cells(const std::vector<glm::ivec3>& zones, glm::ivec3 dims,
                                  uint32_t round) {
    std::vector<glm::vec3> centres;
    for (uint32_t i = 0; i < 8 * zones.size(); ++i) {
        const uint32_t word = mix_word(mix_word(round + 1) ^ i);
        glm::ivec3 cell = zones[i / 8];
        for (int axis = 0; axis < 3; ++axis)
            cell[axis] += int(i >> axis & 1) * (edge / 2) + int((word >> 8 * axis) % (edge / 2));
        if (glm::all(glm::lessThan(cell, dims)))
            centres.push_back(glm::vec3(cell) + 0.5f);
    }
    return centres;
}

Volume empty_volume(std::size_t cells) {
    Volume volume;
    volume.grid.dims = {int(cells), 1, 1};
    volume.validity.assign(cells, 1.0f);
    return volume;
}

/// Cells outside geometry.
std::vector<glm::vec3> draw_open_cells(glm::ivec3 dims, const visibility::Visibility& visibility) {
    const std::vector<glm::ivec3> zones = draw_zones(dims);
    std::vector<glm::vec3> open;
    std::set<std::array<float, 3>> seen;
    for (uint32_t round = 0; round < most_rounds && open.size() < most_open; ++round) {
        const std::vector<glm::vec3> cells = draw_cells(zones, dims, round);
        std::vector<char> outside(cells.size());
        tbb::parallel_for(std::size_t(0), cells.size(), [&](std::size_t i) {
            const visibility::Capture capture = visibility.capture_at(cells[i]);
            outside[i] =
                capture.open && visibility::backs_around(visibility, capture.point, 0) <= 0;
        });
        for (std::size_t i = 0; i < cells.size() && open.size() < most_open; ++i)
            if (outside[i] && seen.insert({cells[i].x, cells[i].y, cells[i].z}).second)
                open.push_back(cells[i]);
    }
    return open;
}

/// Some of the cells, by their index, and how many each stands for.
struct Sample {
    std::vector<std::size_t> cells;
    std::vector<double> stands_for;
};

/// Draws by the light in them, so that one beside a lamp is not missed, by even steps (systematic
/// sampling; Madow 1949).
Sample draw_by_light(const Volume& light) {
    std::vector<double> size(light.sh[0].size());
    double sum = 0;
    for (std::size_t i = 0; i < size.size(); ++i)
        sum += size[i] = std::max(0.0, double(glm::dot(light.sh[0][i], glm::vec3(1.0f))));
    const double even =
        0.25 * sum / double(size.size()); // for those that seem darker than they are
    Sample sample;
    const double step = 1.25 * sum / double(most_cells);
    double next = 0.5 * step, end = 0;
    for (std::size_t i = 0; i < size.size(); ++i) {
        end += size[i] + even;
        int times = 0;
        for (; next < end; next += step)
            ++times;
        if (times == 0)
            continue;
        sample.cells.push_back(i);
        sample.stands_for.push_back(times * step / (size[i] + even));
    }
    return sample;
}

Volume up_to(const Volume& volume, int highest) {
    Volume some = volume;
    some.sh_order = highest;
    some.sh.resize(std::size_t(volume::sh_count(highest)));
    return some;
}

template <class T>
std::vector<T> some_of(const std::vector<T>& all, const std::vector<std::size_t>& wanted) {
    std::vector<T> some;
    for (const std::size_t i : wanted)
        some.push_back(all[i]);
    return some;
}

Volume at_cells(const Volume& volume, const std::vector<std::size_t>& wanted) {
    Volume some = empty_volume(wanted.size());
    some.sh_order = volume.sh_order;
    for (const std::vector<glm::vec3>& coefficient : volume.sh)
        some.sh.push_back(some_of(coefficient, wanted));
    return some;
}

/// Relative L1 of irradiance over all cells that the sample stands for.
double lost(const Volume& some, const Volume& all, const Sample& sample) {
    Volume none = all;
    for (std::vector<glm::vec3>& coefficient : none.sh)
        std::ranges::fill(coefficient, glm::vec3(0.0f));
    const auto sum = [&](const Volume& a) {
        const std::vector<float> errors = volume::compare(a, all, {}).cell_error;
        double total = 0;
        for (std::size_t i = 0; i < errors.size(); ++i)
            total += sample.stands_for[i] * double(errors[i]);
        return total;
    };
    return sum(some) / sum(none);
}

} // namespace

BakePlan plan_pilot(const SceneFacts& facts, const BakeSettings& settings,
                    const gpu::DeviceInfo& device) {
    BakeSettings pilot = settings;
    pilot.solver = solver::SolverSettings(solver::gather::gather_kind);
    pilot.solver.set(pilot.solver.kind().ladder.front());
    pilot.solver.set_order(order);
    pilot.solver.set("vpls", many_clusters + solver::more_clusters + solver::few_clusters);
    pilot.fit = nullptr;
    pilot.points = most_cells;
    // What no points have: beams of static lights, and air.
    pilot.direct = {};
    pilot.medium.reset();
    pilot.scattering.reset();
    SceneFacts looked_at = facts;
    for (Light& light : looked_at.lights)
        light.is_static = false;
    return plan_bake(looked_at, pilot, device);
}

std::optional<solver::Pilot> run_pilot(const Scene& scene, const BakePlan& plan,
                                       const gpu::Device& device, Progress& progress) {
    if (plan.seconds > most_seconds * solver::models::seconds::of_threads(plan.threads))
        return std::nullopt;
    const visibility::Visibility visibility(scene, plan.frame, plan.settings.isa);
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, plan.frame, lighting_of(plan), progress);
    const auto gather = [&](const std::vector<glm::vec3>& cells, int clusters, int highest) {
        Volume volume = empty_volume(cells.size());
        solver::gather::GatherSettings settings_at;
        settings_at.order = highest;
        settings_at.vpls = clusters;
        solver::gather::GatherProgram(device, settings_at)
            .gather_at(cells, lit, scene.sky, visibility, volume, progress);
        return volume;
    };
    const std::vector<glm::vec3> open = draw_open_cells(plan.grid.dims, visibility);
    if (open.empty())
        return std::nullopt;
    const Volume rough = gather(open, solver::few_clusters, 2);
    if (volume::total_energy(rough) == 0.0)
        return std::nullopt;
    const Sample sample = draw_by_light(rough);
    const std::vector<glm::vec3> cells = some_of(open, sample.cells);
    const Volume all = gather(cells, many_clusters, order), two = up_to(all, 2);
    return solver::Pilot{{lost(up_to(all, 1), all, sample), lost(two, all, sample)},
                         {lost(at_cells(rough, sample.cells), two, sample),
                          lost(gather(cells, solver::more_clusters, 2), two, sample)}};
}

void add_pilot(const Scene& scene, const SceneFacts& facts, const BakeSettings& settings,
               const gpu::Device& device, Progress& progress, Wish& wish) {
    if (!wish.error || settings.points > 0)
        return;
    const BakePlan plan = plan_pilot(facts, settings, device.info());
    wish.pilot = run_pilot(scene, plan, device, progress);
    wish.pilot_seconds = wish.pilot ? plan.seconds : 0;
}

} // namespace lpvbake::bake
