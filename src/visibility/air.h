// Air that light passes on its way between surfaces, as whoever traces light needs it: what it
// takes, and what it sends. Frame units of the structure that answers rays.
#pragma once

#include <glm/glm.hpp>

#include <array>
#include <cmath>

namespace lpvbake::visibility {

class Air {
public:
    virtual ~Air() = default;

    /// The integral of its density on origin + t * direction, begin <= t <= end, which may be
    /// infinite; frame units of density 1.
    virtual float column(glm::vec3 origin, glm::vec3 direction, float begin, float end) const = 0;
    /// What is taken of light a frame unit of density 1, a channel.
    virtual glm::vec3 extinction() const = 0;
    /// What is left of light on that way.
    glm::vec3 left(glm::vec3 origin, glm::vec3 direction, float begin, float end) const {
        const float passed = column(origin, direction, begin, end);
        const glm::vec3 taken = extinction();
        return taken.x == taken.y && taken.y == taken.z ? glm::vec3(std::exp(-taken.x * passed))
                                                        : glm::exp(-taken * passed);
    }

    /// It sends light. Then that is all the light there is: surfaces reflect it, but lamps, sky and
    /// emitters are dark, so that what one order of scattering adds is found by itself.
    virtual bool is_lit() const { return false; }
    /// Luminance (nits) that the air on that way sends to the origin; 0 where it is not lit.
    virtual glm::vec3 sent(glm::vec3 /*origin*/, glm::vec3 /*direction*/, float /*begin*/,
                           float /*end*/) const {
        return glm::vec3(0.0f);
    }

    /// The air around a place of the grid, as a sweep passes it.
    struct Place {
        float density = 0;
        /// What luminance becomes on a long way through it, as Volume::sh has it.
        std::array<glm::vec3, 9> source{};
    };
    /// Interpolated from the cells around.
    virtual Place at(glm::vec3 place) const = 0;
    /// Coefficients of sources that are not 0: 0, 1 or 9.
    virtual int coefficients() const { return 0; }
};

} // namespace lpvbake::visibility
