// The shared library as a program sees it: its headers, and the symbols that they mark.
#include "lpvbake/bake.h"
#include "lpvbake/error.h"
#include "lpvbake/file.h"
#include "lpvbake/pack.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

namespace {

using namespace lpvbake;

/// A floor of 2 m x 2 m in y = 0, white up to max_albedo, with a light of 100 cd 1 m above its
/// middle.
Scene floor_with_light() {
    Scene scene;
    scene.path = "floor";
    Material white;
    white.base_color = glm::vec4(1.0f);
    scene.materials.push_back(white);
    Mesh floor;
    floor.positions = {{-1, 0, -1}, {-1, 0, 1}, {1, 0, 1}, {1, 0, -1}};
    floor.triangles = {{0, 1, 2}, {0, 2, 3}};
    scene.meshes.push_back(floor);
    scene.instances.emplace_back();
    Light light;
    light.type = LightType::point;
    light.intensity = 100;
    light.position = {0, 1, 0};
    scene.lights.push_back(light);
    return scene;
}

BakeRequest coarse() {
    BakeRequest request;
    request.resolution = 8;
    request.bounds = Bounds{{-1, 0, -1}, {1, 1, 1}};
    return request;
}

class Api : public testing::Test {
protected:
    static const gpu::Device* device() {
        static const auto device = []() -> std::unique_ptr<gpu::Device> {
            try {
                return std::make_unique<gpu::Device>(gpu::DeviceOptions{});
            } catch (const Error& error) {
                if (error.kind != ErrorKind::device)
                    throw;
                return nullptr;
            }
        }();
        return device.get();
    }
    void SetUp() override {
        if (!device())
            GTEST_SKIP() << "no Vulkan device";
    }

    template <class F>
    static void expect_error(ErrorKind kind, const std::string& part, F&& f) {
        try {
            f();
            ADD_FAILURE() << "no error; expected one with '" << part << "'";
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, kind) << error.what();
            EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
        }
    }
};

TEST_F(Api, BakesASceneOfItsOwn) {
    const Scene scene = floor_with_light();
    EXPECT_EQ(bounds_of(scene).hi, glm::dvec3(1, 0, 1));
    const BakeForecast expected = forecast(scene, coarse(), device()->info());
    const Baked baked = bake_volume(scene, coarse(), *device());
    const Volume& volume = baked.volume;
    EXPECT_EQ(volume.grid, expected.grid);
    EXPECT_EQ(volume.metadata.at("choice"), expected.choice);
    EXPECT_GT(expected.seconds, 0);
    EXPECT_FALSE(baked.stages.empty());
    // What the middle of a small ceiling at half a metre gets from the floor: each dA of it has
    // E = 100 h / r^3 lux of the light (h = 1), and sends 0.95 E / pi cos cos / s^2 to the ceiling.
    double lux = 0;
    const double step = 0.01, height = 0.5;
    for (double x = -1 + step / 2; x < 1; x += step)
        for (double z = -1 + step / 2; z < 1; z += step) {
            const double r2 = x * x + z * z;
            const double arriving = 100 / std::pow(r2 + 1, 1.5);
            const double s2 = r2 + height * height;
            lux += 0.95 * arriving / M_PI * height * height / (s2 * s2) * step * step;
        }
    const glm::dvec3 read = read_irradiance(volume, {0, height, 0}, {0, -1, 0}, Reading::trilinear);
    EXPECT_NEAR(read.g, lux, 0.15 * lux);
    EXPECT_EQ(read_irradiance(volume, {0, height, 0}, {0, 1, 0}, Reading::trilinear).g < 0.1 * lux,
              true);
}

TEST_F(Api, FilesGiveBackWhatWasWritten) {
    const std::filesystem::path folder =
        std::filesystem::temp_directory_path() / ("lpvbake-api-" + std::to_string(getpid()));
    std::filesystem::create_directory(folder);
    const Volume volume = bake_volume(floor_with_light(), coarse(), *device()).volume;
    const WriteReport report = write_volume(folder / "a.vdb", volume);
    ASSERT_EQ(report.files.size(), 1u);
    EXPECT_EQ(report.files[0].bytes, std::filesystem::file_size(folder / "a.vdb"));
    EXPECT_EQ(read_volume(folder / "a.vdb").sh, volume.sh);
    EXPECT_EQ(write_volume(folder / "b.exr", volume, "unity").precision, Precision::half);
    EXPECT_EQ(read_volume(folder / "b.json").grid, volume.grid);
    EXPECT_EQ(write_volume(folder / "c.exr", volume, "unity", Precision::full).precision,
              Precision::full);
    // A scene's file gets the volume.
    std::ofstream(folder / "scene.gltf")
        << R"({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"name": "n"}]})";
    const PackedScene scene = pack_gltf(folder / "scene.gltf");
    write_volume(folder / "lit.glb", volume, "generic", std::nullopt, &scene);
    EXPECT_EQ(read_volume(folder / "lit.glb").sh, volume.sh);
    EXPECT_NE(pack_gltf(folder / "lit.glb").json.find("\"name\":\"n\""), std::string::npos);
    expect_error(ErrorKind::argument, "none of generic, ",
                 [&] { write_volume(folder / "c.vdb", volume, "quake"); });
    expect_error(ErrorKind::argument, ".vdb", [&] { read_volume(folder / "c.txt"); });
    expect_error(ErrorKind::file, "none.vdb", [&] { read_volume(folder / "none.vdb"); });
    std::filesystem::remove_all(folder);
}

TEST_F(Api, RequestsThatContradictThemselvesAreRefused) {
    const auto refuses = [](const std::string& part, const auto& change) {
        BakeRequest request = coarse();
        change(request);
        expect_error(ErrorKind::argument, part,
                     [&] { forecast(floor_with_light(), request, device()->info()); });
    };
    refuses("`solver` radiosity: not of sn,", [](BakeRequest& r) { r.solver = "radiosity"; });
    refuses("directions: not of lpv", [](BakeRequest& r) {
        r.solver = "lpv";
        r.parameters["directions"] = "144";
    });
    refuses("directions: 'many' is none of its values, whole numbers from",
            [](BakeRequest& r) { r.parameters["directions"] = "many"; });
    refuses("`sh_order` 3: not of lpv", [](BakeRequest& r) {
        r.solver = "lpv";
        r.sh_order = 3;
    });
    refuses("`error`", [](BakeRequest& r) { r.error = NAN; });
    refuses("`time_budget`", [](BakeRequest& r) { r.time_budget = 0; });
    refuses("`bounces`", [](BakeRequest& r) { r.bounces = -1; });
    refuses("`resolution`", [](BakeRequest& r) { r.resolution = 2; });
    refuses("`fit` quake", [](BakeRequest& r) { r.fit = "quake"; });
    refuses("rsm-size: not of gather", [](BakeRequest& r) {
        r.solver = "gather";
        r.parameters["rsm-size"] = "64";
    });
}

TEST_F(Api, ParametersChooseTheSolverThatHasThem) {
    const auto choice = [](const std::map<std::string, std::string>& parameters) {
        BakeRequest request = coarse();
        request.parameters = parameters;
        const std::string text = forecast(floor_with_light(), request, device()->info()).choice;
        return text.substr(0, text.find(','));
    };
    EXPECT_EQ(choice({}), "sn");
    EXPECT_EQ(choice({{"occlusion", "none"}}), "lpv");
    EXPECT_EQ(choice({{"rsm-size", "64"}}), "lpv");
    EXPECT_EQ(choice({{"rsm-size", "64"}, {"rsm-samples", "16"}}), "gather");
}

TEST_F(Api, ScenesThatLeadNowhereAreRefused) {
    const auto refuses = [](const std::string& part, const auto& change,
                            ErrorKind kind = ErrorKind::argument) {
        Scene scene = floor_with_light();
        change(scene);
        expect_error(kind, part, [&] { bake_volume(scene, coarse(), *device()); });
    };
    constexpr float nan = std::numeric_limits<float>::quiet_NaN();
    refuses("meshes[0].triangles", [](Scene& s) { s.meshes[0].triangles[1].y = 4; });
    refuses("meshes[0].material: index 1", [](Scene& s) { s.meshes[0].material = 1; });
    refuses("meshes[0]: has an attribute", [](Scene& s) { s.meshes[0].uv.resize(3); });
    refuses("meshes[0].positions", [](Scene& s) { s.meshes[0].positions[2].x = nan; });
    refuses("instances[0].mesh: index -1", [](Scene& s) { s.instances[0].mesh = -1; });
    refuses("instances[0].to_world", [](Scene& s) { s.instances[0].to_world[3][1] = nan; });
    refuses("materials[0].emission_texture: index 0",
            [](Scene& s) { s.materials[0].emission_texture = 0; });
    refuses("textures[0].image: index -1", [](Scene& s) { s.textures.emplace_back(); });
    refuses("images[0].rgba", [](Scene& s) { s.images.push_back({"x", 2, 2, {1, 2, 3, 4}}); });
    refuses("sky.luminance", [](Scene& s) { s.sky.luminance.r = -1; });
    refuses("rules.max_albedo", [](Scene& s) { s.rules.max_albedo = 2; });
    refuses(
        "lights[0].intensity", [](Scene& s) { s.lights[0].intensity = -1; }, ErrorKind::invalid);
    refuses(
        "add `lights`", [](Scene& s) { s.lights.clear(); }, ErrorKind::invalid);
    refuses(
        "no triangles", [](Scene& s) { s.instances.clear(); }, ErrorKind::invalid);
}

TEST_F(Api, ProgressEndsABake) {
    struct : Progress {
        void begin(std::string_view stage, uint64_t) override {
            if (stage == "walls")
                throw Error(ErrorKind::interrupted, "enough");
        }
    } impatient;
    expect_error(ErrorKind::interrupted, "enough",
                 [&] { bake_volume(floor_with_light(), coarse(), *device(), impatient); });
}

} // namespace
