// Light packed as its mean and all else over the mean, for texels of few bits.
#pragma once

#include "io/texel.h"
#include "volume/convention.h"

namespace lpvbake::io {

/// How much a cell's errors count: those of cells inside geometry, which readers leave out, little;
/// but after a fit to programs that read them, as much as others.
std::vector<float> cell_weights(const Volume& volume);

/// Turns light into texels, in place. The mean becomes what `mean`, the form of its texture, gives
/// back of it, at most 32768 in units of a power of 2 that is 1 if it can be, and 0 where it is
/// below that; of blocks it becomes the grid of base_kind. All other coefficients become 0 to 1. A
/// range leaves out what costs less, clipped, than finer steps of all else save.
Ranges to_ratios(const TexelForm& mean, Volume& stored);

/// The other way; there is no base after it.
void from_ratios(const Ranges& ranges, Volume& stored);

/// What packing adds to the error of `stored`; `packed` has its texels as they are read.
PackingError packing_error(const Volume& stored, const volume::Encoding& encoding,
                           const Ranges& ranges, Volume packed);

} // namespace lpvbake::io
