// Where surfaces lie between the centres of cells.
#pragma once

#include "surface/patches.h"

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

struct Occupancy {
    glm::ivec3 dims{0};
    /// occupied[i + (dims.x + 1) (j + (dims.y + 1) k)]: 1 where a surface meets the unit cube whose
    /// corners are the centres of the cells i - 1 and i, j - 1 and j, k - 1 and k.
    std::vector<uint8_t> occupied;

    bool is_occupied(glm::ivec3 cube) const {
        return occupied[size_t(cube.x)
                        + size_t(dims.x + 1)
                              * (size_t(cube.y) + size_t(dims.y + 1) * size_t(cube.z))]
               != 0;
    }
};

/// Finds the cubes that hold a surface, or come within surface_margin of one, and a little more.
Occupancy find_occupied(const std::vector<surface::Patch>& patches, glm::ivec3 dims);

/// 1 for each cell whose luminance a sweep may carry into one whose validity is above 0: these, and
/// what is joined to them by cubes without surfaces. Without a validity all cells.
std::vector<uint8_t> find_feeding(const Occupancy& occupancy, std::span<const float> validity);

} // namespace lpvbake::solver::sn
