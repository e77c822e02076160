#include "lpvbake/scene.h"

#include "lpvbake/error.h"
#include "quoted.h"
#include "scene/gltf/folder.h"
#include "scene/lights.h"

#include <nlohmann/json.hpp>

#include <initializer_list>
#include <string_view>

namespace lpvbake::scene::gltf {
namespace {

using nlohmann::json;

/// A JSON object together with where it stands.
struct Place {
    const json& value;
    std::string path;

    [[noreturn]] void fail(const std::string& why) const {
        throw Error(ErrorKind::invalid, path + ": " + why);
    }

    void check_object(std::initializer_list<std::string_view> known) const {
        if (!value.is_object())
            fail("must be an object");
        for (const auto& [key, unused] : value.items())
            if (std::find(known.begin(), known.end(), key) == known.end())
                fail("has an unknown property " + in_quotes(key));
    }

    Place child(const char* key) const { return {value.at(key), path + "." + key}; }

    double number() const {
        if (!value.is_number())
            fail("must be a number");
        return value.get<double>();
    }

    std::string string() const {
        if (!value.is_string())
            fail("must be a string");
        return value.get<std::string>();
    }

    glm::dvec3 vector() const {
        if (!value.is_array() || value.size() != 3)
            fail("must be an array of 3 numbers");
        glm::dvec3 result;
        for (int i = 0; i < 3; ++i)
            result[i] = Place{value[i], path + "[" + std::to_string(i) + "]"}.number();
        return result;
    }
};

LightType light_type(const Place& place) {
    const std::string name = place.string();
    if (name == "directional")
        return LightType::directional;
    if (name == "point")
        return LightType::point;
    if (name == "spot")
        return LightType::spot;
    place.fail("must be \"directional\", \"point\" or \"spot\", is " + in_quotes(name));
}

Light light_from(const Place& place, std::vector<std::string>& warnings) {
    place.check_object({"type", "name", "color", "intensity", "unit", "range", "spot", "position",
                        "direction", "extras", "extensions"});
    const json& value = place.value;
    if (!value.contains("type"))
        place.fail("lacks \"type\"");
    Light light;
    light.type = light_type(place.child("type"));
    const char* const unit = light.type == LightType::directional ? "lux" : "candela";
    if (value.contains("unit") && place.child("unit").string() != unit)
        place.child("unit").fail(std::string("must be \"") + unit + "\" for this type");
    if (value.contains("name"))
        light.name = place.child("name").string();
    if (value.contains("color"))
        light.color = place.child("color").vector();
    if (value.contains("intensity"))
        light.intensity = place.child("intensity").number();
    if (value.contains("range")) {
        light.range = place.child("range").number();
        if (light.range <= 0.0)
            place.child("range").fail("must be above 0; leave it out for no limit");
    }
    if (value.contains("position"))
        light.position = place.child("position").vector();
    if (value.contains("direction")) {
        const glm::dvec3 direction = place.child("direction").vector();
        const double length = glm::length(direction);
        if (!(length > 0.0) || !std::isfinite(length))
            place.child("direction").fail("must not be zero");
        light.direction = direction / length;
    }
    if (value.contains("spot")) {
        const Place spot = place.child("spot");
        spot.check_object({"innerConeAngle", "outerConeAngle", "extras", "extensions"});
        if (spot.value.contains("innerConeAngle"))
            light.inner_cone = spot.child("innerConeAngle").number();
        if (spot.value.contains("outerConeAngle"))
            light.outer_cone = spot.child("outerConeAngle").number();
    }
    constexpr double rounding = 1e-3; // radians: a twentieth of a degree, or four digits
    if (make_hard_edge(light, rounding))
        warnings.push_back(place.path
                           + ".spot.innerConeAngle: is not below outerConeAngle: the spot has a "
                             "hard edge there; make it smaller for a soft one");
    check_light(light, place.path);
    return light;
}

std::vector<Light> lights_of(const std::string& path, std::vector<std::string>& warnings) {
    const std::vector<unsigned char> text = read_file(path, path);
    json root;
    try {
        root = json::parse(text.begin(), text.end());
    } catch (const json::exception& error) {
        throw Error(ErrorKind::invalid, path + ": not JSON: " + printable(error.what(), 300));
    }
    const Place place{root, path};
    if (!root.is_object() || root.value("command", json()) != "info")
        place.check_object({"lights"});
    if (!root.contains("lights"))
        place.fail("lacks \"lights\", an array of lights");
    const Place list{root["lights"], path + ": lights"};
    if (!list.value.is_array())
        list.fail("must be an array");
    std::vector<Light> lights;
    for (size_t i = 0; i < list.value.size(); ++i)
        lights.push_back(
            light_from({list.value[i], list.path + "[" + std::to_string(i) + "]"}, warnings));
    return lights;
}

} // namespace

} // namespace lpvbake::scene::gltf

namespace lpvbake {

std::vector<Light> load_lights(const std::string& path, std::vector<std::string>& warnings) {
    return scene::gltf::lights_of(path, warnings);
}

} // namespace lpvbake
