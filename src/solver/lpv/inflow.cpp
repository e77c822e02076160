#include "solver/lpv/inflow.h"

#include "solver/occlusion.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <cstdlib>

namespace lpvbake::solver::lpv {
namespace {

using Lobes = std::array<double, 12>; ///< as Injection::coefficients of a cell

/// How a side of a grid lies to the cells of a coarser one.
struct Side {
    Side(const SolvedLevel& coarse, const Grid& fine, int which)
        : grid(fine),
          index(which),
          axis(which / 2),
          u((axis + 1) % 3),
          v((axis + 2) % 3),
          ratio(int(std::lround(coarse.grid.cell / fine.cell))),
          first(coarse.cell_at(fine.center(glm::ivec3(0)))),
          count((fine.dims - 1) / ratio + 1) {}

    bool is_high() const { return index % 2 != 0; }
    std::size_t links() const { return std::size_t(count[u]) * std::size_t(count[v]); }
    /// The coarse cell on the hull that a link ends in, or the one before it.
    glm::ivec3 cell(std::size_t link, bool before) const {
        glm::ivec3 c = first;
        c[axis] += is_high() ? count[axis] - (before ? 0 : 1) : (before ? -1 : 0);
        c[u] += int(link) % count[u];
        c[v] += int(link) / count[u];
        return c;
    }
    /// Calls with each border cell less than a link away, and its weight.
    template <class Call>
    void spread(std::size_t link, const Call& call) const {
        const int at_u = int(link) % count[u] * ratio, at_v = int(link) / count[u] * ratio;
        for (int dv = 1 - ratio; dv < ratio; ++dv)
            for (int du = 1 - ratio; du < ratio; ++du) {
                glm::ivec3 c;
                c[axis] = is_high() ? grid.dims[axis] - 1 : 0;
                c[u] = at_u + du;
                c[v] = at_v + dv;
                if (grid.contains(c))
                    call(c, (1.0 - double(std::abs(du)) / ratio)
                                * (1.0 - double(std::abs(dv)) / ratio));
            }
    }

    const Grid& grid;
    int index, axis, u, v, ratio;
    glm::ivec3 first, count; ///< coarse cells on the hull
};

/// What comes over a link, as lobes of the cell that receives it.
Lobes carried(const SolvedLevel& coarse, const Side& side, std::size_t link) {
    const std::size_t from = coarse.grid.index(side.cell(link, true));
    const std::size_t to = coarse.grid.index(side.cell(link, false));
    const std::size_t low = side.is_high() ? to : from;
    const double k0 = std::sqrt(glm::pi<double>()) / 2.0, k1 = std::sqrt(glm::pi<double>() / 3.0);
    Lobes lobes{};
    for (std::size_t channel = 0; channel < 3; ++channel) {
        const float* lobe = &coarse.coefficients[12 * from + 4 * channel];
        const double scale = budget(lobe) / glm::pi<double>();
        for (std::size_t i = 0; i < 5; ++i) {
            const std::size_t at = 5 * std::size_t(side.index) + i;
            const LpvFace& face = lpv_faces()[at];
            const float open = coarse.occlusion == Occlusion::none ? 1.0f
                               : coarse.occlusion == Occlusion::face
                                   ? coarse.transmittance[3 * low + std::size_t(side.axis)]
                                   : coarse.transmittance[30 * from + at];
            const double flux = scale * double(open) * flux_through(face, lobe);
            const glm::dvec3 n(face.normal);
            const double k[4] = {k0, k1 * n.y, k1 * n.z, k1 * n.x};
            for (std::size_t j = 0; j < 4; ++j)
                lobes[4 * channel + j] += flux * k[j];
        }
    }
    return lobes;
}

/// How much of a link's light each border cell around it takes, in the order of Side::spread.
struct Shares {
    std::vector<double> shares;
    double shut = 0; ///< what none sees
};

Shares part(const SolvedLevel& coarse, const Side& side, std::size_t link,
            const visibility::Visibility* visibility) {
    const glm::vec3 from(side.grid.to_grid(coarse.grid.center(side.cell(link, true))));
    Shares parted;
    double before = 0, sum = 0;
    side.spread(link, [&](glm::ivec3 cell, double weight) {
        before += weight;
        const glm::vec3 centre = glm::vec3(cell) + 0.5f;
        if (visibility)
            weight *= visibility->capture(cell).point == centre
                          ? double(visibility->transmittance({from, centre - from, 0.0f, 1.0f}))
                          : 0.0;
        parted.shares.push_back(weight);
        sum += weight;
    });
    before /= side.ratio * side.ratio;
    for (double& share : parted.shares)
        share *= sum > 0 ? before / sum : 0.0;
    parted.shut = sum > 0 ? 0.0 : before;
    return parted;
}

} // namespace

bool SolvedLevel::is_beyond(int side, const Grid& fine) const {
    const int axis = side / 2;
    return side % 2 ? cell_at(fine.center(fine.dims - 1))[axis] < grid.dims[axis] - 1
                    : cell_at(fine.center(glm::ivec3(0)))[axis] > 0;
}

Inflow let_flow(const SolvedLevel& coarse, const Grid& fine, int side,
                const visibility::Visibility* visibility, Injection& injection) {
    const Side border(coarse, fine, side);
    std::vector<Shares> parts(border.links());
    tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t link) {
        parts[link] = part(coarse, border, link, visibility);
    });
    const auto place = [&](glm::ivec3 cell) {
        return std::size_t(cell[border.u])
               + std::size_t(cell[border.v]) * std::size_t(fine.dims[border.u]);
    };
    std::vector<Lobes> sums(std::size_t(fine.dims[border.u]) * std::size_t(fine.dims[border.v]));
    const double power_of = std::sqrt(4.0 * glm::pi<double>());
    Inflow inflow;
    for (std::size_t link = 0; link < parts.size(); ++link) {
        const Lobes lobes = carried(coarse, border, link);
        const glm::dvec3 power = power_of * glm::dvec3(lobes[0], lobes[4], lobes[8]);
        inflow.shut += parts[link].shut * power;
        std::size_t i = 0;
        border.spread(link, [&](glm::ivec3 cell, double) {
            const double share = parts[link].shares[i++];
            inflow.power += share * power;
            for (std::size_t k = 0; k < 12; ++k)
                sums[place(cell)][k] += share * lobes[k];
        });
    }
    for (int j = 0; j < fine.dims[border.v]; ++j)
        for (int i = 0; i < fine.dims[border.u]; ++i) {
            glm::ivec3 cell;
            cell[border.axis] = border.is_high() ? fine.dims[border.axis] - 1 : 0;
            cell[border.u] = i;
            cell[border.v] = j;
            float* own = &injection.coefficients[12 * fine.index(cell)];
            for (std::size_t k = 0; k < 12; ++k)
                own[k] = float(double(own[k]) + sums[place(cell)][k]);
        }
    injection.power += inflow.power.x + inflow.power.y + inflow.power.z;
    return inflow;
}

} // namespace lpvbake::solver::lpv
