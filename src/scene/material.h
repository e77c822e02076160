// The optics of a surface point. RSM, surfaces and references share these rules.
#pragma once

#include "scene/scene.h"

namespace lpvbake::scene {

/// What a surface point does to light. `alpha` is the covered share that light does not pass: 0 or
/// 1 for opaque and mask, anything between for blend and for what transmits. A front or a
/// double-sided back reflects alpha * albedo as a Lambert surface and lets (1 - alpha) * tint()
/// through.
struct SurfaceSample {
    glm::vec3 albedo{0.0f}; ///< linear, clamped to MaterialRules::max_albedo
    float alpha = 1.0f;
    float coverage = 1.0f; ///< by the alpha of the material; more than `alpha` where it transmits
    glm::vec3 color{1.0f}; ///< linear, at most 1

    /// The colour of what passes: of light that a material transmits, its own, and what
    /// `attenuation` leaves; of light past the coverage, the hue in which a white ground shows
    /// under it. Exactly 1 where all that is white.
    glm::vec3 tint(glm::vec3 attenuation = glm::vec3(1.0f)) const;
};

/// Bilinear (or nearest) texture lookup at mip level 0, linear RGB and alpha in [0, 1]. Texels are
/// linearised before they are blended; a coordinate that is not finite counts as 0.
glm::vec4 sample_texture(const Scene& scene, int texture, glm::vec2 uv);

/// Base colour factor times texture times vertex colour at a point of a mesh's triangle;
/// `barycentric` holds the weights of its second and third vertex.
SurfaceSample sample_surface(const Scene& scene, const Mesh& mesh, uint32_t triangle,
                             glm::vec2 barycentric);

/// Emitted luminance (nits) at a point of a mesh's triangle, towards its front (both sides if
/// double-sided). The covered share of mask and blend is in it: what is not there does not glow.
glm::vec3 sample_emission(const Scene& scene, const Mesh& mesh, uint32_t triangle,
                          glm::vec2 barycentric);

/// True if light may pass the material's front somewhere: mask, blend, or transmission.
inline bool is_partly_clear(const Material& material) {
    return material.alpha_mode != AlphaMode::opaque || material.transmission > 0.0f;
}

/// True if how much light passes is not 0 or 1 alone: rays pass by chance.
inline bool is_veil(const Material& material) {
    return material.alpha_mode == AlphaMode::blend || material.transmission > 0.0f;
}

/// True if a ray may pass the material somewhere: what is partly clear, or a culled back.
bool is_see_through(const Scene& scene, const Material& material);

/// True if what passes the mesh may be coloured by it.
bool is_tinting(const Scene& scene, const Mesh& mesh);

/// Material::attenuation for an instance, whose scale makes it as thick: the cube root of its
/// volume.
glm::vec3 attenuation_of(const Scene& scene, const Instance& instance);

} // namespace lpvbake::scene
