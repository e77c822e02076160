// A bake that takes from an earlier one what geometry decides is the same bake.
#include "bake/bake.h"
#include "cache/cache.h"
#include "gpu/device.h"
#include "scenes.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>
#include <random>

namespace lpvbake {
namespace {

/// Without files.
class MemoryCache final : public cache::Cache {
public:
    std::map<std::string, std::string> values;

private:
    std::optional<std::string> load(const std::string& key) override {
        const auto found = values.find(key);
        return found == values.end() ? std::nullopt : std::optional(found->second);
    }
    void store(const std::string& key, std::string_view value) override { values[key] = value; }
    std::string place_of(const std::string&) const override { return "memory"; }
};

class CachedBake : public testing::DeviceTest {
protected:
    Baked run(const Scene& scene, const char* solver, cache::Cache* cache) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.bounds = Bounds{{-1, 0, -1}, {1, 2, 1}};
        settings.grid.cell = 0.4;
        settings.solver.set_lighting_rays(1 << 14);
        settings.cache = cache;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        Progress silent;
        return bake::bake(scene, plan, device(), silent);
    }
    static void expect_same(const Volume& a, const Volume& b, const std::string& what) {
        EXPECT_TRUE(a.sh == b.sh) << what; // not to print them
        EXPECT_TRUE(a.validity == b.validity) << what;
        EXPECT_TRUE(a.walls == b.walls) << what;
        EXPECT_EQ(a.metadata, b.metadata) << what;
    }
    /// Of a stage, or of all.
    static cache::Cache::Counts counts(const Baked& baked, std::string_view stage = {}) {
        cache::Cache::Counts sum;
        for (const StageReport& report : baked.stages)
            if (stage.empty() || report.name == stage) {
                sum.reused += report.reused;
                sum.made += report.made;
            }
        return sum;
    }
    /// A lamp, a sun, something that glows, a pane of amber glass and a sky.
    static Scene room() {
        Scene scene = scenes::cornell_box_with_sun();
        scene.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 200));
        scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(300.0f)),
                        {-0.9f, 1.2f, -0.9f}, {-0.8f, 1.4f, -0.8f}, scenes::Facing::outward);
        const int glass = scenes::add_material(scene, {0.9f, 0.6f, 0.2f}, {}, true);
        scene.materials[size_t(glass)].transmission = 0.75f;
        scenes::add_quad(scene, glass, {-0.3f, 0.0f, 0.8f}, {0.6f, 0, 0}, {0, 0.9f, 0});
        scene.sky.luminance = {50.0f, 60.0f, 90.0f};
        return scene;
    }
    /// The same in other light.
    static std::vector<std::pair<std::string, Scene>> relit() {
        std::vector<std::pair<std::string, Scene>> scenes;
        const auto add = [&](const char* what, auto change) {
            scenes.emplace_back(what, room());
            change(scenes.back().second);
        };
        add("intensity", [](Scene& s) { s.lights[1].intensity *= 0.37; });
        add("colour", [](Scene& s) { s.lights[0].color = {1.0f, 0.4f, 0.1f}; });
        add("position", [](Scene& s) { s.lights[1].position = {-0.5, 0.9, 0.2}; });
        add("direction",
            [](Scene& s) { s.lights[0].direction = glm::normalize(glm::dvec3(0.5, -0.6, -0.4)); });
        add("no lamp", [](Scene& s) { s.lights.pop_back(); });
        add("another lamp", [](Scene& s) {
            s.lights.push_back(scenes::spot_light({0.0, 1.5, 0.7}, {0.2, -1, 0.1}, 500, 0.05, 0.1));
        });
        add("sky", [](Scene& s) { s.sky.luminance = {300.0f, 10.0f, 0.0f}; });
        add("emission", [](Scene& s) {
            for (Material& material : s.materials)
                material.emission *= glm::vec3(0.3f, 2.0f, 1.0f);
        });
        return scenes;
    }
};

TEST_F(CachedBake, IsTheSameInOtherLight) {
    for (const char* solver : {"gather", "sn", "lpv"}) {
        MemoryCache cache;
        const Baked cold = run(room(), solver, &cache);
        expect_same(run(room(), solver, nullptr).volume, cold.volume, solver);
        EXPECT_EQ(counts(cold).reused, 0u);
        const Baked again = run(room(), solver, &cache);
        EXPECT_EQ(counts(again).made, 0u) << solver;
        expect_same(cold.volume, again.volume, solver);
        const auto kept = cache.values;
        std::vector<std::pair<std::string, Scene>> scenes = relit();
        if (solver != std::string("gather"))
            scenes = {scenes[0], scenes[2]}; // the lighting is the same
        for (const auto& [what, scene] : scenes) {
            cache.values = kept;
            const Baked warm = run(scene, solver, &cache);
            const std::string of = std::string(solver) + ", " + what;
            const Baked plain = run(scene, solver, nullptr);
            expect_same(plain.volume, warm.volume, of);
            EXPECT_FALSE(cold.volume.sh == warm.volume.sh) << of;
            EXPECT_EQ(counts(warm, "validity").made, 0u) << of;
            EXPECT_EQ(counts(warm, "walls").made, 0u) << of;
            if (what == "intensity" || what == "colour") {
                EXPECT_EQ(counts(warm).made, 0u) << of;
            }
            EXPECT_GE(counts(warm, "lighting").reused, 2u) << of;
            EXPECT_EQ(warm.warnings, plain.warnings) << of;
        }
        expect_same(run(room(), solver, &cache).volume, cold.volume, solver); // after the last one
    }
}

TEST_F(CachedBake, IsTheSameForAnyNumberOfThreads) {
    MemoryCache one, many;
    {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        run(room(), "gather", &one);
    }
    run(room(), "gather", &many);
    EXPECT_TRUE(one.values == many.values);
}

TEST_F(CachedBake, TakesNothingFromAnotherScene) {
    MemoryCache cache;
    run(room(), "gather", &cache);
    std::vector<Scene> others(5, room());
    others[0].meshes[0].positions[0].x += 1e-3f;
    others[1].materials[0].base_color.x *= 0.5f;
    others[2].rules.cull_backfaces = true;
    others[3].instances.back().role = Role::receive_only;
    others[4].instances.pop_back();
    for (const Scene& other : others) {
        const Baked baked = run(other, "gather", &cache);
        EXPECT_EQ(counts(baked).reused, 0u);
        expect_same(run(other, "gather", nullptr).volume, baked.volume, "another scene");
    }
}

TEST_F(CachedBake, MakesAnewWhatIsNoSuchValue) {
    // What comes with a right hash may still be anything.
    MemoryCache cache;
    const Baked cold = run(room(), "gather", &cache);
    const auto kept = cache.values;
    std::mt19937 random(3);
    for (const auto& [key, value] : kept)
        for (const int kind : {0, 1, 2, 3}) {
            cache.values = kept;
            std::string& bytes = cache.values[key];
            if (kind == 0)
                bytes.resize(random() % bytes.size());
            else if (kind == 1)
                bytes.clear();
            else if (kind == 2)
                bytes += '\0';
            else // numbers that are too large for any index
                std::fill(bytes.begin() + ptrdiff_t(bytes.size() / 2), bytes.end(), '\x7f');
            const Baked baked = run(room(), "gather", &cache);
            if (kind == 3)
                continue; // it does not crash; as a number it may be right
            EXPECT_EQ(counts(baked).made, 1u);
            expect_same(cold.volume, baked.volume, "damaged");
            EXPECT_EQ(baked.warnings.size(), cold.warnings.size() + 1);
        }
}

} // namespace
} // namespace lpvbake
