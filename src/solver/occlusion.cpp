#include "solver/occlusion.h"

#include "colour/colour.h"
#include "visibility/capture.h"
#include "visibility/validity.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::solver {
namespace {

/// Lines beside the centre, a quarter of a cell off it: where a link's coverage is sampled.
constexpr glm::vec2 sides[4] = {{-0.25f, -0.25f}, {0.25f, -0.25f}, {-0.25f, 0.25f}, {0.25f, 0.25f}};

/// Luminance of a tint, exactly 1 of white: links know no colours.
float brightness(glm::vec3 tint) {
    return tint.x + glm::dot(glm::vec3(colour::rec709_luminance), tint - tint.x);
}

/// What passes from centre i to centre i + 1, for all i.
void link_transmittance(const std::vector<visibility::Crossing>& crossings,
                        std::vector<float>& open) {
    std::fill(open.begin(), open.end(), 1.0f);
    for (const visibility::Crossing& crossing : crossings) {
        // Link i spans t in [i + 1/2, i + 3/2].
        const int i = int(std::floor(crossing.t - 0.5f));
        if (i >= 0 && i < int(open.size()))
            open[size_t(i)] *= crossing.transmittance * brightness(crossing.tint);
    }
}

/// Light that goes from cell to cell has no side of a surface that halves one to be on.
void close_cells_on_surfaces(const visibility::Visibility& visibility,
                             const std::vector<int8_t>& backs, const Grid& grid, Links& links) {
    const std::vector<size_t> cells = visibility::cells_on_surfaces(visibility, grid.dims);
    links.validity = visibility::validity_of(visibility, grid.dims, backs, cells);
    for (const size_t cell : cells) {
        links.validity[cell] = 0.0f;
        for (int axis = 0; axis < 3; ++axis) {
            links.open[3 * cell + size_t(axis)] = 0.0f;
            glm::ivec3 before = grid.cell_at(cell);
            if (before[axis]-- > 0)
                links.open[3 * grid.index(before) + size_t(axis)] = 0.0f;
        }
    }
}

} // namespace

Links trace_links(const visibility::Visibility& visibility, const Grid& grid) {
    Links links;
    links.open.assign(3 * grid.size(), 1.0f);
    std::vector<int8_t> backs(grid.size(), 0); // backs less fronts among the six first hits
    for (int axis = 0; axis < 3; ++axis) {
        const visibility::AxisLines lines(visibility, grid.dims, axis);
        const int n = grid.dims[axis];
        tbb::parallel_for(0, grid.dims[lines.v], [&](int k) {
            std::vector<visibility::Crossing> crossings;
            std::vector<int8_t> own(static_cast<size_t>(n));
            std::vector<float> center(size_t(n - 1)), side(size_t(n - 1)), mean(size_t(n - 1));
            for (int j = 0; j < grid.dims[lines.u]; ++j) {
                lines.trace(j, k, crossings);
                visibility::count_backs(crossings, own);
                for (int i = 0; i < n; ++i)
                    backs[lines.cell(i, j, k)] += own[size_t(i)];
                link_transmittance(crossings, center);
                std::fill(mean.begin(), mean.end(), 0.0f);
                for (const glm::vec2 shift : sides) {
                    lines.trace(j, k, shift, 0.0f, float(n), crossings);
                    link_transmittance(crossings, side);
                    for (size_t i = 0; i < mean.size(); ++i)
                        mean[i] += 0.25f * side[i];
                }
                for (int i = 0; i + 1 < n; ++i)
                    links.open[3 * lines.cell(i, j, k) + size_t(axis)] =
                        center[size_t(i)] > 0.0f ? mean[size_t(i)] : 0.0f;
            }
        });
    }
    close_cells_on_surfaces(visibility, backs, grid, links);
    return links;
}

GeometryVolume make_geometry_volume(const std::vector<surface::Patch>& patches, const Grid& grid) {
    GeometryVolume geometry;
    geometry.nodes = grid.dims + 1;
    const Grid nodes{{}, 1.0, geometry.nodes};
    std::vector<uint32_t> largest(nodes.size(), ~0u);
    std::vector<uint32_t> node_of(patches.size());
    for (uint32_t i = 0; i < patches.size(); ++i) {
        const glm::ivec3 node = glm::clamp(glm::ivec3(glm::floor(patches[i].position + 0.5f)),
                                           glm::ivec3(0), grid.dims);
        node_of[i] = uint32_t(nodes.index(node));
        uint32_t& best = largest[node_of[i]];
        if (best == ~0u || patches[i].area > patches[best].area)
            best = i;
    }
    geometry.blocking.assign(nodes.size(), glm::vec4(0.0f));
    for (uint32_t i = 0; i < patches.size(); ++i) {
        const surface::Patch& patch = patches[i];
        const glm::vec3 side = patches[largest[node_of[i]]].normal;
        const glm::vec3 n = glm::dot(patch.normal, side) < 0.0f ? -patch.normal : patch.normal;
        // Clamped cosine in SH: sqrt(pi)/2 and sqrt(pi/3) (Ramamoorthi and Hanrahan 2001).
        geometry.blocking[node_of[i]] +=
            patch.alpha * patch.area
            * glm::vec4(0.886226925f, 1.02332671f * n.y, 1.02332671f * n.z, 1.02332671f * n.x);
    }
    return geometry;
}

glm::vec4 GeometryVolume::at(glm::vec3 point) const {
    const glm::vec3 p = glm::clamp(point, glm::vec3(0.0f), glm::vec3(nodes - 1));
    const glm::ivec3 base = glm::min(glm::ivec3(p), nodes - 2);
    const glm::vec3 f = p - glm::vec3(base);
    glm::vec4 sum{0.0f};
    for (int corner = 0; corner < 8; ++corner) {
        const glm::ivec3 o{corner & 1, corner >> 1 & 1, corner >> 2};
        const glm::vec3 w = glm::mix(1.0f - f, f, glm::vec3(o));
        const Grid lattice{{}, 1.0, nodes};
        sum += w.x * w.y * w.z * blocking[lattice.index(base + o)];
    }
    return sum;
}

float GeometryVolume::blocked(glm::vec3 point, glm::vec3 w) const {
    const glm::vec4 b = at(point);
    const float even = volume::sh_y0 * b.x;
    const float odd = volume::sh_y1 * (b.y * w.y + b.z * w.z + b.w * w.x);
    return std::clamp(even + std::abs(odd), 0.0f, 1.0f);
}

std::vector<std::vector<float>> at_cell_centers(const GeometryVolume& geometry, const Grid& grid) {
    std::vector<std::vector<float>> occlusion(4, std::vector<float>(grid.size()));
    tbb::parallel_for(0, grid.dims.z, [&](int z) {
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x) {
                const glm::vec4 blocking = geometry.at(glm::vec3(x, y, z) + 0.5f);
                for (int k = 0; k < 4; ++k)
                    occlusion[size_t(k)][grid.index({x, y, z})] = blocking[k];
            }
    });
    return occlusion;
}

const std::array<LpvFace, 30>& lpv_faces() {
    static const std::array<LpvFace, 30> faces = [] {
        std::array<LpvFace, 30> all{};
        size_t n = 0;
        for (int d = 0; d < 6; ++d) {
            glm::vec3 toward{0.0f};
            toward[d / 2] = d % 2 ? -1.0f : 1.0f;
            all[n++] = {d, toward, toward};
            for (int next = 1; next <= 2; ++next)
                for (const float sign : {1.0f, -1.0f}) {
                    glm::vec3 normal{0.0f};
                    normal[(d / 2 + next) % 3] = sign;
                    all[n++] = {d, normal, (normal + 2.0f * toward) / std::sqrt(5.0f)};
                }
        }
        return all;
    }();
    return faces;
}

std::vector<float> face_transmittance(const GeometryVolume& geometry, const Grid& grid) {
    std::vector<float> transmittance(30 * grid.size());
    tbb::parallel_for(0, grid.dims.z, [&](int z) {
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x) {
                const glm::vec3 center = glm::vec3(x, y, z) + 0.5f;
                float* tau = &transmittance[30 * grid.index({x, y, z})];
                for (const LpvFace& face : lpv_faces())
                    *tau++ = 1.0f - geometry.blocked(center + 0.5f * face.toward, face.toward);
            }
    });
    return transmittance;
}

} // namespace lpvbake::solver
