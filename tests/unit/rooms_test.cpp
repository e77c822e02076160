// Rooms of a scene, found from its air.
#include "bake/rooms.h"
#include "scene/scene.h"
#include "scenes.h"
#include "volume/grid.h"
#include "volume/places.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <sstream>

namespace lpvbake {
namespace {

using scenes::Facing;

/// Walls, as boxes that face outward.
struct House {
    Scene scene;
    int white = scenes::add_material(scene, glm::vec3(0.7f));

    void wall(glm::vec3 lo, glm::vec3 hi) {
        scenes::add_box(scene, white, lo, hi, Facing::outward);
    }
    /// Floor and ceiling over a rectangle.
    void slabs(float x0, float z0, float x1, float z1, float height = 2.5f) {
        wall({x0, -0.2f, z0}, {x1, 0, z1});
        wall({x0, height, z0}, {x1, height + 0.2f, z1});
    }
};

/// Two rooms, 4 x 5 m and 5 x 5 m, with a door of 0.9 x 2 m between them; a window of 1.1 m.
Scene two_rooms() {
    House house;
    house.slabs(-0.2f, -0.2f, 9.3f, 5.2f);
    house.wall({-0.2f, 0, -0.2f}, {9.3f, 2.5f, 0});
    house.wall({-0.2f, 0, 5}, {9.3f, 2.5f, 5.2f});
    house.wall({-0.2f, 0, 0}, {0, 0.9f, 5});
    house.wall({-0.2f, 2, 0}, {0, 2.5f, 5});
    house.wall({-0.2f, 0.9f, 0}, {0, 2, 2});
    house.wall({-0.2f, 0.9f, 3.1f}, {0, 2, 5});
    house.wall({9.1f, 0, 0}, {9.3f, 2.5f, 5});
    house.wall({4, 0, 0}, {4.1f, 2.5f, 2});
    house.wall({4, 0, 2.9f}, {4.1f, 2.5f, 5});
    house.wall({4, 2, 2}, {4.1f, 2.5f, 2.9f});
    return house.scene;
}

const glm::dquat untouched(1, 0, 0, 0);

/// Around walls by `most` at most.
void expect_box(const volume::VolumeBox& box, glm::dvec3 lo, glm::dvec3 hi, double most = 0.35) {
    EXPECT_EQ(box.turn, untouched);
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_LE(box.lo[axis], lo[axis]) << box.place.name << " " << axis;
        EXPECT_GT(box.lo[axis], lo[axis] - most) << box.place.name << " " << axis;
        EXPECT_GE(box.hi[axis], hi[axis]) << box.place.name << " " << axis;
        EXPECT_LT(box.hi[axis], hi[axis] + most) << box.place.name << " " << axis;
    }
}

std::string text_of(const bake::Rooms& rooms) {
    std::ostringstream text;
    text << rooms.detail;
    for (const volume::VolumeBox& box : rooms.boxes)
        text << "; " << box.place.name << " " << box.lo.x << "," << box.lo.y << "," << box.lo.z
             << " to " << box.hi.x << "," << box.hi.y << "," << box.hi.z;
    return text.str();
}

TEST(Rooms, ADoorPartsTwo) {
    const bake::Rooms rooms = bake::find_rooms(two_rooms());
    ASSERT_EQ(rooms.boxes.size(), 2u) << text_of(rooms);
    EXPECT_EQ(rooms.boxes[0].place.name, "room1");
    expect_box(rooms.boxes[0], {4.1, 0, 0}, {9.1, 2.5, 5});
    expect_box(rooms.boxes[1], {0, 0, 0}, {4, 2.5, 5});
    // A wider opening does not.
    bake::RoomSettings settings;
    settings.radius = 0.35;
    EXPECT_EQ(bake::find_rooms(two_rooms(), settings).boxes.size(), 1u);
    settings.radius = 0.6;
    settings.most_rooms = 1;
    const bake::Rooms largest = bake::find_rooms(two_rooms(), settings);
    EXPECT_EQ(largest.left_out, 1u);
    expect_box(largest.boxes[0], {4.1, 0, 0}, {9.1, 2.5, 5});
}

TEST(Rooms, FurnitureSolidsAndTheSkyAreNone) {
    House house;
    house.scene = two_rooms();
    house.wall({1, 0.7f, 1}, {3, 0.75f, 2.4f});     // a table
    house.wall({6, 0, 1.8f}, {7.4f, 2.5f, 3.2f});   // a pillar
    house.wall({20, -0.2f, 0}, {28, 6, 8});         // another house, solid
    house.wall({-20, -0.4f, -20}, {40, -0.2f, 20}); // the ground
    const bake::Rooms rooms = bake::find_rooms(house.scene);
    ASSERT_EQ(rooms.boxes.size(), 2u) << text_of(rooms);
    expect_box(rooms.boxes[0], {4.1, 0, 0}, {9.1, 2.5, 5}, 0.7);
    expect_box(rooms.boxes[1], {0, 0, 0}, {4, 2.5, 5}, 0.7);
}

TEST(Rooms, AnLIsOneRoomInOneBox) {
    House house;
    house.slabs(-0.2f, -0.2f, 6.2f, 6.2f);
    house.wall({-0.2f, 0, -0.2f}, {6.2f, 2.5f, 0});
    house.wall({-0.2f, 0, 0}, {0, 2.5f, 6.2f});
    house.wall({6, 0, 0}, {6.2f, 2.5f, 3});
    house.wall({3, 0, 3}, {6.2f, 2.5f, 3.2f});
    house.wall({3, 0, 3}, {3.2f, 2.5f, 6.2f});
    house.wall({0, 0, 6}, {3, 2.5f, 6.2f});
    const bake::Rooms rooms = bake::find_rooms(house.scene);
    ASSERT_EQ(rooms.boxes.size(), 1u) << text_of(rooms);
    expect_box(rooms.boxes[0], {0, 0, 0}, {6, 2.5, 6});
}

TEST(Rooms, CorridorsAreFoundInWhatRoomsLeave) {
    House house; // a corridor of 1.2 m along two rooms, with doors to both
    house.slabs(-0.2f, -0.2f, 8.3f, 6.5f);
    house.wall({-0.2f, 0, -0.2f}, {8.3f, 2.5f, 0});
    house.wall({-0.2f, 0, 6.3f}, {8.3f, 2.5f, 6.5f});
    house.wall({-0.2f, 0, 0}, {0, 2.5f, 6.3f});
    house.wall({8.1f, 0, 0}, {8.3f, 2.5f, 6.3f});
    house.wall({4, 0, 0}, {4.1f, 2.5f, 5});
    for (const float x : {0.0f, 4.1f}) {
        house.wall({x, 0, 5}, {x + 1, 2.5f, 5.1f});
        house.wall({x + 1.8f, 0, 5}, {x + 4, 2.5f, 5.1f});
        house.wall({x + 1, 2, 5}, {x + 1.8f, 2.5f, 5.1f});
    }
    const bake::Rooms rooms = bake::find_rooms(house.scene);
    ASSERT_EQ(rooms.boxes.size(), 3u) << text_of(rooms);
    expect_box(rooms.boxes[2], {0, 0, 5.1}, {8.1, 2.5, 6.3});
}

double degrees_of(const volume::VolumeBox& box) {
    EXPECT_EQ(box.turn.x, 0);
    EXPECT_EQ(box.turn.z, 0);
    return glm::degrees(2 * std::atan2(box.turn.y, box.turn.w));
}

glm::dmat4 turn_about(glm::dvec3 middle, double degrees) {
    return glm::translate(glm::dmat4(1.0), middle)
           * glm::rotate(glm::dmat4(1.0), glm::radians(degrees), glm::dvec3(0, 1, 0));
}

TEST(Rooms, WallsTurnABoxNotWhatStandsInIt) {
    // 5 x 4 m, 46.8 m2 of wall; blocks of 19.2 m2, all turned one way, which turn the mean by 4.5
    // degrees.
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_box(scene, white, {0, 0, 0}, {5, 2.6f, 4}, Facing::inward);
    for (const glm::dvec3 middle : {glm::dvec3(1.2, 0, 1), glm::dvec3(3.8, 0, 1.2),
                                    glm::dvec3(1.2, 0, 3), glm::dvec3(3.8, 0, 2.9)})
        scenes::add_box(scene, white, {-0.6f, 0, -0.6f}, {0.6f, 1, 0.6f}, Facing::outward,
                        turn_about(middle, 17));
    for (const double turn : {0.0, 20.0, -33.0, 44.0}) {
        const Scene turned =
            scene::turned(scene, glm::dmat3(turn_about({}, turn)), glm::dvec3(1, 0, 2));
        const bake::Rooms rooms = bake::find_rooms(turned);
        ASSERT_EQ(rooms.boxes.size(), 1u) << text_of(rooms);
        EXPECT_NEAR(degrees_of(rooms.boxes[0]), turn, 0.1);
    }
}

TEST(Rooms, ACornellBoxIsNotTurned) {
    const bake::Rooms rooms = bake::find_rooms(scenes::cornell_box_with_sun());
    ASSERT_EQ(rooms.boxes.size(), 1u) << text_of(rooms);
    EXPECT_EQ(rooms.boxes[0].place.name, "room1");
    expect_box(rooms.boxes[0], {-1, 0, -1}, {1, 2, 1});
}

TEST(Rooms, ARoundRoomIsNotTurned) {
    House house;
    house.slabs(-3, -3, 3, 3);
    for (int i = 0; i < 36; ++i)
        scenes::add_box(house.scene, house.white, {-0.3f, 0, 2}, {0.3f, 2.5f, 2.2f},
                        Facing::outward, turn_about({}, 10 * i + 3));
    const bake::Rooms rooms = bake::find_rooms(house.scene);
    ASSERT_EQ(rooms.boxes.size(), 1u) << text_of(rooms);
    expect_box(rooms.boxes[0], {-1.95, 0, -1.95}, {1.95, 2.5, 1.95});
}

TEST(Rooms, DoorsAndWindowsDoNotWidenABox) {
    House house = {two_rooms()}; // thick walls beside both rooms, with an opening each
    house.wall({-1.2f, 0, 5.2f}, {9.3f, 2.5f, 5.4f});
    house.wall({-1.2f, -0.2f, -0.2f}, {0, 0, 5.2f});
    house.wall({-1.2f, 2.5f, -0.2f}, {0, 2.7f, 5.2f});
    house.wall({-1.2f, 0, -0.2f}, {-0.2f, 0.9f, 5.2f});
    house.wall({-1.2f, 2, -0.2f}, {-0.2f, 2.5f, 5.2f});
    house.wall({-1.2f, 0.9f, -0.2f}, {-0.2f, 2, 2});
    house.wall({-1.2f, 0.9f, 3.1f}, {-0.2f, 2, 5.2f});
    const bake::Rooms rooms = bake::find_rooms(house.scene);
    ASSERT_EQ(rooms.boxes.size(), 2u) << text_of(rooms);
    expect_box(rooms.boxes[0], {4.1, 0, 0}, {9.1, 2.5, 5}, 0.2);
    expect_box(rooms.boxes[1], {0, 0, 0}, {4, 2.5, 5}, 0.2);
}

TEST(Rooms, WhatNoLightGetsIntoIsNone) {
    // A block of walls that have two fronts: from within nothing tells it from a room.
    House house = {two_rooms()};
    const int both = scenes::add_material(house.scene, glm::vec3(0.7f), glm::vec3(0.0f), true);
    scenes::add_box(house.scene, both, {5.6f, 0, 1.6f}, {7.4f, 2.3f, 3.4f}, Facing::outward);
    EXPECT_EQ(bake::find_rooms(house.scene).boxes.size(), 3u) << "there is no light at all";
    const auto lit = [&](const auto& by) {
        Scene scene = house.scene;
        by(scene);
        return bake::find_rooms(scene);
    };
    for (const bake::Rooms& rooms :
         {lit([](Scene& scene) { scene.sky.luminance = glm::vec3(1000.0f); }),
          lit([](Scene& scene) {
              scene.lights = {scenes::point_light({2, 2, 2}, 100)};
          })}) {
        EXPECT_EQ(rooms.boxes.size(), 2u) << text_of(rooms);
        EXPECT_NE(rooms.detail.find("1 more"), std::string::npos) << rooms.detail;
    }
    // With a lamp in it, or a pane that glows, it is one.
    EXPECT_EQ(lit([](Scene& scene) {
                  scene.lights = {scenes::point_light({2, 2, 2}, 100),
                                  scenes::point_light({6.5, 2, 2.5}, 100)};
              }).boxes.size(),
              3u);
    EXPECT_EQ(lit([](Scene& scene) {
                  const int glow = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(100.0f));
                  scenes::add_quad(scene, glow, {6, 2.2f, 2}, {1, 0, 0}, {0, 0, 1});
              }).boxes.size(),
              1u)
        << "without light in the others";
}

TEST(Rooms, ATurnedHouseHasTurnedBoxes) {
    for (const double degrees : {30.0, -20.0}) {
        const double turn = glm::radians(degrees);
        const Scene house =
            scene::turned(two_rooms(), glm::mat3_cast(glm::angleAxis(turn, glm::dvec3(0, 1, 0))),
                          glm::dvec3(3, 0, 1));
        const bake::Rooms rooms = bake::find_rooms(house);
        ASSERT_EQ(rooms.boxes.size(), 2u) << text_of(rooms);
        for (const volume::VolumeBox& box : rooms.boxes) {
            EXPECT_NEAR(2 * std::asin(box.turn.y), turn, 0.01) << degrees;
            EXPECT_EQ(box.turn.x, 0);
        }
        const glm::dvec3 size = rooms.boxes[0].hi - rooms.boxes[0].lo;
        EXPECT_NEAR(size.x, 5.2, 0.2);
        EXPECT_NEAR(size.z, 5.2, 0.2);
        // A quarter turn more is the same box.
        const glm::dvec3 other = rooms.boxes[1].hi - rooms.boxes[1].lo;
        EXPECT_NEAR(other.x, 4.4, 0.3); // with the window's reveal
    }
}

TEST(Rooms, AnOpenSceneIsOneVolume) {
    House yard;
    yard.wall({-10, -0.2f, -10}, {10, 0, 10});
    yard.wall({-2, 0, -2}, {2, 4, 2});
    yard.wall({4, 0, -8}, {4.2f, 3, 8});
    const bake::Rooms rooms = bake::find_rooms(yard.scene);
    ASSERT_EQ(rooms.boxes.size(), 1u) << text_of(rooms);
    EXPECT_EQ(rooms.boxes[0].place.name, "all");
    EXPECT_LT(glm::distance(rooms.boxes[0].lo, glm::dvec3(-10, -0.2, -10)), 1e-5);
    EXPECT_LT(glm::distance(rooms.boxes[0].hi, glm::dvec3(10, 4, 10)), 1e-5);
}

TEST(Rooms, AreTheSameOnAnyNumberOfThreads) {
    const bake::Rooms one = bake::find_rooms(two_rooms());
    const tbb::global_control single(tbb::global_control::max_allowed_parallelism, 1);
    const bake::Rooms two = bake::find_rooms(two_rooms());
    ASSERT_EQ(one.boxes.size(), two.boxes.size());
    for (std::size_t i = 0; i < one.boxes.size(); ++i) {
        EXPECT_EQ(one.boxes[i].lo, two.boxes[i].lo);
        EXPECT_EQ(one.boxes[i].hi, two.boxes[i].hi);
    }
}

} // namespace
} // namespace lpvbake
