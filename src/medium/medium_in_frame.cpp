#include "medium/medium_in_frame.h"

#include <cmath>

namespace lpvbake::medium {

MediumInFrame::MediumInFrame(const Medium& medium, const scene::Frame& frame)
    : frame_(frame),
      medium_(medium),
      lo_(frame.from_world(medium.box.lo)),
      hi_(frame.from_world(medium.box.hi)),
      scatter_(medium.scatter * frame.unit),
      extinction_(medium.extinction() * frame.unit) {}

std::optional<MediumInFrame::Part> MediumInFrame::part_in(glm::dvec3 origin, glm::dvec3 direction,
                                                          double distance) const {
    const auto in = within(origin, direction, lo_, hi_, 0.0, distance);
    if (!in)
        return std::nullopt;
    return Part{origin, direction, in->x, in->y};
}

double MediumInFrame::column(glm::dvec3 from, glm::dvec3 to) const {
    return medium_.is_even()
               ? glm::length(to - from)
               : medium_.column(frame_.to_world(from), frame_.to_world(to)) / frame_.unit;
}

double MediumInFrame::density(glm::dvec3 place) const {
    return medium_.is_even() ? 1 : medium_.density_at(frame_.to_world(place));
}

double MediumInFrame::column_before(glm::dvec3 place, glm::dvec3 direction) const {
    const auto in = within(place, -direction, lo_, hi_, 0.0, HUGE_VAL);
    return !in ? 0 : medium_.is_even() ? in->y : column(place - in->y * direction, place);
}

double MediumInFrame::column_from(glm::dvec3 lamp, glm::dvec3 place) const {
    const glm::dvec3 way = lamp - place;
    const auto in = within(place, way, lo_, hi_, 0.0, 1.0);
    return in ? column(place + in->x * way, place + in->y * way) : 0;
}

glm::dvec3 MediumInFrame::step_weight(double before, double own) const {
    glm::dvec3 weight;
    for (int c = 0; c < 3; ++c)
        weight[c] = std::exp(-extinction_[c] * before) * decay(extinction_[c], 0, own);
    return weight;
}

} // namespace lpvbake::medium
