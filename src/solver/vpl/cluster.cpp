#include "colour/colour.h"
#include "solver/vpl/rsm.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::vpl {

namespace {

constexpr float same_facing = 0.7f; ///< least cosine between normals that join: 45 degrees

float luminance(glm::vec3 rgb) {
    return glm::dot(rgb, glm::vec3(colour::rec709_luminance));
}

struct Candidate {
    std::size_t texel;
    float brightness;
};

/// Which cell a texel lies in, of the finest level of a frame that holds another one.
class Cells {
public:
    Cells(const scene::Frame& frame, glm::vec3 position) {
        const glm::vec3 inside = glm::clamp(position, glm::vec3(0), glm::vec3(frame.extent));
        if (frame.coarser.empty() || position == inside)
            return;
        for (const scene::CoarserBox& level : frame.coarser) {
            lo_ = level.lo;
            size_ = level.cell;
            if (position == glm::clamp(position, level.lo, level.hi))
                return;
        }
    }
    glm::vec3 at(glm::vec3 position) const { return glm::floor((position - lo_) / size_); }

private:
    glm::vec3 lo_{0};
    float size_ = 1;
};

/// Takes the brightest candidate and all that join it out of `left`; those that remain keep their
/// order.
Vpl take_cluster(const Rsm& rsm, const scene::Frame& frame, std::vector<Candidate>& left) {
    const Candidate seed = *std::ranges::max_element(left, {}, &Candidate::brightness);
    const Cells cells(frame, rsm.position[seed.texel]);
    const glm::vec3 own = cells.at(rsm.position[seed.texel]);
    std::vector<std::size_t> members;
    glm::dvec3 power(0), mean(0), normal(0);
    double weight = 0;
    std::erase_if(left, [&](const Candidate& candidate) {
        const glm::vec3 apart = cells.at(rsm.position[candidate.texel]) - own;
        if (candidate.texel != seed.texel
            && (glm::dot(apart, apart) >= 3
                || glm::dot(rsm.normal[candidate.texel], rsm.normal[seed.texel]) < same_facing))
            return false;
        const double share = candidate.brightness;
        members.push_back(candidate.texel);
        power += glm::dvec3(rsm.power[candidate.texel]);
        mean += share * glm::dvec3(rsm.position[candidate.texel]);
        normal += share * glm::dvec3(rsm.normal[candidate.texel]);
        weight += share;
        return true;
    });
    mean /= weight;
    // On a curved surface the mean lies inside the solid; a texel does not.
    const std::size_t nearest = *std::ranges::min_element(members, {}, [&](std::size_t texel) {
        return glm::distance(glm::dvec3(rsm.position[texel]), mean);
    });
    return {rsm.position[nearest], glm::vec3(glm::normalize(normal)), glm::vec3(power)};
}

} // namespace

void cluster_vpls(const Rsm& rsm, const scene::Frame& frame, int kernel, std::vector<Vpl>& vpls) {
    kernel = std::max(kernel, 1);
    const int block_rows = (rsm.height + kernel - 1) / kernel;
    std::vector<std::vector<Vpl>> found(block_rows);
    tbb::parallel_for(0, block_rows, [&](int block_row) {
        const int top = block_row * kernel, bottom = std::min(top + kernel, rsm.height);
        std::vector<Candidate> block;
        for (int left = 0; left < rsm.width; left += kernel) {
            const int right = std::min(left + kernel, rsm.width);
            block.clear();
            for (int y = top; y < bottom; ++y)
                for (int x = left; x < right; ++x) {
                    const std::size_t texel = std::size_t(y) * rsm.width + x;
                    const float brightness = luminance(rsm.power[texel]);
                    if (brightness > 0)
                        block.push_back({texel, brightness});
                }
            while (!block.empty())
                found[block_row].push_back(take_cluster(rsm, frame, block));
        }
    });
    for (const std::vector<Vpl>& row : found)
        vpls.insert(vpls.end(), row.begin(), row.end());
}

} // namespace lpvbake::solver::vpl
