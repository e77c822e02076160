#include "surface/lit_part.h"

#include <iterator>

namespace lpvbake::surface {
namespace {

template <class T>
void append(std::vector<T>& from, std::vector<T>& to) {
    if (to.empty())
        std::swap(from, to);
    else
        to.insert(to.end(), from.begin(), from.end());
    from = {};
}

} // namespace

LitSurfaces join(std::vector<LitPart> parts, Progress& progress) {
    LitPart& whole = parts.front();
    for (LitPart& part : std::span(parts).subspan(1)) {
        append(part.rays.lux, whole.rays.lux);
        append(part.rays.spots, whole.rays.spots);
        append(part.rays.hits, whole.rays.hits);
        append(part.rays.tints, whole.rays.tints);
    }
    whole.reflections.endless = [](const Patch&) {
        return Error(ErrorKind::invalid, "light is reflected without end between surfaces that "
                                         "take none of it: set `max_albedo` lower in all parts");
    };
    if (whole.elements.size() > 0)
        reflect_found(std::move(whole.rays), whole.elements, whole.spots, whole.reflections,
                      nullptr, whole.lit, progress);
    if (whole.emitters)
        add_emission(emission_of(whole.lit.patches), whole.lit);
    whole.lit.share();
    return std::move(whole.lit);
}

} // namespace lpvbake::surface
