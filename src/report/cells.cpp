#include "report/cells.h"

#include "colour/colour.h"
#include "lpvbake/error.h"
#include "visibility/validity.h"
#include "volume/compare.h"

#include <algorithm>
#include <chrono>

namespace lpvbake::report {
namespace {

using Clock = std::chrono::steady_clock;

double since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

} // namespace

Place::Place(const Scene& scene, const Grid& grid)
    : frame(scene::frame_of(grid)),
      visibility(scene, frame) {}

DrawnCells draw_cells(const Scene& scene, const Grid& grid, uint64_t count, uint64_t seed) {
    const Clock::time_point begin = Clock::now();
    DrawnCells drawn;
    drawn.place = std::make_unique<const Place>(scene, grid);
    const visibility::Visibility& visibility = drawn.place->visibility;
    drawn.validity = visibility::trace_validity(visibility, grid.dims);
    drawn.setup = since(begin);
    drawn.valid = uint64_t(std::ranges::count(drawn.validity, 1.0f));
    drawn.cells = draw_cells(drawn.validity, count, seed);
    if (drawn.cells.empty())
        throw Error(ErrorKind::invalid,
                    scene.path + ": no cell of the grid has its centre outside geometry");
    for (const std::size_t cell : drawn.cells)
        drawn.points.push_back(visibility.capture(grid.cell_at(cell)).point);
    return drawn;
}

Truth trace_truth(const Scene& scene, const DrawnCells& drawn, const reference::PathRules& rules,
                  const TruthSettings& settings, Progress& progress) {
    return trace_truth(scene, drawn.place->visibility, drawn.place->frame, drawn.points, {}, rules,
                       settings, progress);
}

TruthCost truth_cost(const Scene& scene, const DrawnCells& drawn, const reference::PathRules& rules,
                     const TruthSettings& settings, Progress& progress) {
    TruthSettings few = settings;
    few.noise = 0;
    few.most_rays = 256;
    const Truth pilot = trace_truth(scene, drawn, rules, few, progress);
    const double more = std::max(1.0, pilot.noise / settings.noise);
    double passes = 1; // each doubles the rays
    while (passes < more * more && passes * double(pilot.rays) < double(settings.most_rays))
        passes *= 2;
    return {pilot.seconds * passes,
            pilot.seconds / (double(pilot.rays) * double(drawn.points.size()))};
}

FieldError error_at_cells(const std::vector<std::vector<glm::vec3>>& sh, int order,
                          const std::vector<std::vector<glm::vec3>>& true_sh,
                          std::span<const glm::dvec3> truth) {
    uint64_t negative = 0;
    FieldError error = error_of(irradiance_of(sh, order, &negative), truth);
    error.negative = negative;
    glm::dvec3 light{0.0}, true_light{0.0};
    for (const glm::vec3& c : sh[0])
        light += glm::dvec3(c);
    for (const glm::vec3& c : true_sh[0])
        true_light += glm::dvec3(c);
    const double whole = glm::dot(true_light, colour::rec709_luminance);
    if (whole > 0)
        error.energy_ratio = glm::dot(light, colour::rec709_luminance) / whole;
    return error;
}

CellErrors errors_at_cells(const std::vector<std::vector<glm::vec3>>& sh, int order,
                           const Truth& truth) {
    return {error_at_cells(sh, order, truth.sh, truth.irradiance),
            error_at_cells(sh, order, truth.sh, irradiance_of(truth.sh, order))};
}

std::vector<std::vector<glm::vec3>> coefficients_at(const Volume& volume,
                                                    std::span<const std::size_t> cells) {
    std::vector<std::vector<glm::vec3>> sh(volume.sh.size());
    for (std::size_t k = 0; k < sh.size(); ++k)
        for (const std::size_t cell : cells)
            sh[k].push_back(volume.sh[k][cell]);
    return sh;
}

} // namespace lpvbake::report
