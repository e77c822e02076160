#include "io/layout.h"

#include "volume/sh.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <sstream>

namespace lpvbake {
namespace {

constexpr const char* coefficient_names[] = {
    "l0",    "l1_y",  "l1_z",  "l1_x",  "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2",
    "l3_n3", "l3_n2", "l3_n1", "l3_0",  "l3_p1", "l3_p2", "l3_p3", "l4_n4", "l4_n3",
    "l4_n2", "l4_n1", "l4_0",  "l4_p1", "l4_p2", "l4_p3", "l4_p4"};
static_assert(std::size(coefficient_names) == sh_count(sh_max_order));

/// Calls visit(name, cells) for each grid of the volume; RGB cells come as three floats.
template <typename Visit>
void for_each_grid(const Volume& volume, const Visit& visit) {
    for (size_t k = 0; k < volume.sh.size(); ++k)
        visit(std::string("sh_") + coefficient_name(int(k)), volume.sh[k].size(), 3,
              volume.sh[k].empty() ? nullptr : &volume.sh[k][0].x);
    for (size_t k = 0; k < volume.occlusion.size(); ++k)
        visit(std::string("occlusion_") + coefficient_name(int(k)), volume.occlusion[k].size(), 1,
              volume.occlusion[k].data());
    if (!volume.validity.empty())
        visit(std::string("validity"), volume.validity.size(), 1, volume.validity.data());
    for (size_t k = 0; k < volume.walls.size(); ++k)
        visit(wall_name(int(k)), volume.walls[k].size(), 3,
              volume.walls[k].empty() ? nullptr : &volume.walls[k][0].x);
}

} // namespace

const char* coefficient_name(int k) {
    return coefficient_names[k];
}

std::string wall_name(int k) {
    return "wall_" + std::to_string(k);
}

std::vector<std::pair<std::string, std::string>> field_facts(const Encoding& encoding) {
    const bool travel = encoding.convention == ShConvention::lpv;
    return {
        {"convention", name_of(encoding.convention)},
        {"direction", travel ? "travel" : "incident"},
        {"axes", name_of(encoding.axes)},
        {"probe_position", "center"},
    };
}

Encoding encoding_of(const std::function<std::string(const char*)>& fact, const std::string& path) {
    const auto unknown = [&](const char* key, const std::string& value) {
        return Error(ExitCode::invalid,
                     path + ": " + key + " is '" + value + "', which this version does not know");
    };
    const std::string convention = fact("convention"), axes = fact("axes");
    const auto known_convention = convention_named(convention);
    if (!known_convention)
        throw unknown("convention", convention);
    const auto known_axes = axes_named(axes);
    if (!known_axes)
        throw unknown("axes", axes);
    const Encoding encoding{*known_convention, *known_axes};
    for (const auto& [key, value] : field_facts(encoding))
        if (const std::string found = fact(key.c_str()); found != value)
            throw Error(ExitCode::invalid,
                        path + ": " + key + " is '" + found + "', expected '" + value + "'");
    return encoding;
}

Volume encoded(const Volume& volume, const Encoding& encoding, const std::string& path) {
    if (volume.sh_order > highest_order(encoding.convention))
        throw Error(ExitCode::unsupported, path + ": the convention " + name_of(encoding.convention)
                                               + " has a form for order "
                                               + std::to_string(highest_order(encoding.convention))
                                               + " at most; the volume has order "
                                               + std::to_string(volume.sh_order)
                                               + ": set --sh-order");
    Volume stored = turned(volume, from_gltf(encoding.axes));
    encode(encoding.convention, stored.sh_order, stored.sh);
    return stored;
}

Volume decoded(Volume stored, const Encoding& encoding, const std::string& path) {
    if (stored.sh_order > highest_order(encoding.convention))
        throw Error(ExitCode::invalid, path + ": order " + std::to_string(stored.sh_order)
                                           + " cannot be of the convention "
                                           + name_of(encoding.convention));
    decode(encoding.convention, stored.sh_order, stored.sh);
    return turned(stored, glm::transpose(from_gltf(encoding.axes)));
}

std::pair<std::string, std::string> grid_quantity(const std::string& grid_name,
                                                  ShConvention convention) {
    if (grid_name.starts_with("sh_"))
        return {quantity_of(convention).name, quantity_of(convention).units};
    if (grid_name == "density")
        return {"mean luminance over all directions", "cd/m^2"};
    if (grid_name.starts_with("occlusion"))
        return {"blocking potential", "1"};
    if (grid_name.starts_with("wall_"))
        return {"way to a plane that hides what is beyond", "cells"};
    return {"validity", "1"};
}

void check_volume(const Volume& volume, const std::string& path, ExitCode code) {
    const auto reject = [&](const auto&... parts) {
        std::ostringstream text;
        text << path << ": ";
        (text << ... << parts);
        throw Error(code, text.str());
    };
    const Grid& grid = volume.grid;
    const glm::ivec3 dims = grid.dims;
    if (dims.x < 1 || dims.y < 1 || dims.z < 1 || !std::isnormal(grid.cell) || grid.cell < 0
        || !std::isfinite(grid.origin.x) || !std::isfinite(grid.origin.y)
        || !std::isfinite(grid.origin.z))
        reject("the lattice of ", dims.x, " x ", dims.y, " x ", dims.z, " cells of ", grid.cell,
               " m is not valid");
    if (volume.sh_order < 0 || volume.sh_order > sh_max_order)
        reject("the SH order ", volume.sh_order, " is not 0 to ", sh_max_order);
    const size_t coefficients = size_t(sh_count(volume.sh_order));
    if (volume.sh.size() != coefficients)
        reject(volume.sh.size(), " coefficients are given, SH order ", volume.sh_order, " has ",
               coefficients);
    if (!volume.occlusion.empty() && volume.occlusion.size() != 4)
        reject(volume.occlusion.size(), " occlusion grids are given, expected 4");
    if (volume.walls.size() > size_t(most_walls))
        reject(volume.walls.size(), " grids of walls are given, at most ", most_walls,
               " are known");
    for_each_grid(
        volume, [&](const std::string& name, size_t cells, int floats, const float* data) {
            if (cells != grid.size())
                reject("grid ", name, " has ", cells, " cells, expected ", grid.size());
            const size_t count = cells * size_t(floats);
            const float* bad =
                std::find_if_not(data, data + count, [](float x) { return std::isfinite(x); });
            if (bad == data + count)
                return;
            const size_t i = size_t(bad - data) / size_t(floats);
            const size_t nx = size_t(dims.x), ny = size_t(dims.y);
            reject("grid ", name, " has a value that is not finite in cell (", i % nx, ", ",
                   i / nx % ny, ", ", i / (nx * ny), "); such volumes are not stored");
        });
}

void check_dims(glm::ivec3 dims, int floats, const std::string& path) {
    const auto text = [&](const char* why) {
        return path + ": the lattice of " + std::to_string(dims.x) + " x " + std::to_string(dims.y)
               + " x " + std::to_string(dims.z) + " cells " + why;
    };
    if (dims.x < 1 || dims.y < 1 || dims.z < 1 || double(dims.x) * dims.y * dims.z > 2147483647.0)
        throw Error(ExitCode::invalid, text("is not valid"));
    const double bytes = double(dims.x) * dims.y * dims.z * floats * 4;
    if (bytes > double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGESIZE)))
        throw Error(ExitCode::memory, text("does not fit this machine's memory"));
}

std::optional<std::string> half_misfit(const Volume& volume) {
    constexpr float half_max = 65504, half_min = 1.0f / 16384;
    std::optional<std::string> why;
    for_each_grid(
        volume, [&](const std::string& name, size_t cells, int floats, const float* data) {
            float largest = 0;
            for (size_t i = 0; i < cells * size_t(floats); ++i)
                largest = std::max(largest, std::abs(data[i]));
            const bool beyond = largest > half_max;
            const bool below = name == "sh_l0" && largest > 0 && largest < half_min;
            if (why || (!beyond && !below))
                return;
            std::ostringstream text;
            text << name << (beyond ? " reaches " : " reaches only ") << largest
                 << (beyond ? ", more than half precision's largest value "
                            : ", less than half precision's smallest normal value ")
                 << (beyond ? half_max : half_min) << "; full precision was written instead";
            why = text.str();
        });
    return why;
}

} // namespace lpvbake
