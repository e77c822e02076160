#include "io/boxes.h"

#include "file_error.h"
#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"

#include <nlohmann/json.hpp>

#include <cmath>

namespace lpvbake::io {
namespace {

using Json = nlohmann::ordered_json;

constexpr uint64_t most_bytes = 1 << 22;

void read_box(const std::string& path, const std::string& place, const Json& json,
              volume::Adjustment& box) {
    bool good = json.is_array() && json.size() == 6;
    for (std::size_t i = 0; good && i < 6; ++i)
        good = json[i].is_number() && std::isfinite(json[i].get<double>());
    if (!good)
        reject(path, place + ".box: must be an array of 6 numbers, x0, y0, z0, x1, y1, z1");
    const std::vector<double> x = json;
    box.lo = {x[0], x[1], x[2]};
    box.hi = {x[3], x[4], x[5]};
    if (!glm::all(glm::lessThanEqual(box.lo, box.hi)))
        reject(path, place + ".box: is inside out; give the lower corner first");
}

void read_set(const std::string& path, const std::string& place, const Json& json,
              volume::Adjustment& box) {
    const std::string what = json.is_string() ? json.get<std::string>() : "";
    if (what == "finer" || what == "coarser")
        throw Error(ErrorKind::unsupported,
                    path + ": " + place + ".set: \"" + what
                        + "\" is for grids that adapt, which a bake has none of; give the box "
                          "cells of another size as a `level`");
    if (what != "valid" && what != "invalid")
        reject(path, place + ".set: must be \"valid\" or \"invalid\"");
    box.valid = what == "valid";
}

volume::Adjustment read_adjustment(const std::string& path, const std::string& place,
                                   const Json& json) {
    volume::Adjustment box{};
    if (!json.is_object() || !json.contains("box"))
        reject(path, place + ": lacks \"box\", an array of 6 numbers");
    for (const auto& [key, value] : json.items()) {
        if (key == "box") {
            read_box(path, place, value, box);
        } else if (key == "set") {
            read_set(path, place, value, box);
        } else if (key == "intensity") {
            box.intensity = value.is_number() ? value.get<double>() : -1;
            if (!(box.intensity >= 0 && box.intensity <= 1e6))
                reject(path, place + ".intensity: must be a number from 0 to 1000000");
        } else {
            reject(path, place + ": has an unknown property " + in_quotes(key)
                             + "; there are \"box\", \"set\" and \"intensity\"");
        }
    }
    if (!json.contains("set") && !json.contains("intensity"))
        reject(path, place + ": adjusts nothing; give it \"set\" or \"intensity\"");
    return box;
}

} // namespace

std::vector<volume::Adjustment> read_adjustments(const std::string& path) {
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    if (!json.is_object() || json.size() != 1 || !json.contains("boxes")
        || !json["boxes"].is_array())
        reject(path, "is not JSON of the form {\"boxes\": [{\"box\": [x0, y0, z0, x1, y1, z1], "
                     "\"set\": \"valid\"}]}");
    std::vector<volume::Adjustment> boxes;
    for (const Json& each : json["boxes"])
        boxes.push_back(read_adjustment(path, format("boxes[%zu]", boxes.size()), each));
    if (boxes.empty())
        reject(path, "has no box");
    return boxes;
}

} // namespace lpvbake::io
