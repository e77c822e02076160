// What two volumes on one lattice differ by in the cells that both have.
#pragma once

#include "lpvbake/volume.h"

#include <cstdint>

namespace lpvbake::report {

struct Seam {
    uint64_t cells = 0;      ///< valid in both
    double off = 0, sum = 0; ///< of irradiance on faces along the axes: differences, and the light

    double share() const { return sum > 0 ? off / sum : 0.0; }
    Seam& operator+=(const Seam& other);
};

/// Throws Error (invalid) unless their lattices are one.
Seam seam_between(const Volume& a, const Volume& b);

} // namespace lpvbake::report
