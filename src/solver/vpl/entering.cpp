#include "solver/vpl/entering.h"

#include "mix_word.h"
#include "surface/hemisphere.h"
#include "surface/patches.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>

namespace lpvbake::solver::vpl {
namespace {

constexpr float slack = 1e-3f; ///< what lies so little outside the grid lies on its border

/// A ray that comes into the grid.
struct Entry {
    size_t face; ///< of all outer faces
    glm::vec3 power;
    glm::vec3 direction;
    glm::vec3 share; ///< of the power of the one it comes from
};

/// The outer faces of a grid's cells: sides -x, +x, -y, ..., the next axis fastest.
class Faces {
public:
    explicit Faces(glm::ivec3 dims) : dims_(dims) {
        size_t sum = 0;
        for (size_t side = 0; side < first_.size(); ++side) {
            first_[side] = sum;
            const int axis = int(side) / 2;
            sum += size_t(dims[(axis + 1) % 3]) * size_t(dims[(axis + 2) % 3]);
        }
        size_ = sum;
    }
    size_t size() const { return size_; }

    struct Crossing {
        size_t face;
        float distance;
        size_t side;
    };
    /// Where a ray from outside comes in.
    std::optional<Crossing> crossed_by(glm::vec3 from, glm::vec3 direction) const {
        float enters = 0.0f, leaves = HUGE_VALF;
        int axis = -1;
        for (int k = 0; k < 3; ++k) {
            float a = -from[k] / direction[k], b = (float(dims_[k]) - from[k]) / direction[k];
            if (direction[k] == 0.0f) {
                const bool between = from[k] >= 0.0f && from[k] <= float(dims_[k]);
                a = between ? -HUGE_VALF : HUGE_VALF;
                b = -a;
            }
            if (a > b)
                std::swap(a, b);
            if (a > enters) {
                enters = a;
                axis = k;
            }
            leaves = std::min(leaves, b);
        }
        if (axis < 0 || !(enters < leaves))
            return std::nullopt;
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        const glm::vec3 at = from + enters * direction;
        const auto cell = [&](int k) {
            return size_t(std::clamp(int(std::floor(at[k])), 0, dims_[k] - 1));
        };
        const size_t side = size_t(2 * axis + (direction[axis] < 0.0f ? 1 : 0));
        return Crossing{first_[side] + cell(u) + cell(v) * size_t(dims_[u]), enters, side};
    }
    glm::vec3 centre(size_t face) const {
        size_t side = first_.size() - 1;
        while (face < first_[side])
            --side;
        const int axis = int(side) / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        const size_t place = face - first_[side];
        glm::vec3 centre;
        centre[axis] = side % 2 != 0 ? float(dims_[axis]) : 0.0f;
        centre[u] = float(place % size_t(dims_[u])) + 0.5f;
        centre[v] = float(place / size_t(dims_[u])) + 0.5f;
        return centre;
    }

private:
    glm::ivec3 dims_;
    std::array<size_t, 6> first_{};
    size_t size_ = 0;
};

/// What of the light of one comes in by these sides.
void send(const Vpl& vpl, uint32_t key, int rays, const visibility::Visibility& visibility,
          const Faces& faces, Sides sides, std::vector<Entry>& entries) {
    const uint32_t word = mix_word(key), more = mix_word(word ^ key);
    const float first = float(word >> 8) * 0x1p-24f;
    const float turn = float(more >> 8) * 0x1p-24f;
    const glm::vec3 from = vpl.position + surface::ray_offset(vpl.position) * vpl.normal;
    for (int i = 0; i < rays; ++i) {
        constexpr float golden = 0.618034f;
        const float angle = turn + golden * float(i);
        const glm::vec2 place{(float(i) + first) / float(rays), angle - std::floor(angle)};
        const glm::vec3 direction = surface::sample_cosine(vpl.normal, place);
        const auto crossing = faces.crossed_by(from, direction);
        if (!crossing || !(sides >> crossing->side & 1))
            continue;
        const glm::vec3 passed = visibility.filter({from, direction, 0.0f, crossing->distance});
        if (passed != glm::vec3(0.0f))
            entries.push_back({crossing->face, vpl.power * passed / float(rays), direction,
                               passed / float(rays)});
    }
}

} // namespace

bool is_inside(glm::vec3 point, const scene::Frame& frame) {
    return glm::all(glm::greaterThanEqual(point, glm::vec3(-slack)))
           && glm::all(glm::lessThanEqual(point, glm::vec3(frame.extent) + slack));
}

void let_in(std::vector<Vpl>& vpls, const visibility::Visibility& visibility,
            const scene::Frame& frame, Sides sides) {
    const auto middle = std::stable_partition(
        vpls.begin(), vpls.end(), [&](const Vpl& vpl) { return is_inside(vpl.position, frame); });
    const std::vector<Vpl> outside(middle, vpls.end());
    vpls.erase(middle, vpls.end());
    if (outside.empty())
        return;
    const Faces faces{glm::ivec3(frame.extent)};
    struct Sum {
        glm::dvec3 power{0.0}, way{0.0};
    };
    std::vector<Sum> sums(faces.size());
    const size_t layers = outside.front().layers.size();
    std::vector<glm::dvec3> of_layers(layers * faces.size(), glm::dvec3(0.0)); // [face, layer]
    const int rays = int(std::clamp<size_t>((1 << 18) / outside.size(), 1, 1 << 13));
    constexpr size_t block = 4096;
    std::vector<std::vector<Entry>> entries(std::min(block, outside.size()));
    for (size_t first = 0; first < outside.size(); first += block) {
        const size_t count = std::min(block, outside.size() - first);
        tbb::parallel_for(size_t(0), count, [&](size_t i) {
            entries[i].clear();
            send(outside[first + i], uint32_t(first + i), rays, visibility, faces, sides,
                 entries[i]);
        });
        for (size_t i = 0; i < count; ++i)
            for (const Entry& entry : entries[i]) {
                const glm::dvec3 power(entry.power);
                sums[entry.face].power += power;
                sums[entry.face].way += (power.x + power.y + power.z) * glm::dvec3(entry.direction);
                for (size_t layer = 0; layer < layers; ++layer)
                    of_layers[layers * entry.face + layer] +=
                        glm::dvec3(entry.share) * glm::dvec3(outside[first + i].layers[layer]);
            }
    }
    for (size_t face = 0; face < sums.size(); ++face)
        if (const Sum& sum = sums[face]; sum.power != glm::dvec3(0.0)) {
            const auto of_face = std::span(of_layers).subspan(layers * face, layers);
            vpls.push_back({faces.centre(face),
                            glm::vec3(glm::normalize(sum.way)),
                            glm::vec3(sum.power),
                            {of_face.begin(), of_face.end()}});
        }
}

} // namespace lpvbake::solver::vpl
