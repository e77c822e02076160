#include "medium_options.h"

#include "io/density.h"
#include "lpvbake/error.h"
#include "options/values.h"
#include "report/json.h"
#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::cmd {
namespace {

/// "X", or "R/G/B".
glm::dvec3 parse_channels(const std::string& text, const std::string& part) {
    const auto numbers = options::parse_numbers(part, '/');
    if (!numbers || (numbers->size() != 1 && numbers->size() != 3)
        || std::ranges::any_of(*numbers, [](double x) { return !(x >= 0 && x <= 1e6); }))
        options::refuse(text, "'" + part + "' is neither X nor R/G/B, each a share a metre from 0");
    return numbers->size() == 1 ? glm::dvec3(numbers->front())
                                : glm::dvec3((*numbers)[0], (*numbers)[1], (*numbers)[2]);
}

/// "H0:H".
medium::Falloff parse_height(const std::string& text, const std::string& part) {
    const auto numbers = options::parse_numbers(part, ':');
    if (!numbers || numbers->size() != 2 || (*numbers)[1] == 0)
        options::refuse(text, "'" + part + "' is no height H0:H, metres, H not 0");
    return {(*numbers)[0], (*numbers)[1]};
}

/// "scatter=0.02,absorb=0.002,g=0.6,height=0:12".
medium::Medium parse_medium(const std::string& text) {
    medium::Medium air;
    for (const std::string& part : options::split(text, ',')) {
        const std::size_t equals = part.find('=');
        const std::string key = part.substr(0, equals);
        const std::string value = equals == std::string::npos ? "" : part.substr(equals + 1);
        if (key == "scatter")
            air.scatter = parse_channels(text, value);
        else if (key == "absorb")
            air.absorb = parse_channels(text, value);
        else if (key == "height")
            air.height = parse_height(text, value);
        else if (const auto g = options::parse_number(value); key == "g" && g && std::abs(*g) < 1)
            air.g = *g;
        else
            options::refuse(text,
                            "'" + part
                                + "' is none of scatter=X, absorb=X, height=H0:H and g=X with "
                                  "X between -1 and 1");
    }
    if (air.extinction() == glm::dvec3(0))
        options::refuse(text, "neither scatters nor absorbs");
    return air;
}

/// The box around all voxels.
Bounds box_of(const volume::Density& density) {
    const glm::dmat4 to_metres = glm::inverse(density.to_voxels);
    Bounds box;
    for (int i = 0; i < 8; ++i) {
        const glm::dvec3 corner(
            to_metres
            * glm::dvec4(glm::dvec3(i & 1, i >> 1 & 1, i >> 2) * glm::dvec3(density.dims), 1));
        box.lo = glm::min(box.lo, corner);
        box.hi = glm::max(box.hi, corner);
    }
    return box;
}

/// Where the name of a grid begins, behind the file's.
std::size_t colon_of(const std::string& density) {
    const std::size_t end = density.rfind(".vdb:");
    return end == std::string::npos ? std::string::npos : end + 4;
}

} // namespace

void add_medium_options(options::Options& options, MediumOptions& o, const std::string& help) {
    options.group("Air");
    options
        .value("--medium", o.medium, "scatter=X,absorb=X,g=X,height=H0:H", parse_medium,
               help
                   + ": shares of light scattered and absorbed a metre, X or R/G/B, and the mean "
                     "cosine of scattering; with height that much at H0 metres and e times less "
                     "each H above; see below")
        .record(options::Recorded::if_changed);
    options
        .text("--medium-density", o.density, "FILE.vdb[:GRID]",
              "Float grid of an OpenVDB file, on any affine transform, that multiplies the medium; "
              "default: its grid density, or its only one")
        .need("medium")
        .record(options::Recorded::if_changed);
    options
        .value("--medium-bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1", options::parse_bounds,
               "Box of the medium, metres; default: that of the density, or the scene's")
        .need("medium")
        .record(options::Recorded::if_changed);
}

report::Json medium_json(const medium::Medium& air, const std::string& density) {
    report::Json json{{"scatter", report::vector_json(air.scatter)},
                      {"absorb", report::vector_json(air.absorb)},
                      {"g", air.g},
                      {"height", nullptr},
                      {"density", nullptr}};
    if (air.height)
        json["height"] = {air.height->from, air.height->scale};
    if (!density.empty())
        json["density"] = density;
    return json;
}

std::string density_file(const MediumOptions& o) {
    return o.density.substr(0, colon_of(o.density));
}

std::optional<medium::Medium> medium_of(const MediumOptions& o, const Scene& scene,
                                        std::vector<std::string>& warnings) {
    if (!o.medium)
        return std::nullopt;
    medium::Medium air = *o.medium;
    air.box = bounds_of(scene);
    if (!o.density.empty()) {
        const std::size_t colon = colon_of(o.density);
        air.density = std::make_shared<volume::Density>(io::read_density(
            density_file(o), colon == std::string::npos ? "" : o.density.substr(colon + 1),
            warnings));
        air.box = box_of(*air.density);
    }
    air.box = o.bounds.value_or(air.box);
    medium::check_medium(air, "--medium" + (o.density.empty() ? "" : " of " + o.density));
    const Bounds scene_box = bounds_of(scene);
    if (glm::any(glm::greaterThan(air.box.lo, scene_box.hi))
        || glm::any(glm::lessThan(air.box.hi, scene_box.lo)))
        warnings.push_back(format("--medium: its box, from %.4g,%.4g,%.4g to %.4g,%.4g,%.4g, lies "
                                  "beside the scene; --medium-bounds places it",
                                  air.box.lo.x, air.box.lo.y, air.box.lo.z, air.box.hi.x,
                                  air.box.hi.y, air.box.hi.z));
    return air;
}

} // namespace lpvbake::cmd
