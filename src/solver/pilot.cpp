#include "solver/pilot.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::solver {

double lost_bands(const Pilot& pilot, int order) {
    // A surface's irradiance has no band 3 (Ramamoorthi and Hanrahan 2001); what the pilot does not
    // have falls as what it has.
    const auto [one, two] = pilot.bands;
    return order >= 4 ? one > 0 ? two * two / one : 0.0 : order >= 2 ? two : order == 1 ? one : 1.0;
}

double lost_clusters(const Pilot& pilot, int clusters) {
    constexpr double least_power = 0.25, most_power = 1.0; // what random numbers do to a short fit
    const auto [few, more] = pilot.clusters;
    if (!(few > 0 && more > 0))
        return more;
    const double power =
        std::clamp(std::log(few / more) / std::log(double(more_clusters) / few_clusters),
                   least_power, most_power);
    return more * std::pow(double(more_clusters) / clusters, power);
}

} // namespace lpvbake::solver
