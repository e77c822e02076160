// What places of a zone see does not depend on who looks at the same time.
#include "solver/gather/zone.h"

#include "scenes.h"

#include <gtest/gtest.h>

#include <bit>
#include <random>

namespace lpvbake {
namespace {

using solver::gather::Zone;

TEST(Zone, PlacesSeeTogetherWhatEachSeesAlone) {
    Scene scene = scenes::cornell_box_with_point();
    scene.sky.luminance = glm::vec3(100.0f);
    const int pane = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scene.materials[size_t(pane)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(pane)].base_color.a = 0.5f;
    scenes::add_quad(scene, pane, {-0.5f, 1, -0.5f}, {1, 0, 0}, {0, 0, 1});
    const scene::Frame frame{glm::dvec3(-1.1, -0.1, -1.1), 0.1, glm::dvec3(22.0)};
    const visibility::Visibility visibility(scene, frame);
    Progress silent;
    const surface::LitSurfaces lit = surface::light_surfaces(scene, visibility, frame, {}, silent);
    const solver::gather::Clusters clusters = solver::gather::make_clusters(lit, visibility);
    const std::vector<solver::gather::SkyBin> sky = solver::gather::make_sky_bins(scene.sky, 16, 2);
    const solver::gather::Surroundings world{visibility, clusters, sky, 100, 1.0f};
    const Zone zone(world, glm::vec3(3.0f), glm::vec3(18.0f));
    ASSERT_GE(zone.words(), 2u);

    std::mt19937 random(11);
    std::uniform_real_distribution<float> inside(3.0f, 18.0f);
    // Sources that many places test, few, or one; more places than lanes, and fewer.
    for (const size_t count : {size_t(1), size_t(2), size_t(5), size_t(9), Zone::most_looks})
        for (const unsigned share : {1u, 3u, 20u}) {
            std::vector<std::vector<uint64_t>> open(count), together(count), alone(count);
            std::vector<Zone::Look> looks(count);
            uint64_t rays = 0, bits = 0;
            for (size_t i = 0; i < count; ++i) {
                open[i].assign(zone.words(), 0);
                for (size_t bit = 0; bit < 64 * zone.words(); ++bit)
                    open[i][bit / 64] |= uint64_t(random() % share == 0) << (bit % 64);
                together[i].assign(zone.words(), 0);
                alone[i].assign(zone.words(), 0);
                const glm::vec3 from(inside(random), inside(random), inside(random));
                looks[i] = {from, uint32_t(random()), open[i], together[i].data()};
                rays += zone.look(from, looks[i].pattern, open[i], alone[i].data());
            }
            EXPECT_EQ(zone.look(looks), rays);
            for (size_t i = 0; i < count; ++i) {
                EXPECT_EQ(together[i], alone[i]) << count << " " << share << " " << i;
                for (const uint64_t word : alone[i])
                    bits += uint64_t(std::popcount(word));
            }
            EXPECT_GT(bits, 0u);
        }
}

} // namespace
} // namespace lpvbake
