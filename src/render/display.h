// From light to what a screen shows, and how far two pictures are apart.
#pragma once

#include "image/image.h"
#include "lpvbake/volume.h"
#include "render/shade.h"

namespace lpvbake::render {

enum class ToneMap {
    neutral, ///< Khronos PBR Neutral, three.js' NeutralToneMapping
    none,    ///< clipped at 1
};

/// Exposure as a camera's at ISO 100: luminance (nits) times 1 / (1.2 2^EV) is the scene-referred
/// value that the tone map gets (Lagarde and de Rousiers 2014, saturation-based sensitivity).
double exposure_scale(double ev);

/// EV at which the median luminance of what is lit (colour/metering.h) shows as 0.18, to a tenth; 0
/// for a picture that is all black.
double automatic_exposure(const image::Pixels& picture, Show show);

/// The same of surfaces in the volume's light that reflect half of it.
double automatic_exposure(const Volume& volume);

/// Khronos PBR Neutral (Khronos Group 2024): colours below 0.8 - 0.04 are kept but for a Fresnel
/// offset of 0.04, brighter ones are compressed and lose saturation. RGB in [0, infinity).
glm::dvec3 neutral_tone_map(glm::dvec3 colour);

/// Display-referred samples in [0, 1] as a PNG holds them. Light is exposed, tone-mapped and
/// sRGB-encoded (irradiance as a white surface that reflects it); albedo, occlusion and validity
/// are sRGB-encoded; a normal n becomes (n + 1) / 2.
image::Pixels to_display(const image::Pixels& picture, Show show, double ev, ToneMap map);

/// Mean Rec.709 luminance over all pixels.
double mean_luminance(const image::Pixels& picture);

/// Of linear pictures, over pixels and RGB.
struct PictureError {
    double rmse = 0;     ///< root mean square of A - B
    double relative = 0; ///< rmse over B's mean; 0 where both are 0
    double ratio = 0;    ///< A's mean over B's; 0 where B's is 0
};
PictureError compare_pictures(const image::Pixels& a, const image::Pixels& b);

} // namespace lpvbake::render
