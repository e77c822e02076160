// Files of lit surfaces, .lit: what one bake has lit, for the shards of the same bake.
//
// "LPVLIT", a version, what they are of as text, a hash (XXH3), and what surface::put puts.
#pragma once

#include "lpvbake/file.h"
#include "scene/scene.h"
#include "surface/lit_surfaces.h"

#include <string>

namespace lpvbake::bake {

/// What surfaces are lit by; all of it has to be that of the bake that takes them.
struct LitOrigin {
    std::string version;  ///< of the program
    std::string scene;    ///< its hash
    std::string settings; ///< of the bake, as metadata `settings`
    std::string tracer;   ///< visibility::Visibility::tracer()

    bool operator==(const LitOrigin&) const = default;
};

/// Throws Error (file).
WriteReport::File write_lit(const std::string& path, const LitOrigin& origin,
                            surface::LitSurfaces lit);

/// `visibility` outlives the result. Throws Error that names the file: file; invalid (it is no such
/// file, is damaged, or of something else, which is told).
surface::LitSurfaces read_lit(const std::string& path, const LitOrigin& origin, const Scene& scene,
                              const visibility::Visibility& visibility);

} // namespace lpvbake::bake
