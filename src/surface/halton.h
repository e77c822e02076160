// Low-discrepancy numbers.
#pragma once

#include <cstdint>

namespace lpvbake::surface {

/// Element i of Van der Corput's sequence of a base, in [0, 1): a coordinate of Halton's. `Index`
/// is unsigned; narrow ones divide faster.
template <class Index>
double radical_inverse(Index i, uint32_t base) {
    double inverse = 0.0, scale = 1.0;
    for (; i > 0; i /= base) {
        scale /= base;
        inverse += scale * double(i % base);
    }
    return inverse;
}

} // namespace lpvbake::surface
