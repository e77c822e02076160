#include "surface/layered_elements.h"

#include "scene/sky.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

namespace lpvbake::surface {
namespace {

/// What a layer has of a patch's emission.
glm::vec3 weight_of(const Scene& scene, const scene::LightLayer& layer, const Patch& patch) {
    const Mesh& mesh = scene.meshes[size_t(scene.instances[patch.instance].mesh)];
    return layer.emissions[size_t(mesh.material)];
}

} // namespace

LayeredElements::LayeredElements(const Scene& scene, std::span<const scene::LightLayer> layers,
                                 const Elements& elements, const Spots& spots, LitSurfaces& lit)
    : scene_(scene),
      layers_(layers),
      elements_(elements),
      spots_(spots),
      lit_(lit),
      count_(layers.size()),
      by_spots_(spots.sides.empty() ? 0 : count_ * elements.size(), glm::vec3(0.0f)) {
    if (empty() || spots.sides.empty())
        return;
    spot_of_.assign(lit.luminance.size(), no_spot);
    for (size_t spot = 0; spot < spots.sides.size(); ++spot) {
        const uint32_t side = spots.sides[spot];
        spot_of_[side] = uint32_t(spot);
        const auto light = lit.layers.begin() + std::ptrdiff_t(count_ * side);
        spot_light_.insert(spot_light_.end(), light, light + std::ptrdiff_t(count_));
    }
}

LayeredElements::Found::Found(const LayeredElements& of)
    : of_(of),
      met_(of.count_, glm::vec3(0.0f)),
      aimed_(met_),
      spots_met_(met_),
      spots_aimed_(met_) {}

void LayeredElements::Found::sky(glm::vec3 tint, glm::vec3 towards) {
    glm::vec3 own(-1.0f);
    for (size_t layer = 0; layer < met_.size(); ++layer) {
        const scene::LightLayer& of = of_.layers_[layer];
        if (of.sky != glm::vec3(0.0f)) {
            if (own.x < 0.0f)
                own = scene::sky_rest(of_.scene_.sky, towards);
            met_[layer] += of.sky * (tint * own);
        }
        if (of.is_reflected())
            met_[layer] += tint * of.beyond(towards);
    }
}

void LayeredElements::Found::emitter(uint32_t side, glm::vec3 light) {
    for (size_t layer = 0; layer < met_.size(); ++layer)
        met_[layer] +=
            weight_of(of_.scene_, of_.layers_[layer], of_.lit_.patches[side / 2]) * light;
}

void LayeredElements::Found::aimed_emitter(uint32_t patch, glm::vec3 light) {
    for (size_t layer = 0; layer < aimed_.size(); ++layer)
        aimed_[layer] += weight_of(of_.scene_, of_.layers_[layer], of_.lit_.patches[patch]) * light;
}

void LayeredElements::Found::spot(uint32_t side, glm::vec3 share) {
    if (of_.spot_of_[side] != no_spot)
        add_spot(of_.spot_of_[side], share, spots_met_);
}

void LayeredElements::Found::aimed_spot(uint32_t spot, glm::vec3 share) {
    const Patch& patch = of_.lit_.patches[of_.spots_.sides[spot] / 2];
    add_spot(spot, patch.alpha * share, spots_aimed_);
}

void LayeredElements::Found::add_spot(uint32_t spot, glm::vec3 share,
                                      std::vector<glm::vec3>& sums) const {
    for (size_t layer = 0; layer < sums.size(); ++layer)
        sums[layer] += share * of_.spot_light_[sums.size() * spot + layer];
}

void LayeredElements::take(size_t element, const Found& found, int rays) {
    for (size_t layer = 0; layer < count_; ++layer) {
        const glm::vec3 lux =
            found.met_[layer] * (glm::pi<float>() / float(rays)) + found.aimed_[layer];
        for (const uint32_t side : elements_.members_of(element))
            lit_.layers[count_ * side + layer] +=
                lit_.patches[side / 2].albedo / glm::pi<float>() * lux;
        if (!by_spots_.empty())
            by_spots_[count_ * element + layer] = found.spots_met_[layer] / float(rays)
                                                  + found.spots_aimed_[layer] / glm::pi<float>();
    }
}

void LayeredElements::reflect(size_t element, glm::vec3 albedo, std::span<const uint32_t> hits,
                              uint32_t none, std::span<const glm::vec3> tints) {
    const bool first = order_.empty();
    std::vector<glm::dvec3> sums(count_, glm::dvec3(0.0));
    for (size_t ray = 0; ray < hits.size(); ++ray) {
        const uint32_t hit = hits[ray];
        if (hit == none)
            continue;
        const glm::vec3 tint = tints.empty() ? glm::vec3(1.0f) : tints[ray];
        const glm::vec3* sent = (first ? lit_.layers : order_).data() + count_ * hit;
        for (size_t layer = 0; layer < count_; ++layer)
            sums[layer] += glm::dvec3(tint * sent[layer]);
        if (first && !spot_of_.empty() && spot_of_[hit] != no_spot)
            for (size_t layer = 0; layer < count_; ++layer)
                sums[layer] -= glm::dvec3(tint * spot_light_[count_ * spot_of_[hit] + layer]);
    }
    for (size_t layer = 0; layer < count_; ++layer) {
        glm::dvec3 sum = sums[layer] / double(hits.size());
        if (first && !by_spots_.empty())
            sum += glm::dvec3(by_spots_[count_ * element + layer]);
        next_[count_ * element + layer] = glm::vec3(glm::dvec3(albedo) * sum);
        met_[count_ * element + layer] += sum;
    }
}

void LayeredElements::begin_orders() {
    next_.resize(count_ * elements_.size());
    met_.assign(next_.size(), glm::dvec3(0.0));
}

void LayeredElements::next_order() {
    std::swap(order_, next_);
    next_.resize(order_.size());
}

void LayeredElements::add_reflected() {
    tbb::parallel_for(size_t(0), elements_.size(), [&](size_t i) {
        for (const uint32_t side : elements_.members_of(i))
            for (size_t layer = 0; layer < count_; ++layer)
                lit_.layers[count_ * side + layer] +=
                    lit_.patches[side / 2].albedo * glm::vec3(met_[count_ * i + layer]);
    });
}

void add_layered_emission(const Scene& scene, std::span<const scene::LightLayer> layers,
                          const std::vector<glm::vec3>& emission, LitSurfaces& lit) {
    const size_t count = layers.size();
    for (size_t side = 0; side < emission.size(); ++side)
        if (emission[side] != glm::vec3(0.0f))
            for (size_t layer = 0; layer < count; ++layer)
                lit.layers[count * side + layer] +=
                    weight_of(scene, layers[layer], lit.patches[side / 2]) * emission[side];
}

} // namespace lpvbake::surface
