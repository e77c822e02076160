#include "scene/scene_hash.h"

#include "file_error.h"
#include "lpvbake/error.h"
#include "scene/sky.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <numeric>
#include <string_view>
#include <type_traits>

namespace lpvbake::scene {
namespace {

/// FNV-1a by 8-byte words, the tail padded with zeros; every range is led by its length.
class Hash {
public:
    template <class T>
    void add(const std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T>);
        word(values.size());
        bytes(values.data(), values.size() * sizeof(T));
    }
    void add_text(std::string_view text) {
        word(text.size());
        bytes(text.data(), text.size());
    }
    /// Values without padding only.
    template <class... T>
    void add(const T&... values) {
        static_assert((std::is_trivially_copyable_v<T> && ...));
        (bytes(&values, sizeof values), ...);
    }
    uint64_t value() const { return state_; }
    /// 16 hexadecimal digits.
    std::string text() const {
        char digits[17];
        std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(state_));
        return digits;
    }

private:
    void word(uint64_t w) { state_ = (state_ ^ w) * 0x100000001b3u; }
    void bytes(const void* data, std::size_t count) {
        const auto* from = static_cast<const char*>(data);
        for (; count >= 8; from += 8, count -= 8) {
            uint64_t w;
            std::memcpy(&w, from, 8);
            word(w);
            state_ ^= state_ >> 32; // a multiplication alone never carries high bits down
        }
        uint64_t tail = 0;
        if (count > 0)
            std::memcpy(&tail, from, count);
        word(tail);
    }

    uint64_t state_ = 0xcbf29ce484222325u;
};

/// Of each instance, with or without emission.
std::vector<uint64_t> instance_hashes(const Scene& scene, bool emission) {
    std::vector<uint64_t> images, textures, materials, meshes;
    for (const Image& image : scene.images) {
        Hash hash;
        hash.add(image.width, image.height);
        hash.add(image.rgba);
        images.push_back(hash.value());
    }
    for (const Texture& texture : scene.textures) {
        Hash hash;
        hash.add(images[std::size_t(texture.image)], texture.wrap_u, texture.wrap_v,
                 texture.nearest);
        textures.push_back(hash.value());
    }
    const auto of_texture = [&](int texture) {
        return texture < 0 ? uint64_t(0) : textures[std::size_t(texture)];
    };
    for (const Material& material : scene.materials) {
        Hash hash;
        hash.add(material.base_color, of_texture(material.base_color_texture), material.alpha_mode,
                 material.alpha_cutoff, material.transmission, material.attenuation,
                 material.double_sided);
        if (emission)
            hash.add(material.emission, of_texture(material.emission_texture));
        materials.push_back(hash.value());
    }
    for (const Mesh& mesh : scene.meshes) {
        Hash hash;
        hash.add(materials[std::size_t(mesh.material)]);
        hash.add(mesh.positions);
        hash.add(mesh.uv);
        hash.add(mesh.uv_emission);
        hash.add(mesh.colors);
        hash.add(mesh.triangles);
        meshes.push_back(hash.value());
    }
    std::vector<uint64_t> instances;
    for (const Instance& instance : scene.instances) {
        Hash hash;
        hash.add(meshes[std::size_t(instance.mesh)], instance.to_world, instance.role);
        instances.push_back(hash.value());
    }
    return instances;
}

} // namespace

SceneParts parts_of(const Scene& scene) {
    SceneParts parts;
    parts.instances = instance_hashes(scene, true);
    Hash hash;
    for (const Light& light : scene.lights)
        hash.add(light.type, light.color, light.intensity, light.position, light.direction,
                 light.range, light.inner_cone, light.outer_cone);
    hash.add(scene.sky.luminance);
    if (scene.sky.map) {
        hash.add(scene.sky.map->width, scene.sky.map->height, scene.sky.map->turn);
        hash.add(scene.sky.map->texels);
    }
    hash.add(scene.rules.max_albedo, scene.rules.metallic_black, scene.rules.cull_backfaces);
    parts.others = hash.value();
    return parts;
}

std::string scene_hash(const SceneParts& parts, std::span<const std::size_t> kept) {
    Hash hash;
    for (const std::size_t i : kept)
        hash.add(parts.instances[i]);
    hash.add(parts.others);
    return hash.text();
}

std::string scene_hash(const Scene& scene) {
    const SceneParts parts = parts_of(scene);
    std::vector<std::size_t> all(parts.instances.size());
    std::iota(all.begin(), all.end(), std::size_t(0));
    return scene_hash(parts, all);
}

std::string surfaces_hash(const Scene& scene) {
    Hash hash;
    hash.add(instance_hashes(scene, false));
    hash.add(scene.rules.max_albedo, scene.rules.metallic_black, scene.rules.cull_backfaces);
    return hash.text();
}

std::string file_hash(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::array<char, 1 << 16> part;
    Hash hash;
    while (file) {
        file.read(part.data(), part.size());
        hash.add_text(std::string_view(part.data(), std::size_t(file.gcount())));
    }
    if (!file.eof())
        throw Error(kind_of_file_error(errno), path + ": cannot be read: " + std::strerror(errno));
    return hash.text();
}

std::string text_hash(std::span<const std::string> texts) {
    Hash hash;
    for (const std::string& text : texts)
        hash.add_text(text);
    return hash.text();
}

} // namespace lpvbake::scene
