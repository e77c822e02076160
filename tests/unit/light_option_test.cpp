#include "options/lights.h"

#include "lpvbake/error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace lpvbake {
namespace {

void expect_near(glm::dvec3 a, glm::dvec3 b, double tolerance = 1e-12) {
    EXPECT_LT(glm::distance(a, b), tolerance) << a.x << " " << a.y << " " << a.z;
}

/// The error that `f` ends in.
template <typename F>
Error error_of(F f) {
    try {
        f();
    } catch (const Error& error) {
        return error;
    }
    ADD_FAILURE() << "no error";
    return {ErrorKind::failure, "no error"};
}

TEST(ParseSky, IsAColourTimesNits) {
    EXPECT_EQ(cmd::options::parse_sky("1:0.5:0,200").luminance, glm::vec3(200, 100, 0));
    EXPECT_EQ(cmd::options::parse_sky("#ffffff,3").luminance, glm::vec3(3.0f));
    for (const char* wrong :
         {"", "200", "#fff,1", "1:1:1,-1", "1:1:1,nan", "1:1:1,2,3", "1e30:1:1,1e30", "1:1:1,"})
        EXPECT_THROW(cmd::options::parse_sky(wrong), Error) << wrong;
}

TEST(ParseSun, StandsWhereItSays) {
    expect_near(cmd::options::parse_sun("0,0,1").direction,
                {0, 0, -1}); // stands at +Z, shines to -Z
    expect_near(cmd::options::parse_sun("90,0,1").direction, {-1, 0, 0});
    expect_near(cmd::options::parse_sun("180,0,1").direction, {0, 0, 1});
    expect_near(cmd::options::parse_sun("-90,0,1").direction, {1, 0, 0});
    expect_near(cmd::options::parse_sun("123,90,1").direction, {0, -1, 0});
    const double c = std::sqrt(0.5);
    expect_near(cmd::options::parse_sun("90,45,1").direction, {-c, -c, 0});
    const Light sun = cmd::options::parse_sun("45,30,100000");
    EXPECT_EQ(sun.type, LightType::directional);
    EXPECT_EQ(sun.intensity, 100000.0);
    EXPECT_EQ(sun.color, glm::vec3(1.0f));
    EXPECT_NEAR(glm::length(sun.direction), 1.0, 1e-15);
}

TEST(ParsePoint, ReadsPositionAndCandela) {
    const Light light = cmd::options::parse_point("-1.5, 2e3,+0.25,120,1:0.5:0");
    EXPECT_EQ(light.type, LightType::point);
    EXPECT_EQ(light.position, glm::dvec3(-1.5, 2000, 0.25));
    EXPECT_EQ(light.intensity, 120.0);
    EXPECT_EQ(light.color, glm::vec3(1.0f, 0.5f, 0.0f));
    EXPECT_EQ(light.range, 0.0);
}

TEST(ParseColour, DecodesSrgb) {
    const glm::vec3 color = cmd::options::parse_point("0,0,0,1,#fF8000").color;
    EXPECT_FLOAT_EQ(color.r, 1.0f);
    EXPECT_NEAR(color.g, 0.21586, 1e-5); // 128 / 255 by the published table
    EXPECT_EQ(color.b, 0.0f);
}

TEST(ParseLights, RefusesWhatItCannotRead) {
    for (const char* text : {"",
                             "1,2",
                             "1,2,3,4,5",
                             "a,2,3",
                             "1,2,3x",
                             "1,,3",
                             "1,91,3",
                             "1,2,-3",
                             "nan,2,3",
                             "1,2,inf",
                             "1,2,1e999",
                             "1,2,3,red",
                             "1,2,3,#12345",
                             "1,2,3,#12345g",
                             "1,2,3,#1234567",
                             "1,2,3,1:2",
                             "1,2,3,1:2:-3",
                             "1,2,3,1:2:1e300",
                             "1,2,1e39",
                             "1,2,1e30,1e30:1:1",
                             "1,2,3,#-12345"}) {
        const Error error = error_of([&] { cmd::options::parse_sun(text); });
        EXPECT_EQ(error.kind, ErrorKind::argument) << text;
        EXPECT_NE(std::string(error.what()).find("AZIMUTH,ELEVATION,LUX[,COLOUR]"),
                  std::string::npos)
            << error.what();
    }
    for (const char* text : {"1,2,3", "1,2,3,-4", "1,2,3,4,5", "1,2,3,4,1:1:1,7"}) {
        const Error error = error_of([&] { cmd::options::parse_point(text); });
        EXPECT_EQ(error.kind, ErrorKind::argument) << text;
        EXPECT_NE(std::string(error.what()).find("X,Y,Z,CD[,COLOUR]"), std::string::npos);
    }
}

} // namespace
} // namespace lpvbake
