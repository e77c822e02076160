#include "render/display.h"

#include "colour/colour.h"
#include "colour/metering.h"
#include "volume/sh.h"
#include "volume/volume.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::render {
namespace {

glm::dvec3 pixel(const image::Pixels& picture, std::size_t i) {
    return {picture.samples[3 * i], picture.samples[3 * i + 1], picture.samples[3 * i + 2]};
}

std::size_t pixels_of(const image::Pixels& picture) {
    return picture.samples.size() / 3;
}

/// Of a surface that shows the value: nits.
double luminance_scale(Show show) {
    return show == Show::irradiance ? glm::one_over_pi<double>() : 1.0;
}

bool is_light(Show show) {
    return show == Show::final || show == Show::direct || show == Show::indirect
           || show == Show::irradiance || show == Show::cells;
}

double exposure_for(std::vector<float> luminances) {
    const std::vector<float> lit = colour::lit_of(std::move(luminances));
    if (lit.empty())
        return 0;
    return std::round(10 * std::log2(lit[lit.size() / 2] / (1.2 * 0.18))) / 10;
}

} // namespace

double exposure_scale(double ev) {
    return 1.0 / (1.2 * std::exp2(ev));
}

double automatic_exposure(const image::Pixels& picture, Show show) {
    if (!is_light(show))
        return 0;
    std::vector<float> luminances;
    for (std::size_t i = 0; i < pixels_of(picture); ++i)
        luminances.push_back(
            float(luminance_scale(show) * glm::dot(pixel(picture, i), colour::rec709_luminance)));
    return exposure_for(std::move(luminances));
}

double automatic_exposure(const Volume& volume) {
    constexpr double reflectance = 0.5;
    std::vector<float> luminances;
    for (std::size_t i = 0; i < volume.sh[0].size(); ++i)
        if (volume.is_valid(i))
            luminances.push_back(float(
                reflectance
                * glm::dot(glm::dvec3(volume::sh_y0 * volume.sh[0][i]), colour::rec709_luminance)));
    return exposure_for(std::move(luminances));
}

glm::dvec3 neutral_tone_map(glm::dvec3 colour) {
    constexpr double fresnel = 0.04, begin = 0.8 - fresnel, desaturation = 0.15;
    const double least = std::min({colour.x, colour.y, colour.z});
    colour -= least < 2 * fresnel ? least - least * least / (4 * fresnel) : fresnel;
    const double peak = std::max({colour.x, colour.y, colour.z});
    if (peak < begin)
        return colour;
    const double room = 1 - begin;
    const double mapped = 1 - room * room / (peak + room - begin);
    const double kept = 1 / (desaturation * (peak - mapped) + 1);
    return glm::mix(glm::dvec3(mapped), colour * (mapped / peak), kept);
}

image::Pixels to_display(const image::Pixels& picture, Show show, double ev, ToneMap map) {
    image::Pixels shown = picture;
    for (std::size_t i = 0; i < pixels_of(picture); ++i) {
        glm::dvec3 colour = pixel(picture, i);
        if (is_light(show)) {
            colour *= exposure_scale(ev) * luminance_scale(show);
            if (map == ToneMap::neutral)
                colour = neutral_tone_map(colour);
        } else if (show == Show::normal) {
            colour = 0.5 * colour + 0.5;
        }
        for (int channel = 0; channel < 3; ++channel) {
            const double value = std::clamp(colour[channel], 0.0, 1.0);
            shown.samples[3 * i + std::size_t(channel)] =
                float(show == Show::normal ? value : colour::linear_to_srgb(value));
        }
    }
    return shown;
}

double mean_luminance(const image::Pixels& picture) {
    double sum = 0;
    for (std::size_t i = 0; i < pixels_of(picture); ++i)
        sum += glm::dot(pixel(picture, i), colour::rec709_luminance);
    return sum / double(std::max<std::size_t>(pixels_of(picture), 1));
}

PictureError compare_pictures(const image::Pixels& a, const image::Pixels& b) {
    double squares = 0, sum_a = 0, sum_b = 0;
    for (std::size_t i = 0; i < a.samples.size(); ++i) {
        const double off = double(a.samples[i]) - double(b.samples[i]);
        squares += off * off;
        sum_a += double(a.samples[i]);
        sum_b += double(b.samples[i]);
    }
    const double n = double(std::max<std::size_t>(a.samples.size(), 1));
    PictureError error;
    error.rmse = std::sqrt(squares / n);
    if (sum_b > 0) {
        error.relative = error.rmse / (sum_b / n);
        error.ratio = sum_a / sum_b;
    }
    return error;
}

} // namespace lpvbake::render
