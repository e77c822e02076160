#include "solver/vpl/lit_vpls.h"

#include "scene/sky.h"
#include "surface/cutting.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::vpl {
namespace {

/// Directions of equal cosine-weighted solid angle around +z: rings of 4, 8 and 12.
std::vector<glm::vec3> portal_directions() {
    std::vector<glm::vec3> directions;
    int before = 0;
    for (const int count : {4, 8, 12}) {
        const float square = (float(before) + 0.5f * float(count)) / 24.0f;
        for (int i = 0; i < count; ++i) {
            const float angle = glm::two_pi<float>() * (float(i) + 0.5f) / float(count);
            directions.push_back({std::sqrt(square) * std::cos(angle),
                                  std::sqrt(square) * std::sin(angle), std::sqrt(1.0f - square)});
        }
        before += count;
    }
    return directions;
}

/// More than a cell away from all levels.
bool is_beside(glm::vec3 point, const scene::Frame& frame) {
    return surface::distance_to_box(point, glm::vec3(frame.extent)) > 1.0f
           && std::ranges::all_of(frame.coarser, [&](const scene::CoarserBox& level) {
                  return glm::distance(point, glm::clamp(point, level.lo, level.hi)) > level.cell;
              });
}

} // namespace

void emit_vpls(const surface::LitSurfaces& surfaces, const scene::Frame& frame,
               std::vector<Vpl>& vpls) {
    for (size_t i = 0; i < surfaces.luminance.size(); ++i) {
        const surface::Patch& patch = surfaces.patches[i / 2];
        const glm::vec3 luminance = surfaces.luminance[i];
        if (luminance == glm::vec3(0.0f))
            continue;
        const double area = double(patch.area) * double(patch.alpha) * frame.unit * frame.unit;
        if (!(area > 0.0))
            continue;
        // The four halves of its halves: a patch is as large as a cell, and may lie before several.
        static constexpr glm::vec2 parts[] = {{1.0f / 6.0f, 1.0f / 6.0f},
                                              {2.0f / 3.0f, 1.0f / 6.0f},
                                              {1.0f / 6.0f, 2.0f / 3.0f},
                                              {1.0f / 3.0f, 1.0f / 3.0f}};
        const double quarter = 0.25 * glm::pi<double>() * area;
        const glm::vec3 power{quarter * glm::dvec3(luminance)};
        std::vector<glm::vec3> layers;
        for (size_t layer = 0; layer < surfaces.layer_count; ++layer)
            layers.emplace_back(quarter
                                * glm::dvec3(surfaces.layers[surfaces.layer_count * i + layer]));
        const glm::vec3 normal = i % 2 ? -patch.normal : patch.normal;
        if (is_beside(patch.position, frame)) {
            for (glm::vec3& layer : layers)
                layer *= 4.0f;
            vpls.push_back({patch.position, normal, 4.0f * power, layers});
            continue;
        }
        for (const glm::vec2 part : parts)
            vpls.push_back(
                {patch.crossed ? patch.position : patch.at(part), normal, power, layers});
    }
}

void sky_vpls(const Sky& sky, const visibility::Visibility& visibility, const scene::Frame& frame,
              std::vector<Vpl>& vpls, Sides sides, std::span<const scene::LightLayer> layers) {
    static const std::vector<glm::vec3> directions = portal_directions();
    const glm::ivec3 dims(frame.extent);
    const double power = glm::pi<double>() * frame.unit * frame.unit;
    for (int side = 0; side < 6; ++side) {
        if (!(sides >> side & 1))
            continue;
        const int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        const float outward = side % 2 ? -1.0f : 1.0f;
        std::vector<Vpl> faces(size_t(dims[u]) * size_t(dims[v]));
        tbb::parallel_for(size_t(0), faces.size(), [&](size_t i) {
            Vpl& face = faces[i];
            face.position[axis] = outward > 0.0f ? float(dims[axis]) : 0.0f;
            face.position[u] = float(i % size_t(dims[u])) + 0.5f;
            face.position[v] = float(i / size_t(dims[u])) + 0.5f;
            face.normal = glm::vec3(0.0f);
            face.normal[axis] = -outward;
            glm::vec3 sum{0.0f};
            for (const glm::vec3& d : directions) {
                glm::vec3 towards;
                towards[axis] = outward * d.z;
                towards[u] = d.x;
                towards[v] = d.y;
                sum += visibility.filter({face.position, towards, 0.0f, HUGE_VALF})
                       * scene::sky_rest(sky, towards);
            }
            face.power = sum * float(power / double(directions.size()));
            for (const Light& sun : scene::sky_suns(sky)) {
                const glm::vec3 towards(-sun.direction);
                if (towards[axis] * outward > 0.0f)
                    face.power += float(frame.unit * frame.unit) * towards[axis] * outward
                                  * sun.color
                                  * visibility.filter({face.position, towards, 0.0f, HUGE_VALF});
            }
        });
        for (Vpl& face : faces) {
            if (face.power == glm::vec3(0.0f))
                continue;
            for (const scene::LightLayer& layer : layers)
                face.layers.push_back(layer.sky * face.power);
            vpls.push_back(std::move(face));
        }
    }
}

} // namespace lpvbake::solver::vpl
