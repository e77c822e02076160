// The table of grids: which kinds a volume may hold, and what files, turns and comparisons have to
// know of each.
//
// A new kind is a row of grid_kinds(). Files, info, diff and suites go by the rows; code that works
// with the values finds them in a member of Volume, which the row names, or in Volume::others.
#pragma once

#include "volume/volume.h"

#include <cstddef>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace lpvbake::volume {

/// What becomes of values when axes turn.
enum class Turning {
    none,      ///< numbers without a direction
    vector,    ///< x, y, z of a cell turn
    harmonics, ///< the kind's grids together are coefficients, in the order of sh.h
    operators, ///< they take coefficients of order 1 to such: grid 4 i + k has of i what k gives
};

/// What a number stands for and its unit, as text.
struct Quantity {
    const char* name;
    const char* units;
};

} // namespace lpvbake::volume

namespace lpvbake {

/// A kind of grid. One that has no member is kept in Volume::others.
struct GridKind {
    const char* name; ///< unique; see grid_name
    /// The letter of each float of a cell, such as "rgb" and "xyz"; empty: one float a cell.
    const char* channels = "";
    volume::Turning turning = volume::Turning::none;
    int fewest = 1, most = 1; ///< grids of a volume that has the kind at all; most <= 32
    volume::Quantity quantity = {"", ""}; ///< of light: see quantity_of(ShConvention)
    bool subtracted = false;              ///< difference() holds it, where both volumes do
    std::variant<std::monostate, std::vector<float> Volume::*,
                 std::vector<std::vector<float>> Volume::*,
                 std::vector<std::vector<glm::vec3>> Volume::*>
        member = {};

    int width() const { return channels[0] == '\0' ? 1 : 3; } ///< floats a cell
};

} // namespace lpvbake

namespace lpvbake::volume {

using GridKinds = std::span<const GridKind* const>;

/// sh (light), occlusion, validity, wall, direct, visibility, shadow, shaft, scatter, scattered,
/// extinction, sky_occlusion, sky_direction, local_transfer, local_visibility, in the order in
/// which files and lists have them.
GridKinds grid_kinds();

/// The row of that name, which there must be.
const GridKind& kind_named(const char* name);

/// The row of Volume::sh.
const GridKind& light_kind();

/// Direct light of punctual lights, no part of the field: as Volume::sh, but canonical in all
/// files; and of each light the share of it that arrives.
const GridKind& direct_kind();
const GridKind& visibility_kind();

/// Of a white sky, as volume/sky_occlusion.h has it.
const GridKind& sky_occlusion_kind();
const GridKind& sky_direction_kind();

/// What surfaces around a cell make of light, and what they leave to be seen (transfer/local.h).
const GridKind& local_transfer_kind();
const GridKind& local_visibility_kind();

/// Lights of which a volume may have the visibility.
inline constexpr int most_visibilities = 32;

/// Band of coefficient k (0 to 24), and its polynomial: l0, l1_y, l1_z, l1_x, l2_xy, l2_yz, l2_z2,
/// l2_xz, l2_x2y2; from band 3 on its m, with n for minus and p for plus, as programs that read
/// grids take letters, digits and underscores alone: l3_n3, l3_n2, l3_n1, l3_0, l3_p1, l3_p2,
/// l3_p3, l4_n4, ..., l4_p4.
const char* coefficient_name(int k);

/// The name of the kind's grid number k: the kind's own; with _0, _1, ... where it may have
/// several; with _ and coefficient_name(k) for harmonics; with those of both for operators,
/// "local_transfer_l0_l1_y" for what of band 0 leaves of what comes in as l1_y.
std::string grid_name(const GridKind& kind, int k);

/// One grid of a volume. Float is float or const float.
template <class Float>
struct BasicGridView {
    const GridKind* kind = nullptr;
    int k = 0;             ///< which of its kind
    Float* data = nullptr; ///< kind->width() floats a cell, cells by Grid::index
    std::size_t cells = 0; ///< that are there

    std::string name() const { return grid_name(*kind, k); }
    std::span<Float> values() const { return {data, cells * std::size_t(kind->width())}; }
    /// "sh_l0.r", "wall_1.x", "validity".
    std::string channel_name(int channel) const {
        return kind->width() == 1 ? name() : name() + "." + kind->channels[channel];
    }
};
using GridView = BasicGridView<float>;
using ConstGridView = BasicGridView<const float>;

/// All grids of a volume, those of a kind one after the other, in the order of grid_kinds(), then
/// what else Volume::others has. They are valid until the volume's vectors change.
std::vector<GridView> grids_of(Volume& volume);
std::vector<ConstGridView> grids_of(const Volume& volume);

/// Those of one kind.
std::vector<GridView> grids_of(Volume& volume, const GridKind& kind);
std::vector<ConstGridView> grids_of(const Volume& volume, const GridKind& kind);

/// Gives the volume `count` grids of the kind, all 0, instead of those that it had.
void set_grids(Volume& volume, const GridKind& kind, int count);

/// Range of one grid, a channel at a time.
struct GridRange {
    std::vector<double> min, max, mean;
    std::size_t nonzero = 0; ///< cells with a channel other than 0
};
GridRange range_of(const ConstGridView& grid);

} // namespace lpvbake::volume
