#include "transfer/propagation.h"

#include "colour/colour.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lpvbake::transfer {
namespace {

constexpr std::size_t neighbours = 26;

glm::ivec3 way_to(std::size_t neighbour) {
    const int i = int(neighbour < neighbours / 2 ? neighbour : neighbour + 1);
    return glm::ivec3(i % 3, i / 3 % 3, i / 9) - 1;
}

/// What all hops have in common.
class Hop {
public:
    std::array<std::array<float, 16>, neighbours> project{}; ///< P, [4 i + j]
    std::array<Light4, neighbours> beyond{};                 ///< what the sky has there
    std::array<volume::ShValues, neighbours> basis{};        ///< along the way, to order 2

    explicit Hop(const std::function<glm::vec3(glm::vec3)>& sky) {
        for (std::size_t n = 0; n < neighbours; ++n) {
            ways_[n] = glm::normalize(glm::vec3(way_to(n)));
            basis[n] = volume::sh_basis(2, ways_[n]);
        }
        Sums sums;
        // Texels of a cube.
        for (int face = 0; face < 6; ++face)
            for (int texel = 0; texel < edge * edge; ++texel) {
                const glm::dvec2 at =
                    (glm::dvec2(texel % edge, texel / edge) + 0.5) * (2.0 / edge) - 1.0;
                glm::dvec3 way;
                way[face / 2] = face % 2 ? 1 : -1;
                way[(face / 2 + 1) % 3] = at.x;
                way[(face / 2 + 2) % 3] = at.y;
                add(way, sky, sums);
            }
        // The sum over all directions becomes what the integral is.
        for (std::size_t n = 0; n < neighbours; ++n)
            for (std::size_t i = 0; i < 4; ++i) {
                beyond[n][i] = glm::vec3(sums.beyond[n][i] / std::sqrt(sums.all[i] * sums.all[0]));
                for (std::size_t j = 0; j < 4; ++j)
                    project[n][4 * i + j] =
                        float(sums.project[n][4 * i + j] / std::sqrt(sums.all[i] * sums.all[j]));
            }
    }

private:
    static constexpr int edge = 128;
    struct Sums {
        std::array<std::array<double, 16>, neighbours> project{};
        std::array<std::array<glm::dvec3, 4>, neighbours> beyond{};
        std::array<double, 4> all{};
    };

    void add(glm::dvec3 way, const std::function<glm::vec3(glm::vec3)>& sky, Sums& sums) const {
        const double length = glm::length(way);
        const double angle = 4.0 / (edge * edge) / (length * length * length);
        const glm::vec3 towards(way / length);
        const auto nearest =
            std::size_t(std::ranges::max_element(
                            ways_, {}, [&](const glm::vec3& to) { return glm::dot(towards, to); })
                        - ways_.begin());
        const volume::ShValues y = volume::sh_basis(1, towards);
        const glm::dvec3 luminance = sky ? glm::dvec3(sky(towards)) : glm::dvec3(0.0);
        for (std::size_t i = 0; i < 4; ++i) {
            const double weight = angle * double(y[i]);
            sums.all[i] += weight * double(y[i]);
            sums.beyond[nearest][i] += weight * luminance;
            for (std::size_t j = 0; j < 4; ++j)
                sums.project[nearest][4 * i + j] += weight * double(y[j]);
        }
    }

    std::array<glm::vec3, neighbours> ways_;
};

/// What a cell makes of light.
struct Cell {
    std::array<glm::mat4, 3> reflected; ///< (1 - T)^-1 - 1 of each channel
    glm::mat4 product;                  ///< V
    std::array<float, neighbours> open; ///< v
};

std::vector<Cell> cells_of(const Volume& volume, const Hop& hop) {
    const std::vector<volume::ConstGridView> transfer =
        volume::grids_of(volume, volume::local_transfer_kind());
    const std::vector<volume::ConstGridView> visibility =
        volume::grids_of(volume, volume::local_visibility_kind());
    std::vector<Cell> cells(volume.grid.size());
    tbb::parallel_for(std::size_t(0), cells.size(), [&](std::size_t i) {
        Cell& cell = cells[i];
        for (std::size_t channel = 0; channel < 3; ++channel) {
            glm::dmat4 once;
            for (int k = 0; k < 16; ++k)
                once[k % 4][k / 4] = double(transfer[std::size_t(k)].data[3 * i + channel]);
            const glm::dmat4 one(1.0);
            cell.reflected[channel] = glm::mat4(glm::inverse(one - once) - one);
        }
        std::array<float, 9> visible;
        for (std::size_t k = 0; k < visible.size(); ++k)
            visible[k] = visibility[k].data[i];
        const std::vector<double> product = volume::sh_product(1, visible);
        for (int k = 0; k < 16; ++k)
            cell.product[k % 4][k / 4] = float(
                product[std::size_t(volume::sh_count(volume::sh_max_order) * (k / 4) + k % 4)]);
        for (std::size_t n = 0; n < neighbours; ++n)
            cell.open[n] = std::clamp(
                std::inner_product(visible.begin(), visible.end(), hop.basis[n].begin(), 0.0f),
                0.0f, 1.0f);
    });
    return cells;
}

class Propagation {
public:
    Propagation(const Volume& volume, const Sources& sources)
        : grid_(volume.grid),
          sources_(sources),
          hop_(sources.beyond),
          cells_(cells_of(volume, hop_)) {}

    /// The light of a cell after a hop, of that before.
    Light4 next(std::size_t cell, const std::vector<Light4>& field) const {
        const Light4 in = arriving(cell, field);
        Light4 out;
        for (int channel = 0; channel < 3; ++channel) {
            const auto of = [channel](const Light4& light) {
                return glm::vec4(light[0][channel], light[1][channel], light[2][channel],
                                 light[3][channel]);
            };
            glm::vec4 light = cells_[cell].product * of(in);
            if (!sources_.emitted.empty())
                light += of(sources_.emitted[cell]);
            glm::vec4 falling = light;
            for (const std::vector<Light4>* direct : {&sources_.direct, &sources_.suns})
                if (!direct->empty())
                    falling += of((*direct)[cell]);
            light += cells_[cell].reflected[std::size_t(channel)] * falling;
            for (int i = 0; i < 4; ++i)
                out[std::size_t(i)][channel] = light[i];
        }
        return out;
    }

private:
    Light4 arriving(std::size_t cell, const std::vector<Light4>& field) const {
        const glm::ivec3 at = grid_.cell_at(cell);
        const Light4& own = field[cell];
        Light4 in = own;
        for (std::size_t n = 0; n < neighbours; ++n) {
            const glm::ivec3 neighbour = at + way_to(n);
            const float open = cells_[cell].open[n];
            const std::array<float, 16>& project = hop_.project[n];
            const bool inside = grid_.contains(neighbour);
            Light4 more{};
            for (std::size_t j = 0; j < 4; ++j)
                more[j] = inside ? field[grid_.index(neighbour)][j] - own[j] : -own[j];
            for (std::size_t i = 0; i < 4; ++i) {
                glm::vec3 sum = inside ? glm::vec3(0.0f) : hop_.beyond[n][i];
                for (std::size_t j = 0; j < 4; ++j)
                    sum += project[4 * i + j] * more[j];
                in[i] += open * sum;
            }
        }
        return in;
    }

    Grid grid_;
    const Sources& sources_;
    Hop hop_;
    std::vector<Cell> cells_;
};

} // namespace

Propagated propagate(const Volume& volume, const Sources& sources,
                     const PropagationSettings& settings, Progress& progress) {
    const Propagation propagation(volume, sources);
    Propagated result;
    std::vector<Light4>& field = result.field;
    field.resize(volume.grid.size());
    std::vector<Light4> next(field.size());
    const std::size_t layer = std::size_t(volume.grid.dims.x) * std::size_t(volume.grid.dims.y);
    std::vector<glm::dvec2> sums(std::size_t(volume.grid.dims.z)); // of light, and of its change
    double before = 0;
    while (result.iterations < settings.iterations.value_or(settings.most)) {
        tbb::parallel_for(std::size_t(0), sums.size(), [&](std::size_t z) {
            sums[z] = glm::dvec2(0.0);
            for (std::size_t cell = z * layer; cell < (z + 1) * layer; ++cell) {
                next[cell] = propagation.next(cell, field);
                const glm::dvec3 now(next[cell][0]), change = now - glm::dvec3(field[cell][0]);
                sums[z] += glm::dvec2(glm::dot(colour::rec709_luminance, now),
                                      glm::dot(colour::rec709_luminance, glm::abs(change)));
            }
        });
        field.swap(next);
        progress.advance(uint64_t(++result.iterations));
        const glm::dvec2 sum = std::accumulate(sums.begin(), sums.end(), glm::dvec2(0.0));
        // What is to come falls from hop to hop as it does now.
        if (!(sum.y > 0))
            result.missing = 0;
        else if (result.iterations > 1 && sum.y < before)
            result.missing = std::min(1.0, sum.y / sum.x * sum.y / (before - sum.y));
        before = sum.y;
        if (!settings.iterations && result.missing < settings.missing)
            break;
    }
    for (std::size_t cell = 0; cell < sources.suns.size(); ++cell)
        for (std::size_t i = 0; i < 4; ++i)
            field[cell][i] += sources.suns[cell][i];
    return result;
}

} // namespace lpvbake::transfer
