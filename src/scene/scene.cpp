#include "scene/scene.h"

#include "scene/roles.h"
#include "scene/sky.h"

#include <glm/gtc/type_precision.hpp>

#include <algorithm>

#include <fnmatch.h>

namespace lpvbake::scene {
namespace {

/// Vertices that some triangle uses, each once.
std::vector<uint32_t> used_vertices(const Mesh& mesh) {
    std::vector<bool> used(mesh.positions.size());
    for (const glm::uvec3& triangle : mesh.triangles)
        for (int corner = 0; corner < 3; ++corner)
            used[triangle[corner]] = true;
    std::vector<uint32_t> indices;
    for (uint32_t i = 0; i < used.size(); ++i)
        if (used[i])
            indices.push_back(i);
    return indices;
}

/// Whether the scene's box is that of a role's surfaces.
class Bounded {
public:
    explicit Bounded(const Scene& scene) : all_(!any_of_role(scene, is_asked)) {}
    bool operator()(const Instance& instance) const { return all_ || is_asked(instance.role); }

private:
    bool all_;
};

bool emits(const Scene& scene, const Material& material) {
    if (material.emission_texture < 0)
        return glm::any(glm::greaterThan(material.emission, glm::vec3(0.0f)));
    const Image& image = scene.images[scene.textures[material.emission_texture].image];
    for (size_t texel = 0; texel < image.rgba.size(); texel += 4)
        for (int channel = 0; channel < 3; ++channel)
            if (material.emission[channel] > 0.0f && image.rgba[texel + channel] > 0)
                return true;
    return false;
}

} // namespace

Bounds trimmed_bounds(const Scene& scene, double share) {
    constexpr int bins = 1024;
    const Bounds bounds = bounds_of(scene);
    if (bounds.empty())
        return bounds;
    const glm::dvec3 bin_size = (bounds.hi - bounds.lo) / double(bins);
    const glm::dvec3 scale = 1.0 / glm::max(bin_size, glm::dvec3(1e-300));
    // How many triangles start and how many end in each bin of each axis.
    std::vector<glm::u64vec3> starts(bins), ends(bins);
    const Bounded is_bounded(scene);
    uint64_t triangles = 0;
    for (const Instance& instance : scene.instances) {
        if (!is_bounded(instance))
            continue;
        const Mesh& mesh = scene.meshes[instance.mesh];
        triangles += mesh.triangles.size();
        std::vector<glm::ivec3> bin_of;
        for (const glm::vec3& position : mesh.positions) {
            const glm::dvec3 p(instance.to_world * glm::dvec4(position, 1.0));
            bin_of.emplace_back(
                glm::clamp((p - bounds.lo) * scale, glm::dvec3(0.0), glm::dvec3(bins - 1)));
        }
        for (const glm::uvec3& t : mesh.triangles)
            for (int axis = 0; axis < 3; ++axis) {
                const auto [low, high] =
                    std::minmax({bin_of[t.x][axis], bin_of[t.y][axis], bin_of[t.z][axis]});
                ++starts[low][axis];
                ++ends[high][axis];
            }
    }
    const auto cut = uint64_t(share * double(triangles));
    Bounds trimmed;
    for (int axis = 0; axis < 3; ++axis) {
        int low = 0, high = bins - 1;
        for (uint64_t left_out = starts[low][axis]; left_out <= cut && low < bins - 1;)
            left_out += starts[++low][axis];
        for (uint64_t left_out = ends[high][axis]; left_out <= cut && high > 0;)
            left_out += ends[--high][axis];
        trimmed.lo[axis] = bounds.lo[axis] + low * bin_size[axis];
        trimmed.hi[axis] = bounds.lo[axis] + (high + 1) * bin_size[axis];
    }
    return trimmed;
}

std::vector<Bounds> instance_boxes(const Scene& scene) {
    std::vector<std::vector<uint32_t>> used(scene.meshes.size());
    std::vector<Bounds> boxes;
    boxes.reserve(scene.instances.size());
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[instance.mesh];
        Bounds& box = boxes.emplace_back();
        if (mesh.triangles.empty())
            continue;
        std::vector<uint32_t>& vertices = used[instance.mesh];
        if (vertices.empty())
            vertices = used_vertices(mesh);
        for (const uint32_t vertex : vertices) {
            const glm::dvec3 p(instance.to_world * glm::dvec4(mesh.positions[vertex], 1.0));
            box.lo = glm::min(box.lo, p);
            box.hi = glm::max(box.hi, p);
        }
    }
    return boxes;
}

Bounds union_of(std::span<const Bounds> boxes) {
    Bounds all;
    for (const Bounds& box : boxes) {
        all.lo = glm::min(all.lo, box.lo);
        all.hi = glm::max(all.hi, box.hi);
    }
    return all;
}

Scene turned(const Scene& scene, const glm::dmat3& rotation, glm::dvec3 about) {
    Scene result = scene;
    glm::dmat4 motion(rotation);
    motion[3] = glm::dvec4(about - rotation * about, 1);
    for (Instance& instance : result.instances)
        instance.to_world = motion * instance.to_world;
    for (Camera& camera : result.cameras)
        camera.to_world = motion * camera.to_world;
    for (Light& light : result.lights) {
        light.position = glm::dvec3(motion * glm::dvec4(light.position, 1));
        light.direction = rotation * light.direction;
    }
    result.sky = turned_sky(scene.sky, rotation);
    return result;
}

uint64_t triangle_count(const Scene& scene) {
    uint64_t count = 0;
    for (const Instance& instance : scene.instances)
        count += scene.meshes[instance.mesh].triangles.size();
    return count;
}

std::vector<std::string> static_names(const Scene& scene) {
    std::vector<std::string> names;
    for (const Light& light : scene.lights)
        if (light.is_static)
            names.push_back(light.name);
    return names;
}

bool has_sky(const Scene& scene) {
    return scene.sky.map ? !scene.sky.map->cumulative.empty()
                         : scene.sky.luminance != glm::vec3(0.0f);
}

bool has_reflectors(const Scene& scene) {
    for (const Instance& instance : scene.instances) {
        if (!reflects(instance.role))
            continue;
        const Mesh& mesh = scene.meshes[instance.mesh];
        const Material& material = scene.materials[mesh.material];
        glm::vec3 albedo = scene.rules.max_albedo * glm::vec3(material.base_color);
        glm::vec3 vertex(mesh.colors.empty() ? 1.0f : 0.0f);
        for (const glm::vec4& color : mesh.colors)
            vertex = glm::max(vertex, glm::vec3(color));
        albedo *= vertex;
        if (material.base_color_texture >= 0) {
            const Image& image = scene.images[scene.textures[material.base_color_texture].image];
            for (int channel = 0; channel < 3; ++channel) {
                uint8_t most = 0;
                for (size_t i = channel; i < image.rgba.size(); i += 4)
                    most = std::max(most, image.rgba[i]);
                albedo[channel] *= most;
            }
        }
        if (!mesh.triangles.empty() && albedo != glm::vec3(0.0f))
            return true;
    }
    return false;
}

bool fits_pattern(const std::string& name, const std::string& pattern) {
    return fnmatch(pattern.c_str(), name.c_str(), 0) == 0;
}

const char* name_of(Role role) {
    switch (role) {
    case Role::full:
        return "full";
    case Role::receive_only:
        return "receive-only";
    case Role::cast_only:
        return "cast-only";
    case Role::lights_only:
        return "lights-only";
    }
    return "";
}

std::vector<bool> emissive_materials(const Scene& scene) {
    std::vector<bool> placed(scene.materials.size());
    for (const Instance& instance : scene.instances)
        if (const Mesh& mesh = scene.meshes[instance.mesh];
            !mesh.triangles.empty() && shines(instance.role))
            placed[mesh.material] = true;
    for (size_t i = 0; i < placed.size(); ++i)
        placed[i] = placed[i] && emits(scene, scene.materials[i]);
    return placed;
}

bool has_emitters(const Scene& scene) {
    return std::ranges::count(emissive_materials(scene), true) > 0;
}

} // namespace lpvbake::scene

namespace lpvbake {

Bounds bounds_of(const Scene& scene) {
    const scene::Bounded is_bounded(scene);
    std::vector<Bounds> boxes = scene::instance_boxes(scene);
    for (size_t i = 0; i < boxes.size(); ++i)
        if (!is_bounded(scene.instances[i]))
            boxes[i] = {};
    return scene::union_of(boxes);
}

} // namespace lpvbake
