// The optics of a surface point. RSM, surfaces and references share these rules.
#pragma once

#include "scene/scene.h"

namespace lpvbake::scene {

/// What a surface point does to light. `alpha` is the covered share: 0 or 1 for opaque and mask,
/// anything between for blend. A front or a double-sided back reflects alpha * albedo as a
/// Lambert surface and lets 1 - alpha through.
struct SurfaceSample {
    glm::vec3 albedo{0.0f}; ///< linear, clamped to MaterialRules::max_albedo
    float alpha = 1.0f;
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

/// True if a ray may pass the material somewhere: mask or blend, or a culled back.
bool is_see_through(const Scene& scene, const Material& material);

} // namespace lpvbake::scene
