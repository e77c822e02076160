// What both kinds of file share: names of grids, facts about the field, and what may be stored.
#pragma once

#include "error.h"
#include "volume/convention.h"

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lpvbake {

/// Band of coefficient k (0 to 24), and its polynomial: l0, l1_y, l1_z, l1_x, l2_xy, l2_yz, l2_z2,
/// l2_xz, l2_x2y2; from band 3 on its m, with n for minus and p for plus, as programs that read
/// grids take letters, digits and underscores alone: l3_n3, l3_n2, l3_n1, l3_0, l3_p1, l3_p2,
/// l3_p3, l4_n4, ..., l4_p4. Grids are called `sh_` or `occlusion_` and this.
const char* coefficient_name(int k);

/// wall_0, wall_1, wall_2: grids of Volume::walls.
std::string wall_name(int k);

/// What is true of the field as a file stores it, as text, keys without the `lpv:` prefix:
/// convention, direction, axes, probe_position.
std::vector<std::pair<std::string, std::string>> field_facts(const Encoding& encoding);

/// The encoding that a file's facts tell; `fact` returns the text of a key. Throws Error (invalid),
/// naming `path`, for facts that no encoding has.
Encoding encoding_of(const std::function<std::string(const char*)>& fact, const std::string& path);

/// What a file stores of a canonical volume. Throws Error (unsupported, naming `path`) for an order
/// that the convention has no form for.
Volume encoded(const Volume& volume, const Encoding& encoding, const std::string& path);

/// The inverse. Throws Error (invalid).
Volume decoded(Volume stored, const Encoding& encoding, const std::string& path);

/// What a grid holds and in which unit: {quantity, units}.
std::pair<std::string, std::string> grid_quantity(const std::string& grid_name,
                                                  ShConvention convention);

/// Throws Error with `code`, naming `path`, the grid and the cell, unless all grids fit the
/// lattice, the number of coefficients fits the order (0 to 4) and every value is finite.
void check_volume(const Volume& volume, const std::string& path, ExitCode code);

/// Throws Error (invalid, memory) unless a volume of these dims and so many floats a cell is one
/// that this machine could hold. For dims that come from a file.
void check_dims(glm::ivec3 dims, int floats, const std::string& path);

/// Why the volume should not be stored as half: values beyond 65504, or an L0 whose largest value
/// lies below 2^-14, where half has fewer digits. None: it fits.
std::optional<std::string> half_misfit(const Volume& volume);

} // namespace lpvbake
