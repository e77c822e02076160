#include "report/seams.h"

#include "lpvbake/error.h"
#include "volume/sh.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::report {
namespace {

/// Light on six faces along the axes in three channels.
std::array<double, 18> irradiance_in(const Volume& volume, std::size_t cell) {
    std::array<double, 18> light;
    std::array<float, volume::sh_count(volume::sh_max_order)> one;
    const auto coefficients = std::span(one).first(volume.sh.size());
    for (int channel = 0; channel < 3; ++channel) {
        for (std::size_t k = 0; k < coefficients.size(); ++k)
            coefficients[k] = volume.sh[k][cell][channel];
        for (int face = 0; face < 6; ++face) {
            glm::vec3 normal(0.0f);
            normal[face / 2] = face % 2 ? -1.0f : 1.0f;
            light[std::size_t(6 * channel + face)] =
                std::max(0.0, double(volume::sh_irradiance(coefficients, normal)));
        }
    }
    return light;
}

bool is_valid(const Volume& volume, std::size_t cell) {
    return volume.validity.empty() || volume.validity[cell] > 0.0f;
}

} // namespace

Seam& Seam::operator+=(const Seam& other) {
    cells += other.cells;
    off += other.off;
    sum += other.sum;
    return *this;
}

Seam seam_between(const Volume& a, const Volume& b) {
    const glm::dvec3 apart = (b.grid.origin - a.grid.origin) / a.grid.cell;
    const glm::dvec3 whole = glm::round(apart);
    const double widest = double(std::max({a.grid.dims.x, a.grid.dims.y, a.grid.dims.z}));
    if (std::abs(a.grid.cell - b.grid.cell) * widest > 1e-3 * a.grid.cell
        || glm::any(glm::greaterThan(glm::abs(apart - whole), glm::dvec3(1e-3)))
        || glm::any(glm::greaterThan(glm::abs(whole), glm::dvec3(1e8))))
        throw Error(ErrorKind::invalid, "two tiles are not on one lattice; plan the world again");
    const glm::ivec3 shift(whole);
    const glm::ivec3 begin = glm::max(glm::ivec3(0), shift);
    const glm::ivec3 end = glm::min(a.grid.dims, shift + b.grid.dims);
    Seam seam;
    for (int z = begin.z; z < end.z; ++z)
        for (int y = begin.y; y < end.y; ++y)
            for (int x = begin.x; x < end.x; ++x) {
                const glm::ivec3 at(x, y, z);
                const std::size_t i = a.grid.index(at), j = b.grid.index(at - shift);
                if (!is_valid(a, i) || !is_valid(b, j))
                    continue;
                const std::array<double, 18> in_a = irradiance_in(a, i), in_b = irradiance_in(b, j);
                ++seam.cells;
                for (std::size_t k = 0; k < in_a.size(); ++k) {
                    seam.off += std::abs(in_a[k] - in_b[k]);
                    seam.sum += 0.5 * (in_a[k] + in_b[k]);
                }
            }
    return seam;
}

} // namespace lpvbake::report
