// How cells stand in pictures.
#pragma once

#include "lpvbake/file.h"

#include <optional>
#include <string_view>
#include <vector>

namespace lpvbake::io {

/// What the pictures hold. Cubes, VRC's and the atlas hold nothing but light: no occlusion, no
/// validity.
enum class Packing {
    band, ///< one RGB file a coefficient
    /// RGBA files for each colour channel: the coefficients 1, y, z, x (with ShConvention::unity x,
    /// y, z, 1), of order 2 also xy, yz, z2, xz, and for all colours together one RGB file of x2y2.
    channel,
    /// Order 1 of ShConvention::unity as VRC Light Volumes take it (LV_SampleLightVolumeTex of
    /// LightVolumes.cginc at 3cefcb7), in RGBA files 0 to 2: colours of 1 and red z; colours of x
    /// and green z; colours of y and blue z.
    vrc,
    /// Irradiance over pi on the six sides of a cube, as Bevy takes it (bevy_pbr's
    /// irradiance_volume.wgsl at 00620e1): one RGB picture of x times 2 y times 3 z texels, +x
    /// before -x along y, then y and z behind along z. It cannot be read back.
    cube,
    /// The atlas of three.js r187's LightProbeGridWebGL (shader chunk lightprobes_pars_fragment):
    /// canonical coefficients of orders 0 to 2, colour by colour, four to an RGBA texel, in seven
    /// blocks along z, each between copies of its outermost slices.
    atlas,
    /// Of Precision::unorm8: sh_l0 as `band` has it, and for each colour
    /// the other coefficients in their order, four a texture: ratio_r, ratio_r2, ..., ratio_g, ...
    ratio,
    /// Of Precision::bc6h: base, a mean of no sign, and one RGB file a coefficient as `band` has
    /// it.
    block,
};

const char* name_of(Packing packing);
std::optional<Packing> packing_named(std::string_view name);

/// The names of all packings.
std::vector<const char*> packing_names();

struct Pictures {
    Packing packing = Packing::band;
    int columns = 0; ///< tiles a row; 0: so that the picture is nearly square
    /// For programs that take every tile for a slice: only numbers of columns that divide the
    /// number of slices.
    bool no_empty_tiles = false;
    const PackedScene* scene = nullptr; ///< that a .glb gets the volume into; null: an empty one
};

} // namespace lpvbake::io
