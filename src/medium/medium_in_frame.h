// A medium as a frame has it: in its units.
#pragma once

#include "medium/medium.h"
#include "scene/frame.h"

#include <optional>

namespace lpvbake::medium {

class MediumInFrame {
public:
    MediumInFrame(const Medium& medium, const scene::Frame& frame);

    /// The part of a ray in the medium.
    struct Part {
        glm::dvec3 origin, direction; ///< unit
        double begin, end;
        glm::dvec3 at(double t) const { return origin + t * direction; }
    };
    /// None where the ray does not meet it before `distance`, which may be infinite.
    std::optional<Part> part_in(glm::dvec3 origin, glm::dvec3 direction, double distance) const;
    /// Of density along a segment in the medium, and how much there is at a place.
    double column(glm::dvec3 from, glm::dvec3 to) const;
    double density(glm::dvec3 place) const;
    /// The column that light has passed at a place: parallel light of a unit direction, from where
    /// it enters; and that of a lamp.
    double column_before(glm::dvec3 place, glm::dvec3 direction) const;
    double column_from(glm::dvec3 lamp, glm::dvec3 place) const;
    /// What of a step at this column from the eye, and of so much itself, is left of it at the eye,
    /// a unit of light a unit of density.
    glm::dvec3 step_weight(double before, double own) const;

    const Medium& medium() const { return medium_; }
    glm::dvec3 lo() const { return lo_; }
    glm::dvec3 hi() const { return hi_; }
    /// Over a unit of density's column, a channel.
    glm::dvec3 scatter() const { return scatter_; }
    glm::dvec3 extinction() const { return extinction_; }

private:
    scene::Frame frame_;
    Medium medium_;
    glm::dvec3 lo_, hi_;
    glm::dvec3 scatter_, extinction_;
};

} // namespace lpvbake::medium
