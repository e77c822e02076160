// Materials and the images that they need.
#pragma once

#include "scene/gltf/document.h"

#include <vector>

namespace lpvbake::scene::gltf {

/// Which coordinates a texture is looked up with: set TEXCOORD_<set>, transformed by
/// KHR_texture_transform, uv' = offset + R(rotation) * (scale * uv), R turning counter-clockwise as
/// seen in an image, whose v points down.
struct UvSource {
    int set = 0;
    glm::dvec2 offset{0.0};
    glm::dvec2 scale{1.0};
    double rotation = 0.0;

    glm::vec2 operator()(glm::vec2 uv) const;
    bool is_identity() const {
        return offset == glm::dvec2(0.0) && scale == glm::dvec2(1.0) && rotation == 0.0;
    }
};

/// A material with texture references that are still glTF's, -1 for none.
struct SourceMaterial {
    Material material;
    std::string place;
    int base_texture = -1;
    int emission_texture = -1;
    int metallic_texture = -1; ///< only where metal is to be black
    double metallic = 0.0;     ///< factor; 0 unless metal is to be black
    int transmission_texture = -1;
    double transmission = 0.0;
    int thickness_texture = -1;
    double thickness = 0.0;            ///< in attenuation distances; 0 without transmission
    glm::dvec3 attenuation_color{1.0}; ///< what one attenuation distance leaves
    UvSource base_uv;
    UvSource emission_uv;
    bool unlit = false;
};

/// The material of that index, glTF's default one for -1. Throws Error.
SourceMaterial read_material(Document& document, int index, const MaterialRules& rules);

/// Decodes what the materials need, each image once, puts images and textures that are sampled into
/// the scene, points the materials at them, and settles what depends on texels: how much of a
/// material is metal, and how much light it lets through. Returns each material's mean base colour
/// texel (linear). Where an image cannot be read its texture's next one is, and where there is none
/// the texture is left out, with a warning. Images that would take more than half of the document's
/// memory together are halved, the largest first, with a warning. With `skip_colors` an image that
/// is a base colour alone is not decoded: it has a size but no texels, and counts as black. So has
/// an image of materials alone that are not `wanted`, though it counts where images are halved.
std::vector<glm::dvec3> load_textures(Document& document, std::vector<SourceMaterial>& materials,
                                      const std::vector<bool>& wanted, bool skip_colors,
                                      Scene& scene);

} // namespace lpvbake::scene::gltf
