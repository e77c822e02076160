#include "options/lights.h"

#include "colour/colour.h"
#include "options/values.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <vector>

namespace lpvbake::cmd::options {
namespace {

/// A text with what is needed to complain about it.
struct Argument {
    std::string text;
    const char* form;
    const char* example;

    [[noreturn]] void fail(const std::string& why) const {
        refuse(text, "is no light: " + why + "; the form is " + form + ", for example " + example);
    }
};

double number(std::string_view text, const char* name, const Argument& argument) {
    while (!text.empty() && text.front() == ' ')
        text.remove_prefix(1);
    while (!text.empty() && text.back() == ' ')
        text.remove_suffix(1);
    if (text.starts_with('+'))
        text.remove_prefix(1);
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
        argument.fail(std::string(name) + " is not a number");
    return value;
}

double positive(std::string_view text, const char* name, const Argument& argument) {
    const double value = number(text, name, argument);
    if (value < 0.0)
        argument.fail(std::string(name) + " is negative");
    return value;
}

/// "#rrggbb" (sRGB) or "R:G:B" (linear).
glm::vec3 color(std::string_view text, const Argument& argument) {
    if (text.starts_with('#')) {
        const std::optional<glm::vec3> parsed = parse_hex_colour(text);
        if (!parsed)
            argument.fail("COLOUR is not #rrggbb");
        return *parsed;
    }
    glm::vec3 result;
    const std::vector<std::string> channels = split(std::string(text), ':');
    if (channels.size() != 3)
        argument.fail("COLOUR is neither #rrggbb nor R:G:B");
    for (int channel = 0; channel < 3; ++channel)
        result[channel] = static_cast<float>(positive(channels[channel], "COLOUR", argument));
    if (!std::isfinite(result.x + result.y + result.z))
        argument.fail("COLOUR is too large");
    return result;
}

/// A light's brightest channel has to be a float.
void check_brightness(const Light& light, const Argument& argument) {
    const float most = std::max({light.color.r, light.color.g, light.color.b});
    if (!std::isfinite(float(light.intensity) * most))
        argument.fail("it is too bright");
}

std::vector<std::string> fields(const Argument& argument, size_t required) {
    std::vector<std::string> parts = split(argument.text, ',');
    if (parts.size() != required && parts.size() != required + 1)
        argument.fail(std::to_string(parts.size()) + " values were given");
    return parts;
}

} // namespace

std::optional<glm::vec3> parse_hex_colour(std::string_view text) {
    if (text.size() != 7 || text[0] != '#')
        return std::nullopt;
    uint32_t value = 0;
    const auto [end, error] = std::from_chars(text.data() + 1, text.data() + 7, value, 16);
    if (error != std::errc() || end != text.data() + 7)
        return std::nullopt;
    glm::vec3 result;
    for (int channel = 0; channel < 3; ++channel)
        result[channel] = static_cast<float>(
            colour::srgb_to_linear(((value >> (16 - 8 * channel)) & 255u) / 255.0));
    return result;
}

Light parse_sun(const std::string& text) {
    const Argument argument{text, "AZIMUTH,ELEVATION,LUX[,COLOUR]", "45,30,100000,#fff4e0"};
    const std::vector<std::string> parts = fields(argument, 3);
    const double azimuth = glm::radians(number(parts[0], "AZIMUTH", argument));
    const double elevation = glm::radians(number(parts[1], "ELEVATION", argument));
    if (std::abs(elevation) > glm::radians(90.0))
        argument.fail("ELEVATION is outside -90 to 90 degrees");
    Light light;
    light.type = LightType::directional;
    light.name = "sun";
    light.intensity = positive(parts[2], "LUX", argument);
    light.direction = -glm::dvec3(std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
                                  std::cos(elevation) * std::cos(azimuth));
    if (parts.size() == 4)
        light.color = color(parts[3], argument);
    check_brightness(light, argument);
    return light;
}

Light parse_point(const std::string& text) {
    const Argument argument{text, "X,Y,Z,CD[,COLOUR]", "0,1.8,0,100,1:0.8:0.6"};
    const std::vector<std::string> parts = fields(argument, 4);
    Light light;
    light.type = LightType::point;
    light.name = "point";
    light.position = {number(parts[0], "X", argument), number(parts[1], "Y", argument),
                      number(parts[2], "Z", argument)};
    light.intensity = positive(parts[3], "CD", argument);
    if (parts.size() == 5)
        light.color = color(parts[4], argument);
    check_brightness(light, argument);
    return light;
}

Sky parse_sky(const std::string& text) {
    const Argument argument{text, "COLOUR,NITS or FILE[,SCALE]", "0.6:0.8:1,3000"};
    const std::vector<std::string> parts = split(text, ',');
    if (parts.size() != 2)
        argument.fail(std::to_string(parts.size()) + " values were given");
    Sky sky;
    sky.luminance = color(parts[0], argument) * float(positive(parts[1], "NITS", argument));
    if (!std::isfinite(sky.luminance.x + sky.luminance.y + sky.luminance.z))
        argument.fail("NITS is too large");
    return sky;
}

} // namespace lpvbake::cmd::options
