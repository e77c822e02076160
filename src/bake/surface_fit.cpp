#include "bake/surface_fit.h"

#include "scene/scene.h"
#include "text.h"
#include "volume/dering.h"
#include "volume/dilate.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::bake {

namespace {

/// Adds what of static lights arrives at points.
void add_statics(const Scene& scene, const surface::LitSurfaces& lit, const scene::Frame& frame,
                 std::span<const surface::SidePoint> points, const medium::BeamSettings& settings,
                 std::span<glm::vec3> irradiance) {
    if (scene::static_names(scene).empty())
        return;
    tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t i) {
        irradiance[i] += medium::static_illuminance(scene.lights, *lit.visibility, frame,
                                                    points[i].position, points[i].normal, settings);
    });
}

/// Other points than those of the fit, by their area alone and by rays that are shared with none.
std::vector<readers::FitPoint> check_points(const Scene& scene, const surface::LitSurfaces& lit,
                                            const scene::Frame& frame, bool emitters,
                                            const SurfaceFitSettings& settings,
                                            Progress& progress) {
    const surface::SidePointSettings drawing{.most_points = settings.checks, .seed = 2};
    const surface::SidePoints sides =
        surface::draw_side_points(lit, glm::vec3(frame.extent), drawing);
    std::vector<glm::vec3> irradiance = surface::irradiance_at(
        scene, lit, sides.points, emitters, settings.check_rays, drawing.seed, progress);
    add_statics(scene, lit, frame, sides.points, settings.statics, irradiance);
    auto points = weighed_points(frame, sides, irradiance);
    for (size_t i = 0; i < points.size(); ++i)
        points[i].weight = double(sides.area[i]);
    return points;
}

/// Turns points of a frame that begins where the grid does, whatever the grid's turn, as that is.
void turn(const Grid& grid, std::vector<readers::FitPoint>& points) {
    for (readers::FitPoint& point : points) {
        point.position = grid.origin + grid.turn * (point.position - grid.origin);
        point.normal = grid.turn * point.normal;
    }
}

} // namespace

std::vector<readers::FitPoint> weighed_points(const scene::Frame& frame,
                                              const surface::SidePoints& sides,
                                              std::span<const glm::vec3> irradiance) {
    std::vector<readers::FitPoint> points;
    for (size_t i = 0; i < sides.points.size(); ++i)
        points.push_back({frame.to_world(glm::dvec3(sides.points[i].position)),
                          glm::normalize(glm::dvec3(sides.points[i].normal)),
                          double(sides.area[i]) * readers::openness_weight(double(sides.open[i])),
                          irradiance.empty() ? glm::dvec3(0.0) : glm::dvec3(irradiance[i])});
    return points;
}

bool any_light(std::span<const readers::FitPoint> points) {
    return std::ranges::any_of(
        points, [](const readers::FitPoint& point) { return point.irradiance != glm::dvec3(0.0); });
}

int rays_a_point(const SurfaceFitSettings& settings, double points) {
    return int(std::clamp(double(settings.rays) / std::max(points, 1.0), 16.0, 64.0));
}

std::vector<readers::FitPoint> fit_points(const Scene& scene, const surface::LitSurfaces& lit,
                                          const scene::Frame& frame, bool emitters,
                                          const SurfaceFitSettings& settings, Progress& progress) {
    surface::SidePoints sides = surface::draw_side_points(
        lit, glm::vec3(frame.extent),
        {.density = settings.density, .most_points = settings.most_points, .looks = 0});
    const std::vector<surface::SideLight> light = surface::shared_irradiance_at(
        scene, lit, sides.points, emitters, rays_a_point(settings, double(sides.points.size())), 1,
        progress);
    std::vector<glm::vec3> irradiance;
    for (size_t i = 0; i < light.size(); ++i) {
        sides.open[i] = light[i].open;
        irradiance.push_back(light[i].irradiance);
    }
    add_statics(scene, lit, frame, sides.points, settings.statics, irradiance);
    return weighed_points(frame, sides, irradiance);
}

SurfaceFit fit_to_points(const readers::Reader& reader, std::span<const readers::FitPoint> points,
                         std::span<const readers::FitPoint> checks,
                         const SurfaceFitSettings& settings, Volume& volume) {
    SurfaceFit result;
    volume::dilate(volume, settings.dilate);
    if (settings.dering && readers::shows_ringing(reader))
        volume::dering(volume, readers::order_of(reader, volume));
    result.before = readers::error_of(reader, volume, checks);
    result.fit =
        readers::fit(reader, points, settings.solve, volume, checks.empty() ? points : checks);
    result.after = readers::error_of(reader, volume, checks);
    volume.metadata["fit"] = reader.name;
    if (!readers::is_linear(reader))
        volume.metadata["fit_evaluation"] = readers::name_of(reader.evaluation);
    volume.metadata["fit_error"] = format("%.3g", result.after.relative);
    volume.metadata["fit_energy"] = format("%.4g", result.after.energy);
    volume.metadata["fit_leak"] = format("%.3g", result.after.leak);
    volume.metadata["fit_moved"] = format("%.3g", result.fit.moved);
    const readers::WorstPlace worst = readers::worst_place(reader, volume, points);
    const glm::dvec3 at = worst.position;
    volume.metadata["fit_worst"] = format("%.3g", worst.error);
    volume.metadata["fit_worst_at"] = format("%.5g,%.5g,%.5g", at.x, at.y, at.z);
    return result;
}

SurfaceFit fit_to_surfaces(const Scene& scene, const surface::LitSurfaces& lit,
                           const scene::Frame& frame, bool emitters, const readers::Reader& reader,
                           const SurfaceFitSettings& settings, Volume& volume, Progress& progress) {
    auto checks = check_points(scene, lit, frame, emitters, settings, progress);
    if (!any_light(checks))
        return {};
    auto points = fit_points(scene, lit, frame, emitters, settings, progress);
    if (volume.grid.is_turned()) {
        turn(volume.grid, checks);
        turn(volume.grid, points);
    }
    SurfaceFit result = fit_to_points(reader, points, checks, settings, volume);
    result.contested = find_contested(reader, volume, points, *lit.visibility);
    volume.metadata["fit_contested"] = format("%.3g", result.contested.share);
    volume.metadata["fit_cell"] = format("%.4g", result.contested.cell);
    return result;
}

} // namespace lpvbake::bake
