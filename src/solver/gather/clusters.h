// Lit patches in a tree of clusters: near ones are looked at singly, far ones together.
#pragma once

#include "surface/lit_surfaces.h"

#include <vector>

namespace lpvbake::solver::gather {

/// One side of a patch that sends light, a triangle whose corners run counter-clockwise as seen
/// from where the light goes. Frame units.
struct Emitter {
    glm::vec3 a, b, c;
    glm::vec3 normal;     ///< unit, to where the light goes
    glm::vec3 luminance;  ///< nits, times the covered share
    float power;          ///< sum of the luminance's channels times the area
    uint32_t crossed : 1; ///< Patch::crossed
    uint32_t side : 31;   ///< 2 * patch + side

    glm::vec3 center() const { return (a + b + c) / 3.0f; }
    /// Lifted off the surface; u in [0, 1)^2 spreads evenly over the triangle. Where something
    /// crosses it, its centroid: the light is that of there, and must not start behind a wall.
    glm::vec3 point(glm::vec2 u) const;
};

/// Emitters that lie together, seen from afar: a point that sends the intensity
/// intensity max(0, normal . w) along w.
struct Cluster {
    glm::vec3 position;    ///< mean by power
    glm::vec3 normal;      ///< mean by power, shorter than 1 where they differ
    glm::vec3 intensity;   ///< luminance times area, nits times frame units squared
    float power;           ///< sum of its channels
    glm::vec3 lo, hi;      ///< the box of the triangles
    float size;            ///< across, frame units; more where normals differ
    float spread;          ///< mean square distance from the position, by power
    uint32_t first, count; ///< of Clusters::emitters
    uint32_t second = 0;   ///< its halves are the node after it and this one; 0: one emitter
    bool divided = false;  ///< its halves do not see each other
};

struct Clusters {
    std::vector<Emitter> emitters;
    std::vector<double> power_before; ///< of the emitters before each, and of all
    std::vector<Cluster> nodes;       ///< the root comes first; empty: no light
    /// [layer_count * node + layer]: intensities as the clusters', of LitSurfaces::layers.
    std::vector<glm::vec3> layers;
    size_t layer_count = 0;

    /// The emitter at this share of a cluster's power, in [0, 1).
    uint32_t emitter_at(const Cluster& cluster, double share) const;
};

/// Halves the emitters recursively across the longest side of their box in place and normal
/// together, normals counting most (after Walter et al. 2005): parts are flat before they are
/// small. The same tree for any number of threads.
/// Of the light no more is taken than what luminance_above() leaves; of layers the same share of
/// each side. They have no say in the tree.
Clusters make_clusters(const surface::LitSurfaces& surfaces,
                       const visibility::Visibility& visibility, float above = 0.0f);

/// True if nothing in the box `centre` +- `half` is before the cluster's surfaces.
bool faces_away(const Cluster& cluster, glm::vec3 centre, glm::vec3 half);

} // namespace lpvbake::solver::gather
