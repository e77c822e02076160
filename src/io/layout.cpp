#include "io/layout.h"

#include "machine.h"
#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <span>
#include <sstream>
#include <utility>

namespace lpvbake::io {
namespace {

constexpr uint32_t exponent_bits = 0x7f800000; ///< of a float; all are set where it is not finite

tbb::blocked_range<size_t> in_blocks(size_t values) {
    return {0, values, size_t(1) << 14};
}

std::string dims_text(glm::ivec3 dims) {
    return std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x " + std::to_string(dims.z)
           + " cells";
}

bool all_finite(std::span<const float> values) {
    std::atomic<bool> finite = true;
    tbb::parallel_for(in_blocks(values.size()), [&](const auto& block) {
        uint32_t bad = 0; // without a branch, so that it takes many at a time
        for (size_t i = block.begin(); i < block.end(); ++i)
            bad |= uint32_t((std::bit_cast<uint32_t>(values[i]) & exponent_bits) == exponent_bits);
        if (bad)
            finite = false;
    });
    return finite;
}

/// The largest size of a value; all are finite.
float largest_size(std::span<const float> values) {
    return tbb::parallel_reduce(
        in_blocks(values.size()), 0.0f,
        [&](const auto& block, float largest) {
            for (size_t i = block.begin(); i < block.end(); ++i)
                largest = std::max(largest, std::abs(values[i]));
            return largest;
        },
        [](float a, float b) { return std::max(a, b); });
}

} // namespace

std::vector<std::pair<std::string, std::string>> field_facts(const volume::Encoding& encoding) {
    const bool travel = encoding.convention == volume::ShConvention::lpv;
    return {
        {"convention", volume::name_of(encoding.convention)},
        {"direction", travel ? "travel" : "incident"},
        {"axes", volume::name_of(encoding.axes)},
        {"probe_position", "center"},
    };
}

volume::Encoding encoding_of(const std::function<std::string(const char*)>& fact,
                             const std::string& path) {
    const auto unknown = [&](const char* key, const std::string& value) {
        return Error(ErrorKind::invalid,
                     path + ": " + key + " is '" + value + "', which this version does not know");
    };
    const std::string convention = fact("convention"), axes = fact("axes");
    const auto known_convention = volume::convention_named(convention);
    if (!known_convention)
        throw unknown("convention", convention);
    const auto known_axes = volume::axes_named(axes);
    if (!known_axes)
        throw unknown("axes", axes);
    const volume::Encoding encoding{*known_convention, *known_axes};
    for (const auto& [key, value] : field_facts(encoding))
        if (const std::string found = fact(key.c_str()); found != value)
            throw Error(ErrorKind::invalid,
                        path + ": " + key + " is '" + found + "', expected '" + value + "'");
    return encoding;
}

void check_volume(const Volume& volume, const std::string& path, ErrorKind error) {
    const auto reject = [&](const auto&... parts) {
        std::ostringstream text;
        text << path << ": ";
        (text << ... << parts);
        throw Error(error, text.str());
    };
    const Grid& grid = volume.grid;
    const glm::ivec3 dims = grid.dims;
    if (dims.x < 1 || dims.y < 1 || dims.z < 1 || !std::isnormal(grid.cell) || grid.cell < 0
        || !std::isfinite(grid.origin.x) || !std::isfinite(grid.origin.y)
        || !std::isfinite(grid.origin.z) || !(std::abs(glm::length(grid.turn) - 1) < 1e-6))
        reject("the lattice of ", dims.x, " x ", dims.y, " x ", dims.z, " cells of ", grid.cell,
               " m is not valid");
    if (volume.sh_order < 0 || volume.sh_order > volume::sh_max_order)
        reject("the SH order ", volume.sh_order, " is not 0 to ", volume::sh_max_order);
    const size_t coefficients = size_t(volume::sh_count(volume.sh_order));
    if (volume.sh.size() != coefficients)
        reject(volume.sh.size(), " coefficients are given, SH order ", volume.sh_order, " has ",
               coefficients);
    for (const volume::ConstGridView& view : volume::grids_of(volume)) {
        const GridKind& kind = *view.kind;
        if (view.k == 0 && &kind != &volume::light_kind())
            if (const int count = int(volume::grids_of(volume, kind).size());
                count < kind.fewest || count > kind.most)
                reject(count, " grids of ", kind.name, " are given, expected ", kind.fewest,
                       kind.fewest < kind.most ? " to " + std::to_string(kind.most) : "");
        if (view.cells != grid.size())
            reject("grid ", view.name(), " has ", view.cells, " cells, expected ", grid.size());
        if (all_finite(view.values()))
            continue;
        const auto bad =
            std::ranges::find_if_not(view.values(), [](float x) { return std::isfinite(x); });
        const glm::ivec3 cell =
            grid.cell_at(size_t(bad - view.values().begin()) / size_t(kind.width()));
        reject("grid ", view.name(), " has a value that is not finite in cell (", cell.x, ", ",
               cell.y, ", ", cell.z, "); such volumes are not stored");
    }
}

void check_dims(glm::ivec3 dims, int sh_order, volume::GridKinds kinds, const std::string& path) {
    int floats = 0;
    for (const GridKind* kind : kinds)
        if (!std::holds_alternative<std::monostate>(kind->member)) // else see make_grids
            floats += kind->width()
                      * (kind == &volume::light_kind() ? volume::sh_count(sh_order) : kind->most);
    const auto text = [&](const char* why) {
        return path + ": the lattice of " + dims_text(dims) + " " + why;
    };
    if (dims.x < 1 || dims.y < 1 || dims.z < 1 || double(dims.x) * dims.y * dims.z > 2147483647.0)
        throw Error(ErrorKind::invalid, text("is not valid"));
    const double bytes = double(dims.x) * dims.y * dims.z * floats * 4;
    if (bytes > double(machine_memory()))
        throw Error(ErrorKind::memory, text("does not fit this machine's memory"));
}

void make_grids(Volume& volume, const GridKind& kind, int count, const std::string& path) {
    double bytes = double(volume.grid.size()) * count * kind.width() * 4;
    for (const volume::ConstGridView& grid : volume::grids_of(std::as_const(volume)))
        if (grid.kind != &kind)
            bytes += double(grid.values().size_bytes());
    if (bytes > double(machine_memory()))
        throw Error(ErrorKind::memory, path + ": the grids of " + dims_text(volume.grid.dims)
                                           + " do not fit this machine's memory");
    volume::set_grids(volume, kind, count);
}

std::optional<std::string> half_misfit(const volume::ConstGridView& grid) {
    const float largest = largest_size(grid.values());
    const bool beyond = largest > half_max;
    const bool below =
        grid.kind == &volume::light_kind() && grid.k == 0 && largest > 0 && largest < half_min;
    if (!beyond && !below)
        return {};
    std::ostringstream text;
    text << grid.name() << (beyond ? " reaches " : " reaches only ") << largest
         << (beyond ? ", more than half precision's largest value "
                    : ", less than half precision's smallest normal value ")
         << (beyond ? half_max : half_min);
    return text.str();
}

std::optional<std::string> half_misfit(const Volume& volume, bool no_light) {
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        if (!no_light || grid.kind != &volume::light_kind())
            if (auto why = half_misfit(grid))
                return why;
    return {};
}

} // namespace lpvbake::io
