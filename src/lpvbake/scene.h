// What a bake reads: meshes, materials, lights and cameras as plain values, from files or your own.
//
// SI units (metres, lux, candela, nits), linear Rec.709 RGB, right-handed, +Y up, as glTF 2.0 has
// them. A triangle's front is the side from which its vertices run counter-clockwise.
#pragma once

#include "lpvbake/export.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <memory>
#include <optional>
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
    float transmission =
        0.0f; ///< share of what is covered that passes, filtered by the base colour
    glm::vec3 attenuation{1.0f}; ///< what of that the thickness leaves, of an instance of scale 1
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

/// What a placed mesh does to light, and whether light is wanted on it.
enum class Role {
    full,
    receive_only, ///< light passes it and none comes from it
    cast_only,    ///< black, and no place where light is wanted
    lights_only,  ///< its emission lights; light passes it; no place where light is wanted
};

/// A mesh placed in the world. A transform of negative determinant keeps the front the front:
/// whoever applies it turns the winding.
struct Instance {
    int mesh = 0;
    glm::dmat4 to_world{1.0};
    Role role = Role::full;
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
    bool is_static = false; ///< the field holds its direct light, too, so that nobody adds it
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

/// What surrounds the scene. A map comes from load_sky.
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
    /// A node that has a name. What it and the nodes below it place are the instances [begin, end).
    struct Node {
        std::string name;
        size_t begin = 0;
        size_t end = 0;
    };
    /// What a node that LoadSettings::boxes fits bounds: its mesh or, without one, a unit cube
    /// around its origin.
    struct Box {
        std::string name; ///< empty: it has none
        glm::dvec3 lo{-0.5}, hi{0.5};
        glm::dmat4 to_world{1.0};
        std::optional<double> cell, priority, falloff; ///< numbers of these names in its extras
    };
    std::string generator; ///< the program that wrote it
    std::vector<std::string>
        beside; ///< absolute paths of the files beside it that were read, sorted
    std::vector<std::string> extensions_used;
    std::vector<std::string> extensions_required;
    std::vector<std::string> scenes; ///< names, by index; empty where there is none
    std::vector<std::string> variants;
    std::vector<Animation> animations;
    std::vector<Node> nodes; ///< of the scene that was taken, but for those that place nothing
    std::vector<Box> boxes;  ///< in the scene's order, of hidden and excluded nodes too
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
    size_t clamped_materials = 0; ///< brighter than `rules.max_albedo`, of textures by their mean
    std::vector<std::string> warnings; ///< one line each: file, place, what, remedy
};

/// Axis-aligned box in world space, metres. Empty while lo > hi.
struct Bounds {
    glm::dvec3 lo{1e300};
    glm::dvec3 hi{-1e300};
    bool empty() const { return lo.x > hi.x; }
};

/// The box around all placed triangles on which light is wanted; where it is on none, around all.
LPVBAKE_API Bounds bounds_of(const Scene& scene);

/// Which surfaces have a role. The pattern is one of the shell (fnmatch): a name of a node, which
/// stands for all below it, of a mesh or of a material; of one of them alone as "node:GLOB",
/// "mesh:GLOB", "material:GLOB"; or "extras:KEY" and "extras:KEY=GLOB", what they have in `extras`.
struct RoleRule {
    std::string pattern;
    std::optional<Role> role = {}; ///< none: they are not loaded, nor lights of such nodes
};

/// What of a file is taken, and how much it may cost. Scenes, animations and variants go by name
/// or, where no name fits, by index.
struct LoadSettings {
    MaterialRules rules = {};
    std::string scene = {};           ///< empty: the file's default, else its first
    std::string animation = {};       ///< empty: none, or the first where there is a time
    std::optional<double> time = {};  ///< seconds; none: 0 where there is an animation
    std::string variant = {};         ///< of KHR_materials_variants; empty: the default materials
    std::vector<RoleRule> roles = {}; ///< of several that fit the last; a warning where none fits
    bool strict = false;              ///< a warning is an error
    bool allow_external = false;      ///< URIs may leave the scene's folder
    bool skip_colors = false; ///< images that do nothing but colour surfaces have a size alone
    uint64_t max_memory = uint64_t{4} << 30; ///< bytes that loading may take
    /// A pattern as RoleRule's, of nodes that bound volumes (SceneFile::boxes); empty: none do.
    std::string boxes = {};
};

/// The path of a scene that is read from standard input, with its buffers and images embedded.
inline constexpr const char* standard_input = "-";

/// Loads a file, or what comes on `standard_input`. Errors carry the file, the JSON path, what is
/// wrong and the remedy: file (unreadable), invalid (broken, or a warning under `strict`),
/// unsupported (a required extension that is not understood), argument (there is no such scene,
/// animation or variant), memory (past `max_memory`). What is left out or understood only in part
/// is named in Scene::warnings.
LPVBAKE_API Scene load_gltf(const std::string& path, const LoadSettings& settings = {});

/// Reads {"lights": [{"type": "directional"|"point"|"spot", "color": [r, g, b], "intensity": x,
/// "range": m, "spot": {"innerConeAngle": rad, "outerConeAngle": rad}, "position": [x, y, z],
/// "direction": [x, y, z], "name": "..."}]}: the extension's properties, and position and direction
/// (of travel) in place of a node. A spot whose inner angle is the outer one, or past it by
/// rounding, has a hard edge and gives a warning. Throws Error (file, invalid) with the JSON path.
LPVBAKE_API std::vector<Light> load_lights(const std::string& path,
                                           std::vector<std::string>& warnings);

/// Reads an equirectangular picture, of any format that OpenImageIO knows, whose values times
/// `scale` are nits: the middle of the picture stands at +X, its left end at -X, and -Z halfway
/// between them, turned by `turn` degrees around +Y, counter-clockwise from above. Texels that are
/// negative or not finite, or above 1e12 nits, count as 0 and give a warning, as does a picture
/// that is not twice as wide as high. Throws Error (file, invalid; also for more than `max_bytes`
/// once it is unpacked).
LPVBAKE_API Sky load_sky(const std::string& path, std::vector<std::string>& warnings,
                         double scale = 1, double turn = 0, uint64_t max_bytes = uint64_t{4} << 30);

} // namespace lpvbake
