#include "readers/readers.h"

#include "colour/colour.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace lpvbake::readers {
namespace {

constexpr Reader readers[] = {
    {.name = "lpvbake",
     .lookup = Reading::facing,
     .highest_order = volume::sh_max_order,
     .clamped = true,
     .gives_coefficients = true,
     .source = "volume/sampler.h; examples/shaders"},
    {.name = "blender",
     .highest_order = volume::sh_max_order,
     .source = "a volume grid, linear; examples/blender"},
    {.name = "houdini", .highest_order = volume::sh_max_order, .source = "volumesample() of VEX"},
    {.name = "unity",
     .gives_coefficients = true,
     .source = "a Texture3D, bilinear and clamped; ShadeSH9 of UnityCG.cginc"},
    {.name = "unreal",
     .clamped = true,
     .source = "a volume texture, clamped; DotSH3 of SHCommon.ush, BasePassPixelShader.usf"},
    {.name = "godot", .source = "a Texture3D; lightmap captures of scene_forward_clustered.glsl"},
    {.name = "threejs",
     .offset = 0.5,
     .source = "lightprobes_pars_fragment.glsl.js, three.js r187 (f292d02)"},
    {.name = "vrc",
     .highest_order = 1,
     .beyond_box = false,
     .gives_coefficients = true,
     .source = "LightVolumes.cginc, REDSIM/VRCLightVolumes 3cefcb7"},
    {.name = "bevy",
     .evaluation = Evaluation::cube,
     .beyond_box = false,
     .source = "irradiance_volume.wgsl, bevyengine/bevy 394a060"},
    {.name = "geomerics",
     .evaluation = Evaluation::geomerics,
     .highest_order = 1,
     .source = "Geomerics, CEDEC 2015"},
    {.name = "zh3",
     .evaluation = Evaluation::zh3,
     .highest_order = 1,
     .source = "Roughton et al. 2024, section 3.4.3"},
};

constexpr std::pair<const char*, Evaluation> evaluations[] = {
    {"linear", Evaluation::linear},
    {"geomerics", Evaluation::geomerics},
    {"zh3", Evaluation::zh3},
};

/// Which end of an axis the cube looks to; 0 counts as positive.
glm::vec3 cube_side(int axis, glm::dvec3 n) {
    glm::vec3 side(0.0f);
    side[axis] = n[axis] < 0 ? -1.0f : 1.0f;
    return side;
}

/// Coefficients of the lookup, one colour after the other.
std::vector<glm::vec3> mix(const Volume& volume, const volume::CellWeights& taps,
                           std::size_t count) {
    std::vector<glm::vec3> mixed(count);
    for (std::size_t k = 0; k < count; ++k) {
        glm::dvec3 sum(0.0);
        for (std::size_t i = 0; i < taps.cell.size(); ++i)
            if (taps.weight[i] > 0)
                sum += taps.weight[i] * glm::dvec3(volume.sh[k][taps.cell[i]]);
        mixed[k] = glm::vec3(sum);
    }
    return mixed;
}

double towards(std::span<const glm::vec3> c, int colour, glm::vec3 n) {
    std::array<float, volume::sh_count(volume::sh_max_order)> one;
    for (std::size_t k = 0; k < c.size(); ++k)
        one[k] = c[k][colour];
    return double(volume::sh_irradiance(std::span(one).first(c.size()), n));
}

/// Band 1 as a vector (x, y, z), one colour.
glm::dvec3 first_band(std::span<const glm::vec3> c, int colour) {
    return c.size() < 4 ? glm::dvec3(0.0) : glm::dvec3(c[3][colour], c[1][colour], c[2][colour]);
}

double geomerics(double l0, glm::dvec3 l1, glm::dvec3 n) {
    const double mean = std::numbers::pi * double(volume::sh_y0) * l0; // of irradiance over normals
    const double length = glm::length(l1);
    if (!(mean > 0 && length > 0))
        return std::max(0.0, mean);
    const double r =
        std::min(1.0, double(volume::sh_y1) * length / (3.0 * double(volume::sh_y0) * l0));
    const double q = std::clamp(0.5 + 0.5 * glm::dot(l1 / length, n), 0.0, 1.0);
    const double p = 1 + 2 * r, a = (1 - r) / (1 + r);
    return mean * (a + (1 - a) * (p + 1) * std::pow(q, p));
}

glm::dvec3 zh3(std::span<const glm::vec3> c, glm::dvec3 n) {
    glm::dvec3 result, axis(0.0);
    for (int colour = 0; colour < 3; ++colour) {
        result[colour] = towards(c, colour, glm::vec3(n));
        axis += colour::rec709_luminance[colour] * first_band(c, colour);
    }
    const double length = glm::length(axis);
    if (!(length > 0))
        return result;
    axis /= length;
    const double along = glm::dot(axis, n);
    const double zonal = double(volume::sh_y2b) * (3 * along * along - 1);
    for (int colour = 0; colour < 3; ++colour) {
        const double l0 = double(c[0][colour]);
        if (!(l0 > 0))
            continue;
        const double r =
            std::min(std::abs(glm::dot(first_band(c, colour), axis)) / l0, std::numbers::sqrt3);
        result[colour] += volume::sh_cosine_factor(2) * l0 * (0.08 * r + 0.6 * r * r) * zonal;
    }
    return result;
}

} // namespace

std::span<const Reader> all_readers() {
    return readers;
}

const Reader* reader_named(std::string_view name) {
    for (const Reader& reader : readers)
        if (name == reader.name)
            return &reader;
    return nullptr;
}

const Evaluation* evaluation_named(std::string_view name) {
    for (const auto& [own, evaluation] : evaluations)
        if (name == own)
            return &evaluation;
    return nullptr;
}

const char* name_of(Evaluation evaluation) {
    for (const auto& [name, own] : evaluations)
        if (evaluation == own)
            return name;
    return "";
}

Reader with_evaluation(Reader reader, Evaluation evaluation) {
    assert(reader.gives_coefficients);
    reader.evaluation = evaluation;
    if (!is_linear(reader))
        reader.highest_order = std::min(reader.highest_order, 1);
    return reader;
}

bool read_alike(const Reader& a, const Reader& b) {
    return a.lookup == b.lookup && a.offset == b.offset && a.evaluation == b.evaluation
           && a.highest_order == b.highest_order && a.clamped == b.clamped
           && a.beyond_box == b.beyond_box;
}

int order_of(const Reader& reader, const Volume& volume) {
    return std::min(reader.highest_order, volume.sh_order);
}

volume::CellWeights taps_of(const Reader& reader, const Volume& volume, glm::dvec3 point,
                            glm::dvec3 n) {
    if (!reader.beyond_box) {
        const glm::dvec3 at = volume.grid.to_grid(point);
        if (at != glm::clamp(at, glm::dvec3(0), glm::dvec3(volume.grid.dims)))
            return {};
    }
    if (reader.offset != 0)
        point += reader.offset * volume.grid.cell * n;
    return volume::weights_at(volume, point, n, reader.lookup);
}

std::array<double, volume::sh_count(volume::sh_max_order)> transfer_of(const Reader& reader,
                                                                       int order, glm::dvec3 n) {
    assert(is_linear(reader));
    std::array<double, volume::sh_count(volume::sh_max_order)> result{};
    const auto add = [&](glm::vec3 direction, double share) {
        const volume::ShValues basis = volume::sh_basis(order, direction);
        for (int l = 0, k = 0; l <= order; ++l)
            for (const double factor = share * volume::sh_cosine_factor(l); k < volume::sh_count(l);
                 ++k)
                result[std::size_t(k)] += factor * double(basis[std::size_t(k)]);
    };
    if (reader.evaluation == Evaluation::linear)
        add(glm::vec3(n), 1.0);
    else
        for (int axis = 0; axis < 3; ++axis)
            add(cube_side(axis, n), n[axis] * n[axis]);
    return result;
}

glm::dvec3 evaluate(Evaluation evaluation, std::span<const glm::vec3> coefficients, glm::dvec3 n) {
    assert(evaluation != Evaluation::cube);
    if (evaluation == Evaluation::zh3)
        return zh3(coefficients, n);
    glm::dvec3 result;
    for (int colour = 0; colour < 3; ++colour)
        result[colour] =
            evaluation == Evaluation::linear
                ? towards(coefficients, colour, glm::vec3(n))
                : geomerics(double(coefficients[0][colour]), first_band(coefficients, colour), n);
    return result;
}

namespace {

glm::dvec3 irradiance_of(const Reader& reader, const Volume& volume,
                         const volume::CellWeights& taps, glm::dvec3 n) {
    const std::size_t count = std::size_t(volume::sh_count(order_of(reader, volume)));
    glm::dvec3 result(0.0);
    if (reader.evaluation == Evaluation::cube) {
        std::vector<glm::vec3> cell(count);
        for (std::size_t i = 0; i < taps.cell.size(); ++i) {
            if (!(taps.weight[i] > 0))
                continue;
            for (std::size_t k = 0; k < count; ++k)
                cell[k] = volume.sh[k][taps.cell[i]];
            for (int axis = 0; axis < 3; ++axis) {
                const glm::dvec3 side = evaluate(Evaluation::linear, cell, cube_side(axis, n));
                result += taps.weight[i] * n[axis] * n[axis] * glm::max(side, 0.0);
            }
        }
    } else {
        result = evaluate(reader.evaluation, mix(volume, taps, count), n);
    }
    return reader.clamped ? glm::max(result, 0.0) : result;
}

} // namespace

glm::dvec3 irradiance(const Reader& reader, const Volume& volume, glm::dvec3 point, glm::dvec3 n) {
    return irradiance_of(reader, volume, taps_of(reader, volume, point, n), n);
}

glm::dvec3 irradiance(const Reader& reader, const volume::Levels& levels, glm::dvec3 point,
                      glm::dvec3 n) {
    return volume::blend(levels, point, [&](std::size_t level) {
        const Volume& volume = levels.volumes[level];
        const volume::CellWeights taps = taps_of(reader, volume, point, n);
        const bool found = std::ranges::count(taps.weight, 0.0) < std::ssize(taps.weight);
        return volume::LevelReading<glm::dvec3>{irradiance_of(reader, volume, taps, n),
                                                taps.clear && found};
    });
}

} // namespace lpvbake::readers
