// What a camera sees of a bake, as programs show it, beside a path-traced picture.
#pragma once

#include "readers/fit.h"
#include "report/report.h"

#include <functional>

namespace lpvbake::report {

/// The volume as the target of a reader writes it, if it is not fitted yet: fitted to the points,
/// or, without any, filled.
Volume written_for(const readers::Reader& reader, Volume volume,
                   std::span<const readers::FitPoint> points);

/// The error on surfaces of what a reader shows of a volume.
using SurfaceErrorOf = std::function<FieldError(const readers::Reader&, const Volume&)>;

/// Pictures from the scene's first camera, or one that its form calls for: of our own sampler, of
/// told_readers as their targets write the volume (fitted to `points`, or, without any, filled),
/// and of the first of them without the fit. Throws what render and trace_picture throw.
Views draw_views(const Scene& scene, const visibility::Visibility& visibility,
                 const scene::Frame& frame, const reference::PathRules& rules,
                 const gpu::Device& device, const Volume& volume,
                 std::span<const readers::FitPoint> points, const SurfaceErrorOf& error_of,
                 Progress& progress);

} // namespace lpvbake::report
