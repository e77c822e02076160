#include "scene/surroundings.h"

#include "text.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace lpvbake::scene {
namespace {

/// Of the distance the square.
double distance2(const Bounds& a, const Bounds& b) {
    const glm::dvec3 apart = glm::max(glm::dvec3(0.0), glm::max(a.lo - b.hi, b.lo - a.hi));
    return glm::dot(apart, apart);
}

/// A box along a direction: its extent along two axes across it, and where it begins and ends.
Bounds along(const Bounds& box, glm::dvec3 direction) {
    const glm::dvec3 side = std::abs(direction.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
    const glm::dvec3 u = glm::normalize(glm::cross(side, direction));
    const glm::dvec3 v = glm::cross(direction, u);
    Bounds across;
    for (int corner = 0; corner < 8; ++corner) {
        const glm::dvec3 p(corner & 1 ? box.hi.x : box.lo.x, corner & 2 ? box.hi.y : box.lo.y,
                           corner & 4 ? box.hi.z : box.lo.z);
        const glm::dvec3 q(glm::dot(p, u), glm::dot(p, v), glm::dot(p, direction));
        across.lo = glm::min(across.lo, q);
        across.hi = glm::max(across.hi, q);
    }
    return across;
}

/// Whether a box may hold up beams on their way to another, both along() these.
bool stands_before(const Bounds& a, const Bounds& lit) {
    return a.lo.x <= lit.hi.x && lit.lo.x <= a.hi.x && a.lo.y <= lit.hi.y && lit.lo.y <= a.hi.y
           && a.lo.z <= lit.hi.z;
}

/// Takes out of `values` those that no index in `used` names; the new index of each.
template <class T>
std::vector<int> keep_used(std::vector<T>& values, const std::vector<bool>& used) {
    std::vector<int> index(values.size(), -1);
    std::size_t count = 0;
    for (std::size_t i = 0; i < values.size(); ++i)
        if (used[i]) {
            index[i] = int(count);
            if (count != i)
                values[count] = std::move(values[i]);
            ++count;
        }
    values.resize(count);
    return index;
}

} // namespace

std::string text_of(const Surroundings& around) {
    const auto& [lo, hi] = around.box;
    return format("%.17g;%.17g,%.17g,%.17g,%.17g,%.17g,%.17g", around.reach, lo.x, lo.y, lo.z, hi.x,
                  hi.y, hi.z);
}

std::optional<Surroundings> parse_surroundings(const std::string& text) {
    Surroundings around;
    auto& [lo, hi] = around.box;
    int end = 0;
    const int read = std::sscanf(text.c_str(), "%lf;%lf,%lf,%lf,%lf,%lf,%lf%n", &around.reach,
                                 &lo.x, &lo.y, &lo.z, &hi.x, &hi.y, &hi.z, &end);
    if (read != 7 || std::size_t(end) != text.size())
        return {};
    return around;
}

std::vector<glm::dvec3> directions_of(std::span<const Light> lights) {
    std::vector<glm::dvec3> directions;
    for (const Light& light : lights)
        if (light.type == LightType::directional)
            directions.push_back(glm::normalize(light.direction));
    return directions;
}

namespace {

std::vector<bool> emitting(const Scene& scene) {
    const std::vector<bool> emissive = emissive_materials(scene);
    std::vector<bool> emits;
    for (const Instance& instance : scene.instances)
        emits.push_back(emissive[std::size_t(scene.meshes[std::size_t(instance.mesh)].material)]);
    return emits;
}

} // namespace

Around::Around(const Scene& scene)
    : Around(instance_boxes(scene), emitting(scene), directions_of(scene.lights)) {}

Around::Around(std::vector<Bounds> boxes, std::vector<bool> emits,
               std::span<const glm::dvec3> directions)
    : boxes_(std::move(boxes)),
      emits_(std::move(emits)),
      directions_(directions.begin(), directions.end()) {
    for (const glm::dvec3 direction : directions_) {
        std::vector<Bounds>& seen = along_light_.emplace_back();
        for (const Bounds& box : boxes_)
            seen.push_back(along(box, direction));
    }
}

std::vector<std::size_t> Around::operator()(const Surroundings& around) const {
    const Bounds reached{around.box.lo - around.reach, around.box.hi + around.reach};
    std::vector<Bounds> lit;
    for (const glm::dvec3 direction : directions_)
        lit.push_back(along(reached, direction));
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
        const Bounds& box = boxes_[i];
        if (box.empty())
            continue;
        const glm::dvec3 size = box.hi - box.lo;
        const double near = std::max({around.reach, size.x, size.y, size.z});
        bool counts = emits_[i] || distance2(box, around.box) <= near * near;
        for (std::size_t light = 0; light < lit.size() && !counts; ++light)
            counts = stands_before(along_light_[light][i], lit[light]);
        if (counts)
            kept.push_back(i);
    }
    return kept;
}

Scene with_instances(const Scene& scene, std::span<const std::size_t> kept) {
    // A copy that lacks what is large of what is not kept.
    Scene light;
    light.path = scene.path;
    light.file = scene.file;
    light.textures = scene.textures;
    light.materials = scene.materials;
    light.instances = scene.instances;
    light.lights = scene.lights;
    light.cameras = scene.cameras;
    light.sky = scene.sky;
    light.rules = scene.rules;
    light.clamped_materials = scene.clamped_materials;
    light.warnings = scene.warnings;
    light.meshes.resize(scene.meshes.size());
    light.images.resize(scene.images.size());
    std::vector<bool> has_mesh(scene.meshes.size(), false);
    for (const std::size_t i : kept) {
        const auto mesh = std::size_t(scene.instances[i].mesh);
        if (has_mesh[mesh])
            continue;
        has_mesh[mesh] = true;
        light.meshes[mesh] = scene.meshes[mesh];
        const Material& material = scene.materials[std::size_t(scene.meshes[mesh].material)];
        for (const int texture : {material.base_color_texture, material.emission_texture})
            if (texture >= 0)
                if (const auto image = std::size_t(scene.textures[std::size_t(texture)].image);
                    light.images[image].width == 0)
                    light.images[image] = scene.images[image];
    }
    return with_instances(std::move(light), kept);
}

Scene with_instances(Scene&& scene, std::span<const std::size_t> kept) {
    std::vector<bool> is_kept(scene.instances.size(), false);
    for (const std::size_t i : kept)
        is_kept[i] = true;
    std::vector<std::size_t> before(scene.instances.size() + 1, 0); // how many are kept
    for (std::size_t i = 0; i < is_kept.size(); ++i)
        before[i + 1] = before[i] + is_kept[i];
    std::erase_if(scene.file.nodes, [&](SceneFile::Node& node) {
        node.begin = before[node.begin];
        node.end = before[node.end];
        return node.begin == node.end;
    });
    keep_used(scene.instances, is_kept);

    std::vector<bool> used(scene.meshes.size(), false);
    for (const Instance& instance : scene.instances)
        used[std::size_t(instance.mesh)] = true;
    const std::vector<int> meshes = keep_used(scene.meshes, used);
    for (Instance& instance : scene.instances)
        instance.mesh = meshes[std::size_t(instance.mesh)];

    used.assign(scene.materials.size(), false);
    for (const Mesh& mesh : scene.meshes)
        used[std::size_t(mesh.material)] = true;
    const std::vector<int> materials = keep_used(scene.materials, used);
    for (Mesh& mesh : scene.meshes)
        mesh.material = materials[std::size_t(mesh.material)];

    used.assign(scene.textures.size(), false);
    for (const Material& material : scene.materials)
        for (const int texture : {material.base_color_texture, material.emission_texture})
            if (texture >= 0)
                used[std::size_t(texture)] = true;
    const std::vector<int> textures = keep_used(scene.textures, used);
    for (Material& material : scene.materials)
        for (int* texture : {&material.base_color_texture, &material.emission_texture})
            if (*texture >= 0)
                *texture = textures[std::size_t(*texture)];

    used.assign(scene.images.size(), false);
    for (const Texture& texture : scene.textures)
        used[std::size_t(texture.image)] = true;
    const std::vector<int> images = keep_used(scene.images, used);
    for (Texture& texture : scene.textures)
        texture.image = images[std::size_t(texture.image)];
    return std::move(scene);
}

Scene within(Scene scene, const Surroundings& around) {
    const std::vector<std::size_t> kept = Around(scene)(around);
    return with_instances(std::move(scene), kept);
}

} // namespace lpvbake::scene
