// What of a picture is lit.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lpvbake::colour {

/// Those of the luminances that lie within ten stops, which is what a screen shows, of the 99th
/// percentile of all above 0; ascending. Corners that no light gets to do not count, however many
/// they are.
inline std::vector<float> lit_of(std::vector<float> luminances) {
    std::erase_if(luminances, [](float y) { return !(y > 0); });
    std::ranges::sort(luminances);
    if (luminances.empty())
        return luminances;
    const float least = luminances[(luminances.size() - 1) * 99 / 100] / 1024;
    luminances.erase(luminances.begin(), std::ranges::lower_bound(luminances, least));
    return luminances;
}

} // namespace lpvbake::colour
