#include "io/boxes.h"

#include "file_error.h"
#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <optional>

namespace lpvbake::io {
namespace {

using Json = nlohmann::ordered_json;

constexpr uint64_t most_bytes = 1 << 22;

template <class Box>
void read_box(const std::string& path, const std::string& place, const Json& json, Box& box) {
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
    if (what == "valid" || what == "invalid")
        box.valid = what == "valid";
    else if (what == "finer" || what == "coarser")
        box.finer = what == "finer";
    else
        reject(path, place + ".set: must be \"valid\", \"invalid\", \"finer\" or \"coarser\"");
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

/// The value of a property, within bounds.
double number_in(const std::string& path, const std::string& place, const Json& json, double lo,
                 double hi) {
    const double x = json.is_number() ? json.get<double>() : std::nan("");
    if (!(x >= lo && x <= hi))
        reject(path, place + format(": must be a number from %.7g to %.7g", lo, hi));
    return x;
}

/// An array of so many finite numbers.
std::vector<double> numbers_in(const std::string& path, const std::string& place, const Json& json,
                               std::size_t count, const char* what) {
    bool good = json.is_array() && json.size() == count;
    for (std::size_t i = 0; good && i < count; ++i)
        good = json[i].is_number() && std::isfinite(json[i].get<double>());
    if (!good)
        reject(path, place + format(": must be an array of %zu numbers, ", count) + what);
    return json;
}

glm::dmat4 transform_in(const std::string& path, const std::string& place, const Json& json) {
    const std::vector<double> x =
        numbers_in(path, place, json, 16, "a matrix column by column, as glTF has it");
    glm::dmat4 matrix;
    for (int i = 0; i < 16; ++i)
        matrix[i / 4][i % 4] = x[std::size_t(i)];
    for (int column = 0; column < 4; ++column)
        if (matrix[column][3] != (column == 3 ? 1 : 0))
            reject(path, place + ": is not affine: its last row must be 0 0 0 1");
    return matrix;
}

glm::dquat rotation_in(const std::string& path, const std::string& place, const Json& json) {
    const std::vector<double> x = numbers_in(path, place, json, 4, "a quaternion, x, y, z, w");
    const glm::dquat turn(x[3], x[0], x[1], x[2]);
    if (!(std::abs(glm::length(turn) - 1) < 1e-4))
        reject(path, place + ": is no unit quaternion");
    return glm::normalize(turn);
}

volume::VolumeBox read_volume_box(const std::string& path, const std::string& place,
                                  const Json& json) {
    volume::VolumeBox box{{"", 0, -1}, glm::dvec3(-0.5), glm::dvec3(0.5), 0};
    if (!json.is_object() || !json.contains("name")
        || !(json.contains("box") || json.contains("transform")))
        reject(path, place + ": lacks \"name\" or \"box\", an array of 6 numbers");
    std::optional<glm::dmat4> to_world;
    std::optional<glm::dquat> rotation;
    for (const auto& [key, value] : json.items()) {
        const std::string own = place + "." + key;
        if (key == "box") {
            read_box(path, place, value, box);
        } else if (key == "name") {
            if (!value.is_string())
                reject(path, own + ": must be a string");
            box.place.name = value.get<std::string>();
        } else if (key == "transform") {
            to_world = transform_in(path, own, value);
        } else if (key == "rotation") {
            rotation = rotation_in(path, own, value);
        } else if (key == "cell") {
            box.cell = number_in(path, own, value, 1e-9, 1e9);
        } else if (key == "priority") {
            box.place.priority = int(number_in(path, own, value, -1e6, 1e6));
            if (double(box.place.priority) != value.get<double>())
                reject(path, own + ": must be a whole number");
        } else if (key == "falloff") {
            box.place.falloff = number_in(path, own, value, 0, 1e9);
        } else {
            reject(path, place + ": has an unknown property " + in_quotes(key)
                             + "; there are \"name\", \"box\", \"rotation\", \"transform\", "
                               "\"cell\", \"priority\" and \"falloff\"");
        }
    }
    if (to_world && rotation)
        reject(path, place + ": has both \"rotation\" and \"transform\"; give one");
    if (rotation) { // about the middle
        const glm::dvec3 middle = 0.5 * (box.lo + box.hi);
        to_world = glm::mat4_cast(*rotation);
        (*to_world)[3] = glm::dvec4(middle - *rotation * middle, 1);
    }
    if (to_world) {
        const double cell = box.cell;
        box = volume::box_in_world(box.place, box.lo, box.hi, *to_world);
        box.cell = cell;
    }
    return box;
}

/// The list of this name that is all that a file holds.
Json list_in(const std::string& path, const char* name, const char* form) {
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    if (!json.is_object() || json.size() != 1 || !json.contains(name) || !json[name].is_array())
        reject(path, std::string("is not JSON of the form ") + form);
    if (json[name].empty())
        reject(path, "has no box");
    return json[name];
}

} // namespace

std::vector<volume::VolumeBox> read_boxes(const std::string& path) {
    std::vector<volume::VolumeBox> boxes;
    for (const Json& each : list_in(path, "volumes",
                                    "{\"volumes\": [{\"name\": \"hall\", \"box\": [x0, y0, z0, "
                                    "x1, y1, z1]}]}"))
        boxes.push_back(read_volume_box(path, format("volumes[%zu]", boxes.size()), each));
    return boxes;
}

std::vector<volume::Adjustment> read_adjustments(const std::string& path) {
    std::vector<volume::Adjustment> boxes;
    for (const Json& each : list_in(path, "boxes",
                                    "{\"boxes\": [{\"box\": [x0, y0, z0, x1, y1, z1], "
                                    "\"set\": \"valid\"}]}"))
        boxes.push_back(read_adjustment(path, format("boxes[%zu]", boxes.size()), each));
    return boxes;
}

} // namespace lpvbake::io
