#include "scene/material.h"

#include "colour/colour.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::scene {
namespace {

/// Brings a coordinate near [0, 1] without changing what it samples, so that texel indices fit
/// whatever the file says.
float wrapped(float u, Wrap wrap) {
    if (!std::isfinite(u))
        return 0.0f;
    switch (wrap) {
    case Wrap::repeat:
        return u - std::floor(u);
    case Wrap::mirrored_repeat:
        return u - 2.0f * std::floor(0.5f * u);
    case Wrap::clamp_to_edge:
        return glm::clamp(u, 0.0f, 1.0f);
    }
    return 0.0f;
}

/// Index in [0, size) of a texel index in [-size, 3 size).
int wrapped(int i, int size, Wrap wrap) {
    switch (wrap) {
    case Wrap::repeat:
        return (i + size) % size;
    case Wrap::mirrored_repeat:
        i = (i + 2 * size) % (2 * size);
        return i < size ? i : 2 * size - 1 - i;
    case Wrap::clamp_to_edge:
        return glm::clamp(i, 0, size - 1);
    }
    return 0;
}

glm::vec4 texel(const Image& image, int x, int y) {
    const uint8_t* p = &image.rgba[4 * (static_cast<size_t>(y) * image.width + x)];
    const std::array<float, 256>& linear = colour::linear_values();
    return {linear[p[0]], linear[p[1]], linear[p[2]], p[3] / 255.0f};
}

template <typename T>
T interpolate(const std::vector<T>& values, glm::uvec3 corners, glm::vec2 barycentric) {
    return values[corners[0]] * (1.0f - barycentric.x - barycentric.y)
           + values[corners[1]] * barycentric.x + values[corners[2]] * barycentric.y;
}

glm::vec2 uv_at(const std::vector<glm::vec2>& uv, glm::uvec3 corners, glm::vec2 barycentric) {
    return uv.empty() ? glm::vec2(0.0f) : interpolate(uv, corners, barycentric);
}

} // namespace

glm::vec4 sample_texture(const Scene& scene, int texture_index, glm::vec2 uv) {
    const Texture& texture = scene.textures[texture_index];
    const Image& image = scene.images[texture.image];
    const float x = wrapped(uv.x, texture.wrap_u) * static_cast<float>(image.width);
    const float y = wrapped(uv.y, texture.wrap_v) * static_cast<float>(image.height);
    const auto fetch = [&](int column, int row) {
        return texel(image, wrapped(column, image.width, texture.wrap_u),
                     wrapped(row, image.height, texture.wrap_v));
    };
    if (texture.nearest)
        return fetch(static_cast<int>(x), static_cast<int>(y));
    const float left = std::floor(x - 0.5f), top = std::floor(y - 0.5f);
    const float right_share = x - 0.5f - left, lower_share = y - 0.5f - top;
    const int column = static_cast<int>(left), row = static_cast<int>(top);
    const glm::vec4 upper = glm::mix(fetch(column, row), fetch(column + 1, row), right_share);
    const glm::vec4 lower =
        glm::mix(fetch(column, row + 1), fetch(column + 1, row + 1), right_share);
    return glm::mix(upper, lower, lower_share);
}

SurfaceSample sample_surface(const Scene& scene, const Mesh& mesh, uint32_t triangle,
                             glm::vec2 barycentric) {
    const Material& material = scene.materials[mesh.material];
    const glm::uvec3 corners = mesh.triangles[triangle];
    glm::vec4 color = material.base_color;
    if (material.base_color_texture >= 0)
        color *= sample_texture(scene, material.base_color_texture,
                                uv_at(mesh.uv, corners, barycentric));
    if (!mesh.colors.empty())
        color *= interpolate(mesh.colors, corners, barycentric);
    SurfaceSample sample;
    sample.albedo =
        glm::clamp(glm::vec3(color), glm::vec3(0.0f), glm::vec3(scene.rules.max_albedo));
    if (material.alpha_mode == AlphaMode::mask)
        sample.coverage = color.a >= material.alpha_cutoff ? 1.0f : 0.0f;
    else if (material.alpha_mode == AlphaMode::blend)
        sample.coverage = glm::clamp(color.a, 0.0f, 1.0f);
    sample.alpha = sample.coverage * (1.0f - material.transmission);
    sample.color = glm::clamp(glm::vec3(color), 0.0f, 1.0f);
    return sample;
}

glm::vec3 SurfaceSample::tint(glm::vec3 attenuation) const {
    const float passing = 1.0f - alpha;
    if (!(passing > 0.0f))
        return glm::vec3(1.0f);
    const glm::vec3 ground = 1.0f - coverage * (1.0f - color); // white, under the coverage
    const float brightest = std::max({ground.x, ground.y, ground.z});
    const glm::vec3 hue = brightest > 0.0f ? ground / brightest : glm::vec3(1.0f);
    const float beside = (1.0f - coverage) / passing;
    const float through = std::max(coverage - alpha, 0.0f) / passing;
    return glm::clamp(1.0f - beside * (1.0f - hue) - through * (1.0f - color * attenuation), 0.0f,
                      1.0f);
}

glm::vec3 sample_emission(const Scene& scene, const Mesh& mesh, uint32_t triangle,
                          glm::vec2 barycentric) {
    const Material& material = scene.materials[mesh.material];
    glm::vec3 emission = material.emission;
    if (emission == glm::vec3(0.0f))
        return emission;
    if (material.emission_texture >= 0)
        emission *= glm::vec3(
            sample_texture(scene, material.emission_texture,
                           uv_at(mesh.uv_emission, mesh.triangles[triangle], barycentric)));
    if (is_partly_clear(material))
        emission *= sample_surface(scene, mesh, triangle, barycentric).alpha;
    return emission;
}

bool is_see_through(const Scene& scene, const Material& material) {
    return is_partly_clear(material) || (scene.rules.cull_backfaces && !material.double_sided);
}

bool is_tinting(const Scene& scene, const Mesh& mesh) {
    const Material& material = scene.materials[mesh.material];
    const bool white =
        material.base_color_texture < 0 && mesh.colors.empty()
        && glm::all(glm::greaterThanEqual(glm::vec3(material.base_color), glm::vec3(1.0f)));
    return is_veil(material)
           && (!white || (material.transmission > 0.0f && material.attenuation != glm::vec3(1.0f)));
}

glm::vec3 attenuation_of(const Scene& scene, const Instance& instance) {
    const glm::vec3 attenuation = scene.materials[scene.meshes[instance.mesh].material].attenuation;
    if (attenuation == glm::vec3(1.0f))
        return attenuation;
    const double scale = std::cbrt(std::abs(glm::determinant(glm::dmat3(instance.to_world))));
    return glm::vec3(glm::pow(glm::dvec3(attenuation), glm::dvec3(scale)));
}

} // namespace lpvbake::scene
