// Air that scatters and absorbs light.
#pragma once

#include "scene/scene.h"
#include "volume/density.h"

#include <memory>
#include <optional>
#include <string>

namespace lpvbake::medium {

/// Of a density that falls with height: 1 at a height, e times less each so many metres above it.
struct Falloff {
    double from = 0, scale = 1; ///< metres; `scale` is not 0
};

/// Air in a box, and nothing outside of it. Its density is 1 everywhere, unless it falls with
/// height or is given; where both, their product.
struct Medium {
    glm::dvec3 scatter{0.0}; ///< share of light that is scattered a metre, RGB, at density 1
    glm::dvec3 absorb{0.0};  ///< and that is absorbed
    double g = 0;            ///< mean cosine of the angle by which it is scattered, -1 < g < 1
    Bounds box;              ///< metres
    std::optional<Falloff> height = {};
    std::shared_ptr<const volume::Density> density = {};

    glm::dvec3 extinction() const { return scatter + absorb; }
    bool is_even() const { return !height && !density; }

    /// At a place, metres.
    double density_at(glm::dvec3 place) const;
    /// The largest in the box; no less than any, and 0 for none.
    double peak() const;
    /// The integral of density along a segment, metres; exact.
    double column(glm::dvec3 from, glm::dvec3 to) const;
    /// Of a box along the axes, metres: of a given density along 16 lines through it, else exact.
    double mean_density(glm::dvec3 lo, glm::dvec3 hi) const;
    /// How far apart places are at which the density may be another, metres; 0: it is even.
    double grain() const;
};

/// Light of which so much is left as goes a metre of density 1.
inline constexpr double most_extinction = 1e6;

/// Throws Error (invalid) that begins with `place` where the extinction is above most_extinction,
/// or all of the box is without density.
void check_medium(const Medium& medium, const std::string& place);

/// "scatter=0.02/0.02/0.02,absorb=0/0/0,g=0.6,height=0:12".
std::string text_of(const Medium& medium);

/// Share of scattered light that goes on at an angle of this cosine from the way it came, 1 / sr
/// (Henyey and Greenstein 1941).
double phase(double g, double cosine);

/// The part of a ray from `begin` to `end` that lies in the box [lo, hi]: none where it is empty.
/// The direction is of any length.
std::optional<glm::dvec2> within(glm::dvec3 origin, glm::dvec3 direction, glm::dvec3 lo,
                                 glm::dvec3 hi, double begin, double end);

/// The integral of exp(-a t) from t0 to t1, any a.
double decay(double a, double t0, double t1);

} // namespace lpvbake::medium
