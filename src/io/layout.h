// What all kinds of file share: facts about the field, and what may be stored.
#pragma once

#include "lpvbake/error.h"
#include "volume/convention.h"
#include "volume/grids.h"

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lpvbake::io {

/// What is true of the field as a file stores it, as text, keys without the `lpv:` prefix:
/// convention, direction, axes, probe_position.
std::vector<std::pair<std::string, std::string>> field_facts(const volume::Encoding& encoding);

/// The encoding that a file's facts tell; `fact` returns the text of a key. Throws Error (invalid),
/// naming `path`, for facts that no encoding has.
volume::Encoding encoding_of(const std::function<std::string(const char*)>& fact,
                             const std::string& path);

/// Throws an Error of kind `error`, naming `path`, the grid and the cell, unless all grids fit the
/// lattice, the number of coefficients fits the order (0 to 4) and every value is finite.
void check_volume(const Volume& volume, const std::string& path, ErrorKind error);

/// Throws Error (invalid, memory) unless a volume of these dims with all kinds of grids that have a
/// member is one that this machine could hold. For dims that come from a file.
void check_dims(glm::ivec3 dims, int sh_order, volume::GridKinds kinds, const std::string& path);

/// volume::set_grids. Throws Error (memory) unless this machine could hold them beside what the
/// volume has.
void make_grids(Volume& volume, const GridKind& kind, int count, const std::string& path);

/// The largest number of half precision, and the smallest with all of its digits.
inline constexpr float half_max = 65504, half_min = 1.0f / 16384;

/// Why the volume, or what of it is no light, should not be stored as half: values beyond 65504, or
/// an L0 whose largest value lies below 2^-14, where half has fewer digits. None: it fits.
std::optional<std::string> half_misfit(const Volume& volume, bool no_light = false);
/// The same of one grid.
std::optional<std::string> half_misfit(const volume::ConstGridView& grid);

} // namespace lpvbake::io
