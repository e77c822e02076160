#include "bake/contested.h"

#include "scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lpvbake {
namespace {

constexpr double cell = 0.5; ///< metres
constexpr glm::dvec3 up(0, 1, 0);

/// Eight cells along each axis that show `shown` lux everywhere, from all directions alike.
Volume even(double shown) {
    Volume volume;
    volume.grid = {{-1, 0, 2}, cell, glm::ivec3(8)};
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.sh[0].assign(volume.grid.size(),
                        glm::vec3(float(shown) / (float(std::numbers::pi) * volume::sh_y0)));
    return volume;
}

/// Points by places in cells, and what stands there.
struct Place {
    Scene scene;
    int material = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    std::vector<readers::FitPoint> points;

    static glm::dvec3 metres(glm::dvec3 p) { return glm::dvec3(-1, 0, 2) + cell * p; }
    void stand(glm::dvec3 corner, glm::dvec3 u, glm::dvec3 v) {
        scenes::add_quad(scene, material, glm::vec3(metres(corner)), glm::vec3(cell * u),
                         glm::vec3(cell * v));
    }
    void floor(double y) { stand({0, y, 0}, {0, 0, 8}, {8, 0, 0}); }

    /// Sixteen points a face from (x, z) to (x_end, 6).
    void light(double y, double x, double x_end, double lux, glm::dvec3 normal = up) {
        for (double at = x + 0.125; at < x_end; at += 0.25)
            for (double z = 2.125; z < 6; z += 0.25)
                points.push_back({metres({at, y, z}), normal, 1.0 / 16, glm::dvec3(lux)});
    }

    bake::Contested contested(double shown, const char* reader = "unity") const {
        const Volume volume = even(shown);
        const scene::Frame frame = scene::frame_of(volume.grid);
        const visibility::Visibility visibility(scene, frame);
        return bake::find_contested(*readers::reader_named(reader), volume, points, visibility);
    }
};

TEST(Contested, StoreysNeedCellsOfTheirDistance) {
    for (const double gap : {0.6, 0.9, 1.3}) {
        Place place;
        place.floor(2.2);
        place.floor(2.2 + gap);
        place.light(2.2, 2, 6, 1);
        place.light(2.2 + gap, 2, 6, 0);
        const bake::Contested contested = place.contested(0.5);
        EXPECT_NEAR(contested.share, gap < 1 ? 1 : 0, 1e-4) << gap; // half of it on each floor
        EXPECT_NEAR(contested.cell, std::min(gap, 1.0) * cell, 1e-5) << gap;
    }
}

TEST(Contested, AWallOnAFloorLeavesAStripAsWideAsACell) {
    Place place;
    place.floor(2.2);
    place.light(2.2, 1, 4.03, 1);
    place.light(2.2, 4.03, 7, 0);
    EXPECT_EQ(place.contested(0.5).share, 0) << "an edge of a shadow";
    place.stand({4.03, 2.2, 0}, {0, 3, 0}, {0, 0, 8});
    const bake::Contested contested = place.contested(0.5);
    // Points that have another behind the wall within a cell, of 3.03 cells of light.
    EXPECT_NEAR(contested.share, 0.5 * 1.8 / 3.03, 0.05);
    EXPECT_NEAR(contested.cell, cell * bake::contested_most / contested.share, 1e-6);
    EXPECT_NEAR(contested.worst.x, Place::metres({4.03, 0, 0}).x, cell);
    EXPECT_EQ(contested.worst.y, Place::metres({0, 2.2, 0}).y);
}

TEST(Contested, IsWhatOtherLightOfTheSameCellsExplains) {
    Place place;
    place.floor(2.2);
    place.floor(2.8);
    place.light(2.2, 2, 6, 1);
    place.light(2.8, 2, 6, 0);
    EXPECT_GT(place.contested(0.5).share, 0.9);
    EXPECT_EQ(place.contested(2).share, 0) << "brighter than either";
    EXPECT_NEAR(place.contested(0.02).share, 0.98, 1e-3) << "little is felt on the dark one";
    EXPECT_EQ(place.contested(0.5, "lpvbake").share, 0) << "it reads cells before the surface";

    Place sides; // of one wall
    sides.floor(2.2);
    sides.light(2.2, 2, 6, 1);
    sides.light(2.2, 2, 6, 0, -up);
    EXPECT_EQ(sides.contested(0.5).share, 0) << "the bands tell them apart";

    for (readers::FitPoint& point : place.points)
        point.irradiance = glm::dvec3(0.0);
    const bake::Contested dark = place.contested(0.5);
    EXPECT_EQ(dark.share, 0);
    EXPECT_EQ(dark.cell, cell);
}

} // namespace
} // namespace lpvbake
