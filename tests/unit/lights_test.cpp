#include "error.h"
#include "scene/gltf/light_file.h"
#include "scene/lights.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

namespace lpvbake {
namespace {

constexpr double pi = 3.14159265358979323846;

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
    EXPECT_EQ(parse_sky("1:0.5:0,200").luminance, glm::vec3(200, 100, 0));
    EXPECT_EQ(parse_sky("#ffffff,3").luminance, glm::vec3(3.0f));
    for (const char* wrong :
         {"", "200", "#fff,1", "1:1:1,-1", "1:1:1,nan", "1:1:1,2,3", "1e30:1:1,1e30", "1:1:1,"})
        EXPECT_THROW(parse_sky(wrong), Error) << wrong;
}

TEST(ParseSun, StandsWhereItSays) {
    expect_near(parse_sun("0,0,1").direction, {0, 0, -1}); // stands at +Z, shines to -Z
    expect_near(parse_sun("90,0,1").direction, {-1, 0, 0});
    expect_near(parse_sun("180,0,1").direction, {0, 0, 1});
    expect_near(parse_sun("-90,0,1").direction, {1, 0, 0});
    expect_near(parse_sun("123,90,1").direction, {0, -1, 0});
    const double c = std::sqrt(0.5);
    expect_near(parse_sun("90,45,1").direction, {-c, -c, 0});
    const Light sun = parse_sun("45,30,100000");
    EXPECT_EQ(sun.type, LightType::directional);
    EXPECT_EQ(sun.intensity, 100000.0);
    EXPECT_EQ(sun.color, glm::vec3(1.0f));
    EXPECT_NEAR(glm::length(sun.direction), 1.0, 1e-15);
}

TEST(ParsePoint, ReadsPositionAndCandela) {
    const Light light = parse_point("-1.5, 2e3,+0.25,120,1:0.5:0");
    EXPECT_EQ(light.type, LightType::point);
    EXPECT_EQ(light.position, glm::dvec3(-1.5, 2000, 0.25));
    EXPECT_EQ(light.intensity, 120.0);
    EXPECT_EQ(light.color, glm::vec3(1.0f, 0.5f, 0.0f));
    EXPECT_EQ(light.range, 0.0);
}

TEST(ParseColour, DecodesSrgb) {
    const glm::vec3 color = parse_point("0,0,0,1,#fF8000").color;
    EXPECT_FLOAT_EQ(color.r, 1.0f);
    EXPECT_NEAR(color.g, 0.21586, 1e-5); // 128 / 255 by the published table
    EXPECT_EQ(color.b, 0.0f);
}

TEST(ParseLights, RefusesWhatItCannotRead) {
    for (const char* text :
         {"", "1,2", "1,2,3,4,5", "a,2,3", "1,2,3x", "1,,3", "1,91,3", "1,2,-3", "nan,2,3",
          "1,2,inf", "1,2,1e999", "1,2,3,red", "1,2,3,#12345", "1,2,3,#12345g", "1,2,3,#1234567",
          "1,2,3,1:2", "1,2,3,1:2:-3", "1,2,3,1:2:1e300", "1,2,3,#-12345"}) {
        const Error error = error_of([&] { parse_sun(text); });
        EXPECT_EQ(error.kind, ErrorKind::argument) << text;
        EXPECT_NE(std::string(error.what()).find("AZIMUTH,ELEVATION,LUX[,COLOUR]"),
                  std::string::npos)
            << error.what();
    }
    for (const char* text : {"1,2,3", "1,2,3,-4", "1,2,3,4,5", "1,2,3,4,1:1:1,7"}) {
        const Error error = error_of([&] { parse_point(text); });
        EXPECT_EQ(error.kind, ErrorKind::argument) << text;
        EXPECT_NE(std::string(error.what()).find("X,Y,Z,CD[,COLOUR]"), std::string::npos);
    }
}

class LightFile : public testing::Test {
protected:
    void SetUp() override {
        const auto* test = testing::UnitTest::GetInstance()->current_test_info();
        path_ = std::filesystem::path(testing::TempDir())
                / (std::string("lpvbake_lights_") + test->name() + ".json");
    }
    void TearDown() override { std::filesystem::remove(path_); }

    std::vector<Light> load(const std::string& text) {
        std::ofstream(path_) << text;
        return load_lights(path_.string());
    }

    std::filesystem::path path_;
};

TEST_F(LightFile, ReadsEveryTerm) {
    const std::vector<Light> lights = load(R"({"lights": [
        {"type": "directional", "direction": [0, -2, 0], "intensity": 5e4, "name": "sun"},
        {"type": "point", "position": [1, 2, 3], "color": [1, 0.5, 0.25], "range": 7},
        {"type": "spot", "position": [0, 3, 0], "direction": [0, 0, 1],
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
        {"type": "spot"}]})");
    ASSERT_EQ(lights.size(), 4u);
    EXPECT_EQ(lights[0].name, "sun");
    EXPECT_EQ(lights[0].direction, glm::dvec3(0, -1, 0));
    EXPECT_EQ(lights[0].intensity, 5e4);
    EXPECT_EQ(lights[1].type, LightType::point);
    EXPECT_EQ(lights[1].position, glm::dvec3(1, 2, 3));
    EXPECT_EQ(lights[1].color, glm::vec3(1, 0.5f, 0.25f));
    EXPECT_EQ(lights[1].range, 7.0);
    EXPECT_EQ(lights[1].intensity, 1.0);
    EXPECT_EQ(lights[2].inner_cone, 0.1);
    EXPECT_EQ(lights[2].outer_cone, 0.5);
    EXPECT_EQ(lights[3].direction, glm::dvec3(0, 0, -1)); // the extension's defaults
    EXPECT_NEAR(lights[3].outer_cone, pi / 4, 1e-12);
}

TEST_F(LightFile, NamesThePlaceOfAMistake) {
    const auto expect = [&](const std::string& text, const std::string& part) {
        const Error error = error_of([&] { load(text); });
        EXPECT_EQ(error.kind, ErrorKind::invalid) << text;
        EXPECT_NE(std::string(error.what()).find(path_.string()), std::string::npos);
        EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    };
    const auto light = [](const std::string& text) {
        return R"({"lights": [{"type": "point"}, {)" + text + "}]}";
    };
    expect("", "not JSON");
    expect("[]", "must be an object");
    expect("{}", "lacks \"lights\"");
    expect(R"({"lights": 3})", "lights: must be an array");
    expect(light(R"("intensity": 3)"), "lights[1]: lacks \"type\"");
    expect(light(R"("type": "area")"), "lights[1].type");
    expect(light(R"("type": "point", "lux": 3)"), "unknown property \"lux\"");
    expect(light(R"("type": "point", "intensity": "3")"), "lights[1].intensity");
    expect(light(R"("type": "point", "intensity": -3)"), "lights[1].intensity");
    expect(light(R"("type": "point", "color": [1, 2])"), "lights[1].color");
    expect(light(R"("type": "point", "color": [1, 2, "3"])"), "lights[1].color[2]");
    expect(light(R"("type": "point", "color": [1, 2, -3])"), "lights[1].color");
    expect(light(R"("type": "point", "range": 0)"), "lights[1].range");
    expect(light(R"("type": "directional", "direction": [0, 0, 0])"), "lights[1].direction");
    expect(light(R"("type": "spot", "spot": {"innerConeAngle": 1})"), "innerConeAngle");
    expect(light(R"("type": "spot", "spot": {"outerConeAngle": 2})"), "outerConeAngle");
}

TEST_F(LightFile, SaysIfItIsMissing) {
    const Error error = error_of([&] { load_lights(path_.string()); });
    EXPECT_EQ(error.kind, ErrorKind::file);
}

} // namespace
} // namespace lpvbake
