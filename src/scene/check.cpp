#include "lpvbake/error.h"
#include "scene/lights.h"
#include "scene/scene.h"

#include <cmath>
#include <string>

namespace lpvbake::scene {
namespace {

/// "meshes[3].material".
std::string at(const char* array, std::size_t index, const char* member = "") {
    return std::string(array) + "[" + std::to_string(index) + "]" + member;
}

void require(bool ok, const std::string& place, const char* what) {
    if (!ok)
        throw Error(ErrorKind::argument, place + ": " + what);
}

void check_index(int index, int least, std::size_t size, const std::string& place) {
    if (index < least || (index >= 0 && std::size_t(index) >= size))
        throw Error(ErrorKind::argument, place + ": index " + std::to_string(index)
                                             + " is out of range: there are "
                                             + std::to_string(size));
}

bool is_finite(glm::vec3 v) {
    return std::isfinite(v.x + v.y + v.z);
}

bool is_finite(const glm::dmat4& m) {
    double sum = 0;
    for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 4; ++row)
            sum += m[column][row];
    return std::isfinite(sum);
}

void check_mesh(const Scene& scene, std::size_t i) {
    const Mesh& mesh = scene.meshes[i];
    check_index(mesh.material, 0, scene.materials.size(), at("meshes", i, ".material"));
    const std::size_t vertices = mesh.positions.size();
    const auto fits = [&](const auto& attribute) {
        return attribute.empty() || attribute.size() == vertices;
    };
    require(fits(mesh.normals) && fits(mesh.uv) && fits(mesh.uv_emission) && fits(mesh.colors),
            at("meshes", i), "has an attribute of another number of vertices than positions");
    for (const glm::vec3 position : mesh.positions)
        require(is_finite(position), at("meshes", i, ".positions"), "not finite");
    for (const glm::uvec3 t : mesh.triangles)
        require(t.x < vertices && t.y < vertices && t.z < vertices, at("meshes", i, ".triangles"),
                "an index is out of range");
}

} // namespace

void check_scene(const Scene& scene) {
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
        const Image& image = scene.images[i];
        require(image.width >= 0 && image.height >= 0
                    && image.rgba.size()
                           == 4 * std::size_t(image.width) * std::size_t(image.height),
                at("images", i, ".rgba"), "is not width x height x 4 bytes");
    }
    for (std::size_t i = 0; i < scene.textures.size(); ++i) {
        const int image = scene.textures[i].image;
        check_index(image, 0, scene.images.size(), at("textures", i, ".image"));
        require(!scene.images[std::size_t(image)].rgba.empty(), at("textures", i, ".image"),
                "has no texels");
    }
    for (std::size_t i = 0; i < scene.materials.size(); ++i) {
        const Material& material = scene.materials[i];
        check_index(material.base_color_texture, -1, scene.textures.size(),
                    at("materials", i, ".base_color_texture"));
        check_index(material.emission_texture, -1, scene.textures.size(),
                    at("materials", i, ".emission_texture"));
    }
    for (std::size_t i = 0; i < scene.meshes.size(); ++i)
        check_mesh(scene, i);
    for (std::size_t i = 0; i < scene.instances.size(); ++i) {
        check_index(scene.instances[i].mesh, 0, scene.meshes.size(), at("instances", i, ".mesh"));
        require(is_finite(scene.instances[i].to_world), at("instances", i, ".to_world"),
                "not finite");
    }
    for (std::size_t i = 0; i < scene.lights.size(); ++i)
        check_light(scene.lights[i], at("lights", i));
    const glm::vec3 nits = scene.sky.luminance;
    require(is_finite(nits) && nits.x >= 0 && nits.y >= 0 && nits.z >= 0, "sky.luminance",
            "is negative or not finite");
    require(scene.rules.max_albedo >= 0 && scene.rules.max_albedo <= 1, "rules.max_albedo",
            "is not from 0 to 1");
}

} // namespace lpvbake::scene
