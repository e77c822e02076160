// Rays against an oracle that tests every triangle, and against scenes whose answers are known.
#include "visibility/visibility.h"

#include "lpvbake/error.h"
#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace lpvbake {
namespace {

Scene random_soup(int triangles, uint32_t seed) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> at(0.0f, 10.0f), off(-1.0f, 1.0f);
    Mesh mesh;
    mesh.material = material;
    for (int i = 0; i < triangles; ++i) {
        const glm::vec3 p{at(random), at(random), at(random)};
        for (int k = 0; k < 3; ++k)
            mesh.positions.push_back(p + glm::vec3(off(random), off(random), off(random)));
        mesh.triangles.push_back(glm::uvec3(0, 1, 2) + uint32_t(3 * i));
    }
    scene.meshes.push_back(mesh);
    scene.instances.push_back({0, glm::dmat4(1.0)});
    return scene;
}

struct Met {
    double t;
    bool back;
};

/// Plane first, then three half-plane tests, in double.
std::vector<Met> brute_force(const Scene& scene, const visibility::Ray& ray) {
    std::vector<Met> met;
    const Mesh& mesh = scene.meshes[0];
    const glm::dvec3 o{ray.origin}, d{ray.direction};
    for (const glm::uvec3& v : mesh.triangles) {
        const glm::dvec3 a{mesh.positions[v.x]}, b{mesh.positions[v.y]}, c{mesh.positions[v.z]};
        const glm::dvec3 n = glm::cross(b - a, c - a);
        const double slope = glm::dot(n, d);
        if (slope == 0.0)
            continue;
        const double t = glm::dot(n, a - o) / slope;
        const glm::dvec3 p = o + t * d;
        if (t < double(ray.t_min) || t > double(ray.t_max)
            || glm::dot(glm::cross(b - a, p - a), n) < 0.0
            || glm::dot(glm::cross(c - b, p - b), n) < 0.0
            || glm::dot(glm::cross(a - c, p - c), n) < 0.0)
            continue;
        met.push_back({t, slope > 0.0});
    }
    std::sort(met.begin(), met.end(), [](const Met& a, const Met& b) { return a.t < b.t; });
    return met;
}

TEST(Visibility, AgreesWithBruteForce) {
    const Scene scene = random_soup(400, 1);
    const visibility::Visibility visibility(scene, scene::Frame{});
    std::mt19937 random(2);
    std::uniform_real_distribution<float> at(0.0f, 10.0f);
    std::vector<visibility::Crossing> crossings;
    int hits = 0, different = 0;
    for (int i = 0; i < 2000; ++i) {
        const glm::vec3 from{at(random), at(random), at(random)};
        const glm::vec3 to{at(random), at(random), at(random)};
        const visibility::Ray ray{from, to - from, 0.0f, 1.0f};
        const std::vector<Met> expected = brute_force(scene, ray);
        visibility.crossings(ray, crossings);
        const visibility::Hit hit = visibility.closest(ray);
        // Rays within rounding of an edge may differ; they are few.
        if (crossings.size() != expected.size()) {
            ++different;
            continue;
        }
        EXPECT_EQ(visibility.transmittance(ray), expected.empty() ? 1.0f : 0.0f);
        EXPECT_EQ(hit.instance == visibility::no_hit, expected.empty());
        for (size_t k = 0; k < expected.size(); ++k) {
            EXPECT_NEAR(double(crossings[k].t), expected[k].t, 1e-5);
            EXPECT_EQ(crossings[k].facing == visibility::Facing::back, expected[k].back);
            ++hits;
        }
        if (!expected.empty()) {
            EXPECT_NEAR(double(hit.t), expected[0].t, 1e-5);
            EXPECT_EQ(hit.facing == visibility::Facing::back, expected[0].back);
            const Mesh& mesh = scene.meshes[0];
            const glm::uvec3 v = mesh.triangles[hit.triangle];
            const glm::vec3 p = (1.0f - hit.barycentric.x - hit.barycentric.y) * mesh.positions[v.x]
                                + hit.barycentric.x * mesh.positions[v.y]
                                + hit.barycentric.y * mesh.positions[v.z];
            EXPECT_LT(glm::distance(p, from + hit.t * (to - from)), 1e-4f);
        }
    }
    EXPECT_GT(hits, 1000);
    EXPECT_LE(different, 2);
}

/// Squares of many sizes in a few turned planes, each with its front to one side or the other.
Scene squares_on_squares(uint32_t seed) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> at(0.0f, 1.0f);
    for (int plane = 0; plane < 3; ++plane) {
        const glm::dmat4 turned =
            glm::rotate(glm::translate(glm::dmat4(1.0), glm::dvec3(5.0, 5.0, 5.0)), 0.7 * plane,
                        glm::dvec3(1.0, 0.3 * plane, 0.2));
        for (int i = 0; i < 120; ++i) {
            const float edge = 0.2f + (i == 0 ? 9.0f : 2.0f * at(random) * at(random));
            const glm::vec3 corner((9.8f - edge) * at(random) - 5.0f,
                                   (9.8f - edge) * at(random) - 5.0f, 0.0f);
            const glm::vec3 u(edge, 0, 0), v(0, edge, 0);
            const bool up = random() & 1;
            scenes::add_quad(scene, material, corner, up ? u : v, up ? v : u, turned);
        }
    }
    return scene;
}

TEST(Visibility, OfSurfacesInOnePlaceAFrontComesBeforeABack) {
    const Scene scene = squares_on_squares(3);
    const visibility::Visibility visibility(scene, scene::Frame{});
    std::mt19937 random(4);
    std::uniform_real_distribution<float> at(0.0f, 10.0f);
    std::vector<visibility::Hit> sheets;
    int backs = 0, before_backs = 0;
    for (int i = 0; i < 20000; ++i) {
        const glm::vec3 from{at(random), at(random), at(random)};
        const visibility::Ray ray{from, glm::vec3{at(random), at(random), at(random)} - from, 0.0f,
                                  HUGE_VALF};
        const visibility::Hit hit = visibility.closest(ray);
        if (hit.instance == visibility::no_hit)
            continue;
        const glm::vec3 place = from + hit.t * ray.direction;
        const bool is_back = hit.facing == visibility::Facing::back;
        const glm::vec3 against = is_back ? -hit.normal : hit.normal;
        visibility.sheets_at(place, against, visibility::same_place(place), sheets);
        const auto fronts = std::ranges::count_if(sheets, [](const visibility::Hit& sheet) {
            return sheet.facing == visibility::Facing::front;
        });
        if (is_back) {
            ++backs;
            EXPECT_EQ(fronts, 0);
        } else {
            before_backs += size_t(fronts) < sheets.size();
        }
    }
    EXPECT_GT(backs, 1000);
    EXPECT_GT(before_backs, 1000);
}

TEST(Visibility, ClosedBoxIsTightAtEdgesAndCorners) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), glm::vec3(0.0f),
                    glm::vec3(1.0f), scenes::Facing::outward);
    const visibility::Visibility visibility(scene, scene::Frame{});
    for (int x = 0; x <= 8; ++x)
        for (int y = 0; y <= 8; ++y)
            for (int z = 0; z <= 8; ++z) {
                const glm::vec3 to = glm::vec3(x, y, z) / 8.0f;
                const glm::vec3 away = to - glm::vec3(0.5f);
                if (std::max({std::abs(away.x), std::abs(away.y), std::abs(away.z)}) < 0.5f)
                    continue; // not on the box
                const visibility::Ray ray{glm::vec3(0.5f), away, 0.0f, 4.0f};
                EXPECT_EQ(visibility.transmittance(ray), 0.0f) << x << ' ' << y << ' ' << z;
                EXPECT_EQ(visibility.closest(ray).facing, visibility::Facing::back);
            }
}

TEST(Visibility, MirroredInstanceKeepsItsFrontAndItsBarycentrics) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_quad(scene, material, {0, 0, 0}, {1, 0, 0}, {0, 1, 0},
                     glm::scale(glm::dmat4(1.0), glm::dvec3(-1, 1, 1)));
    const visibility::Visibility visibility(scene, scene::Frame{});
    const visibility::Ray ray{{-0.7f, 0.2f, 1.0f}, {0, 0, -1}, 0.0f, 2.0f};
    const visibility::Hit hit = visibility.closest(ray);
    ASSERT_NE(hit.instance, visibility::no_hit);
    EXPECT_EQ(hit.facing, visibility::Facing::front); // the quad faces +Z before and after
    EXPECT_NEAR(hit.normal.z, 1.0f, 1e-6f);
    const Mesh& mesh = scene.meshes[0];
    const glm::uvec3 v = mesh.triangles[hit.triangle];
    const glm::vec3 p = (1.0f - hit.barycentric.x - hit.barycentric.y) * mesh.positions[v.x]
                        + hit.barycentric.x * mesh.positions[v.y]
                        + hit.barycentric.y * mesh.positions[v.z];
    EXPECT_NEAR(p.x, 0.7f, 1e-5f);
    EXPECT_NEAR(p.y, 0.2f, 1e-5f);
}

TEST(Visibility, BlendedLayersMultiply) {
    Scene scene;
    const int glass = scenes::add_material(scene, glm::vec3(0.5f));
    scene.materials[size_t(glass)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(glass)].base_color.w = 0.25f;
    for (int i = 0; i < 3; ++i)
        scenes::add_quad(scene, glass, {0, 0, float(i)}, {1, 0, 0}, {0, 1, 0});
    const visibility::Visibility visibility(scene, scene::Frame{});
    const visibility::Ray ray{{0.3f, 0.6f, -1.0f}, {0, 0, 1}, 0.0f, 4.0f};
    EXPECT_FLOAT_EQ(visibility.transmittance(ray), 0.75f * 0.75f * 0.75f);
    // Stochastic nearest hits meet the first layer with probability alpha.
    std::mt19937 random(3);
    std::uniform_real_distribution<float> at(0.0f, 1.0f);
    int first = 0;
    for (int i = 0; i < 4000; ++i)
        first +=
            visibility.closest({{at(random), at(random), -1.0f}, {0, 0, 1}, 0.0f, 1.5f}).instance
            != visibility::no_hit;
    EXPECT_NEAR(first / 4000.0, 0.25, 0.03);
}

TEST(Visibility, CulledBacksAreNotThere) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {0, 0, 0}, {1, 0, 0},
                     {0, 1, 0});
    const visibility::Ray to_front{{0.3f, 0.6f, 1.0f}, {0, 0, -1}, 0.0f, 2.0f};
    const visibility::Ray to_back{{0.3f, 0.6f, -1.0f}, {0, 0, 1}, 0.0f, 2.0f};
    EXPECT_EQ(visibility::Visibility(scene, scene::Frame{}).transmittance(to_back), 0.0f);
    scene.rules.cull_backfaces = true;
    const visibility::Visibility visibility(scene, scene::Frame{});
    EXPECT_EQ(visibility.transmittance(to_back), 1.0f);
    EXPECT_EQ(visibility.closest(to_back).instance, visibility::no_hit);
    EXPECT_EQ(visibility.transmittance(to_front), 0.0f);
}

TEST(Visibility, FrameMakesTinyAndFarScenesAlike) {
    for (const double scale : {1e-4, 1.0, 1e4})
        for (const double offset : {0.0, 1e3, 1e6}) {
            if (offset > 0.0 && scale < 1e-3)
                continue; // below what a double tells apart at that distance
            Scene scene;
            scenes::add_quad(
                scene, scenes::add_material(scene, glm::vec3(0.5f)), {0, 0, 0}, {1, 0, 0},
                {0, 1, 0},
                glm::scale(glm::translate(glm::dmat4(1.0), glm::dvec3(offset)), glm::dvec3(scale)));
            const scene::Frame frame{glm::dvec3(offset) - 0.5 * scale, scale, glm::dvec3(2.0)};
            const visibility::Visibility visibility(scene, frame);
            const visibility::Hit hit =
                visibility.closest({{0.9f, 0.9f, 1.5f}, {0, 0, -1}, 0.0f, 10.0f});
            ASSERT_NE(hit.instance, visibility::no_hit) << scale << ' ' << offset;
            EXPECT_NEAR(hit.t, 1.0f, 1e-5f);
        }
}

TEST(Visibility, EightsAnswerAsSingleRays) {
    for (const bool cull : {false, true})
        for (const visibility::Bundle bundle :
             {visibility::Bundle::loose, visibility::Bundle::tight}) {
            // Opaque, blended, cut out by a vertex's alpha, and double-sided triangles.
            Scene scene = random_soup(150, 4);
            scene.rules.cull_backfaces = cull;
            scene.materials.resize(4, scene.materials[0]);
            scene.materials[1].alpha_mode = AlphaMode::blend;
            scene.materials[1].base_color.a = 0.3f;
            scene.materials[2].alpha_mode = AlphaMode::mask;
            scene.materials[3].double_sided = true;
            for (int m = 1; m < 4; ++m) {
                scene.meshes.push_back(random_soup(150, uint32_t(4 + m)).meshes[0]);
                scene.meshes.back().material = m;
                if (m == 2)
                    for (size_t i = 0; i < 450; ++i)
                        scene.meshes.back().colors.push_back({1, 1, 1, i % 3 ? 0.0f : 1.0f});
                scene.instances.push_back({m, glm::dmat4(1.0)});
            }
            const visibility::Visibility visibility(scene, scene::Frame{});
            std::mt19937 random(6);
            std::uniform_real_distribution<float> at(0.0f, 10.0f);
            std::vector<visibility::Ray> rays(4003); // the last eight are not full
            for (visibility::Ray& ray : rays)
                ray = {{at(random), at(random), at(random)}, {}, 0.01f, 0.5f};
            for (visibility::Ray& ray : rays)
                ray.direction = glm::vec3(at(random), at(random), at(random)) - ray.origin;
            std::vector<visibility::Hit> hits(rays.size()), on_all_threads(rays.size());
            std::vector<glm::vec3> open(rays.size()), open_on_all_threads(rays.size());
            visibility.closest_of_eights(rays, bundle, hits);
            visibility.filter_of_eights(rays, bundle, open);
            visibility.closest(rays, on_all_threads);
            visibility.filter(rays, open_on_all_threads);
            std::array<int, 4> met{};
            int missed = 0, different = 0, partly = 0, on_threads = 0;
            for (size_t i = 0; i < rays.size(); ++i) {
                const visibility::Hit hit = visibility.closest(rays[i]);
                const float through = visibility.transmittance(rays[i]);
                on_threads += on_all_threads[i].triangle != hits[i].triangle
                              || open_on_all_threads[i] != open[i];
                if (hit.instance != hits[i].instance || hit.triangle != hits[i].triangle
                    || glm::vec3(through) != open[i]) {
                    ++different;
                    continue;
                }
                partly += through > 0.0f && through < 1.0f;
                if (hit.instance == visibility::no_hit) {
                    ++missed;
                    continue;
                }
                ++met[hit.instance];
                if (bundle == visibility::Bundle::loose) { // which kept rays rely on
                    EXPECT_EQ(hit.t, hits[i].t);
                    EXPECT_EQ(hit.barycentric, hits[i].barycentric);
                    EXPECT_EQ(hit.normal, hits[i].normal);
                }
                EXPECT_NEAR(hit.t, hits[i].t, 1e-5f);
                EXPECT_LT(glm::distance(hit.barycentric, hits[i].barycentric), 1e-4f);
                EXPECT_LT(glm::distance(hit.normal, hits[i].normal), 1e-5f);
                EXPECT_EQ(hit.facing, hits[i].facing);
            }
            EXPECT_LE(different, 4); // within rounding of an edge
            EXPECT_LE(on_threads, 4);
            EXPECT_GT(missed, 100);
            EXPECT_GT(partly, 100);
            for (const int count : met)
                EXPECT_GT(count, 30);
        }
}

TEST(Visibility, PackedRaysMeetWhatSingleRaysMeet) {
    const Scene scene = random_soup(400, 1);
    const visibility::Visibility visibility(scene, scene::Frame{});
    std::mt19937 random(7);
    std::uniform_real_distribution<float> at(0.0f, 10.0f);
    std::vector<visibility::Ray> rays(1001);
    int64_t hits = 0;
    for (visibility::Ray& ray : rays) {
        ray = {{at(random), at(random), at(random)}, {}, 0.0f, 0.3f};
        ray.direction = glm::vec3(at(random), at(random), at(random)) - ray.origin;
        hits += visibility.closest(ray).instance != visibility::no_hit;
    }
    EXPECT_GT(hits, 100);
    EXPECT_LT(hits, 900);
    visibility::PackedRays packed;
    packed.add(rays, visibility::Bundle::loose, false);
    packed.add(rays, visibility::Bundle::loose, true);
    packed.add({}, visibility::Bundle::loose, true);
    EXPECT_EQ(packed.size(), 2 * rays.size());
    EXPECT_NEAR(double(packed.trace(visibility)), double(2 * hits), 4);
    EXPECT_EQ(packed.trace(visibility), packed.trace(visibility));
}

TEST(Isa, AutomaticIsThatOfMostProcessors) {
    using visibility::Isa;
    static Isa best; // of the processor
    const auto has = [](Isa isa) { return isa <= best; };
    for (const Isa processor : {Isa::sse2, Isa::avx, Isa::avx2, Isa::avx512}) {
        best = processor;
        EXPECT_EQ(visibility::available(Isa::automatic, has), std::min(processor, Isa::avx2));
        EXPECT_EQ(visibility::available(processor, has), processor);
    }
    best = Isa::avx;
    try {
        visibility::available(Isa::avx512, has);
        FAIL() << "took what is not there";
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::argument);
        EXPECT_STREQ(error.what(), "`isa` avx512: this processor does not have it; it has avx");
    }
    for (const Isa isa : visibility::isas)
        EXPECT_EQ(visibility::isa_named(visibility::name_of(isa)), isa);
    EXPECT_FALSE(visibility::isa_named("avx3"));
}

TEST(Isa, AllMeetTheSameSurfaces) {
    const Scene scene = random_soup(400, 1);
    std::mt19937 random(7);
    std::uniform_real_distribution<float> at(0.0f, 10.0f);
    std::vector<visibility::Ray> rays(4000);
    for (visibility::Ray& ray : rays)
        ray = {{at(random), at(random), at(random)},
               {at(random) - 5.0f, at(random) - 5.0f, at(random) - 5.0f}};
    std::vector<visibility::Hit> first;
    for (const visibility::Isa isa : visibility::isas) {
        if (!visibility::processor_has(isa))
            continue;
        const visibility::Visibility visibility(scene, scene::Frame{}, isa);
        const std::string name = visibility::name_of(visibility::available(isa));
        EXPECT_TRUE(visibility.tracer().starts_with("Embree ")) << visibility.tracer();
        EXPECT_TRUE(visibility.tracer().ends_with(" " + name)) << visibility.tracer();
        std::vector<visibility::Hit> hits(rays.size());
        visibility.closest_of_eights(rays, visibility::Bundle::loose, hits);
        if (first.empty())
            first = hits;
        int different = 0;
        for (size_t i = 0; i < rays.size(); ++i) {
            const visibility::Hit single = visibility.closest(rays[i]);
            EXPECT_EQ(single.triangle, hits[i].triangle) << name;
            EXPECT_EQ(single.t, hits[i].t) << name;
            EXPECT_EQ(single.barycentric, hits[i].barycentric) << name;
            different +=
                hits[i].triangle != first[i].triangle || hits[i].instance != first[i].instance;
            if (hits[i].triangle == first[i].triangle) {
                EXPECT_NEAR(hits[i].t, first[i].t, 1e-5f);
            }
        }
        EXPECT_LE(different, 4) << name; // within rounding of an edge
    }
}

TEST(Visibility, EmptySceneBlocksNothing) {
    const Scene scene;
    const visibility::Visibility visibility(scene, scene::Frame{});
    std::vector<glm::vec3> open(1);
    visibility.filter_of_eights(std::vector<visibility::Ray>{{{0, 0, 0}, {1, 0, 0}, 0.0f, 1e3f}},
                                visibility::Bundle::tight, open);
    EXPECT_EQ(open[0], glm::vec3(1.0f));
    EXPECT_EQ(visibility.transmittance({{0, 0, 0}, {1, 0, 0}, 0.0f, 1e3f}), 1.0f);
}

} // namespace
} // namespace lpvbake
