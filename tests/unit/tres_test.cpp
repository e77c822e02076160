// Probes of Godot 4's LightmapGI, and what Godot looks up of them.
#include "io/io.h"
#include "io/tres.h"
#include "unit/volumes.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <array>
#include <bit>
#include <cmath>
#include <numbers>

using namespace lpvbake;

namespace {

constexpr volume::Encoding godot{.convention = volume::ShConvention::godot};

void write(const std::string& path, const Volume& volume, Precision precision = Precision::full) {
    io::write_volume(path, volume, precision, {}, godot);
}

/// Light, order and metadata alone, which is what is written.
Volume light_of(Volume volume) {
    volume.occlusion.clear();
    volume.validity.clear();
    volume.walls.clear();
    return volume;
}

void expect_near(const Volume& read, const Volume& expected, float relative) {
    EXPECT_EQ(read.grid, expected.grid);
    EXPECT_EQ(read.metadata, expected.metadata);
    EXPECT_TRUE(read.validity.empty());
    ASSERT_EQ(read.sh.size(), expected.sh.size());
    for (size_t k = 0; k < read.sh.size(); ++k)
        for (size_t i = 0; i < read.sh[k].size(); ++i)
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(read.sh[k][i][c], expected.sh[k][i][c],
                            relative * std::abs(expected.sh[k][i][c]));
}

/// The numbers behind a key of the resource.
std::vector<double> numbers(const std::string& text, const std::string& key) {
    const size_t begin = text.find('(', text.find('"' + key + '"')) + 1;
    std::vector<double> all;
    std::istringstream list(text.substr(begin, text.find(')', begin) - begin));
    for (std::string number; std::getline(list, number, ',');)
        all.push_back(std::stod(number));
    return all;
}

/// What Godot makes of a LightmapGIData: LightStorage::lightmap_tap_sh_light of
/// servers/rendering/renderer_rd/storage_rd/light_storage.cpp, Godot 4.4.
class Capture {
public:
    explicit Capture(const std::string& text)
        : bsp_(numbers(text, "bsp")),
          points_(numbers(text, "points")),
          sh_(numbers(text, "sh")),
          tetrahedra_(numbers(text, "tetrahedra")) {
        EXPECT_EQ(points_.size() / 3 * 36, sh_.size()); // what set_capture_data asks for
        EXPECT_EQ(tetrahedra_.size() % 4 + bsp_.size() % 6, 0u);
    }

    /// The first colour of each of nine coefficients, and of the weights their sum.
    std::array<double, 10> tap(glm::dvec3 point) const {
        int64_t node = 0;
        while (node >= 0) {
            const double* at = &bsp_.at(size_t(node) * 6 + 5) - 5;
            const auto plane = [&](int i) { return double(std::bit_cast<float>(int32_t(at[i]))); };
            const bool over =
                plane(0) * point.x + plane(1) * point.y + plane(2) * point.z > plane(3);
            const auto next = int64_t(at[over ? 4 : 5]);
            EXPECT_TRUE(next < 0 || next > node); // or Godot complains
            node = next;
        }
        const double* corners = &tetrahedra_.at(size_t(-1 - node) * 4 + 3) - 3;
        std::array<glm::dvec3, 4> p;
        for (size_t i = 0; i < 4; ++i)
            for (int a = 0; a < 3; ++a)
                p[i][a] = points_.at(size_t(corners[i]) * 3 + size_t(a));
        const glm::dvec3 rest =
            glm::inverse(glm::dmat3(p[1] - p[0], p[2] - p[0], p[3] - p[0])) * (point - p[0]);
        const double weights[] = {1 - rest.x - rest.y - rest.z, rest.x, rest.y, rest.z};
        std::array<double, 10> result{};
        for (size_t i = 0; i < 4; ++i) {
            EXPECT_GT(weights[i], -1e-5); // the tree leads to the tetrahedron that holds it
            const double weight = std::clamp(weights[i], 0.0, 1.0);
            for (size_t k = 0; k < 9; ++k)
                result[k] += weight * sh_.at(size_t(corners[i]) * 36 + 4 * k);
            result[9] += weight;
        }
        return result;
    }

private:
    std::vector<double> bsp_, points_, sh_, tetrahedra_;
};

} // namespace

TEST(Tres, ComesBack) {
    for (const int order : {0, 1, 2})
        for (const glm::ivec3 dims : {glm::ivec3(1), glm::ivec3(5, 4, 3)}) {
            const TemporaryFolder folder;
            const std::string path = folder / "a.tres";
            Volume volume = random_volume(dims, order, false, 1);
            volume.metadata["text"] = "\"quoted\", \\ and\na line";
            write(path, volume);
            EXPECT_EQ(folder.count(), 1);
            expect_near(read_volume(path), light_of(volume), 2e-7f);
            write(path, volume, Precision::half);
            expect_near(read_volume(path), light_of(volume), 5.1e-4f);
        }
}

TEST(Tres, GodotLooksUpWhatCellsHold) {
    const TemporaryFolder folder;
    Volume volume = random_volume({5, 2, 3}, 2, false, 2);
    write(folder / "a.tres", volume);
    const Capture capture(slurp(folder / "a.tres"));
    for (int z = 0; z < 3; ++z)
        for (int y = 0; y < 2; ++y)
            for (int x = 0; x < 5; ++x) {
                const auto shown = capture.tap(volume.grid.center({x, y, z}));
                for (size_t k = 0; k < 9; ++k) {
                    const double cell =
                        volume.sh[k][volume.grid.index({x, y, z})].r / std::numbers::pi;
                    EXPECT_NEAR(shown[k], cell, 1e-3 * (1 + std::abs(cell)));
                }
            }
}

TEST(Tres, BetweenThemItIsLinearAndTheBoxIsFull) {
    const TemporaryFolder folder;
    Volume volume = random_volume({6, 3, 4}, 1, false, 3);
    const auto field = [](glm::dvec3 p) { return 10 + 3 * p.x - 5 * p.y + 2 * p.z; };
    for (int z = 0; z < 4; ++z)
        for (int y = 0; y < 3; ++y)
            for (int x = 0; x < 6; ++x)
                volume.sh[0][volume.grid.index({x, y, z})].r =
                    float(std::numbers::pi * field(volume.grid.center({x, y, z})));
    write(folder / "a.tres", volume);
    const Capture capture(slurp(folder / "a.tres"));
    const glm::dvec3 size = volume.grid.cell * glm::dvec3(volume.grid.dims),
                     half(0.5 * volume.grid.cell);
    std::mt19937 random(4);
    std::uniform_real_distribution<double> share(0.001, 0.999);
    for (int i = 0; i < 2000; ++i) {
        const glm::dvec3 p =
            volume.grid.origin + size * glm::dvec3(share(random), share(random), share(random));
        const glm::dvec3 held =
            glm::clamp(p, volume.grid.origin + half, volume.grid.origin + size - half);
        const auto shown = capture.tap(p);
        EXPECT_NEAR(shown[9], 1, 1e-5);
        EXPECT_NEAR(shown[0], field(held), 1e-4) << p.x << ' ' << p.y << ' ' << p.z;
    }
}

TEST(Tres, GodotMayHaveWrittenItAgain) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({3, 2, 2}, 1, false, 5);
    write(folder / "a.tres", volume);
    std::string text = slurp(folder / "a.tres");
    const size_t description = text.find("metadata/lpvbake"), probes = text.find("probe_data");
    const std::string line = text.substr(description, probes - description);
    text.erase(description, line.size());
    for (size_t at = text.find(", "); at != std::string::npos; at = text.find(", ", at + 1))
        text.replace(at, 2, ",\n");
    spill(folder / "b.tres", text + line); // metadata come last then
    expect_near(read_volume(folder / "b.tres"), light_of(volume), 2e-7f);
}

TEST(Tres, SaysWhatItDoesNotHold) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.tres";
    const auto refused = [&](const Volume& volume, const volume::Encoding& encoding) {
        EXPECT_EQ(
            error_of(path, [&] { io::write_volume(path, volume, Precision::full, {}, encoding); })
                .kind,
            ErrorKind::unsupported);
        EXPECT_FALSE(std::filesystem::exists(path));
    };
    refused(random_volume({3, 2, 2}, 1, false, 6), {});
    refused(random_volume({3, 2, 2}, 4, false, 6), godot);
    refused(random_volume({128, 128, 65}, 0, false, 6), godot);
}

TEST(Tres, RefusesBrokenFilesByName) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.tres";
    write(path, random_volume({3, 2, 2}, 1, false, 7));
    const std::string whole = slurp(path);
    const size_t end = whole.find("\"tetrahedra\"") - 3;
    for (size_t size = 0; size < end; size += 97) {
        spill(path, whole.substr(0, size));
        const Error error = error_of(path, [&] { (void)read_volume(path); });
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        EXPECT_NE(std::string(error.what()).find("bake it again"), std::string::npos)
            << error.what();
    }
    const std::pair<const char*, const char*> edits[] = {
        {"\"sh\": PackedColorArray(", "\"sh\": PackedColorArray(nan, "},
        {"\"sh\": PackedColorArray(", "\"sh\": PackedColorArray(none, "},
        {"metadata/lpvbake = \"", "metadata/lpvbake = 1 \""},
        {"metadata/lpvbake", "metadata/other"},
        {"\\\"sh_order\\\": 1", "\\\"sh_order\\\": 4"},
        {"lpvbake probes", "lpvbake grids"}};
    for (const auto& [from, to] : edits) {
        std::string text = whole;
        ASSERT_NE(text.find(from), std::string::npos) << from;
        text.replace(text.find(from), std::string(from).size(), to);
        spill(path, text);
        EXPECT_EQ(error_of(path, [&] { (void)read_volume(path); }).kind, ErrorKind::invalid) << to;
    }
}
