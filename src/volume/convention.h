// How other programs store the field: signs and factors of coefficients, and axes. In memory a
// volume is always canonical (sh.h), in glTF's axes; files may differ.
#pragma once

#include "volume/grids.h"

#include <optional>
#include <string_view>

namespace lpvbake::volume {

/// What is stored of canonical coefficients c (nits).
enum class ShConvention {
    radiance,   ///< c
    irradiance, ///< A_l c_lm, A = pi, 2 pi / 3, pi / 4, 0, -pi / 24: summed over bases it is lux
    /// Order 1: pi c_0, 2 pi / 3 (c_y, -c_z, c_x), for shaders of light propagation volumes that
    /// evaluate max(0, v.(0.282095, -0.488603 y, 0.488603 z, -0.488603 x)(-n)) / pi.
    lpv,
    godot, ///< c / pi
    /// Orders 1 and 2: factors of unity_cginc's ShadeSH9, whose sum is irradiance over pi:
    /// 0.282095 c_0 - 0.078848 c_z2; 0.325735 c_y, c_z, c_x; 0.273137 c_xy, c_yz; 0.236544 c_z2;
    /// 0.273137 c_xz; 0.136569 c_x2y2.
    unity,
    /// Orders 0 to 2: c with the signs of Condon and Shortley: - + - in band 1, + - + - + in 2.
    unreal,
};

/// Axes of positions and directions. Units stay metres.
enum class Axes {
    gltf,    ///< right-handed, +Y up
    unity,   ///< left-handed, +Y up: (-x, y, z)
    unreal,  ///< left-handed, +Z up: (x, z, y)
    blender, ///< right-handed, +Z up: (x, -z, y)
};

/// How a file stores a volume.
struct Encoding {
    ShConvention convention = ShConvention::radiance;
    Axes axes = Axes::gltf;
    /// Of OpenVDB alone: index i stands at the lower corner of cell i instead of at its centre, for
    /// programs that draw voxel i from i to i + 1 (Blender).
    bool corner_index = false;

    bool operator==(const Encoding&) const = default;
};

const char* name_of(ShConvention convention);
const char* name_of(Axes axes);
std::optional<ShConvention> convention_named(std::string_view name);
std::optional<Axes> axes_named(std::string_view name);

/// The names of all, in the order of the enumerations.
std::vector<const char*> convention_names();
std::vector<const char*> axes_names();

/// What stored coefficients are.
Quantity quantity_of(ShConvention convention);

/// What a grid of this kind holds in a file of this convention.
Quantity quantity_of(const GridKind& kind, ShConvention convention);

/// Highest band that a convention has a form for.
int highest_order(ShConvention convention);

/// Turns canonical coefficients into stored ones and back, up to rounding: exact for radiance and
/// unreal. The order is at most highest_order().
void encode(ShConvention convention, int order, std::vector<std::vector<glm::vec3>>& sh);
void decode(ShConvention convention, int order, std::vector<std::vector<glm::vec3>>& sh);

/// The columns are where glTF's axes go: entries are 0, 1 and -1.
glm::dmat3 from_gltf(Axes axes);

/// A lattice in axes that `turn` (a signed permutation) takes its own to.
Grid turned_grid(const Grid& grid, const glm::dmat3& turn);

/// Turns the light of a volume whose harmonics are in other axes than the world's, by the rotation
/// from those to these; vectors are the lattice's own and stay.
void turn_directions(const glm::dmat3& rotation, Volume& volume);

/// Turns a volume into axes that `turn` takes its own to (a signed permutation), in place and with
/// the memory of one more grid: its lattice, the directions in its grids (see Turning), and its
/// cells' order. Metadata stay. Exact up to band 1, beyond up to rounding.
void turn_axes(const glm::dmat3& turn, Volume& volume);

} // namespace lpvbake::volume
