// Emissive surfaces as virtual point lights.
#pragma once

#include "rsm/rsm.h"
#include "surface/patches.h"

#include <vector>

namespace lpvbake {

/// Appends one VPL of power pi * Le * A (lm) for each emissive patch, and one for the back
/// of a double-sided one. `unit` is the edge of a cell in metres.
void emit_vpls(const std::vector<Patch>& patches, double unit, std::vector<Vpl>& vpls);

} // namespace lpvbake
