// The propagation step of src/solver/lpv/propagate.comp as a plain loop over arrays, to compare the
// kernel with. It shares no code with the solver.
#pragma once

#include <cstddef>

namespace lpvbake::bench {

// Layout of the arrays. Coefficients are apart: plane k of a layer holds coefficient k % 4 (1, y,
// z, x) of channel k / 4. Every row, plane and grid has a border of zeros around it.
struct LoopGrid {
    int nx, ny, nz;

    static constexpr std::ptrdiff_t front_planes = 12; // of a front and of the accumulator
    static constexpr std::ptrdiff_t link_planes = 3;   // transmittances towards +x, +y, +z
    static constexpr std::ptrdiff_t margin = 8;        // floats before and after a row

    constexpr std::ptrdiff_t row() const { return (nx + 7) / 8 * 8 + 2 * margin; }
    constexpr std::ptrdiff_t plane() const { return row() * (ny + 2); }
    constexpr std::ptrdiff_t size(std::ptrdiff_t planes) const {
        return plane() * planes * (nz + 2);
    }
    constexpr std::ptrdiff_t index(int x, int y, int z, std::ptrdiff_t k,
                                   std::ptrdiff_t planes = front_planes) const {
        return ((z + 1) * planes + k) * plane() + (y + 1) * row() + margin + x;
    }
};

// One step: reads front, writes the cells of next (not its border, which must be zero already) and
// adds to accumulator. links may be null: nothing stands between the cells then. Each thread takes
// a run of layers. Returns the flux that has arrived in all cells and channels, summed up in an
// order that does not depend on the number of threads.
double propagate_loop(const LoopGrid& grid, const float* front, float* next, float* accumulator,
                      const float* links, int threads);

} // namespace lpvbake::bench
