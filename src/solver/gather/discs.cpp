#include "solver/gather/discs.h"

#include "mix_word.h"
#include "surface/patches.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

namespace lpvbake::solver::gather {
namespace {

const double pi = glm::pi<double>();

/// Points in [0, 1)^2 that are evenly spread for any number of them, shifted by numbers of `key`'s
/// own (Roberts 2018: the additive recurrence of the plastic number).
glm::dvec2 spread(uint32_t key, int i) {
    const glm::dvec2 shift(mix_word(key) >> 8, mix_word(key ^ 0x9e3779b9u) >> 8);
    return glm::fract(shift * 0x1p-24 + double(i + 1) * glm::dvec2(0.7548776662, 0.5698402910));
}

/// One map, and how cells look into it.
class Map {
public:
    explicit Map(const vpl::Rsm& rsm) : rsm_(rsm), size_(rsm.width, rsm.height) {}

    /// Where the light sees a point, texels; inside the map.
    glm::dvec2 place(glm::dvec3 point) const {
        const scene::RsmView& view = rsm_.view;
        const glm::dvec3 to = point - view.origin;
        const double depth = view.perspective ? glm::dot(to, view.axis) : 1.0;
        if (!(depth > 0.0)) // behind the light
            return 0.5 * size_;
        const glm::dvec2 at(glm::dot(to, view.u) / glm::dot(view.u, view.u),
                            glm::dot(to, view.v) / glm::dot(view.v, view.v));
        return glm::clamp((at / depth + 1.0) * 0.5 * size_, glm::dvec2(0.0), size_);
    }
    /// Of the disc around a place that just covers the map, texels.
    double radius(glm::dvec2 place) const { return glm::length(glm::max(place, size_ - place)); }
    /// The lit texel at a place, or none.
    std::optional<size_t> texel(glm::dvec2 place) const {
        const glm::ivec2 at(glm::floor(place));
        if (at.x < 0 || at.y < 0 || at.x >= rsm_.width || at.y >= rsm_.height)
            return std::nullopt;
        const size_t i = size_t(at.y) * size_t(rsm_.width) + size_t(at.x);
        return rsm_.power[i] == glm::vec3(0.0f) ? std::nullopt : std::optional(i);
    }
    /// Surface that a texel stands for, frame units squared; seen edge-on, twenty times as much as
    /// seen from above at most.
    double footprint(size_t i) const {
        const scene::RsmView& view = rsm_.view;
        const double across = 4.0 * glm::length(view.u) * glm::length(view.v) / (size_.x * size_.y);
        const glm::dvec3 normal(rsm_.normal[i]);
        if (!view.perspective)
            return across / std::max(-glm::dot(normal, view.axis), 0.05);
        const glm::dvec3 ray = glm::dvec3(rsm_.position[i]) - view.origin;
        const double depth = glm::dot(ray, view.axis), distance = glm::length(ray);
        return across * depth * depth
               * std::min(depth / std::max(-glm::dot(normal, ray), 1e-30), 20.0 * depth / distance);
    }
    const vpl::Rsm& operator*() const { return rsm_; }

private:
    const vpl::Rsm& rsm_;
    glm::dvec2 size_;
};

/// Light of one map in one cell; returns the number of rays.
uint64_t gather_cell(const Map& map, uint32_t key, int samples, double unit, glm::ivec3 cell,
                     const visibility::Visibility& visibility, Volume& volume) {
    struct Sample {
        glm::vec3 towards; ///< unit
        glm::vec3 light;   ///< nits times solid angle
    };
    thread_local std::vector<visibility::Ray> rays;
    thread_local std::vector<Sample> seen;
    thread_local std::vector<glm::vec3> open;
    rays.clear();
    seen.clear();
    const size_t index = volume.grid.index(cell);
    const glm::dvec3 center(visibility.capture(cell).point);
    const glm::dvec2 place = map.place(center);
    const double radius = map.radius(place);
    for (int i = 0; i < samples; ++i) {
        const glm::dvec2 u = spread(mix_word(key ^ mix_word(uint32_t(index))), i);
        const double angle = 2.0 * pi * u.y;
        const std::optional<size_t> texel =
            map.texel(place + radius * u.x * glm::dvec2(std::sin(angle), std::cos(angle)));
        if (!texel)
            continue;
        const glm::vec3 point = (*map).position[*texel], normal = (*map).normal[*texel];
        const glm::dvec3 to = glm::dvec3(point) - center;
        const double square = glm::dot(to, to);
        const double facing = -glm::dot(to, glm::dvec3(normal)) / std::sqrt(square);
        if (!(facing > 0.0))
            continue;
        const double footprint = map.footprint(*texel);
        const double seen_area =
            footprint * facing * 2.0 * pi * radius * radius * u.x / double(samples);
        const double angle_of = std::min(seen_area / square, 2.0 * pi);
        const double emitting = pi * footprint * unit * unit;
        seen.push_back(
            {glm::vec3(glm::normalize(to)), (*map).power[*texel] * float(angle_of / emitting)});
        rays.push_back(
            {glm::vec3(center), point + surface::ray_offset(point) * normal - glm::vec3(center)});
    }
    open.resize(rays.size());
    visibility.filter_of_eights(rays, visibility::Bundle::loose, open);
    for (size_t i = 0; i < seen.size(); ++i) {
        const volume::ShValues basis = volume::sh_basis(volume.sh_order, seen[i].towards);
        for (size_t k = 0; k < volume.sh.size(); ++k)
            volume.sh[k][index] += open[i] * basis[k] * seen[i].light;
    }
    return rays.size();
}

} // namespace

DiscReport gather_discs(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
                        const visibility::Visibility& visibility, const DiscSettings& settings,
                        Volume& volume, Progress& progress) {
    DiscReport report;
    vpl::RsmPass pass(device, scene, frame, &visibility);
    const int size = std::min(settings.map_size, largest_disc_map);
    const glm::ivec3 dims = volume.grid.dims;
    uint64_t done = 0;
    for (const Light& light : scene.lights) {
        pass.render(light, size, [&](const vpl::Rsm& rsm) {
            const Map map(rsm);
            const uint32_t key = uint32_t(++report.maps);
            const auto slice = [&](const tbb::blocked_range<int>& range, uint64_t rays) {
                for (int z = range.begin(); z < range.end(); ++z)
                    for (int y = 0; y < dims.y; ++y)
                        for (int x = 0; x < dims.x; ++x)
                            if (volume.validity[volume.grid.index({x, y, z})] > 0.0f)
                                rays += gather_cell(map, key, settings.samples, frame.unit,
                                                    {x, y, z}, visibility, volume);
                return rays;
            };
            report.rays += tbb::parallel_reduce(tbb::blocked_range<int>(0, dims.z), uint64_t(0),
                                                slice, std::plus<uint64_t>());
        });
        progress.advance(++done);
    }
    return report;
}

} // namespace lpvbake::solver::gather
