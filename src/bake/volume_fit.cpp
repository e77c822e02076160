#include "bake/volume_fit.h"

#include "surface/lit_surfaces.h"
#include "visibility/tangents.h"
#include "visibility/visibility.h"

#include <tbb/parallel_for.h>

#include <cmath>

namespace lpvbake::bake {
namespace {

void read_by_own_sampler(const Volume& volume, std::vector<readers::FitPoint>& points) {
    const readers::Reader& own = *readers::reader_named("lpvbake");
    tbb::parallel_for(size_t(0), points.size(), [&](size_t i) {
        points[i].irradiance =
            readers::irradiance(own, volume, points[i].position, points[i].normal);
    });
}

/// Whether x, from a cell's centre, lies before all of its walls but one.
bool is_before_others(const Volume& volume, size_t cell, size_t own, glm::vec3 x) {
    for (size_t k = 0; k < volume.walls.size(); ++k)
        if (const glm::vec3 w = volume.walls[k][cell];
            k != own && w != glm::vec3(0.0f) && glm::dot(x, w) > glm::dot(w, w))
            return false;
    return true;
}

/// along * along points on each wall, nearest to each valid cell.
std::vector<readers::FitPoint> points_on_walls(const Volume& volume, int along) {
    std::vector<readers::FitPoint> points;
    for (size_t cell = 0; cell < volume.grid.size(); ++cell) {
        if (!volume.is_valid(cell))
            continue;
        const glm::dvec3 centre = glm::dvec3(volume.grid.cell_at(cell)) + 0.5;
        for (size_t k = 0; k < volume.walls.size(); ++k) {
            const glm::vec3 w = volume.walls[k][cell];
            const float distance = glm::length(w);
            if (!(distance > 0.0f))
                continue;
            // Of the cells in a row before a wall the nearest, whose column cuts a piece of it.
            const glm::vec3 normal = -w / distance, parts = glm::abs(normal);
            if (distance > parts.x + parts.y + parts.z)
                continue;
            const double face = 1 / double(std::max({parts.x, parts.y, parts.z}));
            const auto [u, v] = visibility::tangents_of(normal);
            for (int i = 0; i < along * along; ++i) {
                const float a = float(i % along) / float(along) - 0.25f * float(along - 1),
                            b = float(i / along) / float(along) - 0.25f * float(along - 1);
                const glm::vec3 x = w + a * u + b * v;
                if (is_before_others(volume, cell, k, x))
                    points.push_back({volume.grid.to_world(centre + glm::dvec3(x)),
                                      glm::normalize(volume.grid.turn * glm::dvec3(normal)),
                                      face / (along * along),
                                      {}});
            }
        }
    }
    read_by_own_sampler(volume, points);
    return points;
}

std::vector<readers::FitPoint> points_on_sides(const surface::LitSurfaces& surfaces,
                                               const scene::Frame& frame, const Volume& volume,
                                               const surface::SidePointSettings& settings) {
    auto points = weighed_points(
        frame, surface::draw_side_points(surfaces, glm::vec3(frame.extent), settings), {});
    read_by_own_sampler(volume, points);
    return points;
}

} // namespace

SurfacePoints wall_points(const Volume& volume) {
    return {points_on_walls(volume, 2), points_on_walls(volume, 1)};
}

SurfacePoints scene_points(Scene scene, const Volume& volume, Progress& progress) {
    scene.lights.clear(); // its surfaces alone count
    scene.sky = {};
    const scene::Frame frame = scene::frame_of(volume.grid);
    const visibility::Visibility visibility(scene, frame);
    surface::LightingSettings dark;
    dark.bounces = 0;
    dark.emitters = false;
    const surface::LitSurfaces surfaces =
        surface::light_surfaces(scene, visibility, frame, dark, progress);
    return {points_on_sides(surfaces, frame, volume, {}),
            points_on_sides(surfaces, frame, volume, {.most_points = 2000, .seed = 2})};
}

} // namespace lpvbake::bake
