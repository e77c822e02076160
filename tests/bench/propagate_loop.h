// The propagation step of src/solver/lpv/propagate.comp as plain loops over arrays, to compare the
// kernel with. It shares no code with the solver.
//
// What makes it fast on a CPU: a row's coefficients lie one after the other, so that a step reads
// and writes long runs; receiving and re-emitting are two loops, short enough for the compiler's
// registers and the core's window; and the new front takes the place of the old one.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <vector>

namespace lpvbake::bench {

/// A field of light on nx * ny * nz cells that is propagated in place.
///
/// Each thread owns a slab of layers and stores the new layer z where the layer behind it was,
/// which no cell needs any more once its row is done; so a slab moves by a layer a step, to and
/// fro. Neighbouring slabs are swept in opposite directions: where two sweeps end, the layers that
/// they read from each other stay in place, and where two begin, both threads wait until the first
/// layers are done.
class PropagateLoop {
public:
    /// `occluded`: light is scaled by the links. All values are zero at first. `threads` is at
    /// most nz.
    PropagateLoop(int nx, int ny, int nz, bool occluded, int threads);

    /// Coefficient k % 4 (in the order 1, y, z, x) of channel k / 4 of what a cell sends out next.
    float& front(int x, int y, int z, int k);
    /// The same of all light that a cell has received.
    float& total(int x, int y, int z, int k);
    /// Transmittance towards the neighbour in +x, +y or +z (axis 0, 1, 2).
    float& link(int x, int y, int z, int axis);

    /// Propagates `steps` times. Returns the flux that arrived in the last step in all cells and
    /// channels together, summed up in an order that does not depend on the number of threads.
    double run(int steps);

private:
    struct Free {
        void operator()(float* p) const { std::free(p); }
    };
    using Array = std::unique_ptr<float[], Free>;
    /// Zeros, in huge pages where the system has them.
    static Array zeros(std::ptrdiff_t count);

    std::ptrdiff_t row(int runs) const { return runs * pitch_; }
    std::ptrdiff_t layer(int runs) const { return row(runs) * (ny_ + 2); }
    std::ptrdiff_t cell(int x, int y, int k, int runs) const {
        return (y + 1) * row(runs) + k * pitch_ + margin + x;
    }
    /// The layer of the front, which may lie outside of the grid and is zero there.
    float* layer_of_front(int z);
    template <bool occluded>
    void sweep_layer(int z, float* target, std::vector<float>& received);

    static constexpr int coefficients = 12; ///< of a cell
    static constexpr int axes = 3;          ///< with a link each
    static constexpr int margin = 8;        ///< zeros before each run of a row

    int nx_, ny_, nz_;
    bool occluded_;
    int threads_;
    std::ptrdiff_t pitch_;  ///< floats from a run of nx values to the next one
    bool moved_ = false;    ///< even slabs lie a layer lower, odd ones a layer higher than at first
    std::vector<int> slab_; ///< of a layer
    std::vector<double> layer_flux_;
    Array front_, total_, links_, border_;
};

} // namespace lpvbake::bench
