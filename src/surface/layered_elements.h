// The light of layers on its way between elements, beside the scene's and by its rays.
#pragma once

#include "surface/elements.h"
#include "surface/lit_surfaces.h"
#include "surface/spots.h"

#include <span>
#include <vector>

namespace lpvbake::surface {

class LayeredElements {
public:
    /// All outlive it, and LitSurfaces::layers are of these layers: they hold the light of lamps.
    /// Does nothing without layers.
    LayeredElements(const Scene& scene, std::span<const scene::LightLayer> layers,
                    const Elements& elements, const Spots& spots, LitSurfaces& lit);

    bool empty() const { return layers_.empty(); }

    /// What the rays of one element find.
    class Found {
    public:
        explicit Found(const LayeredElements& of);

        /// A ray meets the sky, having passed what tints.
        void sky(glm::vec3 tint, glm::vec3 towards);
        /// One meets an emitter: light that counts so much, nits.
        void emitter(uint32_t side, glm::vec3 light);
        /// One meets a side, whose spot counts so much.
        void spot(uint32_t side, glm::vec3 share);
        /// One is aimed at an emitter: light that counts so much, lux.
        void aimed_emitter(uint32_t patch, glm::vec3 light);
        /// One is aimed at a spot (its place in Spots::sides), which counts so much.
        void aimed_spot(uint32_t spot, glm::vec3 share);

    private:
        friend class LayeredElements;
        void add_spot(uint32_t spot, glm::vec3 share, std::vector<glm::vec3>& sums) const;

        const LayeredElements& of_;
        std::vector<glm::vec3> met_, aimed_, spots_met_, spots_aimed_; ///< a layer
    };

    /// Adds what an element's rays (so many in all directions) found to the light of its members.
    void take(size_t element, const Found& found, int rays);
    /// Before the first reflection.
    void begin_orders();
    /// One more reflection of an element of this albedo: of what leaves where its rays hit (sides
    /// the first time, then elements; `none`: nothing), by the tints that they passed, if any.
    void reflect(size_t element, glm::vec3 albedo, std::span<const uint32_t> hits, uint32_t none,
                 std::span<const glm::vec3> tints);
    /// After one of all elements.
    void next_order();
    /// Adds what was reflected between elements to the light of all sides.
    void add_reflected();

private:
    static constexpr uint32_t no_spot = ~0u;

    const Scene& scene_;
    std::span<const scene::LightLayer> layers_;
    const Elements& elements_;
    const Spots& spots_;
    LitSurfaces& lit_;
    size_t count_; ///< of layers; whatever is of an element has one after the other
    std::vector<uint32_t> spot_of_;     ///< a side: its place in Spots::sides; empty: none is one
    std::vector<glm::vec3> spot_light_; ///< of the spots, nits
    std::vector<glm::vec3> by_spots_;   ///< what spots add to the mean that an element meets, nits
    std::vector<glm::vec3> order_, next_; ///< of the last reflection, and of this; empty: the first
    std::vector<glm::dvec3> met_;
};

/// Adds what sides send by themselves (`emission` of each, nits) to LitSurfaces::layers.
void add_layered_emission(const Scene& scene, std::span<const scene::LightLayer> layers,
                          const std::vector<glm::vec3>& emission, LitSurfaces& lit);

} // namespace lpvbake::surface
