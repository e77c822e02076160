// bake for build systems: whether outputs are those that a bake would write, and what they depend
// on.
#pragma once

#include "bake_options.h"
#include "lpvbake/pack.h"

#include <optional>
#include <string>

namespace lpvbake::cmd {

/// The options that say what files hold, which the recorded settings have not, in their form:
/// metadata `output_settings`.
std::string output_settings(const options::Options& options);

/// All that outputs of a bake follow from, as 16 hex digits, which they have as metadata
/// `bake_hash`: version, options that outputs depend on, the bytes of the scene's file, unless
/// --surroundings leaves some of it out, and of files of boxes, the scene as it was loaded, by its
/// `hash` (scene_hash) and the names of lights, and, for a .glb, as it is packed. Empty where a
/// file can be read but once, as standard input. Throws Error (file).
std::string bake_hash(const BakeOptions& o, const options::Options& options, const Scene& scene,
                      const std::string& hash, const std::optional<PackedScene>& packed);

/// True where an output is not there, cannot be read whole, or has another hash; else tells that
/// there is nothing to do. `levels`: whether there are nested grids.
bool needs_bake(const BakeOptions& o, const std::string& hash, bool levels, Run& run);

/// The same of --if-missing: true where an output is not there, cannot be read whole, or is no
/// bake's.
bool is_missing(const BakeOptions& o, Run& run);

/// Writes --depfile, if it is asked for: a rule of Make of the outputs and all files that were
/// read. Throws Error (file, io; argument: a path has no form in it).
void write_depfile(const BakeOptions& o, const Scene& scene);

} // namespace lpvbake::cmd
