// Pictures of a scene: lit by a volume, and by paths.
#pragma once

#include "image/image.h"
#include "lpvbake/progress.h"
#include "medium/fog.h"
#include "medium/volume_light.h"
#include "raster/raster.h"
#include "readers/readers.h"
#include "render/rsm_light.h"
#include "render/shade.h"

namespace lpvbake::render {

/// What all pictures of a scene refer to. `frame` is that of the finest grid.
struct LitScene {
    const Scene& scene;
    const scene::Frame& frame;
    const visibility::Visibility& visibility; ///< of what an eye sees (eye_of)
    const reference::Paths& paths;            ///< its rules say which light the field holds
};

struct ViewSettings {
    Camera camera;
    glm::ivec2 size{960, 540}; ///< pixels
    int samples = 16;          ///< of each pixel, spread over its square
    Show show = Show::final;
    const medium::Fog* fog = nullptr;    ///< what lies between; null: nothing
    const medium::Medium* air = nullptr; ///< the same, for trace_picture
    /// Light of suns in air, if `fog` leaves that out. Null: none.
    const medium::VolumeLight* volume_light = nullptr;
    const RsmLight* rsm = nullptr; ///< what lights instead of the field; null: the field does
};

struct Rendering {
    image::Pixels picture; ///< linear RGB: see Show. Black where nothing is seen, unless the sky is
    uint64_t rays = 0;
    PairCount pairs;         ///< with ViewSettings::rsm
    medium::StepCount steps; ///< with ViewSettings::volume_light
    /// Standard error of the mean, root mean square over pixels and RGB; of path-traced ones.
    double noise = 0;
};

/// Draws the scene on the device, sample by sample, and lights what is seen: punctual lights by
/// shadow rays, the field of one volume or of nested levels as `reader` shows it, and dark where
/// that is negative. Fog is before what is light on its way to the eye; what it adds is taken in at
/// most four samples of a pixel. Backs of single-sided materials are not drawn. The same bits for
/// any number of threads. Throws Error: invalid (Show::occlusion of a volume without); device,
/// memory; and whatever `progress` throws.
Rendering render(const LitScene& lit, const volume::Levels& levels, const raster::Raster& raster,
                 const readers::Reader& reader, const ViewSettings& settings, Progress& progress);

/// The same picture by ViewSettings::samples paths a pixel, from the eye on: instead of the field
/// the light that it should hold, and fog as tracking.h finds it. Of Show only final, direct,
/// indirect, albedo, normal and irradiance. Throws what Paths::arriving and `progress` throw.
Rendering trace_picture(const LitScene& lit, const ViewSettings& settings, Progress& progress);

} // namespace lpvbake::render
