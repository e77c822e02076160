// Volumes of one bake beside each other: their grids, how they are seen together, their manifest.
#include "io/boxes.h"
#include "io/io.h"
#include "io/levels.h"
#include "readers/readers.h"
#include "unit/volumes.h"
#include "volume/compare.h"
#include "volume/levels.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <random>

namespace lpvbake {
namespace {

using volume::Place;
using volume::VolumeBox;
using volume::VolumeSet;

template <class Make>
std::string refused(Make&& make, ErrorKind kind) {
    try {
        make();
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, kind) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "was accepted";
    return "";
}

/// One luminance in each box.
VolumeSet set_of(std::vector<VolumeBox> boxes, const std::vector<float>& luminance) {
    VolumeSet set;
    const std::vector<Grid> grids = volume::place_grids(boxes);
    for (std::size_t i = 0; i < grids.size(); ++i) {
        Volume& volume = set.levels.emplace_back();
        volume.grid = grids[i];
        volume.sh_order = 1;
        volume.sh.assign(4, std::vector<glm::vec3>(grids[i].size(), glm::vec3(0)));
        volume.sh[0].assign(grids[i].size(),
                            glm::vec3(luminance[i] * std::sqrt(4 * glm::pi<float>())));
        volume.metadata["settings"] = "as ever";
        set.places.push_back(boxes[i].place);
    }
    volume::order_by_priority(set);
    return set;
}

double seen(const VolumeSet& set, glm::dvec3 point) {
    return readers::irradiance(*readers::reader_named("lpvbake"), set, point, {0, 1, 0}).y
           / glm::pi<double>();
}

TEST(Places, GridsAreOfWholeCellsAndTheFinestComeFirst) {
    std::vector<VolumeBox> boxes{{{"hall", 0, 1}, {0, 0, 0}, {4, 2, 3}, 0.5},
                                 {{"nook", 2, 1}, {4, 0, 0}, {5, 1, 0.9}, 0.25}};
    const std::vector<Grid> grids = volume::place_grids(boxes);
    EXPECT_EQ(boxes[0].place.name, "nook");
    EXPECT_EQ(grids[0].dims, glm::ivec3(4, 4, 4));
    EXPECT_EQ(grids[1].dims, glm::ivec3(8, 4, 6));
    EXPECT_EQ(grids[1].origin, glm::dvec3(0));
}

TEST(Places, WhatCannotBeIsNamed) {
    const auto why = [](std::vector<VolumeBox> boxes) {
        return refused([&] { volume::place_grids(boxes); }, ErrorKind::argument);
    };
    const glm::dvec3 lo(0), hi(1);
    EXPECT_NE(why({{{"a", 0, 1}, hi, lo, 0.5}}).find("\"a\" has a box that is inside out"),
              std::string::npos);
    EXPECT_NE(why({{{"a", 0, 1}, lo, {1, 0, 1}, 0.5}}).find("without an inside"),
              std::string::npos);
    EXPECT_NE(
        why({{{"a", 0, 1}, lo, hi, 0.5}, {{"A", 0, 1}, lo, hi, 0.5}}).find("\"A\" is there twice"),
        std::string::npos);
    for (const char* name : {"", "a/b", "a b", ".."})
        EXPECT_NE(why({{{name, 0, 1}, lo, hi, 0.5}}).find("has a name"), std::string::npos) << name;
    EXPECT_NE(why({{{"a", 0, 1}, lo, hi, 1e-4}}).find("2^31"), std::string::npos);
    EXPECT_NE(why({257, {{"a", 0, 1}, lo, hi, 0.5}}).find("257 volumes"), std::string::npos);
}

TEST(Places, TheHighestPriorityIsSeenAndFadesAtItsFaces) {
    const VolumeSet set = set_of({{{"all", 0, 0.5}, {0, 0, 0}, {8, 4, 4}, 0.5},
                                  {{"in", 3, 1}, {2, 0, 0}, {6, 4, 4}, 0.5},
                                  {{"fine", 0, 0.5}, {6, 0, 0}, {8, 4, 4}, 0.25}},
                                 {3, 1, 2}); // by falling size of cells, as place_grids has them
    EXPECT_EQ(set.places[0].name, "in");
    EXPECT_EQ(set.places[1].name, "fine") << "of smaller cells";
    EXPECT_EQ(set.places[2].name, "all");
    EXPECT_NEAR(seen(set, {4, 2, 2}), 2, 1e-5);
    EXPECT_NEAR(seen(set, {1, 2, 2}), 1, 1e-5);
    EXPECT_NEAR(seen(set, {7, 2, 2}), 3, 1e-5);
    EXPECT_NEAR(seen(set, {2.5, 2, 2}), 1.5, 1e-5) << "half of its falloff";
    EXPECT_NEAR(seen(set, {2.25, 2, 2}), 1 + 0.15625, 1e-5) << "smoothstep of a quarter";
    EXPECT_NEAR(seen(set, {6.25, 2, 2}), 2, 1e-5) << "half of fine, the rest of all";
    // Nothing else holds these: what there is counts whole, and outside the nearest.
    EXPECT_NEAR(seen(set, {0.001, 2, 2}), 1, 1e-5);
    EXPECT_NEAR(seen(set, {0, 0, 0}), 1, 1e-5);
    EXPECT_NEAR(seen(set, {9, 2, 2}), 3, 1e-5);
}

TEST(Places, OneLuminanceIsSeenEverywhere) {
    const VolumeSet set = set_of({{{"a", 0, 0.7}, {0, 0, 0}, {3, 2, 2}, 0.5},
                                  {{"b", 1, 0.3}, {2, 0.5, 0}, {5, 2.5, 2}, 0.25},
                                  {{"c", 0, 0}, {1, 1, 1}, {2.5, 3, 2.5}, 0.125}},
                                 {1, 1, 1});
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share;
    for (int i = 0; i < 10000; ++i)
        ASSERT_NEAR(
            seen(set, {6 * share(random) - 0.5, 4 * share(random) - 0.5, 3 * share(random) - 0.5}),
            1, 1e-5);
}

TEST(Places, WhatProgramsCannotShowIsRefused) {
    const auto check = [](const char* target, const std::vector<VolumeBox>& of) {
        std::vector<VolumeBox> boxes = of;
        const std::vector<Grid> grids = volume::place_grids(boxes);
        std::vector<Place> places;
        for (const VolumeBox& box : boxes)
            places.push_back(box.place);
        io::check_places(*io::target_named(target), places, grids);
    };
    std::vector<VolumeBox> row;
    for (int i = 0; i < 33; ++i)
        row.push_back(
            {{std::string("r").append(std::to_string(i)), 0, 1}, {i, 0, 0}, {i + 1, 1, 1}, 0.5});
    EXPECT_NE(
        refused([&] { check("vrc", row); }, ErrorKind::argument).find("32 volumes at once, not 33"),
        std::string::npos);
    EXPECT_NO_THROW(check("bevy", row));
    row.pop_back();
    EXPECT_NO_THROW(check("vrc", row));
    // Rounded up to whole cells neighbours meet by less than one.
    EXPECT_NO_THROW(check("bevy", {{{"a", 0, 1}, {0, 0, 0}, {1.1, 1, 1}, 0.25},
                                   {{"b", 0, 1}, {1.1, 0, 0}, {2, 1, 1}, 0.25}}));
    const std::vector<VolumeBox> over{{{"a", 0, 1}, {0, 0, 0}, {2, 1, 1}, 0.25},
                                      {{"b", 0, 1}, {1, 0, 0}, {3, 1, 1}, 0.25}};
    EXPECT_NE(
        refused([&] { check("bevy", over); }, ErrorKind::argument).find("\"a\" overlaps \"b\""),
        std::string::npos);
    EXPECT_NO_THROW(check("threejs", over));
}

glm::dquat about_y(double degrees) {
    return glm::angleAxis(glm::radians(degrees), glm::dvec3(0, 1, 0));
}

TEST(Places, TransformsMakeBoxesTurnedAsLittleAsCanBe) {
    const Place place{"box", 0, 1};
    const glm::dvec3 lo(-1, 0, -2), hi(1, 3, 2);
    const auto box_of = [&](const glm::dmat4& to_world) {
        return volume::box_in_world(place, lo, hi, to_world);
    };
    glm::dmat4 moved(1.0);
    moved[3] = {5, 6, 7, 1};
    EXPECT_EQ(box_of(moved).lo, glm::dvec3(4, 6, 5));
    EXPECT_EQ(box_of(moved).turn, Grid().turn);
    // Quarter turns, as of files whose up is Z, and mirrors leave a box along the axes.
    std::mt19937 random(1);
    for (const double turn : {90, 180, 270, 0}) {
        glm::dmat4 quarter = glm::mat4_cast(about_y(turn));
        quarter[0] *= turn == 0 ? -1.0 : 1.0;
        const VolumeBox box = box_of(quarter);
        EXPECT_EQ(box.turn, Grid().turn) << turn;
        const glm::dvec3 size = box.hi - box.lo;
        EXPECT_NEAR(size.x, turn == 90 || turn == 270 ? 4 : 2, 1e-9) << turn;
        EXPECT_NEAR(size.y, 3, 1e-9);
    }
    // Others: the corners stay where they are.
    for (int i = 0; i < 100; ++i) {
        std::uniform_real_distribution<double> number(-2, 2);
        const glm::dquat turn = glm::normalize(
            glm::dquat(number(random), number(random), number(random), number(random)));
        glm::dmat4 to_world = glm::mat4_cast(turn);
        for (int axis = 0; axis < 3; ++axis)
            to_world[axis] *= 0.5 + std::abs(number(random));
        to_world[3] = {number(random), number(random), number(random), 1};
        VolumeBox box = box_of(to_world);
        box.cell = 0.01;
        std::vector<VolumeBox> boxes{box};
        const Grid grid = volume::place_grids(boxes).front();
        for (int corner = 0; corner < 8; ++corner) {
            const glm::dvec3 own(corner & 1 ? hi.x : lo.x, corner & 2 ? hi.y : lo.y,
                                 corner & 4 ? hi.z : lo.z);
            EXPECT_LT(std::abs(volume::depth_in(grid, glm::dvec3(to_world * glm::dvec4(own, 1)))),
                      0.011);
        }
        const glm::dvec3 middle(to_world * glm::dvec4(0.5 * (lo + hi), 1));
        EXPECT_LT(glm::length(grid.to_world(0.5 * glm::dvec3(grid.dims)) - middle), 1e-9);
        EXPECT_GT(std::abs(box.turn.w), 0.5) << "more than it need be";
    }
    glm::dmat4 shear(1.0);
    shear[1].x = 0.5;
    EXPECT_NE(refused([&] { box_of(shear); }, ErrorKind::argument).find("\"box\" has a transform"),
              std::string::npos);
    glm::dmat4 flat(1.0);
    flat[1].y = 0;
    EXPECT_NE(refused([&] { box_of(flat); }, ErrorKind::argument).find("without an inside"),
              std::string::npos);
}

TEST(Places, TurnedBoxesOverlapWhereTheyDo) {
    const auto grid_of = [](glm::dvec3 lo, glm::dvec3 hi, double degrees) {
        std::vector<VolumeBox> boxes{{{"a", 0, 1}, lo, hi, 0.01, about_y(degrees)}};
        return volume::place_grids(boxes).front();
    };
    const std::vector<Place> places{{"a", 0, 0}, {"b", 0, 0}};
    const auto overlap = [&](const Grid& a, const Grid& b) {
        return !volume::overlapping(places, {a, b}).first.empty();
    };
    const Grid cube = grid_of({-1, -1, -1}, {1, 1, 1}, 0);
    // A diagonal of sqrt(2) reaches 0.41 further along an axis, and less at the corner.
    EXPECT_TRUE(overlap(cube, grid_of({1.3, -1, -1}, {3.3, 1, 1}, 45)));
    EXPECT_FALSE(overlap(cube, grid_of({1.5, -1, -1}, {3.5, 1, 1}, 45)));
    EXPECT_FALSE(overlap(cube, grid_of({0.75, -1, 0.75}, {2.75, 1, 2.75}, 45)));
    EXPECT_TRUE(overlap(cube, grid_of({0.6, -1, 0.6}, {2.6, 1, 2.6}, 45)));
    EXPECT_FALSE(overlap(cube, grid_of({-1, 1, -1}, {1, 3, 1}, 20)));
}

/// Light a + b.x of one colour, the same in all directions.
Volume affine_volume(const Grid& grid) {
    Volume volume;
    volume.grid = grid;
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(grid.size(), glm::vec3(0)));
    for (std::size_t i = 0; i < grid.size(); ++i) {
        const glm::dvec3 at = grid.center(grid.cell_at(i));
        volume.sh[0][i] = glm::vec3(float(10 + glm::dot(at, {0.5, -0.25, 1})));
        volume.sh[3][i] = glm::vec3(1, 0, 0); // towards +x of the world
    }
    return volume;
}

TEST(Places, EveryReaderReadsATurnedVolume) {
    std::vector<VolumeBox> boxes{{{"a", 0, 1},
                                  {-2, -1, -1},
                                  {2, 1, 1},
                                  0.25,
                                  glm::normalize(glm::dquat(0.8, 0.1, 0.5, -0.2))}};
    const Grid grid = volume::place_grids(boxes).front();
    const Volume volume = affine_volume(grid);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1, 1);
    for (const readers::Reader& reader : readers::all_readers()) {
        if (reader.evaluation != readers::Evaluation::linear || reader.lookup == Reading::facing)
            continue;
        for (int i = 0; i < 100; ++i) {
            const glm::dvec3 place =
                glm::dvec3(1.2, 0.3, 0.3) * glm::dvec3(share(random), share(random), share(random));
            const glm::dvec3 point = grid.turn * place;
            const glm::dvec3 n =
                glm::normalize(glm::dvec3(share(random), share(random), share(random)));
            const glm::dvec3 looked_up = point + reader.offset * grid.cell * n;
            const double expected = volume::sh_cosine_factor(0) * double(volume::sh_y0)
                                    * (10 + glm::dot(looked_up, {0.5, -0.25, 1}));
            const glm::dvec3 e = readers::irradiance(reader, volume, point, n);
            ASSERT_NEAR(e.y, expected, 1e-4) << reader.name;
            ASSERT_NEAR(e.x - e.y, volume::sh_cosine_factor(1) * double(volume::sh_y1) * n.x, 1e-4)
                << reader.name;
        }
    }
    // What sees cells by their side goes by the lattice's axes: a floor's cells are those above it.
    Volume floor = volume;
    floor.validity.assign(grid.size(), 1);
    for (std::size_t i = 0; i < grid.size(); ++i)
        if (grid.cell_at(i).y < 4)
            floor.sh[0][i] = glm::vec3(-1e6f);
    const glm::dvec3 e =
        readers::irradiance(*readers::reader_named("lpvbake"), floor, grid.to_world({8, 4.3, 4}),
                            grid.turn * glm::dvec3(0, 1, 0));
    EXPECT_GT(e.y, 0);
}

class PlacesFiles : public ::testing::Test {
protected:
    void write(const VolumeSet& set, const std::string& path) {
        std::vector<Grid> grids;
        for (std::size_t i = 0; i < set.levels.size(); ++i) {
            io::write_for(*io::target_named("generic"), io::member_path(path, set.places, i),
                          set.levels[i]);
            grids.push_back(set.levels[i].grid);
        }
        io::write_manifest(path, grids, volume::Axes::gltf, 1, set.places);
    }
    TemporaryFolder folder_;
};

TEST_F(PlacesFiles, AManifestIsReadAsItWasWritten) {
    const VolumeSet set = set_of(
        {{{"all", -1, 0.5}, {0, 0, 0}, {8, 4, 4}, 0.5}, {{"in", 3, 1}, {2, 0, 0}, {6, 4, 4}, 0.5}},
        {1, 2});
    const std::string path = folder_ / "town.vdb", manifest = folder_ / "town.volumes.json";
    write(set, path);
    EXPECT_EQ(io::manifest_path(path, true), manifest);
    const VolumeSet read = io::read_levels(manifest);
    ASSERT_EQ(read.levels.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(read.places[i].name, set.places[i].name);
        EXPECT_EQ(read.places[i].priority, set.places[i].priority);
        EXPECT_EQ(read.places[i].falloff, set.places[i].falloff);
        EXPECT_EQ(read.levels[i].sh, set.levels[i].sh);
    }
    // In the words of VRC Light Volumes and of bevy: a metre on each side of four is half of it.
    const auto json = nlohmann::json::parse(slurp(manifest));
    EXPECT_EQ(json["volumes"][0]["vrc"], nlohmann::json({{"weight", 3}, {"smooth_blending", 1.0}}));
    EXPECT_EQ(json["volumes"][0]["bevy"]["falloff"], nlohmann::json({0.5, 0.5, 0.5}));
    EXPECT_EQ(json["volumes"][0]["box"], nlohmann::json({2.0, 0.0, 0.0, 6.0, 4.0, 4.0}));
    EXPECT_EQ(io::level_files(manifest),
              std::vector<std::string>({folder_ / "town_in.vdb", folder_ / "town_all.vdb"}));
    EXPECT_NE(
        refused([&] { read_volume(manifest); }, ErrorKind::unsupported).find("several volumes"),
        std::string::npos);
}

TEST_F(PlacesFiles, TurnedVolumesStandWhereTheyStood) {
    Volume volume = random_volume({5, 4, 3}, 2, false, 1, 10);
    volume.grid.turn = glm::normalize(glm::dquat(0.7, 0.2, 0.6, -0.1));
    for (const char* name : {"a.vdb", "a.nvdb", "a.exr", "a.ktx2", "a.dds"}) {
        const std::string path = folder_ / name;
        io::write_for(*io::target_named("generic"), path, volume);
        EXPECT_EQ(read_volume(path).grid, volume.grid) << name;
    }
    for (const volume::Axes axes :
         {volume::Axes::unity, volume::Axes::unreal, volume::Axes::blender}) {
        io::Target target = *io::target_named("generic");
        target.encoding.axes = axes;
        const std::string path = folder_ / (std::string(volume::name_of(axes)) + ".exr");
        io::write_for(target, path, volume);
        const Volume read = read_volume(path);
        EXPECT_FALSE(volume::lattice_difference(read.grid, volume.grid)) << path;
        for (std::size_t i = 0; i < volume.grid.size(); ++i)
            ASSERT_EQ(read.sh[3][i], volume.sh[3][i]) << path;
    }
    // In a VDB by its map, for all who read one.
    const std::string grids = output_of("vdb_print -l '" + folder_ / "a.vdb'");
    EXPECT_NE(grids.find("lpv:grid_turn"), std::string::npos) << grids;
    const glm::dvec3 edge = volume.grid.turn * glm::dvec3(0.1, 0, 0);
    char row[100];
    snprintf(row, sizeof row, "[%.3g, %.3g, %.3g, 0]", edge.x, edge.y, edge.z);
    EXPECT_NE(grids.find(row), std::string::npos) << grids;
    for (const char* name : {"a.glb"})
        EXPECT_NE(
            refused([&] { io::write_for(*io::target_named("generic"), folder_ / name, volume); },
                    ErrorKind::unsupported)
                .find("turned"),
            std::string::npos);
    EXPECT_NE(
        refused([&] { io::write_for(*io::target_named("godot"), folder_ / "a.tres", volume); },
                ErrorKind::unsupported)
            .find("turned"),
        std::string::npos);
    // Bevy's Transform, whose unit cube is the box.
    io::write_for(*io::target_named("bevy"), folder_ / "b.ktx2", volume);
    const auto bevy = nlohmann::json::parse(slurp(folder_ / "b.bevy.json"))["Transform"];
    const glm::dquat& turn = volume.grid.turn;
    EXPECT_EQ(bevy["rotation"], nlohmann::json({turn.x, turn.y, turn.z, turn.w}));
    const std::vector<double> middle = bevy["translation"], size = bevy["scale"];
    const glm::dvec3 corner = glm::dvec3(middle[0], middle[1], middle[2])
                              + turn * (-0.5 * glm::dvec3(size[0], size[1], size[2]));
    EXPECT_LT(glm::length(corner - volume.grid.origin), 1e-9);
}

TEST_F(PlacesFiles, WhatIsMissingDamagedOrForeignIsNamed) {
    VolumeSet set = set_of(
        {{{"a", 0, 0.5}, {0, 0, 0}, {2, 2, 2}, 0.5}, {{"b", 0, 1}, {2, 0, 0}, {4, 2, 2}, 0.5}},
        {1, 2});
    const std::string path = folder_ / "t.vdb", manifest = folder_ / "t.volumes.json";
    const auto why = [&](ErrorKind kind) {
        return refused([&] { io::read_levels(manifest); }, kind);
    };
    set.levels[1].metadata["settings"] = "others";
    write(set, path);
    EXPECT_NE(why(ErrorKind::invalid).find("t_b.vdb is of another bake"), std::string::npos);
    std::filesystem::remove(folder_ / "t_b.vdb");
    EXPECT_NE(why(ErrorKind::file).find("t_b.vdb"), std::string::npos);
    const std::string whole = slurp(manifest);
    for (const auto& [from, to, part] : std::vector<std::array<std::string, 3>>{
             {"\"lpvbake volumes\"", "\"x\"", "no manifest of volumes"},
             {"\"volumes\": [", "\"volume\": [", "lists no volumes"},
             {"t_a.vdb", "../t_a.vdb", "\"file\""},
             {"\"priority\": 0", "\"priority\": 0.5", "whole number"},
             {"\"name\": \"a\"", "\"name\": 1", "\"name\""}}) {
        std::string text = whole;
        const std::size_t at = text.find(from);
        ASSERT_NE(at, std::string::npos) << from;
        spill(manifest, text.replace(at, from.size(), to));
        EXPECT_NE(why(ErrorKind::invalid).find(part), std::string::npos) << part;
    }
}

TEST_F(PlacesFiles, BoxesAreReadFromJson) {
    const std::string path = folder_ / "v.json";
    spill(path, R"({"volumes": [{"name": "hall", "box": [0, 0, 0, 4, 2, 3]},
        {"name": "nook", "box": [4, 0, 0, 5, 1, 1], "cell": 0.25, "priority": 2, "falloff": 0.5}]})");
    const std::vector<VolumeBox> boxes = io::read_boxes(path);
    ASSERT_EQ(boxes.size(), 2u);
    EXPECT_EQ(boxes[0].cell, 0);
    EXPECT_LT(boxes[0].place.falloff, 0);
    EXPECT_EQ(boxes[1].place.name, "nook");
    EXPECT_EQ(boxes[1].hi, glm::dvec3(5, 1, 1));
    EXPECT_EQ(boxes[1].cell, 0.25);
    EXPECT_EQ(boxes[1].place.priority, 2);
    EXPECT_EQ(boxes[1].place.falloff, 0.5);
    // Turned by a quaternion about the middle, or by a matrix of columns.
    spill(path, R"({"volumes": [
        {"name": "a", "box": [0, 0, 0, 4, 2, 2], "rotation": [0, 0.19866933, 0, 0.98006658]},
        {"name": "b", "transform": [0, 0, -4, 0, 0, 2, 0, 0, 3, 0, 0, 0, 5, 6, 7, 1], "cell": 0.5}]})");
    const std::vector<VolumeBox> turned = io::read_boxes(path);
    EXPECT_NEAR(turned[0].turn.y, std::sin(0.2), 1e-7);
    EXPECT_LT(glm::length(turned[0].lo), 1e-9);
    EXPECT_EQ(turned[1].turn, Grid().turn);
    EXPECT_LT(glm::length(turned[1].lo - glm::dvec3(3.5, 5, 5)), 1e-9);
    EXPECT_LT(glm::length(turned[1].hi - glm::dvec3(6.5, 7, 9)), 1e-9);
    EXPECT_EQ(turned[1].cell, 0.5);
    for (
        const auto& [text, part] : std::vector<std::array<std::string, 2>>{
            {"{}", "is not JSON of the form"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, 1], "rotation": [0, 0, 0, 2]}]})",
             "volumes[0].rotation: is no unit"},
            {R"({"volumes": [{"name": "a", "transform": [1, 0, 0]}]})",
             "volumes[0].transform: must be an array of 16"},
            {R"({"volumes": [{"name": "a", "rotation": [0, 0, 0, 1],
                  "transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]})",
             "both"},
            {R"({"volumes": []})", "has no box"},
            {R"({"volumes": [{"name": "a"}]})", "volumes[0]: lacks"},
            {R"({"volumes": [{"name": 1, "box": [0, 0, 0, 1, 1, 1]}]})", "volumes[0].name"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, -1]}]})",
             "volumes[0].box: is inside"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, 1], "cell": 0}]})",
             "volumes[0].cell"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, 1], "priority": 0.5}]})",
             "whole"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, 1], "falloff": -1}]})",
             ".falloff"},
            {R"({"volumes": [{"name": "a", "box": [0, 0, 0, 1, 1, 1], "colour": 1}]})",
             "\"colour\""}}) {
        spill(path, text);
        EXPECT_NE(refused([&] { io::read_boxes(path); }, ErrorKind::invalid).find(part),
                  std::string::npos)
            << text;
    }
}

} // namespace
} // namespace lpvbake
