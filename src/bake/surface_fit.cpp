#include "bake/surface_fit.h"

#include "text.h"
#include "volume/dering.h"
#include "volume/dilate.h"

#include <algorithm>

namespace lpvbake::bake {

namespace {

readers::FitPoint fit_point(const scene::Frame& frame, const surface::SidePoint& point,
                            double weight, glm::vec3 irradiance) {
    return {frame.to_world(glm::dvec3(point.position)), glm::normalize(glm::dvec3(point.normal)),
            weight, glm::dvec3(irradiance)};
}

/// Other points than those of the fit, by rays that are shared with none.
std::vector<readers::FitPoint> check_points(const Scene& scene, const surface::LitSurfaces& lit,
                                            const scene::Frame& frame, bool emitters,
                                            const SurfaceFitSettings& settings,
                                            Progress& progress) {
    const surface::SidePointSettings drawing{.most_points = settings.checks, .seed = 2};
    surface::SidePoints sides = surface::draw_side_points(lit, glm::vec3(frame.extent), drawing);
    std::vector<double> weights; // of what matters
    for (size_t i = 0; i < sides.points.size(); ++i)
        if (const double weight =
                double(sides.area[i]) * readers::openness_weight(double(sides.open[i]));
            weight > 0) {
            sides.points[weights.size()] = sides.points[i];
            weights.push_back(weight);
        }
    sides.points.resize(weights.size());
    const std::vector<glm::vec3> irradiance = surface::irradiance_at(
        scene, lit, frame, sides.points, emitters, settings.check_rays, drawing.seed, progress);
    std::vector<readers::FitPoint> points;
    for (size_t i = 0; i < weights.size(); ++i)
        points.push_back(fit_point(frame, sides.points[i], weights[i], irradiance[i]));
    return points;
}

bool any_light(const std::vector<readers::FitPoint>& points) {
    return std::ranges::any_of(
        points, [](const readers::FitPoint& point) { return point.irradiance != glm::dvec3(0.0); });
}

} // namespace

int rays_a_point(const SurfaceFitSettings& settings, double points) {
    return int(std::clamp(double(settings.rays) / std::max(points, 1.0), 16.0, 64.0));
}

std::vector<readers::FitPoint> fit_points(const Scene& scene, const surface::LitSurfaces& lit,
                                          const scene::Frame& frame, bool emitters,
                                          const SurfaceFitSettings& settings, Progress& progress) {
    const surface::SidePoints sides = surface::draw_side_points(
        lit, glm::vec3(frame.extent),
        {.density = settings.density, .most_points = settings.most_points, .looks = 0});
    const std::vector<surface::SideLight> light = surface::shared_irradiance_at(
        scene, lit, frame, sides.points, emitters,
        rays_a_point(settings, double(sides.points.size())), 1, progress);
    std::vector<readers::FitPoint> points;
    for (size_t i = 0; i < light.size(); ++i)
        if (const double weight =
                double(sides.area[i]) * readers::openness_weight(double(light[i].open));
            weight > 0)
            points.push_back(fit_point(frame, sides.points[i], weight, light[i].irradiance));
    return points;
}

SurfaceFit fit_to_points(const readers::Reader& reader, std::span<const readers::FitPoint> points,
                         std::span<const readers::FitPoint> checks,
                         const SurfaceFitSettings& settings, Volume& volume) {
    SurfaceFit result;
    volume::dilate(volume, settings.dilate);
    if (settings.dering && readers::shows_ringing(reader))
        volume::dering(volume, readers::order_of(reader, volume));
    result.before = readers::error_of(reader, volume, checks);
    result.fit = readers::fit(reader, points, settings.solve, volume);
    result.after = readers::error_of(reader, volume, checks);
    volume.metadata["fit"] = reader.name;
    volume.metadata["fit_error"] = format("%.3g", result.after.relative);
    volume.metadata["fit_energy"] = format("%.4g", result.after.energy);
    volume.metadata["fit_leak"] = format("%.3g", result.after.leak);
    volume.metadata["fit_moved"] = format("%.3g", result.fit.moved);
    return result;
}

SurfaceFit fit_to_surfaces(const Scene& scene, const surface::LitSurfaces& lit,
                           const scene::Frame& frame, bool emitters, const readers::Reader& reader,
                           const SurfaceFitSettings& settings, Volume& volume, Progress& progress) {
    const auto checks = check_points(scene, lit, frame, emitters, settings, progress);
    if (!any_light(checks))
        return {};
    const auto points = fit_points(scene, lit, frame, emitters, settings, progress);
    return fit_to_points(reader, points, checks, settings, volume);
}

} // namespace lpvbake::bake
