#include "readers/readers.h"

#include "unit/volumes.h"
#include "volume/sh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace lpvbake::readers {
namespace {

using std::numbers::pi;

class Places {
public:
    explicit Places(const Grid& grid, unsigned seed = 7) : grid_(grid), random_(seed) {}
    /// Anywhere in the grid's box, or up to `beyond` cells around it.
    glm::dvec3 point(double beyond = 0) {
        const glm::dvec3 share(share_(random_), share_(random_), share_(random_));
        return grid_.origin + grid_.cell * (share * (glm::dvec3(grid_.dims) + 2 * beyond) - beyond);
    }
    glm::dvec3 normal() {
        return glm::normalize(glm::dvec3(bell_(random_), bell_(random_), bell_(random_)));
    }

private:
    Grid grid_;
    std::mt19937 random_;
    std::uniform_real_distribution<double> share_;
    std::normal_distribution<double> bell_;
};

/// Calls visit(cell, index) for all.
void for_each_cell(const Grid& grid, const std::function<void(glm::ivec3, std::size_t)>& visit) {
    glm::ivec3 c;
    for (c.z = 0; c.z < grid.dims.z; ++c.z)
        for (c.y = 0; c.y < grid.dims.y; ++c.y)
            for (c.x = 0; c.x < grid.dims.x; ++c.x)
                visit(c, grid.index(c));
}

/// The same luminance (nits) from all directions, of each cell by its centre.
Volume isotropic(glm::ivec3 dims, int order, const std::function<double(glm::dvec3)>& luminance) {
    Volume volume;
    volume.grid = {{-3, 5, 1}, 0.5, dims};
    volume.sh_order = order;
    volume.sh.assign(std::size_t(volume::sh_count(order)),
                     std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(volume.grid.size(), 1.0f);
    for_each_cell(volume.grid, [&](glm::ivec3 c, std::size_t i) {
        volume.sh[0][i] = glm::vec3(float(luminance(volume.grid.center(c)) * 2 * std::sqrt(pi)));
    });
    return volume;
}

// ---- the readers once more, from their mathematics: hat functions over all cells, and integrals
// over directions ----

/// Polynomials that span the bands up to 2, of norm 1.
std::array<double, 9> polynomials(glm::dvec3 w) {
    const double a = std::sqrt(1 / (4 * pi)), b = std::sqrt(3 / (4 * pi)),
                 c = std::sqrt(15 / (4 * pi)), d = std::sqrt(5 / (16 * pi));
    return {a,
            b * w.y,
            b * w.z,
            b * w.x,
            c * w.x * w.y,
            c * w.y * w.z,
            d * (3 * w.z * w.z - 1),
            c * w.x * w.z,
            c / 2 * (w.x * w.x - w.y * w.y)};
}

/// Integral of luminance times cosine over the hemisphere around n: midpoints in the square of the
/// sine and in azimuth, exact in the latter.
double integrated(const std::array<double, 9>& c, glm::dvec3 n) {
    const glm::dvec3 u = glm::normalize(
        glm::cross(n, std::abs(n.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
    const glm::dvec3 v = glm::cross(n, u);
    constexpr int rings = 400, turns = 8;
    double sum = 0;
    for (int i = 0; i < rings; ++i)
        for (int j = 0; j < turns; ++j) {
            const double sine2 = (i + 0.5) / rings, turn = 2 * pi * j / turns;
            const double sine = std::sqrt(sine2);
            const std::array<double, 9> y = polynomials(
                sine * std::cos(turn) * u + sine * std::sin(turn) * v + std::sqrt(1 - sine2) * n);
            for (std::size_t k = 0; k < 9; ++k)
                sum += c[k] * y[k];
        }
    return pi * sum / (rings * turns);
}

/// What a texture with linear filter and clamped edges gives, one colour.
std::array<double, 9> texture(const Volume& volume, glm::dvec3 point, int order, int colour) {
    std::array<double, 9> c{};
    const Grid& grid = volume.grid;
    const glm::dvec3 at = glm::clamp(point, grid.center({0, 0, 0}), grid.center(grid.dims - 1));
    for_each_cell(grid, [&](glm::ivec3 cell, std::size_t i) {
        const glm::dvec3 hat =
            glm::max(glm::dvec3(0), 1.0 - glm::abs(at - grid.center(cell)) / grid.cell);
        for (std::size_t k = 0; k < std::size_t((order + 1) * (order + 1)); ++k)
            c[k] += hat.x * hat.y * hat.z * double(volume.sh[k][i][colour]);
    });
    return c;
}

TEST(Readers, AreNamedAndFound) {
    for (const readers::Reader& reader : readers::all_readers()) {
        EXPECT_EQ(readers::reader_named(reader.name), &reader);
        EXPECT_STRNE(reader.source, "");
    }
    for (const char* name :
         {"lpvbake", "blender", "houdini", "unity", "unreal", "godot", "threejs", "vrc", "bevy"})
        EXPECT_NE(readers::reader_named(name), nullptr) << name;
    EXPECT_EQ(readers::reader_named("generic"), nullptr);
}

TEST(Readers, AllReadAConstantFieldExactly) {
    const Volume volume = isotropic({4, 5, 6}, 2, [](glm::dvec3) { return 2.0; });
    for (const readers::Reader& reader : readers::all_readers()) {
        Places places(volume.grid);
        for (int i = 0; i < 100; ++i) {
            const glm::dvec3 e =
                readers::irradiance(reader, volume, places.point(), places.normal());
            for (int c = 0; c < 3; ++c)
                ASSERT_NEAR(e[c], 2 * pi, 1e-5) << reader.name;
        }
    }
}

TEST(Readers, ALinearFieldIsReadWhereTheLookupLies) {
    const auto linear = [](glm::dvec3 p) { return 20 + p.x - 2 * p.y + 3 * p.z; };
    const Volume volume = isotropic({4, 5, 6}, 1, linear);
    for (const readers::Reader& reader : readers::all_readers()) {
        if (reader.lookup != Reading::trilinear)
            continue;
        const double offset = reader.name == std::string_view("threejs") ? 0.25 : 0.0; // metres
        Places places(volume.grid);
        for (int i = 0; i < 300; ++i) {
            const glm::dvec3 p = places.point(), n = places.normal();
            const glm::dvec3 hull = glm::clamp(p + offset * n, volume.grid.center({0, 0, 0}),
                                               volume.grid.center(volume.grid.dims - 1));
            ASSERT_NEAR(readers::irradiance(reader, volume, p, n).y, pi * linear(hull), 1e-4)
                << reader.name;
        }
    }
}

TEST(Readers, LinearOnesAreTheIntegralOfWhatATextureGives) {
    const Volume volume = random_volume({4, 3, 5}, 2, false, 3, 10);
    struct Row {
        const char* name;
        double offset; // cells
        int order;
    };
    for (const auto& [name, offset, order] :
         {Row{"blender", 0, 2}, Row{"houdini", 0, 2}, Row{"unity", 0, 2}, Row{"unreal", 0, 2},
          Row{"godot", 0, 2}, Row{"threejs", 0.5, 2}, Row{"vrc", 0, 1}}) {
        const readers::Reader& reader = *readers::reader_named(name);
        Places places(volume.grid);
        for (int i = 0; i < 40; ++i) {
            const glm::dvec3 p = places.point(reader.beyond_box ? 1.5 : 0), n = places.normal();
            const glm::dvec3 e = readers::irradiance(reader, volume, p, n);
            for (int c = 0; c < 3; ++c) {
                const double all =
                    integrated(texture(volume, p + offset * volume.grid.cell * n, order, c), n);
                const bool dark = all < 0 && reader.name == std::string_view("unreal");
                ASSERT_NEAR(e[c], dark ? 0 : all, 2e-3) << name;
            }
        }
    }
}

TEST(Readers, BevyMixesSidesThatCellsStore) {
    Volume volume = random_volume({3, 4, 3}, 2, false, 5, 10);
    const readers::Reader& bevy = *readers::reader_named("bevy");
    Volume sides = volume; // coefficient k: irradiance of side k, +x, -x, +y, ...
    for (std::size_t i = 0; i < volume.grid.size(); ++i)
        for (int c = 0; c < 3; ++c) {
            std::array<double, 9> one;
            for (std::size_t k = 0; k < 9; ++k)
                one[k] = double(volume.sh[k][i][c]);
            for (int side = 0; side < 6; ++side) {
                glm::dvec3 n(0);
                n[side / 2] = side % 2 ? -1 : 1;
                sides.sh[std::size_t(side)][i][c] = float(std::max(0.0, integrated(one, n)));
            }
        }
    Places places(volume.grid);
    for (int i = 0; i < 40; ++i) {
        const glm::dvec3 p = places.point(), n = places.normal();
        const glm::dvec3 e = readers::irradiance(bevy, volume, p, n);
        for (int c = 0; c < 3; ++c) {
            const std::array<double, 9> mixed = texture(sides, p, 2, c);
            double sum = 0;
            for (int axis = 0; axis < 3; ++axis)
                sum += n[axis] * n[axis] * mixed[std::size_t(2 * axis + (n[axis] < 0))];
            ASSERT_NEAR(e[c], sum, 2e-3);
        }
    }
}

TEST(Readers, OursHasTheBitsOfTheSampler) {
    const Volume volume = random_volume({5, 6, 4}, 4, false, 11, 10);
    const readers::Reader& ours = *readers::reader_named("lpvbake");
    Places places(volume.grid);
    for (int i = 0; i < 2000; ++i) {
        const glm::dvec3 p = places.point(0.5), n = places.normal();
        ASSERT_EQ(readers::irradiance(ours, volume, p, n),
                  read_irradiance(volume, p, n, Reading::facing));
    }
}

TEST(Readers, BeyondTheBoxSomeFindNothing) {
    const Volume volume = isotropic({3, 3, 3}, 1, [](glm::dvec3) { return 1.0; });
    const glm::dvec3 outside = volume.grid.origin - glm::dvec3(0.01, 0, 0);
    for (const readers::Reader& reader : readers::all_readers()) {
        const bool none =
            reader.name == std::string_view("vrc") || reader.name == std::string_view("bevy");
        EXPECT_NEAR(readers::irradiance(reader, volume, outside, {1, 0, 0}).x, none ? 0 : pi, 1e-5)
            << reader.name;
    }
}

TEST(Readers, TapsTimesTransferIsWhatALinearOneShows) {
    const Volume volume = random_volume({4, 5, 3}, 2, false, 13, 10);
    for (const readers::Reader& reader : readers::all_readers()) {
        if (!readers::is_linear(reader)
            || reader.evaluation == readers::Evaluation::cube) // which clamps each cell
            continue;
        Places places(volume.grid);
        for (int i = 0; i < 100; ++i) {
            const glm::dvec3 p = places.point(), n = places.normal();
            const volume::CellWeights taps = readers::taps_of(reader, volume, p, n);
            const int order = readers::order_of(reader, volume);
            const auto transfer = readers::transfer_of(reader, order, n);
            glm::dvec3 sum(0.0);
            for (std::size_t t = 0; t < 8; ++t)
                for (std::size_t k = 0; k < std::size_t(volume::sh_count(order)); ++k)
                    sum += taps.weight[t] * transfer[k] * glm::dvec3(volume.sh[k][taps.cell[t]]);
            if (reader.clamped)
                sum = glm::max(sum, 0.0);
            ASSERT_LT(glm::length(readers::irradiance(reader, volume, p, n) - sum), 1e-3)
                << reader.name;
        }
    }
    // Where all sides of all cells are lit, the cube is linear too.
    Volume lit = volume;
    for (glm::vec3& l0 : lit.sh[0])
        l0 = glm::vec3(1000.0f);
    const readers::Reader& bevy = *readers::reader_named("bevy");
    Places places(lit.grid);
    for (int i = 0; i < 100; ++i) {
        const glm::dvec3 p = places.point(), n = places.normal();
        const volume::CellWeights taps = readers::taps_of(bevy, lit, p, n);
        const auto transfer = readers::transfer_of(bevy, 2, n);
        double sum = 0;
        for (std::size_t t = 0; t < 8; ++t)
            for (std::size_t k = 0; k < 9; ++k)
                sum += taps.weight[t] * transfer[k] * double(lit.sh[k][taps.cell[t]].y);
        ASSERT_NEAR(readers::irradiance(bevy, lit, p, n).y, sum, 1e-3);
    }
}

/// One cell lit from direction +z alone, with 1 lux of irradiance there.
Volume beam() {
    Volume volume = isotropic({1, 1, 1}, 1, [](glm::dvec3) { return 1 / (4 * pi); });
    volume.sh[2][0] = glm::vec3(float(std::sqrt(3 / (4 * pi))));
    return volume;
}

TEST(Readers, GeomericsShowsABeamAsACubicLobe) {
    const Volume volume = beam();
    const readers::Reader& reader = *readers::reader_named("geomerics");
    const glm::dvec3 p = volume.grid.center({0, 0, 0});
    for (const double z : {-1.0, -0.3, 0.0, 0.5, 1.0}) {
        const glm::dvec3 n(0, std::sqrt(1 - z * z), z);
        EXPECT_NEAR(readers::irradiance(reader, volume, p, n).x, std::pow((1 + z) / 2, 3), 1e-6);
    }
    // However directional, the mean over normals is band 0's.
    Volume half = volume;
    half.sh[2][0] *= 0.37f;
    double sum = 0;
    for (int i = 0; i < 2000; ++i) {
        const double z = (i + 0.5) / 1000 - 1;
        sum += readers::irradiance(reader, half, p, {std::sqrt(1 - z * z), 0, z}).y / 2000;
    }
    EXPECT_NEAR(sum, 0.25, 1e-5);
}

TEST(Readers, Zh3AddsAZonalBandAlongTheLuminance) {
    const readers::Reader& reader = *readers::reader_named("zh3");
    Volume volume = beam();
    const glm::dvec3 p = volume.grid.center({0, 0, 0});
    const double r = std::sqrt(3.0), l0 = std::sqrt(1 / (4 * pi));
    const double l2 = l0 * (0.08 * r + 0.6 * 3), axis_factor = pi / 4 * std::sqrt(5 / (16 * pi));
    for (const double z : {-1.0, 0.2, 1.0})
        EXPECT_NEAR(readers::irradiance(reader, volume, p, {0, std::sqrt(1 - z * z), z}).z,
                    0.25 + 0.5 * z + l2 * axis_factor * (3 * z * z - 1), 1e-6);
    // Colours share an axis; one whose own band 1 is perpendicular to it gets none.
    volume.sh[1][0] = {0.0f, 0.0f, 0.5f};
    volume.sh[2][0] = {0.4f, 0.0f, 0.0f};
    const glm::dvec3 axis = glm::normalize(glm::dvec3(0, 0.0722 * 0.5, 0.2126 * 0.4));
    const auto linear = [&](float c) {
        return pi * l0 * l0 + 2 * pi / 3 * std::sqrt(3 / (4 * pi)) * double(c);
    };
    const double red = 0.4 * axis.z / l0;
    EXPECT_NEAR(readers::irradiance(reader, volume, p, {0, 0, 1}).x,
                linear(0.4f)
                    + l0 * (0.08 * red + 0.6 * red * red) * axis_factor * (3 * axis.z * axis.z - 1),
                1e-6);
    EXPECT_NEAR(readers::irradiance(reader, volume, p, {0, 0, 1}).y, linear(0.0f), 1e-6);
}

TEST(Readers, OnlySomeClampWhatIsNegative) {
    Volume volume = beam();
    volume.sh[2][0] *= 3.0f;
    const glm::dvec3 p = volume.grid.center({0, 0, 0});
    for (const readers::Reader& reader : readers::all_readers()) {
        const double e = readers::irradiance(reader, volume, p, {0, 0, -1}).x;
        const std::string_view name = reader.name;
        if (name == "unity" || name == "godot" || name == "threejs" || name == "vrc") {
            EXPECT_NEAR(e, 0.25 - 1.5, 1e-6) << name;
        }
        if (name == "lpvbake" || name == "unreal" || name == "bevy") {
            EXPECT_EQ(e, 0.0) << name;
        }
    }
}

TEST(Readers, NotesForUnityAreTheFormulasOfShaders) {
    const Volume volume = random_volume({4, 4, 4}, 1, false, 5);
    Places places(volume.grid);
    int lit = 0;
    for (std::size_t cell = 0; cell < volume.grid.size(); ++cell) {
        std::array<glm::vec3, 4> c;
        for (std::size_t k = 0; k < 4; ++k)
            c[k] = volume.sh[k][cell];
        if (c[1] == glm::vec3(0.0f)) // some are dark
            continue;
        ++lit;
        c[0] = glm::abs(c[0]) + 0.5f;
        const glm::dvec3 n = places.normal();
        const glm::dvec3 geomerics = evaluate(Evaluation::geomerics, c, n);
        const glm::dvec3 zh3 = evaluate(Evaluation::zh3, c, n);
        std::array<glm::dvec3, 3> v; // of a colour, as Unity's convention stores it
        glm::dvec3 w, axis(0.0);
        for (int colour = 0; colour < 3; ++colour) {
            w[colour] = double(volume::sh_y0 * c[0][colour]);
            v[std::size_t(colour)] = 2.0 / 3 * double(volume::sh_y1)
                                     * glm::dvec3(c[3][colour], c[1][colour], c[2][colour]);
            axis += glm::dvec3(0.2126, 0.7152, 0.0722)[colour] * v[std::size_t(colour)];
        }
        const glm::dvec3 d = glm::normalize(axis);
        for (int colour = 0; colour < 3; ++colour) {
            const glm::dvec3 of = v[std::size_t(colour)];
            const double e0 = w[colour], length = glm::length(of);
            double r = std::min(1.0, length / (2 * e0));
            const double q = (1 + glm::dot(of, n) / length) / 2, p = 1 + 2 * r,
                         a = (1 - r) / (1 + r);
            const double whole = pi * e0;
            EXPECT_NEAR(geomerics[colour] / whole, a + (1 - a) * (p + 1) * std::pow(q, p), 1e-4);
            r = std::min(1.732051, 0.866025 * std::abs(glm::dot(of, d)) / e0);
            const double along = glm::dot(d, n);
            EXPECT_NEAR(zh3[colour] / whole,
                        glm::dot(of, n) / e0 + 1
                            + 0.279508 * (0.08 * r + 0.6 * r * r) * (3 * along * along - 1),
                        1e-4);
        }
    }
    EXPECT_GT(lit, 20);
}

} // namespace
} // namespace lpvbake::readers
