#include "solver/lpv/inject.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>

namespace lpvbake::solver::lpv {
namespace {

/// How far a ray starts before the surface it leaves, and how far a centre has to lie before it.
constexpr float lift = 1e-3f;

/// Of each cell whether its light is taken at its centre, asked for when it is first needed: many
/// lights start beside each cell.
class Centres {
public:
    Centres(const visibility::Visibility& visibility, const Grid& grid)
        : visibility_(visibility),
          grid_(grid),
          known_(grid.size()) {}

    /// Threads that ask at once find the same.
    bool is_taken(glm::ivec3 cell) {
        std::atomic<Answer>& known = known_[grid_.index(cell)];
        Answer answer = known.load(std::memory_order_relaxed);
        if (answer == Answer::unasked) {
            const bool taken = visibility_.capture(cell).point == glm::vec3(cell) + 0.5f;
            answer = taken ? Answer::yes : Answer::no;
            known.store(answer, std::memory_order_relaxed);
        }
        return answer == Answer::yes;
    }

private:
    enum class Answer : uint8_t { unasked, yes, no };
    const visibility::Visibility& visibility_;
    const Grid& grid_;
    std::vector<std::atomic<Answer>> known_;
};

size_t front_cell(const vpl::Vpl& vpl, const visibility::Visibility& visibility, const Grid& grid,
                  Centres& centres) {
    const glm::vec3 target = vpl.position + 0.5f * vpl.normal;
    // floor, never truncation: cell -1 is not cell 0.
    const glm::ivec3 base{glm::floor(target)};
    struct Candidate {
        float distance;
        glm::ivec3 cell;
    };
    std::array<Candidate, 27> candidates;
    size_t count = 0;
    for (int z = -1; z <= 1; ++z)
        for (int y = -1; y <= 1; ++y)
            for (int x = -1; x <= 1; ++x) {
                const glm::ivec3 cell = base + glm::ivec3(x, y, z);
                const glm::vec3 center = glm::vec3(cell) + 0.5f;
                if (grid.contains(cell) && glm::dot(center - vpl.position, vpl.normal) > lift)
                    candidates[count++] = {glm::distance(center, target), cell};
            }
    // The nearest first; of equally near cells that which is first in the order of the loops.
    const glm::vec3 from = vpl.position + lift * vpl.normal;
    for (std::span<Candidate> left(candidates.data(), count); !left.empty();) {
        const auto nearest = std::ranges::min_element(left, {}, &Candidate::distance);
        const glm::ivec3 cell = nearest->cell;
        const glm::vec3 center = glm::vec3(cell) + 0.5f;
        if (centres.is_taken(cell)
            && visibility.transmittance({from, center - from, 0.0f, 1.0f}) > 0.0f)
            return grid.index(cell);
        std::move(nearest + 1, left.end(), nearest);
        left = left.first(left.size() - 1);
    }
    return nowhere;
}

/// Of a cell: [4 * colour + k].
using Lobes = std::array<double, 12>;

/// Adds (Phi / pi) K(n); returns Phi, the three channels together.
double add_lobe(const vpl::Vpl& vpl, glm::vec3 power, Lobes& sum) {
    // K(n), the clamped cosine in SH: sqrt(pi)/2 for the constant, sqrt(pi/3) for the linear band.
    const double k0 = std::sqrt(glm::pi<double>()) / 2.0;
    const double k1 = std::sqrt(glm::pi<double>() / 3.0);
    const glm::dvec3 n{vpl.normal};
    const double lobe[4] = {k0, k1 * n.y, k1 * n.z, k1 * n.x};
    double all = 0.0;
    for (size_t channel = 0; channel < 3; ++channel) {
        const double phi = double(power[int(channel)]);
        all += phi;
        for (size_t k = 0; k < 4; ++k)
            sum[4 * channel + k] += phi / glm::pi<double>() * lobe[k];
    }
    return all;
}

/// Whether light goes from here into the grid.
bool stays(const vpl::Vpl& vpl, const Grid& grid) {
    return grid.contains(glm::ivec3(glm::floor(vpl.position + 0.5f * vpl.normal)));
}

} // namespace

Injection inject(std::span<const vpl::Vpl> vpls, const visibility::Visibility& visibility,
                 const Grid& grid) {
    Injection injection;
    std::vector<size_t>& cells = injection.cells;
    cells.resize(vpls.size());
    Centres centres(visibility, grid);
    tbb::parallel_for(size_t(0), vpls.size(),
                      [&](size_t i) { cells[i] = front_cell(vpls[i], visibility, grid, centres); });

    std::vector<size_t> order(vpls.size());
    std::iota(order.begin(), order.end(), size_t(0));
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return cells[a] < cells[b]; });

    injection.coefficients.assign(12 * grid.size(), 0.0f);
    const size_t layers = vpls.empty() ? 0 : vpls.front().layers.size();
    injection.layers.assign(layers, injection.coefficients);
    std::vector<Lobes> sums(1 + layers); // of a cell: of all light, and of layers
    for (size_t first = 0; first < order.size();) {
        const size_t cell = cells[order[first]];
        std::ranges::fill(sums, Lobes{});
        double power = 0.0;
        size_t i = first;
        for (; i < order.size() && cells[order[i]] == cell; ++i) {
            const vpl::Vpl& vpl = vpls[order[i]];
            const double phi = add_lobe(vpl, vpl.power, sums[0]);
            power += phi;
            if (cell == nowhere && stays(vpl, grid))
                injection.shut += phi;
            for (size_t layer = 0; layer < layers; ++layer)
                add_lobe(vpl, vpl.layers[layer], sums[1 + layer]);
        }
        first = i;
        if (cell == nowhere) {
            injection.lost = power;
            continue;
        }
        injection.power += power;
        std::ranges::copy(sums[0], &injection.coefficients[12 * cell]);
        for (size_t layer = 0; layer < layers; ++layer)
            std::ranges::copy(sums[1 + layer], &injection.layers[layer][12 * cell]);
    }
    return injection;
}

} // namespace lpvbake::solver::lpv
