// What a bake reads: meshes, materials, lights and cameras as plain values.
//
// SI units (metres, lux, candela, nits), linear Rec.709 RGB, right-handed, +Y up, as glTF 2.0 has
// them. A triangle's front is the side from which its vertices run counter-clockwise.
#pragma once

#include <glm/glm.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace lpvbake {

/// 8-bit RGBA texels, row-major from the top left as glTF's UV has it. Colour is sRGB-encoded,
/// alpha linear.
struct Image {
    std::string name;
    int width = 0;
    int height = 0;
    std::vector<uint8_t> rgba;
};

enum class Wrap { repeat, mirrored_repeat, clamp_to_edge };

/// An image with the way it is sampled.
struct Texture {
    int image = -1;
    Wrap wrap_u = Wrap::repeat;
    Wrap wrap_v = Wrap::repeat;
    bool nearest = false;
};

enum class AlphaMode { opaque, mask, blend };

/// Everything reflects as Lambert; what glTF says beyond that is not modelled.
struct Material {
    std::string name;
    glm::vec4 base_color{1.0f};
    int base_color_texture = -1; ///< index into Scene::textures, -1: none
    AlphaMode alpha_mode = AlphaMode::opaque;
    float alpha_cutoff = 0.5f;
    bool double_sided = false;
    glm::vec3 emission{0.0f};  ///< luminance, nits
    int emission_texture = -1; ///< multiplies `emission`
};

/// A triangle list with one material. Attributes that the file lacks are empty.
struct Mesh {
    std::string name;
    int material = 0; ///< index into Scene::materials, always valid
    std::vector<glm::vec3> positions;
    std::vector<glm::vec3> normals; ///< shading normals, for pictures; light uses the triangle's
    std::vector<glm::vec2> uv;      ///< for the base colour texture
    std::vector<glm::vec2> uv_emission; ///< for the emission texture
    std::vector<glm::vec4> colors;      ///< linear, multiplies the base colour
    std::vector<glm::uvec3> triangles;  ///< indices below positions.size()
};

/// A mesh placed in the world. A transform of negative determinant keeps the front the front:
/// whoever applies it turns the winding.
struct Instance {
    int mesh = 0;
    glm::dmat4 to_world{1.0};
};

enum class LightType { directional, point, spot };

/// A punctual light in world space, in the terms of KHR_lights_punctual.
struct Light {
    LightType type = LightType::directional;
    std::string name;
    glm::vec3 color{1.0f};          ///< linear RGB, multiplies `intensity`
    double intensity = 1.0;         ///< lux facing the light (directional), candela (point, spot)
    glm::dvec3 position{0.0};       ///< metres
    glm::dvec3 direction{0, 0, -1}; ///< unit vector in which the light travels (directional, spot)
    double range = 0.0;             ///< metres; 0: unlimited
    double inner_cone = 0.0;        ///< radians from the axis
    double outer_cone = 0.785398163397448; ///< radians from the axis
};

/// A perspective camera in world space, looking along -Z of its frame.
struct Camera {
    std::string name;
    glm::dmat4 to_world{1.0};
    double yfov = 0.8;   ///< radians
    double aspect = 0.0; ///< width / height; 0: the picture's
};

/// How materials are read where glTF leaves a choice or physics a limit.
struct MaterialRules {
    float max_albedo = 0.95f;    ///< reflectance is clamped to this, a channel at a time
    bool metallic_black = false; ///< strict PBR: metal has no diffuse reflection
    bool cull_backfaces = false; ///< light passes the back of single-sided surfaces
};

struct SkyMap;

/// What surrounds the scene; its functions are in sky.h.
struct Sky {
    glm::vec3 luminance{0.0f}; ///< nits, the same from everywhere, unless there is a map
    std::shared_ptr<const SkyMap> map;
};

/// What a scene's file says of itself, beyond what is taken from it.
struct SceneFile {
    struct Animation {
        std::string name;
        double duration = 0.0; ///< seconds
    };
    std::string generator; ///< the program that wrote it
    std::vector<std::string> extensions_used;
    std::vector<std::string> extensions_required;
    std::vector<std::string> scenes; ///< names, by index; empty where there is none
    std::vector<std::string> variants;
    std::vector<Animation> animations;
};

struct Scene {
    std::string path;
    SceneFile file;
    std::vector<Image> images;
    std::vector<Texture> textures;
    std::vector<Material> materials;
    std::vector<Mesh> meshes;
    std::vector<Instance> instances;
    std::vector<Light> lights;
    std::vector<Camera> cameras;
    Sky sky;
    MaterialRules rules;
    std::vector<std::string> warnings; ///< one line each: file, place, what, remedy
};

/// Axis-aligned box in world space, metres. Empty while lo > hi.
struct Bounds {
    glm::dvec3 lo{1e300};
    glm::dvec3 hi{-1e300};
    bool empty() const { return lo.x > hi.x; }
};

/// The box around all placed triangles.
Bounds bounds_of(const Scene& scene);

/// The box that is left when, along each axis, the share `share` of the placed triangles that reach
/// lowest and the share that reach highest are left out; on a raster of 1/1024 of the bounds.
Bounds trimmed_bounds(const Scene& scene, double share);

/// Number of placed triangles (instances counted as often as they are placed).
uint64_t triangle_count(const Scene& scene);

/// True if any placed surface has an emission above zero.
bool has_emitters(const Scene& scene);

/// True if the sky is not black.
bool has_sky(const Scene& scene);

} // namespace lpvbake
