#include "scene/scene_hash.h"

#include "file_error.h"
#include "lpvbake/error.h"
#include "scene/sky.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
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

} // namespace

std::string scene_hash(const Scene& scene) {
    Hash hash;
    for (const Image& image : scene.images) {
        hash.add(image.width, image.height);
        hash.add(image.rgba);
    }
    for (const Texture& texture : scene.textures)
        hash.add(texture.image, texture.wrap_u, texture.wrap_v, texture.nearest);
    for (const Material& material : scene.materials)
        hash.add(material.base_color, material.base_color_texture, material.alpha_mode,
                 material.alpha_cutoff, material.transmission, material.attenuation,
                 material.double_sided, material.emission, material.emission_texture);
    for (const Mesh& mesh : scene.meshes) {
        hash.add(mesh.material);
        hash.add(mesh.positions);
        hash.add(mesh.uv);
        hash.add(mesh.uv_emission);
        hash.add(mesh.colors);
        hash.add(mesh.triangles);
    }
    for (const Instance& instance : scene.instances) {
        hash.add(instance.mesh, instance.to_world);
        if (instance.role != Role::full)
            hash.add(instance.role);
    }
    for (const Light& light : scene.lights)
        hash.add(light.type, light.color, light.intensity, light.position, light.direction,
                 light.range, light.inner_cone, light.outer_cone);
    hash.add(scene.sky.luminance);
    if (scene.sky.map) {
        hash.add(scene.sky.map->width, scene.sky.map->height, scene.sky.map->turn);
        hash.add(scene.sky.map->texels);
    }
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
