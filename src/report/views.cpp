#include "report/views.h"

#include "bake/surface_fit.h"
#include "io/target.h"
#include "render/camera.h"
#include "render/display.h"
#include "render/flip.h"
#include "render/render.h"
#include "report/tables.h"
#include "volume/dilate.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::report {
namespace {

constexpr int height = 240;
constexpr int samples = 4; ///< a pixel, of what a volume lights
constexpr int paths = 64;  ///< a pixel, of what is traced
constexpr render::Show show = render::Show::final;

} // namespace

Volume written_for(const readers::Reader& reader, Volume volume,
                   std::span<const readers::FitPoint> points) {
    const int dilate = io::target_named(reader.name)->dilate;
    if (dilate == 0 || volume.metadata.contains("fit"))
        return volume;
    if (points.empty())
        volume::dilate(volume, dilate);
    else
        bake::fit_to_points(reader, points, {}, {}, volume);
    return volume;
}

Views draw_views(const Scene& scene, const visibility::Visibility& visibility,
                 const scene::Frame& frame, const reference::PathRules& rules,
                 const gpu::Device& device, const Volume& volume,
                 std::span<const readers::FitPoint> points, const SurfaceErrorOf& error_of,
                 Progress& progress) {
    const Grid& grid = volume.grid;
    constexpr double usual_aspect = 4.0 / 3;
    render::ViewSettings view;
    view.show = show;
    const std::optional<visibility::Visibility> eye = render::eye_of(scene, frame);
    const visibility::Visibility& seen = eye ? *eye : visibility;
    view.camera = render::choose_camera(
        {}, scene, {grid.origin, grid.to_world(glm::dvec3(grid.dims))}, seen, frame, usual_aspect);
    const double aspect = view.camera.aspect > 0 ? view.camera.aspect : usual_aspect;
    view.size = {int(std::round(std::clamp(aspect, 0.5, 2.0) * height)), height};

    const reference::Paths traced_by(scene, visibility, frame, rules);
    const render::LitScene lit{scene, frame, seen, traced_by};
    view.samples = paths;
    const render::Rendering traced = render::trace_picture(lit, view, progress);
    const double ev = render::automatic_exposure(traced.picture, show);
    const auto displayed = [&](const image::Pixels& picture) {
        return render::to_display(picture, show, ev, render::ToneMap::neutral);
    };
    const image::Pixels truth = displayed(traced.picture);
    Views views{.camera = view.camera.name,
                .paths = paths,
                .exposure = ev,
                .traced = image::encode_png(truth, "view"),
                .shown = {}};

    const raster::Raster raster(device, scene, frame, scene::is_asked);
    view.samples = samples;
    const auto add = [&](const std::string& what, const readers::Reader& reader,
                         const Volume& written) {
        const image::Pixels shown =
            displayed(render::render(lit, written, raster, reader, view, progress).picture);
        views.shown.push_back({what, error_of(reader, written), render::flip(shown, truth),
                               image::encode_png(shown, "view")});
    };
    add("our own sampler", *readers::reader_named("lpvbake"), volume);
    for (const char* name : told_readers) {
        const readers::Reader& reader = *readers::reader_named(name);
        if (name == std::begin(told_readers)[0] && !points.empty())
            add(name + std::string(", not fitted"), reader, written_for(reader, volume, {}));
        add(name, reader, written_for(reader, volume, points));
    }
    return views;
}

} // namespace lpvbake::report
