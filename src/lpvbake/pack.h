// A scene's file in one piece, which a volume may be written into.
#pragma once

#include "lpvbake/export.h"
#include "lpvbake/scene.h"

#include <string>
#include <vector>

namespace lpvbake {

/// A scene's file with all that it refers to in it, so that it may become a .glb of its own.
struct PackedScene {
    std::string json;                  ///< of the file, which keeps all that it has
    std::string bytes;                 ///< of its first buffer: the chunk of a .glb
    int scene = 0;                     ///< that of LoadSettings::scene
    std::vector<std::string> warnings; ///< what refers to other files still
};

/// Packs what load_gltf loads: the first buffer and images beside the file go into the bytes, other
/// buffers beside it into data URIs; nothing is decoded, renumbered or left out. Throws Error:
/// argument (`standard_input`, which is read once), unsupported (a first buffer without bytes), and
/// as load_gltf does.
LPVBAKE_API PackedScene pack_gltf(const std::string& path, const LoadSettings& settings = {});

} // namespace lpvbake
