// The JSON that says what files hold: beside pictures, or inside files that have room for it.
#pragma once

#include "io/stored.h"
#include "io/textures.h"

#include <nlohmann/json.hpp>

#include <functional>

namespace lpvbake::io {

using Json = nlohmann::ordered_json;

/// What is true of all grids of a volume (numbers round-trip exactly):
///
///     {
///       "format": format, "version": 1,
///       "grid": { "dims": [x, y, z], "origin": [x, y, z] (metres), "cell": metres,
///                 "turn": [x, y, z, w] (Grid::turn; of turned ones alone) },
///       "precision": "float" | "half" | "rgb9e5" | "unorm8" | "bc6h", "sh_order": 0 to 4,
///       "convention": "radiance", ..., "direction": "incident" | "travel", "axes": "gltf", ...,
///       "probe_position": "center"
///     }
Json describe(const char* format, const Stored& stored, Precision precision);

/// The same of textures, and what each holds:
///
///       "layout": { "columns": tiles a row, "rows": rows (both of flipbooks alone),
///                   "tile": [width, height], "slices": z,
///                   "padding": slices at either end of each block (atlas alone) },
///       "packing": "band", ...,
///       "files": [ { "file": name, "quantity": what it holds, "units": unit,
///                    "channels": [what each of its channels holds: "sh_l0.r", "occlusion_l1_y",
///                                 "validity", "wall_0.x", ...], or of atlas and cube
///                    "blocks": [the same of each block, "" for nothing],
///                    "low", "high": [numbers, of each of its channels; of ratios alone: a texel t
///                                    stands for low + (high - low) t times the same colour of the
///                                    base or, without one, of sh_l0, for which it stands itself],
///                    "texels": [x, y, z] (of textures of whole blocks that hold more than cells)
///                    }, ... ]
Json describe(const char* format, const Stored& stored, Precision precision, Packing packing,
              const std::vector<Texture>& textures, const std::vector<std::string>& files,
              const std::optional<Layout>& flipbook = {});

/// volume.metadata, "tool" added where it is missing.
Json metadata_of(const Volume& volume);

/// As text: bytes that are not UTF-8 are replaced.
std::string text_of(const Json& description);

/// Parses a description and hands it to `read`. Throws Error (invalid), beginning with `path`, for
/// whatever is wrong with it.
Volume read_description(const std::string& path, const std::string& text,
                        const std::function<Volume(const Json&)>& read);

/// Lattice, order and metadata of a description of this format, without grids. Throws as
/// check_dims, and what read_description makes an Error of.
Volume empty_volume(const std::string& path, const Json& description, const char* format,
                    volume::GridKinds kinds);
volume::Encoding encoding_in(const std::string& path, const Json& description);

/// How many grids of a kind there are, of which those that `has` (by the name of a grid) says there
/// are; light has as many as the order says.
int count_grids(const Volume& volume, const GridKind& kind,
                const std::function<bool(const std::string&)>& has);

/// STEM + sidecar for STEM.EXTENSION and for itself and, where that is missing, for one of its
/// textures STEM_sh_l1_y.EXTENSION.
std::string sidecar_of(const std::string& path, const std::string& sidecar);

/// Textures of the volume that a sidecar describes and these files replace, but for those among
/// them: nothing would name them any more. Empty where there is no such volume.
std::vector<std::string> left_behind(const std::string& sidecar,
                                     const std::vector<std::string>& files);

/// Adds a volume's file and, of a kind that has a sidecar, that and what it lists: all that has to
/// go with it.
void add_with_textures(const std::string& path, std::vector<std::string>& files);

/// NAME + suffix, with the extension of NAME.EXTENSION.
std::string with_suffix(const std::string& path, const std::string& suffix);

/// Throws Error (invalid) unless `path` is that of the volume that `description`, in the file
/// `described`, is of: its own, or one of its textures.
void check_listed(const std::string& path, const std::string& described, const std::string& sidecar,
                  const Json& description);

/// The texels of one file, a picture of `layout` of a texture of `dims`, with so many channels, as
/// its format decodes it; anything may be wrong with the file.
using Decode = std::function<image::Pixels(const std::string& file, glm::ivec3 dims,
                                           const Layout& layout, size_t channels)>;

/// The texels of the textures that a description lists, which lie beside `path`; `ranges` is what
/// those of light stand for, empty if they are light. Throws Error (file, invalid, memory;
/// unsupported: Packing::cube), and what read_description makes an Error of.
Volume read_texels(const std::string& path, const Json& description, const char* format,
                   volume::GridKinds kinds, const Decode& decode, Ranges& ranges);

/// The canonical volume of these. Throws as read_texels.
Volume read_textures(const std::string& path, const Json& description, const char* format,
                     volume::GridKinds kinds, const Decode& decode);

} // namespace lpvbake::io
