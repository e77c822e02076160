// A density on a lattice of its own, as of smoke.
#pragma once

#include <glm/glm.hpp>

#include <vector>

namespace lpvbake::volume {

/// What a voxel holds it holds everywhere in it; outside of the voxels there is nothing.
struct Density {
    /// From metres to voxels, any affine map: voxel (i, j, k) is [i, i + 1] x [j, j + 1] x [k, k +
    /// 1].
    glm::dmat4 to_voxels{1.0};
    glm::ivec3 dims{0};
    std::vector<float> values; ///< x fastest, then y; not negative
    float most = 0;            ///< of them

    /// 0 outside.
    double at(glm::dvec3 voxels) const {
        const glm::ivec3 v(glm::floor(glm::clamp(voxels, -1.0, 1e9)));
        for (int axis = 0; axis < 3; ++axis)
            if (v[axis] < 0 || v[axis] >= dims[axis])
                return 0;
        return double(value(v));
    }
    /// Of a voxel that there is.
    float value(glm::ivec3 v) const {
        return values[std::size_t(v.x)
                      + std::size_t(dims.x)
                            * (std::size_t(v.y) + std::size_t(dims.y) * std::size_t(v.z))];
    }
};

} // namespace lpvbake::volume
