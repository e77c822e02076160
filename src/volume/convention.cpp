#include "volume/convention.h"

#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>

namespace lpvbake::volume {
namespace {

constexpr double pi = std::numbers::pi;

template <class Value>
struct Named {
    Value value;
    const char* name;
};
constexpr Named<ShConvention> conventions[] = {
    {ShConvention::radiance, "radiance"}, {ShConvention::irradiance, "irradiance"},
    {ShConvention::lpv, "lpv"},           {ShConvention::godot, "godot"},
    {ShConvention::unity, "unity"},       {ShConvention::unreal, "unreal"}};
constexpr Named<Axes> all_axes[] = {{Axes::gltf, "gltf"},
                                    {Axes::unity, "unity"},
                                    {Axes::unreal, "unreal"},
                                    {Axes::blender, "blender"}};

template <class Table, class Value>
const char* find_name(const Table& table, Value value) {
    for (const auto& row : table)
        if (row.value == value)
            return row.name;
    return "";
}

template <class Value, size_t n>
std::optional<Value> find_value(const Named<Value> (&table)[n], std::string_view name) {
    for (const auto& row : table)
        if (name == row.name)
            return row.value;
    return std::nullopt;
}

template <class Table>
std::vector<const char*> names_in(const Table& table) {
    std::vector<const char*> names;
    for (const auto& row : table)
        names.push_back(row.name);
    return names;
}

int band_of(int k) {
    return int(std::sqrt(double(k)));
}

/// What coefficient k is stored times.
double factor(ShConvention convention, int k) {
    const int band = band_of(k);
    const double cosine = sh_cosine_factor(band);
    switch (convention) {
    case ShConvention::radiance:
        return 1.0;
    case ShConvention::irradiance:
        return cosine;
    case ShConvention::lpv:
        return k == 2 ? -cosine : cosine;
    case ShConvention::godot:
        return 1.0 / pi;
    case ShConvention::unity: {
        // Those of the basis come with it; the z^2 of 3 z^2 - 1 has three times its own.
        constexpr double basis[] = {sh_y0,  sh_y1,      sh_y1,  sh_y1, sh_y2a,
                                    sh_y2a, 3 * sh_y2b, sh_y2a, sh_y2c};
        return cosine / pi * basis[k];
    }
    case ShConvention::unreal:
        // Odd m: those of band 1 but z, and of band 2 yz and xz.
        return k == 1 || k == 3 || k == 5 || k == 7 ? -1.0 : 1.0;
    }
    return 1.0;
}

/// Calls change(k, cell's value) in place for all.
void scale(std::vector<std::vector<glm::vec3>>& sh, ShConvention convention, bool back) {
    tbb::parallel_for(size_t(0), sh.size(), [&](size_t k) {
        const double f = factor(convention, int(k));
        assert(f != 0.0 || convention == ShConvention::irradiance);
        if (f == 1.0)
            return;
        for (glm::vec3& c : sh[k])
            c = glm::vec3(back ? glm::dvec3(c) / f : glm::dvec3(c) * f);
    });
}

/// ShadeSH9 has no constant beside its z^2, and takes what is missing from band 0: a third of what
/// is stored for z^2.
void move_constant(std::vector<std::vector<glm::vec3>>& sh, double sign) {
    for (size_t cell = 0; cell < sh[0].size(); ++cell)
        sh[0][cell] += glm::vec3(sign / 3.0 * glm::dvec3(sh[6][cell]));
}

void turn_harmonics(const glm::mat3& rotation, std::span<const GridView> grids) {
    const auto width = size_t(grids[0].kind->width());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, grids[0].values().size() / width),
                      [&](const auto& range) {
                          std::vector<float> channel(grids.size());
                          for (size_t i = range.begin() * width; i < range.end() * width; ++i) {
                              for (size_t k = 0; k < channel.size(); ++k)
                                  channel[k] = grids[k].data[i];
                              sh_rotate(rotation, channel);
                              for (size_t k = 0; k < channel.size(); ++k)
                                  grids[k].data[i] = channel[k];
                          }
                      });
}

/// What takes light in to light out turns with both: R M R^T.
void turn_operators(const glm::mat3& rotation, std::span<const GridView> grids) {
    constexpr size_t n = sh_count(1);
    const size_t values = grids[0].values().size();
    tbb::parallel_for(tbb::blocked_range<size_t>(0, values), [&](const auto& range) {
        std::array<float, n> row;
        for (size_t i = range.begin(); i < range.end(); ++i)
            for (const bool out : {true, false})
                for (size_t other = 0; other < n; ++other) {
                    const auto grid = [&](size_t k) {
                        return grids[out ? n * k + other : n * other + k].data + i;
                    };
                    for (size_t k = 0; k < n; ++k)
                        row[k] = *grid(k);
                    sh_rotate(rotation, row);
                    for (size_t k = 0; k < n; ++k)
                        *grid(k) = row[k];
                }
    });
}

void turn_vectors(const glm::mat3& rotation, const GridView& grid) {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, grid.cells), [&](const auto& range) {
        for (float* v = grid.data + 3 * range.begin(); v != grid.data + 3 * range.end(); v += 3) {
            const glm::vec3 turned = rotation * glm::vec3(v[0], v[1], v[2]);
            std::copy_n(&turned.x, 3, v);
        }
    });
}

} // namespace

const char* name_of(ShConvention convention) {
    return find_name(conventions, convention);
}
const char* name_of(Axes axes) {
    return find_name(all_axes, axes);
}
std::optional<ShConvention> convention_named(std::string_view name) {
    return find_value(conventions, name);
}
std::optional<Axes> axes_named(std::string_view name) {
    return find_value(all_axes, name);
}

std::vector<const char*> convention_names() {
    return names_in(conventions);
}
std::vector<const char*> axes_names() {
    return names_in(all_axes);
}

Quantity quantity_of(ShConvention convention) {
    switch (convention) {
    case ShConvention::radiance:
    case ShConvention::unreal:
        return {"luminance", "cd/m^2"};
    case ShConvention::irradiance:
    case ShConvention::lpv:
        return {"irradiance", "lx"};
    case ShConvention::godot:
        return {"luminance / pi", "cd/m^2"};
    case ShConvention::unity:
        return {"irradiance / pi", "lx"};
    }
    return {"", ""};
}

Quantity quantity_of(const GridKind& kind, ShConvention convention) {
    return &kind == &light_kind() ? quantity_of(convention) : kind.quantity;
}

int highest_order(ShConvention convention) {
    switch (convention) {
    case ShConvention::radiance:
        return sh_max_order;
    case ShConvention::lpv:
        return 1;
    case ShConvention::irradiance: // band 3 would be lost
    case ShConvention::godot:
    case ShConvention::unity:
    case ShConvention::unreal:
        return 2;
    }
    return 0;
}

void encode(ShConvention convention, int order, std::vector<std::vector<glm::vec3>>& sh) {
    assert(order <= highest_order(convention));
    scale(sh, convention, false);
    if (convention == ShConvention::unity && order == 2)
        move_constant(sh, -1.0);
}

void decode(ShConvention convention, int order, std::vector<std::vector<glm::vec3>>& sh) {
    assert(order <= highest_order(convention));
    if (convention == ShConvention::unity && order == 2 && !sh.empty()) // of a header there is none
        move_constant(sh, 1.0);
    scale(sh, convention, true);
}

glm::dmat3 from_gltf(Axes axes) {
    switch (axes) {
    case Axes::gltf:
        break;
    case Axes::unity:
        return {{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    case Axes::unreal:
        return {{1, 0, 0}, {0, 0, 1}, {0, 1, 0}};
    case Axes::blender:
        return {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
    }
    return glm::dmat3(1.0);
}

Grid turned_grid(const Grid& grid, const glm::dmat3& turn) {
    if (grid.is_turned()) {
        // Its own turn is about an axis that goes with the others, the other way round in a mirror.
        const glm::dquat& own = grid.turn;
        const glm::dvec3 axis = glm::determinant(turn) * (turn * glm::dvec3(own.x, own.y, own.z));
        const glm::dvec3 dims = turn * glm::dvec3(grid.dims);
        const glm::dquat turned(own.w, axis.x, axis.y, axis.z);
        return {turn * grid.origin + turned * (grid.cell * glm::min(dims, 0.0)), grid.cell,
                glm::ivec3(glm::abs(dims)), turned};
    }
    const glm::dvec3 one = turn * grid.origin,
                     other = turn * (grid.origin + grid.cell * glm::dvec3(grid.dims));
    return {glm::min(one, other), grid.cell, glm::ivec3(glm::abs(turn * glm::dvec3(grid.dims)))};
}

namespace {

/// Turns harmonics and, where they are to be, vectors.
void turn_values(const glm::mat3& rotation, bool vectors, const std::vector<GridView>& grids) {
    for (size_t first = 0, last; first < grids.size(); first = last) {
        const GridKind* kind = grids[first].kind;
        last = first + 1;
        while (last < grids.size() && grids[last].kind == kind)
            ++last;
        const std::span<const GridView> of_kind(&grids[first], last - first);
        if (kind->turning == Turning::harmonics)
            turn_harmonics(rotation, of_kind);
        else if (kind->turning == Turning::operators)
            turn_operators(rotation, of_kind);
        else if (vectors && kind->turning == Turning::vector)
            for (const GridView& grid : of_kind)
                turn_vectors(rotation, grid);
    }
}

} // namespace

void turn_directions(const glm::dmat3& rotation, Volume& volume) {
    turn_values(glm::mat3(rotation), false, grids_of(volume));
}

void turn_axes(const glm::dmat3& turn, Volume& volume) {
    if (turn == glm::dmat3(1.0))
        return;
    const Grid from = volume.grid;
    const Grid to = volume.grid = turned_grid(from, turn);
    const std::vector<GridView> grids = grids_of(volume);
    turn_values(glm::mat3(turn), true, grids);

    // Cell c of the result comes from the one whose centre turns to its own.
    const glm::dmat3 back = glm::transpose(turn);
    const auto source = [&](glm::ivec3 c) {
        const glm::dvec3 middle = glm::dvec3(c) + 0.5 - 0.5 * glm::dvec3(to.dims);
        return from.index(glm::ivec3(back * middle + 0.5 * glm::dvec3(from.dims)));
    };
    std::vector<float> before;
    for (const GridView& grid : grids) {
        before.assign(grid.values().begin(), grid.values().end());
        const auto width = size_t(grid.kind->width());
        tbb::parallel_for(0, to.dims.z, [&](int z) {
            float* value = grid.data + width * to.index({0, 0, z});
            for (int y = 0; y < to.dims.y; ++y)
                for (int x = 0; x < to.dims.x; ++x, value += width)
                    std::copy_n(&before[width * source({x, y, z})], width, value);
        });
    }
}

} // namespace lpvbake::volume
