#include "medium/lit_air.h"

#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {
namespace {

constexpr double nothing = 1e-6; ///< of the peak, what a cell has by rounding alone

} // namespace

DarkAir::DarkAir(const Medium& medium, const scene::Frame& frame)
    : air_(medium, frame),
      frame_(frame) {}

visibility::Air::Place DarkAir::at(glm::vec3 place) const {
    Place air;
    air.density = float(air_.medium().density_at(frame_.to_world(glm::dvec3(place))));
    return air;
}

LitAir::LitAir(const Medium& medium, const Grid& grid, const scene::Frame& frame)
    : DarkAir(medium, frame),
      grid_(grid),
      coefficients_(medium.g == 0 ? 1 : 9),
      density_(grid.size()) {
    tbb::parallel_for(std::size_t(0), grid.size(), [&](std::size_t cell) {
        const glm::dvec3 corner = frame.to_world(grid.cell_at(cell));
        density_[cell] = float(medium.mean_density(corner, corner + frame.unit));
    });
}

void LitAir::scatter(std::span<const std::vector<glm::vec3>> even,
                     std::span<const std::vector<glm::vec3>> by_density) {
    const Medium& medium = air_.medium();
    const double peak = medium.peak();
    std::vector<glm::vec3> sources(std::size_t(coefficients_) * grid_.size(), glm::vec3(0.0f));
    const glm::vec3 extinction(medium.extinction());
    glm::vec3 albedo(0.0f);
    for (int c = 0; c < 3; ++c)
        albedo[c] = extinction[c] > 0 ? float(medium.scatter[c]) / extinction[c] : 0;
    tbb::parallel_for(std::size_t(0), grid_.size(), [&](std::size_t cell) {
        if (!(density_[cell] > nothing * peak))
            return;
        const float denser = float(peak) / density_[cell];
        for (int k = 0; k < coefficients_; ++k) {
            const auto i = std::size_t(k);
            glm::vec3 light(0.0f);
            if (i < even.size())
                light += even[i][cell];
            if (i < by_density.size())
                light += denser * by_density[i][cell];
            const double band = k == 0 ? 0 : k < 4 ? 1 : 2;
            sources[std::size_t(coefficients_) * cell + i] =
                float(std::pow(medium.g, band)) * albedo * light;
        }
    });
    sources_ = std::move(sources);
}

float DarkAir::column(glm::vec3 origin, glm::vec3 direction, float begin, float end) const {
    const glm::dvec3 from(origin), along(direction);
    const auto in = within(from, along, air_.lo(), air_.hi(), double(begin), double(end));
    return in ? float(air_.column(from + in->x * along, from + in->y * along)) : 0.0f;
}

glm::vec3 LitAir::sent(glm::vec3 origin, glm::vec3 direction, float begin, float end) const {
    glm::vec3 sum(0.0f);
    if (!is_lit())
        return sum;
    const auto in = within(glm::dvec3(origin), glm::dvec3(direction), air_.lo(), air_.hi(),
                           double(begin), double(end));
    if (!in)
        return sum;
    const float length = glm::length(direction);
    const volume::ShValues basis = volume::sh_basis(coefficients_ == 1 ? 0 : 2, direction / length);
    const auto first = float(in->x), last = float(in->y);
    const int steps = std::clamp(int(std::ceil((last - first) * length)), 1, most_steps);
    glm::vec3 passes(1.0f);
    for (int i = 0; i < steps; ++i) {
        const float t0 = glm::mix(first, last, float(i) / float(steps));
        const float t1 = i + 1 == steps ? last : glm::mix(first, last, float(i + 1) / float(steps));
        const glm::vec3 behind = passes * left(origin, direction, t0, t1);
        const glm::vec3 place = origin + 0.5f * (t0 + t1) * direction;
        const glm::ivec3 at =
            glm::clamp(glm::ivec3(glm::floor(place)), glm::ivec3(0), grid_.dims - 1);
        const glm::vec3* const source = &sources_[std::size_t(coefficients_) * grid_.index(at)];
        glm::vec3 luminance(0.0f);
        for (int k = 0; k < coefficients_; ++k)
            luminance += basis[std::size_t(k)] * source[k];
        sum += (passes - behind) * luminance;
        passes = behind;
    }
    return sum;
}

visibility::Air::Place LitAir::at(glm::vec3 place) const {
    const glm::vec3 within = glm::clamp(place - 0.5f, glm::vec3(0.0f), glm::vec3(grid_.dims - 1));
    const glm::ivec3 low = glm::min(glm::ivec3(within), glm::max(grid_.dims - 2, 0));
    const glm::vec3 f = within - glm::vec3(low);
    Place air;
    for (int corner = 0; corner < 8; ++corner) {
        const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
        const glm::vec3 share = glm::mix(1.0f - f, f, glm::vec3(step));
        const float weight = share.x * share.y * share.z;
        if (weight == 0.0f)
            continue;
        const std::size_t cell = grid_.index(low + step);
        air.density += weight * density_[cell];
        for (int k = 0; k < coefficients(); ++k)
            air.source[std::size_t(k)] +=
                weight * sources_[std::size_t(coefficients_) * cell + std::size_t(k)];
    }
    return air;
}

} // namespace lpvbake::medium
