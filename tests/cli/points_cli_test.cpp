// `lpvbake bake --at` from outside.
#include "cli/run.h"
#include "io/io.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <cmath>
#include <cstring>
#include <fstream>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

class PointsCli : public ::testing::Test {
protected:
    void write(const std::string& name, const std::string& text) {
        std::ofstream(folder_ / name, std::ios::binary) << text;
    }
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "bake \"$ROOM\" " + arguments);
    }
    json light_at(const json& points, const std::string& arguments = "") {
        write("in.json", points.dump());
        const CliResult result = run("--at in.json -o out.json " + arguments);
        EXPECT_EQ(result.status, 0) << result.err;
        return json::parse(slurp(folder_ / "out.json"));
    }
    void refuse(const std::string& text, ExitCode code, const std::string& why) {
        write("in.json", text);
        expect_one_error(run("--at in.json -o out.json"), text.substr(0, 80), code, why);
        EXPECT_FALSE(std::filesystem::exists(folder_ / "out.json"));
    }

    TemporaryFolder folder_;
};

/// What another program may rely on: the centres of cells have the light that a volume has there.
TEST_F(PointsCli, CentresOfCellsHaveTheLightOfTheGrid) {
    const std::string same = " --cell-size 0.2 --sky '#ffffff,10' ";
    ASSERT_EQ(run("-o v.vdb --solver gather --tolerance 0" + same).status, 0);
    const Volume grid = read_volume(folder_ / "v.vdb");
    json points = json::array();
    for (std::size_t cell = grid.grid.size(); cell-- > 0;) { // in another order
        const glm::dvec3 at = grid.grid.center(grid.grid.cell_at(cell));
        points.push_back({at.x, at.y, at.z});
    }
    const json lit = light_at({{"points", points}}, same);
    EXPECT_EQ(lit["format"], "lpvbake points");
    EXPECT_EQ(lit["sh_order"], 2);
    EXPECT_EQ(lit["metadata"]["scene_hash"], grid.metadata.at("scene_hash"));
    ASSERT_EQ(lit["points"].size(), grid.grid.size());
    double wrong = 0, sum = 0;
    for (std::size_t cell = 0; cell < grid.grid.size(); ++cell) {
        const json& point = lit["points"][grid.grid.size() - 1 - cell];
        EXPECT_EQ(float(point["validity"]), grid.validity[cell]) << cell;
        for (std::size_t k = 0; k < 9; ++k)
            for (int channel = 0; channel < 3; ++channel) {
                const double own = point["sh"][k][std::size_t(channel)];
                wrong += std::abs(own - double(grid.sh[k][cell][channel]));
                sum += std::abs(double(grid.sh[k][cell][channel]));
            }
    }
    EXPECT_GT(sum, 0.0);
    EXPECT_LT(wrong / sum, 0.005);
}

TEST_F(PointsCli, TellsOfSolidsBacksSkyAndNormals) {
    // In the air, in the short box, far above the open front, on the floor, and 2 km away.
    const json lit = light_at(
        {{"points", {{0, 1.5, 0.5}, {0.35, 0.3, 0.35}, {0, 1, 30}, {-0.8, 0, 0.8}, {0, 2000, 0}}},
         {"normals", {{0, 3, 0}, {1, 0, 0}, {0, 0, -1}, {0, 1e-30, 0}, {0, 1, 0}}}},
        "--sky '#ffffff,10'");
    const json& points = lit["points"];
    ASSERT_EQ(points.size(), 5u);
    EXPECT_EQ(points[0]["validity"], 1);
    EXPECT_EQ(points[0]["normal"], json({0.0, 1.0, 0.0}));
    EXPECT_GT(double(points[0]["irradiance"][1]), 0.0);
    EXPECT_EQ(points[1]["validity"], 0);
    EXPECT_GT(double(points[1]["backs"]), 0.8); // all but the floor under it
    EXPECT_EQ(double(points[4]["backs"]), 0.0);
    for (const json& coefficient : points[1]["sh"])
        EXPECT_EQ(coefficient, json({0.0, 0.0, 0.0}));
    EXPECT_EQ(points[3]["validity"], 1);
    EXPECT_GT(double(points[3]["irradiance"][1]), 0.0);
    const double whole = std::sqrt(4.0 * std::acos(-1.0));
    EXPECT_NEAR(double(points[4]["sky"][0]), whole, 1e-5);
    EXPECT_NEAR(double(points[4]["sky"][1]), 0.0, 1e-5);
    EXPECT_LT(double(points[0]["sky"][0]), 0.5 * whole);
    // The same as the coefficients say.
    for (int channel = 0; channel < 3; ++channel) {
        std::array<float, 9> c{};
        for (std::size_t k = 0; k < 9; ++k)
            c[k] = points[3]["sh"][k][std::size_t(channel)];
        EXPECT_FLOAT_EQ(float(points[3]["irradiance"][std::size_t(channel)]),
                        volume::sh_irradiance(c, {0, 1, 0}));
    }
}

TEST_F(PointsCli, IsTheSameForAnyThreadsAndTellsBefore) {
    json points = json::array();
    for (int i = 0; i < 500; ++i)
        points.push_back({std::sin(i * 1.7), 1 + std::sin(i * 2.3), std::sin(i * 3.1)});
    light_at({{"points", points}}, "--threads 1");
    const std::string one = slurp(folder_ / "out.json");
    light_at({{"points", points}}, "--threads 3");
    EXPECT_EQ(slurp(folder_ / "out.json"), one);
    const CliResult dry = run("--at in.json -o out.json --dry-run --format json");
    ASSERT_EQ(dry.status, 0) << dry.err;
    const json plan = json::parse(dry.out);
    EXPECT_EQ(plan["points"], 500);
    EXPECT_EQ(plan["choice"]["solver"], "gather");
    EXPECT_GT(double(plan["host_bytes"]), 0.0);
    EXPECT_GT(double(plan["seconds"]), 0.0);
    EXPECT_EQ(plan["outputs"][0]["files"][0]["path"], "out.json");
}

TEST_F(PointsCli, RefusesBadPointsByTheirPlace) {
    const auto invalid = [&](const std::string& text, const std::string& why) {
        refuse(text, ExitCode::invalid, why);
    };
    invalid("", "in.json: not JSON");
    invalid("[]", "in.json: must be an object with \"points\"");
    invalid("{}", "lacks \"points\"");
    invalid(R"({"points": []})", "has no point");
    invalid(R"({"points": 5})", "points: must be an array");
    invalid(R"({"points": [1, 2, 3]})", "points[0]: must be an array of 3 numbers");
    invalid(R"({"points": [[1, 2, 3], [1, 2]]})", "points[1]: must be an array of 3 numbers");
    invalid(R"({"points": [[1, 2, 3, 4]]})", "points[0]: must be an array of 3 numbers");
    invalid(R"({"points": [[1, 2, null]]})", "points[0]: must be an array of 3 numbers, has null");
    invalid(R"({"points": [[1, 2, [3]]]})", "points[0]: must be an array of 3 numbers");
    invalid(R"({"points": [[1, 2, NaN]]})", "not JSON of finite numbers");
    invalid(R"({"points": [[1, 2, 1e999]]})", "not JSON of finite numbers");
    invalid(R"({"points": [[1, 2, 3]], "points": [[1, 2, 3]]})", "has \"points\" twice");
    invalid(R"({"points": [[1, 2, 3]], "p": 3})", "has an unknown property \"p\"");
    invalid(R"({"points": [[1, 2, 3]], "normals": [[1, 0, 0], [1, 0, 0]]})",
            "has 1 point and 2 normals");
    invalid(R"({"points": [[1, 2, 3]], "normals": [[0, 0, 0]]})", "normals[0]: has no direction");
    invalid(R"({"points": [[0, 1, 0], [0, 1e300, 0]]})", "points[1], 0,1e+300,0, is more than");
    expect_one_error(run("--at none.json -o out.json"), "none", ExitCode::file, "none.json");
    expect_one_error(run("--at in.txt -o out.json"), "txt", ExitCode::usage, "use .json");
}

TEST_F(PointsCli, RefusesWhatPointsDoNotHave) {
    write("in.json", R"({"points": [[0, 1, 0]]})");
    for (const char* option :
         {"--resolution 8", "--bounds -1,0,-1,1,2,1", "--margin 2", "--dilate 1", "--target unity",
          "--fit none", "--verify", "--tolerance 0.1", "--packing band", "--precision half"})
        expect_one_error(run(std::string("--at in.json -o out.json ") + option), option,
                         ExitCode::usage, "exclude each other");
    expect_one_error(run("--at in.json -o out.json --solver sn"), "sn", ExitCode::usage,
                     "--at is an option of gather, not of sn");
    expect_one_error(run("--at in.json -o out.vdb"), "vdb", ExitCode::usage,
                     "out.vdb: the name of an output of --at ends in .json");
    expect_one_error(run("--at in.json -o in.json"), "in", ExitCode::usage,
                     "would replace the input");
}

/// An NPY file of an array.
std::string npy(const std::string& type, const std::string& shape, const std::string& bytes,
                const std::string& order = "False") {
    std::string header =
        "{'descr': '" + type + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }\n";
    return std::string("\x93NUMPY\x01\0", 8) + char(header.size()) + char(0) + header + bytes;
}

template <class T>
std::string bytes_of(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

TEST_F(PointsCli, OtherFormsHoldTheSame) {
    const json points = light_at({{"points", {{0, 1.5, 0.5}, {-0.5, 0.25, 0}}},
                                  {"normals", {{0, 1, 0}, {1, 0, 0}}}})["points"];
    write("in.csv", "x,y,z,nx,ny,nz\r\n0,1.5, 0.5,0,1,0\r\n-.5,2.5e-1,0,1,0,0\n");
    const std::vector<double> doubles{0, 1.5, 0.5, 0, 1, 0, -0.5, 0.25, 0, 1, 0, 0};
    write("in.npy", npy("<f8", "(2, 6)", bytes_of(doubles)));
    write("f.npy",
          npy("<f4", "(2, 6)", bytes_of(std::vector<float>(doubles.begin(), doubles.end()))));
    for (const char* file : {"in.csv", "in.npy", "f.npy"}) {
        ASSERT_EQ(run(std::string("--at ") + file + " -o out.json -o out.npy").status, 0) << file;
        EXPECT_EQ(json::parse(slurp(folder_ / "out.json"))["points"], points) << file;
    }
    const std::string out = slurp(folder_ / "out.npy");
    const std::size_t head =
        10 + static_cast<unsigned char>(out[8]) + 256u * static_cast<unsigned char>(out[9]);
    EXPECT_EQ(head % 64, 0u);
    const std::size_t record = 24 + 12 + 12 + 9 * 12 + 4 + 4 + 16;
    ASSERT_EQ(out.size(), head + 2 * record);
    float z; // of the second point's last coefficient, blue
    std::memcpy(&z, &out[head + record + 48 + 8 * 12 + 8], sizeof z);
    EXPECT_EQ(z, float(points[1]["sh"][8][2]));
}

/// What a picture's channels hold of a point, as its JSON has it.
std::map<std::string, float> channels_of(const json& point) {
    std::map<std::string, float> channels{{"validity", point["validity"]},
                                          {"backs", point["backs"]}};
    for (std::size_t k = 0; k < 4; ++k)
        channels["sky." + std::to_string(k)] = point["sky"][k];
    for (std::size_t c = 0; c < 3; ++c) {
        const std::string colour(1, "RGB"[c]);
        channels[colour] = point["irradiance"][c];
        std::size_t k = 0;
        for (const char* name :
             {"l0", "l1_y", "l1_z", "l1_x", "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2"})
            channels[std::string("sh_") + name + '.' + colour] = point["sh"][k++][c];
    }
    return channels;
}

/// Two by three texels of a lightmap, on the floor, become a picture of as many; a list a column.
TEST_F(PointsCli, TexelsOfALightmapKeepTheirPlace) {
    std::vector<double> texels;
    json points = json::array(), normals = json::array();
    for (int v = 0; v < 2; ++v)
        for (int u = 0; u < 3; ++u) {
            texels.insert(texels.end(), {-0.6 + 0.6 * u, 0, 0.75 + 0.2 * v, 0, 1, 0});
            points.push_back({-0.6 + 0.6 * u, 0.0, 0.75 + 0.2 * v});
            normals.push_back({0, 1, 0});
        }
    const std::string sky = " --sky '#ffffff,10'";
    const json lit = light_at({{"points", points}, {"normals", normals}}, sky)["points"];
    write("in.npy", npy("<f8", "(2, 3, 6)", bytes_of(texels)));
    CliResult result = run("--at in.npy -o out.exr -o out.npy -o again.json" + sky);
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(json::parse(slurp(folder_ / "again.json"))["points"], lit);
    EXPECT_NE(slurp(folder_ / "out.npy").find("'shape': (2, 3), }"), std::string::npos);
    const auto expect_picture = [&](const std::string& name, int width, int height) {
        Imf::InputFile file((folder_ / name).c_str());
        const Imath::Box2i window = file.header().dataWindow();
        ASSERT_EQ(window.max - window.min, Imath::V2i(width - 1, height - 1));
        std::vector<std::map<std::string, float>> found(6);
        for (auto c = file.header().channels().begin(); c != file.header().channels().end(); ++c) {
            std::vector<float> samples(6, NAN);
            Imf::FrameBuffer buffer;
            buffer.insert(c.name(), Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(samples.data()),
                                               sizeof(float), sizeof(float) * std::size_t(width)));
            file.setFrameBuffer(buffer);
            file.readPixels(0, height - 1);
            for (std::size_t i = 0; i < 6; ++i)
                found[i][c.name()] = samples[i];
        }
        for (std::size_t i = 0; i < 6; ++i)
            EXPECT_EQ(found[i], channels_of(lit[i])) << i;
        const auto* order = file.header().findTypedAttribute<Imf::StringAttribute>("lpv:sh_order");
        ASSERT_TRUE(order);
        EXPECT_EQ(order->value(), "2");
    };
    expect_picture("out.exr", 3, 2);
    EXPECT_NE(lit[0]["irradiance"], lit[1]["irradiance"]); // else texels could be anywhere
    EXPECT_NE(lit[0]["irradiance"], lit[3]["irradiance"]);
    result = run("--at in.json -o out.exr" + sky);
    ASSERT_EQ(result.status, 0) << result.err;
    expect_picture("out.exr", 1, 6);
}

TEST_F(PointsCli, RefusesBadTablesByTheirPlace) {
    const auto refused = [&](const std::string& name, const std::string& text,
                             const std::string& why) {
        write(name, text);
        expect_one_error(run("--at " + name + " -o out.json"), text.substr(0, 40),
                         ExitCode::invalid, why);
    };
    refused("a.csv", "", "has no point");
    refused("a.csv", "x,y,z\n", "has no point");
    refused("a.csv", "1,2,3\n1,2\n", "line 2: has 2 columns instead of 3");
    refused("a.csv", "1,2,3,4\n", "line 1: has 4 columns instead of 3 or 6");
    refused("a.csv", "x,y,z,nx,ny,nz\n1,2,3\n", "line 2: has 3 columns instead of 6");
    refused("a.csv", "1,2,3\n1,nan,3\n", "line 2: is not finite");
    refused("a.csv", "1,2,-inf\n", "line 1: is not finite");
    refused("a.csv", "1,2,3,0,0,0\n", "line 1: has no direction");
    refused("a.csv", "x;y;z\n", "line 1: is not x,y,z");
    refused("a.csv", std::string(5000, '1'), "has a line of 1024 characters or more");
    const std::string three = bytes_of(std::vector<float>{1, 2, 3});
    refused("a.npy", "no", "is no NPY file");
    refused("a.npy", npy("<f4", "(3,)", three), "has the shape (3,)");
    refused("a.npy", npy("<f4", "(1, 3, 1)", three), "has the shape (1, 3, 1)");
    refused("a.npy", npy("<f4", "(1, 1, 1, 3)", three), "has the shape (1, 1, 1, 3)");
    refused("a.npy", npy("<f4", "(1, x, 3)", three), "has the shape (1, x, 3)");
    refused("a.npy", npy("<f4", "(2, 2, 3)", three), "ends in row 1 of 4");
    refused("a.npy", npy("<f4", "(10000, 10000, 3)", three), "has 100000000 points, more than");
    refused("a.npy", npy("<f4", "(1, 4)", three), "has the shape (1, 4)");
    refused("a.npy", npy("<i4", "(1, 3)", three), "has numbers of type '<i4'");
    refused("a.npy", npy("<f4", "(1, 3)", three, "True"), "is in Fortran's order");
    refused("a.npy", npy("<f4", "(2, 3)", three), "ends in row 1 of 2");
    refused("a.npy", npy("<f4", "(1, 3)", three + "x"), "goes on after its array");
    refused("a.npy", npy("<f4", "(0, 3)", ""), "has no point");
    refused("a.npy", npy("<f4", "(100000000, 3)", three), "has 100000000 points, more than");
    refused("a.npy", npy("<f4", "(1, 3)", bytes_of(std::vector<float>{1, HUGE_VALF, 3})),
            "row 0: is not finite");
}

} // namespace
} // namespace lpvbake
