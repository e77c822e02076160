// Where the sun stands over a day, and what suns of a day weigh.
#include "lpvbake/error.h"
#include "scene/sun_arc.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace lpvbake {
namespace {

using scene::SunArc;

constexpr double degree = glm::pi<double>() / 180.0;

double elevation(const SunArc& arc, double hour) {
    return std::asin(scene::towards_sun(arc, hour).y) / degree;
}

TEST(SunArc, IsWhereTheAlmanacHasIt) {
    // The example of Reda and Andreas 2004 (Solar position algorithm), 12:30:30 at UTC - 7: zenith
    // 50.11 degrees, azimuth 194.34 from north over east.
    const SunArc golden{39.742476, -105.1786, 10, 17};
    const glm::dvec3 towards = scene::towards_sun(golden, 12.0 + 30.5 / 60);
    EXPECT_NEAR(std::acos(towards.y) / degree, 50.11, 0.25);
    EXPECT_NEAR(std::atan2(towards.x, -towards.z) / degree + 360, 194.34, 0.25);
    EXPECT_NEAR(glm::length(towards), 1.0, 1e-12);
    // At noon of the solstices it is 23.44 degrees off the equator.
    for (const auto& [month, tilt] : {std::pair{6, 23.44}, {12, -23.44}}) {
        const SunArc arc{48.0, 0.0, month, 21};
        double highest = 0;
        for (double hour = 11; hour < 13; hour += 0.01)
            highest = std::max(highest, elevation(arc, hour));
        EXPECT_NEAR(highest, 90 - 48.0 + tilt, 0.1);
    }
    // It rises in the east, stands in the south and sets in the west; south of the equator north.
    const SunArc equinox{50.0, 15.0, 3, 20};
    EXPECT_GT(scene::towards_sun(equinox, 7).x, 0.9);
    EXPECT_GT(scene::towards_sun(equinox, 12).z, 0.5);
    EXPECT_LT(scene::towards_sun(equinox, 17).x, -0.9);
    EXPECT_LT(scene::towards_sun({-50.0, 15.0, 3, 20}, 12).z, -0.5);
}

TEST(SunArc, DaylightEndsAtTheHorizon) {
    const SunArc equinox{50.0, 15.0, 3, 20};
    const auto [rise, set] = scene::daylight(equinox);
    EXPECT_NEAR(set - rise, 12.0, 0.1);
    EXPECT_NEAR(elevation(equinox, rise), 0.0, 1e-6);
    EXPECT_NEAR(elevation(equinox, set), 0.0, 1e-6);
    const auto [begin, end] = scene::daylight({70.0, 20.0, 6, 21});
    EXPECT_EQ(begin, 0.0);
    EXPECT_EQ(end, 24.0);
    EXPECT_THROW(scene::daylight({70.0, 20.0, 12, 21}), Error);
    EXPECT_THROW(scene::parse_arc("x", 91, 0, "06-21"), Error);
    EXPECT_THROW(scene::parse_arc("x", 0, 0, "02-30"), Error);
    EXPECT_THROW(scene::parse_arc("x", 0, 0, "6-21"), Error);
    EXPECT_EQ(scene::clock_text(4.0 + 5.2 / 60), "04:05");
}

TEST(SunArc, IlluminanceIsThatOfAClearSky) {
    EXPECT_NEAR(scene::sun_illuminance(1.0), 127.5e3 * std::exp(-0.21), 1.0);
    EXPECT_NEAR(scene::sun_illuminance(0.5), 127.5e3 * std::exp(-0.42), 1.0);
    EXPECT_EQ(scene::sun_illuminance(0.0), 0.0);
    EXPECT_EQ(scene::sun_illuminance(-0.5), 0.0);
}

TEST(SunArc, WeightsMakeTheSunOfATime) {
    const SunArc arc{48.1, 11.6, 6, 21};
    const std::vector<double> hours = scene::key_hours(arc, 12);
    const auto lux_at = [&](double hour) {
        return scene::sun_illuminance(scene::towards_sun(arc, hour).y);
    };
    // Each of the twelve has a twelfth of its own illuminance.
    const auto sum_at = [&](double hour) {
        const std::vector<double> weights = scene::key_weights(arc, hours, hour);
        double sum = 0;
        for (std::size_t i = 0; i < hours.size(); ++i)
            sum += weights[i] * lux_at(hours[i]) / 12;
        return sum;
    };
    for (const double hour : {5.0, 7.77, 12.0, 16.2, 19.9})
        EXPECT_NEAR(sum_at(hour), lux_at(hour), 1e-9 * lux_at(hour)) << hour;
    EXPECT_EQ(sum_at(2.0), 0.0);
    EXPECT_EQ(sum_at(23.0), 0.0);
    const std::vector<double> at_key = scene::key_weights(arc, hours, hours[4]);
    for (std::size_t i = 0; i < hours.size(); ++i)
        EXPECT_NEAR(at_key[i], i == 4 ? 12.0 : 0.0, 1e-9);
    const std::vector<double> between = scene::key_weights(arc, hours, 0.5 * (hours[4] + hours[5]));
    EXPECT_NEAR(between[4] * lux_at(hours[4]), between[5] * lux_at(hours[5]), 1e-6);
    EXPECT_GT(between[4], 0.0);

    // Where it does not set, the last and the first are beside each other.
    const SunArc north{85.0, 0.0, 6, 21};
    const std::vector<double> round = scene::key_hours(north, 6);
    for (const double hour : {0.0, 24.0}) {
        const std::vector<double> midnight = scene::key_weights(north, round, hour);
        for (const std::size_t i : {std::size_t(0), std::size_t(5)}) {
            const double own = scene::sun_illuminance(scene::towards_sun(north, round[i]).y);
            const double then = scene::sun_illuminance(scene::towards_sun(north, hour).y);
            EXPECT_NEAR(midnight[i] * own, 3.0 * then, 1e-9 * then);
        }
        EXPECT_EQ(midnight[1], 0.0);
    }
}

} // namespace
} // namespace lpvbake
