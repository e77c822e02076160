#include "bake/surface_fit.h"

#include "text.h"
#include "volume/dering.h"
#include "volume/dilate.h"

#include <algorithm>

namespace lpvbake::bake {

std::vector<readers::FitPoint> fit_points(const Scene& scene, const surface::LitSurfaces& lit,
                                          const scene::Frame& frame, bool emitters,
                                          const surface::SidePointSettings& settings, int rays,
                                          Progress& progress) {
    surface::SidePoints sides = surface::draw_side_points(lit, glm::vec3(frame.extent), settings);
    size_t kept = 0; // what matters
    for (size_t i = 0; i < sides.points.size(); ++i)
        if (const double weight =
                double(sides.area[i]) * readers::openness_weight(double(sides.open[i]));
            weight > 0) {
            sides.points[kept] = sides.points[i];
            sides.area[kept++] = float(weight);
        }
    sides.points.resize(kept);
    const std::vector<glm::vec3> irradiance = surface::irradiance_at(
        scene, lit, frame, sides.points, emitters, rays, settings.seed, progress);
    std::vector<readers::FitPoint> points(kept);
    for (size_t i = 0; i < kept; ++i)
        points[i] = {frame.to_world(glm::dvec3(sides.points[i].position)),
                     glm::normalize(glm::dvec3(sides.points[i].normal)), double(sides.area[i]),
                     glm::dvec3(irradiance[i])};
    return points;
}

namespace {

bool any_light(const std::vector<readers::FitPoint>& points) {
    return std::ranges::any_of(
        points, [](const readers::FitPoint& point) { return point.irradiance != glm::dvec3(0.0); });
}

} // namespace

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
    const auto checks =
        fit_points(scene, lit, frame, emitters, {.most_points = settings.checks, .seed = 2},
                   settings.check_rays, progress);
    if (!any_light(checks))
        return {};
    const auto points =
        fit_points(scene, lit, frame, emitters,
                   {.density = settings.density, .most_points = settings.most_points},
                   settings.rays, progress);
    return fit_to_points(reader, points, checks, settings, volume);
}

} // namespace lpvbake::bake
