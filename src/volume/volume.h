// What is asked of a volume.
#pragma once

#include "lpvbake/volume.h"

namespace lpvbake::volume {

/// Rec.709 luminance of L0 over valid cells: sum of sqrt(4 pi) c_0, nits * sr (a measure of
/// energy).
double total_energy(const Volume& volume);

} // namespace lpvbake::volume
