// The whole way of a glTF file into a scene, but for the decoding of images.
//
// The first byte of the input chooses settings and form: a file as it is, or JSON and, after a byte
// of 0, the binary chunk, around which a whole .glb is made; so that changes of length do not end
// at the header.
#include "fuzz.h"

#include "image/header.h"
#include "image/image.h"
#include "lpvbake/pack.h"
#include "lpvbake/scene.h"
#include "scene/lights.h"
#include "scene/material.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace lpvbake::image {

/// In place of the image module, whose libraries are not ours: any texels of the size in the
/// header.
Rgba8 decode_image(std::span<const std::byte> data, const std::string& name, uint64_t max_texels) {
    const ImageHeader header = read_image_header(data);
    if (!header.format || header.texels() == 0 || header.texels() > std::min(max_texels, 1ul << 20))
        throw Error(ErrorKind::invalid, name + ": the image cannot be decoded");
    Rgba8 image{static_cast<int>(header.texels()), 1, {}};
    image.texels.resize(4 * header.texels());
    for (size_t i = 0; i < image.texels.size(); ++i)
        image.texels[i] = std::to_integer<uint8_t>(data[i % data.size()]);
    return image;
}

} // namespace lpvbake::image

namespace lpvbake {
namespace {

using fuzz::require;

enum Form : uint8_t { as_it_is = 1, posed = 2, varied = 4, strict = 8, black_metal = 16 };

std::string word(size_t value) {
    const auto number = static_cast<uint32_t>(value);
    std::string bytes(4, '\0');
    std::memcpy(bytes.data(), &number, 4);
    return bytes;
}

std::string binary_file(std::string_view input) {
    const size_t end = std::min(input.find('\0'), input.size());
    const std::string_view json = input.substr(0, end);
    const std::string_view chunk = input.substr(std::min(end + 1, input.size()));
    return "glTF" + word(2) + word(28 + json.size() + chunk.size()) + word(json.size()) + "JSON"
           + std::string(json) + word(chunk.size()) + std::string("BIN\0", 4) + std::string(chunk);
}

template <class Attributes>
void require_none_or_all(const Attributes& values, const Mesh& mesh) {
    require(values.empty() || values.size() == mesh.positions.size(),
            "an attribute has a value a vertex, or none");
}

/// What the rest of the program takes for granted.
void check(const Scene& scene) {
    const auto within = [](int index, size_t size) { return index >= -1 && index < int(size); };
    for (const Image& image : scene.images)
        fuzz::require(image.width > 0 && image.height > 0
                          && image.rgba.size() == size_t{4} * image.width * image.height,
                      "an image has the texels of its size");
    for (const Texture& texture : scene.textures)
        fuzz::require(texture.image >= 0 && within(texture.image, scene.images.size()),
                      "a texture has an image");
    for (const Material& material : scene.materials) {
        fuzz::require(within(material.base_color_texture, scene.textures.size())
                          && within(material.emission_texture, scene.textures.size()),
                      "a material's textures are there");
        for (int i = 0; i < 4; ++i)
            fuzz::require(material.base_color[i] >= 0 && std::isfinite(material.base_color[i]),
                          "a base colour is finite and not negative");
        for (int i = 0; i < 3; ++i)
            fuzz::require(material.emission[i] >= 0 && std::isfinite(material.emission[i]),
                          "an emission is finite and not negative");
    }
    for (const Mesh& mesh : scene.meshes) {
        fuzz::require(size_t(mesh.material) < scene.materials.size(), "a mesh has a material");
        require_none_or_all(mesh.normals, mesh);
        require_none_or_all(mesh.uv, mesh);
        require_none_or_all(mesh.uv_emission, mesh);
        require_none_or_all(mesh.colors, mesh);
        for (const glm::vec3 p : mesh.positions)
            fuzz::require(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z),
                          "positions are finite");
        for (const glm::vec3 n : mesh.normals)
            fuzz::require(std::abs(glm::length(n) - 1.0f) < 1e-3f, "normals are of length 1");
        for (const glm::uvec3 t : mesh.triangles)
            fuzz::require(std::max({t.x, t.y, t.z}) < mesh.positions.size(),
                          "a triangle has vertices");
        for (uint32_t i = 0; i < std::min<size_t>(mesh.triangles.size(), 16); ++i) {
            const scene::SurfaceSample sample =
                scene::sample_surface(scene, mesh, i, {0.25f, 0.25f});
            for (int k = 0; k < 3; ++k)
                fuzz::require(sample.albedo[k] >= 0 && sample.albedo[k] <= 1,
                              "albedo is within 0 and 1");
            fuzz::require(sample.alpha >= 0 && sample.alpha <= 1, "alpha is within 0 and 1");
            scene::sample_emission(scene, mesh, i, {0.25f, 0.25f});
        }
    }
    for (const Instance& instance : scene.instances) {
        fuzz::require(size_t(instance.mesh) < scene.meshes.size(), "an instance has a mesh");
        for (int i = 0; i < 16; ++i)
            fuzz::require(std::isfinite(instance.to_world[i / 4][i % 4]), "a transform is finite");
    }
    for (const Light& light : scene.lights)
        scene::check_light(light, "light");
    const Bounds bounds = bounds_of(scene);
    fuzz::require(bounds.empty() || (std::isfinite(bounds.lo.x) && std::isfinite(bounds.hi.x)),
                  "bounds are finite");
    scene::triangle_count(scene);
    scene::has_emitters(scene);
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    static const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    if (size < 1)
        return 0;
    const uint8_t form = data[0];
    const std::string_view input(reinterpret_cast<const char*>(data) + 1, size - 1);
    const std::string path = fuzz::Folder::own().write(
        "scene.gltf", form & as_it_is ? std::string(input) : binary_file(input));
    LoadSettings settings;
    settings.max_memory = 32 << 20;
    if (form & posed)
        settings.time = 0.25;
    if (form & varied)
        settings.variant = "0";
    settings.strict = form & strict;
    settings.rules.metallic_black = form & black_metal;
    fuzz::accepts([&] { check(load_gltf(path, settings)); });
    fuzz::accepts([&] { pack_gltf(path, settings); });
    return 0;
}
