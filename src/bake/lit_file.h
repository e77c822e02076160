// Files of lit surfaces, .lit: what one bake has lit, for the shards of the same bake; or one of
// the parts that make it up.
//
// "LPVLIT", a version, what they are of as text, which part of how many (of none: the whole), a
// hash (XXH3), and what surface::put puts.
#pragma once

#include "lpvbake/file.h"
#include "scene/scene.h"
#include "surface/lit_part.h"

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

WriteReport::File write_lit_part(const std::string& path, const LitOrigin& origin,
                                 surface::LitPart part);

/// `visibility` outlives the result. Throws Error that names the file: file; invalid (it is no such
/// file, is damaged, a part, or of something else, which is told).
surface::LitSurfaces read_lit(const std::string& path, const LitOrigin& origin, const Scene& scene,
                              const visibility::Visibility& visibility);

/// Whether a file is one of lit surfaces, or a part.
bool is_lit(const std::string& path);

/// Makes one file of all parts, in any order: that which would have been written without parts, to
/// the byte. Throws Error that names the file and what is wrong: file; invalid (a part is none, is
/// damaged, of something else than the first, comes twice, or is missing; light would never end).
struct MergedLit {
    WriteReport::File file;
    std::size_t patches = 0;
};
MergedLit merge_lit(const std::vector<std::string>& parts, const std::string& path,
                    Progress& progress);

} // namespace lpvbake::bake
