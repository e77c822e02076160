// Surfaces with a role, in bakes and in the truth that these are measured by.
#include "bake/bake.h"
#include "gpu/device.h"
#include "readers/readers.h"
#include "reference/reference.h"
#include "scene/frame.h"
#include "scenes.h"
#include "surface/side_points.h"
#include "volume/compare.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

const Bounds room{{-1, 0, -1}, {1, 2, 1}};

/// A Cornell box, lit by a lamp, in which a large panel that glows stands across the middle.
Scene with_panel(std::optional<Role> role) {
    Scene scene = scenes::cornell_box_with_point(100);
    if (role) {
        scenes::add_quad(
            scene,
            scenes::add_material(scene, glm::vec3(0.7f, 0.2f, 0.1f), glm::vec3(20, 10, 5), true),
            {-0.8f, 0.9f, -0.8f}, {0, 0, 1.6f}, {1.6f, 0.2f, 0});
        scene.instances.back().role = *role;
    }
    return scene;
}

class BakedRoles : public testing::DeviceTest {
protected:
    /// `exact`: no clusters and no interpolation, of `gather`.
    Volume run(const Scene& scene, const char* solver, const std::string& fit = "",
               bool exact = false) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.bounds = room;
        settings.grid.cell = 0.2;
        settings.grid.margin = 0;
        if (!fit.empty())
            settings.fit = readers::reader_named(fit);
        if (exact) {
            settings.solver.set("tolerance", 0);
            settings.solver.set("vpls", 100000);
        }
        Progress silent;
        return bake::bake(scene, bake::plan_bake(bake::survey(scene), settings, device().info()),
                          device(), silent)
            .volume;
    }
    static Volume truth(const Scene& scene, const Grid& grid, uint64_t rays = 256) {
        reference::ReferenceSettings settings;
        settings.paths.bounces.reset();
        settings.sh_order = 2;
        settings.rays = rays;
        Progress silent;
        return reference::make_reference(scene, grid, settings, silent).volume;
    }
    static double error(const Volume& volume, const Volume& reference) {
        return volume::compare(volume, reference, {}).relative_l1;
    }
};

TEST_F(BakedRoles, WhatReceivesAloneChangesNothing) {
    const Scene scene = with_panel(Role::receive_only), without = with_panel({});
    for (const char* solver : {"sn", "gather", "lpv"}) {
        const Volume a = run(scene, solver), b = run(without, solver);
        EXPECT_EQ(a.sh, b.sh) << solver;
        EXPECT_EQ(a.validity, b.validity) << solver;
        EXPECT_EQ(a.walls, b.walls) << solver;
        EXPECT_NE(a.sh, run(with_panel(Role::full), solver).sh) << solver;
    }
    const Grid grid = run(without, "gather").grid;
    EXPECT_EQ(truth(scene, grid).sh, truth(without, grid).sh);
}

TEST_F(BakedRoles, WhatCastsAloneIsBlack) {
    const Scene scene = with_panel(Role::cast_only);
    Scene black = with_panel(Role::full);
    Material& material = black.materials.back();
    material.base_color = {0, 0, 0, 1};
    material.emission = glm::vec3(0);
    for (const char* solver : {"sn", "gather", "lpv"})
        EXPECT_EQ(run(scene, solver).sh, run(black, solver).sh) << solver;
    const Grid grid = run(scene, "gather").grid;
    EXPECT_EQ(truth(scene, grid).sh, truth(black, grid).sh);
}

/// Panels before each other: what shines alone is not in the way of the other, nor of itself.
TEST_F(BakedRoles, WhatShinesAloneHidesNothing) {
    const auto panels = [](bool low, bool high, Role role) {
        Scene scene;
        const auto add = [&](float y, float side, glm::vec3 emission) {
            scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0), emission, true),
                             {-side, y, -side}, {0, 0, 2 * side}, {2 * side, 0, 0});
            scene.instances.back().role = role;
        };
        if (low)
            add(0.61f, 0.9f, {5, 0, 1});
        if (high)
            add(1.27f, 0.6f, {0, 8, 1});
        // Something that is there.
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0)), {-1, -0.5f, -1},
                         {0, 0, 2}, {2, 0, 0});
        return scene;
    };
    const auto differ = [](const Volume& both, const Volume& a, const Volume& b) {
        double most = 0, all = 0;
        for (std::size_t i = 0; i < both.grid.size(); ++i) {
            all = std::max(all, double(both.sh[0][i].z));
            for (std::size_t k = 0; k < both.sh.size(); ++k)
                most = std::max(most, double(glm::length(both.sh[k][i] - a.sh[k][i] - b.sh[k][i])));
        }
        return most / all;
    };
    const auto field = [&](bool low, bool high, Role role) {
        return run(panels(low, high, role), "gather", "", true);
    };
    const auto beside = [&](Role role) {
        return differ(field(true, true, role), field(true, false, role), field(false, true, role));
    };
    EXPECT_LT(beside(Role::lights_only), 0.002);
    EXPECT_GT(beside(Role::full), 0.2);
    const Scene scene = panels(true, true, Role::lights_only);
    const Volume gathered = field(true, true, Role::lights_only);
    const Volume paths = truth(scene, gathered.grid, 4096);
    EXPECT_LT(error(gathered, paths), 0.06); // close to a panel few paths are aimed at what matters
    EXPECT_EQ(run(scene, "sn").sh, run(scene, "gather").sh) << "all of it is gathered";
}

TEST_F(BakedRoles, BakesAgreeWithTheTruthOfEachRole) {
    const Grid grid = run(with_panel({}), "gather").grid;
    const Volume full = truth(with_panel(Role::full), grid);
    for (const Role role : {Role::cast_only, Role::lights_only}) {
        const Scene scene = with_panel(role);
        const Volume paths = truth(scene, grid, 1024);
        for (const char* solver : {"sn", "gather"}) {
            const Volume field = run(scene, solver);
            EXPECT_LT(error(field, paths), 0.06) << solver << " " << scene::name_of(role);
            EXPECT_GT(error(field, full), 0.2) << solver << " " << scene::name_of(role);
        }
    }
}

TEST_F(BakedRoles, VolumesAreFittedToWhatIsAsked) {
    const auto points_on_panel = [](Role role) {
        const Scene scene = with_panel(role);
        const scene::Frame frame = scene::frame_of(Grid{room.lo, 0.2, glm::ivec3(10)});
        const visibility::Visibility visibility(scene, frame);
        Progress silent;
        const surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, frame, {}, silent);
        const glm::vec3 panel =
            glm::normalize(glm::cross(glm::vec3(0, 0, 1.6f), glm::vec3(1.6f, 0.2f, 0)));
        std::size_t count = 0;
        for (const surface::SidePoint& point :
             surface::draw_side_points(lit, glm::vec3(frame.extent), {}).points)
            count += std::abs(glm::dot(point.normal, panel)) > 0.999f;
        return count;
    };
    EXPECT_GT(points_on_panel(Role::full), 400u);
    EXPECT_GT(points_on_panel(Role::receive_only), 400u);
    EXPECT_EQ(points_on_panel(Role::cast_only), 0u);
    EXPECT_EQ(points_on_panel(Role::lights_only), 0u);
    // Light on it is what the field has there: the fit learns of it.
    EXPECT_NE(run(with_panel(Role::receive_only), "gather", "unity").sh,
              run(with_panel({}), "gather", "unity").sh);
}

TEST_F(BakedRoles, BoxesSetValidityAndBrightness) {
    const Scene scene = with_panel({});
    const auto adjusted = [&](std::vector<volume::Adjustment> boxes, const std::string& fit) {
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.bounds = room;
        settings.grid.cell = 0.2;
        settings.grid.margin = 0;
        settings.adjust = std::move(boxes);
        if (!fit.empty())
            settings.fit = readers::reader_named(fit);
        Progress silent;
        return bake::bake(scene, bake::plan_bake(bake::survey(scene), settings, device().info()),
                          device(), silent);
    };
    const Volume plain = run(scene, "gather");
    const std::vector<volume::Adjustment> valid{{{-1, 1.2, -1}, {1, 1.6, 1}, false, 1, {}},
                                                {{-0.6, 1.2, -1}, {1, 1.6, 1}, true, 1, {}}};
    std::vector<volume::Adjustment> all = valid;
    all.push_back({{-1, 1.6, -1}, {1, 2, 1}, {}, 3, {}});
    const Volume darker = adjusted(valid, "").volume, changed = adjusted(all, "").volume;
    for (std::size_t i = 0; i < plain.grid.size(); ++i) {
        const glm::ivec3 cell = plain.grid.cell_at(i);
        const bool layer = cell.y == 6 || cell.y == 7;
        EXPECT_EQ(changed.validity[i], !layer       ? plain.validity[i]
                                       : cell.x < 2 ? 0.0f
                                                    : 1.0f)
            << cell.x << " " << cell.y << " " << cell.z;
        EXPECT_EQ(changed.sh[0][i], darker.sh[0][i] * (cell.y >= 8 ? 3.0f : 1.0f));
    }
    EXPECT_EQ(changed.metadata.at("adjust"),
              "-1,1.2,-1,1,1.6,1 invalid; -0.6,1.2,-1,1,1.6,1 valid; "
              "-1,1.6,-1,1,2,1 intensity 3");
    // Light that is turned up is not fitted away.
    const Volume fitted = run(scene, "gather", "unity");
    EXPECT_EQ(adjusted({{{-1, 0, -1}, {1, 2, 1}, {}, 2, {}}}, "unity").volume.sh[0][200],
              2.0f * fitted.sh[0][200]);
    const std::vector<std::string> warnings =
        adjusted({{{5, 0, 0}, {6, 1, 1}, true, 1, {}}}, "").warnings;
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_NE(warnings[0].find("boxes[0], 5,0,0,6,1,1 valid"), std::string::npos) << warnings[0];
}

} // namespace
} // namespace lpvbake
