// FLIP: how different two pictures look when one alternates between them.
#pragma once

#include "image/image.h"

namespace lpvbake::render {

/// Mean of the difference map of Andersson et al. 2020, "FLIP: A Difference Evaluator for
/// Alternating Images", 0 to 1. `a` and `b` are display-referred (sRGB-encoded RGB, 0 to 1) and of
/// one size; they are looked at with 67 pixels a degree: a 0.7 m wide screen of 3840 pixels from
/// 0.7 m.
double flip(const image::Pixels& a, const image::Pixels& b);

} // namespace lpvbake::render
