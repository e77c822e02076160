// Discrete ordinates by the book: the luminance of a cell in a direction from that of the cells
// upstream, looked up recursively, in double and one direction at a time.
#pragma once

#include <glm/glm.hpp>

#include <cmath>
#include <functional>
#include <map>
#include <tuple>
#include <vector>

namespace lpvbake::oracle {

struct SnWorld {
    glm::ivec3 dims{0};
    /// True if a surface lies in the box between two cell centres.
    std::function<bool(glm::ivec3, glm::ivec3)> surface_between;
    /// What arrives outside the grid and beside surfaces, of light that travels along d.
    std::function<glm::dvec3(glm::ivec3 cell, glm::dvec3 d)> seen;
};

class SnDirection {
public:
    SnDirection(const oracle::SnWorld& world, glm::dvec3 d) : world_(world), d_(d) {
        for (int a = 0; a < 3; ++a)
            step_[a] = d[a] > 0.0 ? -1 : 1;
        axis_ = 0;
        for (int a = 1; a < 3; ++a)
            if (std::abs(d[a]) > std::abs(d[axis_]))
                axis_ = a;
    }

    glm::dvec3 at(glm::ivec3 c) {
        if (glm::any(glm::lessThan(c, glm::ivec3(0)))
            || glm::any(glm::greaterThanEqual(c, world_.dims)))
            return world_.seen(c, d_);
        const auto key = std::tuple(c.x, c.y, c.z);
        if (const auto known = known_.find(key); known != known_.end())
            return known->second;
        return known_[key] = compute(c);
    }

private:
    glm::dvec3 compute(glm::ivec3 c) {
        if (world_.surface_between(c, c + step_))
            return world_.seen(c, d_);
        // Where the ray meets the plane of centres before, and the four around that point.
        const glm::dvec3 at_plane = glm::dvec3(c) - d_ / std::abs(d_[axis_]);
        glm::dvec3 sum{0.0};
        for (int corner = 0; corner < 4; ++corner) {
            glm::ivec3 tap = c;
            tap[axis_] += step_[axis_];
            double weight = 1.0;
            for (int i = 1; i <= 2; ++i) {
                const int a = (axis_ + i) % 3;
                if (corner >> (i - 1) & 1)
                    tap[a] += step_[a];
                weight *= 1.0 - std::abs(at_plane[a] - double(tap[a]));
            }
            sum += weight * at(tap);
        }
        return sum;
    }

    const oracle::SnWorld& world_;
    glm::dvec3 d_;
    glm::ivec3 step_{0};
    int axis_;
    std::map<std::tuple<int, int, int>, glm::dvec3> known_;
};

} // namespace lpvbake::oracle
