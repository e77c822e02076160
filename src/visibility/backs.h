// A check of how a scene was modelled: do lights see fronts or backs?
#pragma once

#include "visibility/visibility.h"

namespace lpvbake::visibility {

/// Share of a light's first hits that meet the back of a single-sided surface, 0 to 1, from 1024
/// rays spread over its directions (point, spot) or over the grid's box (directional). 0 if none
/// hits.
double share_of_backs(const Visibility& visibility, const Light& light, const scene::Frame& frame);

} // namespace lpvbake::visibility
