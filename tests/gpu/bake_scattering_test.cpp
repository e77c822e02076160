// Light that air scatters again and again, in the field itself.
#include "bake/bake.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "scenes.h"
#include "volume/grids.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <random>

namespace lpvbake {
namespace {

constexpr double pi = 3.141592653589793;
constexpr float mean_of_first = 0.28209479177387814f; ///< coefficients to mean luminance

class BakedScattering : public testing::DeviceTest {
protected:
    bake::BakePlan plan(const Scene& scene, const medium::Medium& air, std::optional<int> times,
                        int resolution = 12, const char* solver = "sn") {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.bounds = bounds_of(scene);
        settings.grid.resolution = resolution;
        settings.grid.margin = 0;
        settings.medium = air;
        settings.medium->box = bounds_of(scene);
        settings.scattering = bake::Scattering{times};
        return bake::plan_bake(bake::survey(scene), settings, device().info());
    }
    Volume run(const Scene& scene, const medium::Medium& air, std::optional<int> times,
               int resolution = 12) {
        Progress silent;
        Baked baked = bake::bake(scene, plan(scene, air, times, resolution), device(), silent);
        for (const StageReport& stage : baked.stages)
            if (stage.name == "scattering")
                detail_ = stage.detail;
        return std::move(baked.volume);
    }
    static glm::vec3 mean_at(const Volume& volume, std::size_t cell) {
        return mean_of_first * volume.sh[0][cell];
    }
    std::string detail_;
};

medium::Medium mist(double scatter, double absorb, double g = 0) {
    return {glm::dvec3(scatter), glm::dvec3(absorb), g, {}};
}

/// Paths in a cube [0, edge]^3 of even walls, of grey light; analog but for the lamp, which is
/// asked at every event. It shares nothing with the program.
struct CubeOfMist {
    double edge, albedo, emission; ///< of the walls; what they emit if `ceiling` alone is lit: it
    bool ceiling;
    double scatter, absorb, g;
    glm::dvec3 lamp;
    double candela;

    double wall(glm::dvec3 from, glm::dvec3 along, int& axis) const {
        double nearest = HUGE_VAL;
        for (int a = 0; a < 3; ++a)
            if (along[a] != 0) {
                const double t = ((along[a] > 0 ? edge : 0) - from[a]) / along[a];
                if (t < nearest) {
                    nearest = t;
                    axis = a;
                }
            }
        return nearest;
    }
    double phase(double cosine) const {
        return (1 - g * g) / (4 * pi * std::pow(1 + g * g - 2 * g * cosine, 1.5));
    }
    glm::dvec3 around(glm::dvec3 axis, double cosine, double turn) const {
        const glm::dvec3 other = std::abs(axis.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
        const glm::dvec3 u = glm::normalize(glm::cross(axis, other)), v = glm::cross(axis, u);
        const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
        return cosine * axis + sine * (std::cos(turn) * u + std::sin(turn) * v);
    }
    double luminance(glm::dvec3 from, glm::dvec3 along, std::mt19937_64& random) const {
        std::uniform_real_distribution<double> unit(0, 1);
        const double extinction = scatter + absorb;
        double weight = 1, sum = 0;
        for (int event = 0; event < 1000; ++event) {
            int axis = 0;
            const double end = wall(from, along, axis);
            const double free = -std::log(1 - unit(random)) / extinction;
            const bool in_air = free < end;
            from += std::min(free, end) * along;
            const glm::dvec3 to = lamp - from;
            const double square = glm::dot(to, to), distance = std::sqrt(square);
            const double arrives = candela / square * std::exp(-extinction * distance);
            if (in_air) {
                if (unit(random) >= scatter / extinction)
                    break;
                sum += weight * arrives * phase(glm::dot(to, along) / distance);
                const double u = unit(random);
                const double cosine =
                    g == 0 ? 2 * u - 1
                           : (1 + g * g - std::pow((1 - g * g) / (1 - g + 2 * g * u), 2)) / (2 * g);
                along = around(along, cosine, 2 * pi * unit(random));
            } else {
                glm::dvec3 normal(0);
                normal[axis] = along[axis] > 0 ? -1 : 1;
                from[axis] = along[axis] > 0 ? edge : 0;
                if (!ceiling || (axis == 1 && along.y > 0))
                    sum += weight * emission;
                if (unit(random) >= albedo)
                    break;
                sum += weight * arrives * std::max(0.0, glm::dot(to, normal) / distance) / pi;
                along = around(normal, std::sqrt(unit(random)), 2 * pi * unit(random));
            }
        }
        return sum;
    }
    double mean(glm::dvec3 at, int paths, uint64_t seed) const {
        std::mt19937_64 random(seed);
        std::uniform_real_distribution<double> unit(0, 1);
        double sum = 0;
        for (int i = 0; i < paths; ++i)
            sum += luminance(at, around({0, 1, 0}, 2 * unit(random) - 1, 2 * pi * unit(random)),
                             random);
        return sum / paths;
    }
};

TEST_F(BakedScattering, AFurnaceStaysOneWhereAirOnlyScatters) {
    const Scene scene = scenes::furnace(2, 0.5f, 0.5f); // luminance 1
    for (const double depth : {0.1, 1.0, 5.0})
        for (const double g : {0.0, 0.5}) {
            const Volume volume = run(scene, mist(depth / 2, 0, g), std::nullopt, 10);
            for (std::size_t cell = 0; cell < volume.grid.size(); ++cell) {
                const glm::vec3 seen = mean_at(volume, cell);
                EXPECT_NEAR(seen.x, 1, 0.005) << depth << " " << g << " " << detail_;
                for (std::size_t k = 1; k < 4; ++k)
                    EXPECT_NEAR(volume.sh[k][cell].y, 0, 0.035) << depth << " " << g;
            }
        }
}

TEST_F(BakedScattering, AirThatOnlyTakesLeavesWhatBeerAndLambertHave) {
    const Scene scene = scenes::furnace(2, 0.0f, 1.0f);
    medium::Medium air = mist(0, 0.5);
    air.absorb = {0.2, 0.8, 2.0};
    const Volume volume = run(scene, air, 1, 32);
    const CubeOfMist room{2, 0, 1, false, 0, 0, 0, {}, 0};
    for (const glm::ivec3 cell :
         {glm::ivec3(16, 16, 16), glm::ivec3(6, 24, 16), glm::ivec3(0, 16, 16)}) {
        const glm::dvec3 at = (glm::dvec3(cell) + 0.5) / 16.0;
        glm::dvec3 expected(0);
        const int n = 400;
        for (int i = 0; i < n; ++i)
            for (int k = 0; k < n; ++k) {
                int axis = 0;
                const double way = room.wall(
                    at, room.around({0, 1, 0}, 2 * (i + 0.5) / n - 1, 2 * pi * (k + 0.5) / n),
                    axis);
                expected += glm::exp(-air.absorb * way) / double(n * n);
            }
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(mean_at(volume, volume.grid.index(cell))[c], expected[c],
                        0.025 * expected[c])
                << cell.x << " " << c;
    }
}

TEST_F(BakedScattering, IsAsPathsFindIt) {
    struct Case {
        bool ceiling;
        double candela, scatter, absorb, g;
    };
    for (const Case& of : {Case{true, 0, 0.8, 0.2, 0}, Case{true, 0, 1.5, 0, 0.5},
                           Case{false, 3, 1, 0.1, 0}, Case{false, 3, 0.4, 0.1, 0.6}}) {
        const CubeOfMist room{2,         0.5,  of.ceiling ? 1.0 : 0, true,      of.scatter,
                              of.absorb, of.g, {1, 1.2, 1},          of.candela};
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.5f));
        scenes::add_box(scene, grey, glm::vec3(0), glm::vec3(2), scenes::Facing::inward);
        if (of.ceiling) { // a lit sheet just under it
            const int lit = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(1));
            scene.meshes[0].triangles.erase(scene.meshes[0].triangles.begin() + 6,
                                            scene.meshes[0].triangles.begin() + 8);
            scenes::add_quad(scene, lit, {0, 2, 0}, {2, 0, 0}, {0, 0, 2});
        } else {
            scene.lights.push_back(scenes::point_light(room.lamp, of.candela));
        }
        const Volume volume = run(scene, mist(of.scatter, of.absorb, of.g), std::nullopt, 16);
        double error = 0, sum = 0, worst = 0;
        for (uint32_t i = 0; i < 24; ++i) { // all over it
            const glm::ivec3 cell(1 + i * 5 % 14, 1 + i * 3 % 13, 1 + i * 11 % 15);
            const double expected = room.mean((glm::dvec3(cell) + 0.5) / 8.0, 100000, i);
            const double found = double(mean_at(volume, volume.grid.index(cell)).y);
            worst = std::max(worst, std::abs(found / expected - 1));
            error += std::abs(found - expected);
            sum += expected;
        }
        EXPECT_LT(worst, of.ceiling ? 0.06 : 0.15) << of.candela << " " << of.g << " " << detail_;
        EXPECT_LT(error, (of.ceiling ? 0.02 : 0.04) * sum)
            << of.candela << " " << of.g << " " << detail_;
    }
}

TEST_F(BakedScattering, CellsBesideTheAirAreFinite) {
    const Scene scene = scenes::cornell_box_with_point();
    for (const double scatter : {1e-9, 1e-4, 0.3}) {
        bake::BakePlan wide = plan(scene, mist(scatter, 0), 3, 24);
        bake::BakeSettings settings = wide.settings;
        settings.grid.margin = 1;
        const Baked baked = [&] {
            Progress silent;
            return bake::bake(scene,
                              bake::plan_bake(bake::survey(scene), settings, device().info()),
                              device(), silent);
        }();
        for (const std::vector<glm::vec3>& values : baked.volume.sh)
            for (const glm::vec3 value : values)
                ASSERT_TRUE(std::isfinite(value.x + value.y + value.z)) << scatter;
    }
}

TEST_F(BakedScattering, OrdersAddUpToWhatIsSaidToBeMissing) {
    Scene scene = scenes::furnace(2, 0.3f, 0.0f);
    scene.lights.push_back(scenes::point_light({0.7, 0.9, 1.2}, 10));
    const auto power = [](const Volume& volume) {
        double sum = 0;
        for (const glm::vec3 each : volume.sh[0])
            sum += double(each.y);
        return sum;
    };
    const double once = power(run(scene, mist(1.5, 0.1), 1, 8));
    const double twice = power(run(scene, mist(1.5, 0.1), 2, 8));
    const double thrice = power(run(scene, mist(1.5, 0.1), 3, 8));
    const double all = power(run(scene, mist(1.5, 0.1), 60, 8));
    const Volume told = run(scene, mist(1.5, 0.1), std::nullopt, 8);
    EXPECT_LT(once, twice);
    EXPECT_LT(thrice - twice, twice - once);
    EXPECT_LT(thrice, 0.95 * all);
    EXPECT_NEAR(power(told), all, 1e-3 * all) << detail_;
    EXPECT_EQ(told.metadata.at("scattering"), "inf");
}

TEST_F(BakedScattering, TheSameBitsForAnyNumberOfThreads) {
    Scene scene = scenes::cornell_box_with_point();
    const auto bits = [&](std::size_t threads) {
        const tbb::global_control few(tbb::global_control::max_allowed_parallelism, threads);
        return run(scene, mist(0.4, 0.1, 0.3), 3, 8).sh;
    };
    EXPECT_EQ(bits(1), bits(2));
}

TEST_F(BakedScattering, IsRefusedByName) {
    const Scene scene = scenes::furnace(2, 0.5f, 0.5f);
    const auto why = [&](const auto& make) -> std::string {
        try {
            make();
        } catch (const Error& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_NE(why([&] { plan(scene, mist(1, 0), std::nullopt, 8, "gather"); }).find("sn"),
              std::string::npos);
    EXPECT_NE(why([&] { plan(scene, mist(6, 0), std::nullopt); }).find("mean free paths"),
              std::string::npos);
    EXPECT_EQ(why([&] { plan(scene, mist(6, 0), 4); }), "");
}

} // namespace
} // namespace lpvbake
