// Light packed as its mean and all else over the mean, for texels of few bits.
#pragma once

#include "io/texel.h"
#include "volume/convention.h"

namespace lpvbake::io {

/// Turns light into texels, in place: the mean into what `mean` gives back of it, at most 32768 in
/// units of a power of 2 that is 1 if it can be, without what lies below 0; coefficients above 0
/// into 0 to 1. A range leaves out what costs less, clipped, than finer steps of all else save.
Ranges to_ratios(const TexelForm& mean, Volume& stored);

/// The other way.
void from_ratios(const Ranges& ranges, Volume& stored);

/// What packing adds to the error of `stored`; `packed` has its texels as they are read.
PackingError packing_error(const Volume& stored, const volume::Encoding& encoding,
                           const Ranges& ranges, Volume packed);

} // namespace lpvbake::io
