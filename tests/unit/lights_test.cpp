#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "scene/lights.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

namespace lpvbake {
namespace {

constexpr double pi = 3.14159265358979323846;

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
        return load_lights(path_.string(), warnings_);
    }

    std::filesystem::path path_;
    std::vector<std::string> warnings_;
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

TEST_F(LightFile, GivesSpotsOfOneAngleAHardEdge) {
    for (const char* angles : {R"("innerConeAngle": 0.5, "outerConeAngle": 0.5)",
                               R"("innerConeAngle": 0.5236, "outerConeAngle": 0.52359)",
                               R"("innerConeAngle": 0.7853981633974484)"}) {
        warnings_.clear();
        const std::vector<Light> lights =
            load(std::string(R"({"lights": [{"type": "point"}, {"type": "spot", "spot": {)")
                 + angles + "}}]}");
        ASSERT_EQ(lights.size(), 2u);
        EXPECT_EQ(lights[1].inner_cone, lights[1].outer_cone);
        ASSERT_EQ(warnings_.size(), 1u) << angles;
        EXPECT_EQ(warnings_[0].find(path_.string() + ": lights[1].spot.innerConeAngle: "), 0u)
            << warnings_[0];
    }
    warnings_.clear();
    load(R"({"lights": [{"type": "spot", "spot": {"innerConeAngle": 0.5, "outerConeAngle": 0.51}},
                        {"type": "point", "spot": {"innerConeAngle": 2}}]})");
    EXPECT_TRUE(warnings_.empty());
}

TEST_F(LightFile, SaysIfItIsMissing) {
    const Error error = error_of([&] { load_lights(path_.string(), warnings_); });
    EXPECT_EQ(error.kind, ErrorKind::file);
}

} // namespace
} // namespace lpvbake
