// Rays of a device against Embree's: alone, and in whole bakes.
#include "bake/bake.h"
#include "gpu/rays.h"
#include "gpu/vulkan.h"
#include "lpvbake/error.h"
#include "scenes.h"
#include "solver/gather/gather.h"
#include "solver/gather/zone.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <numeric>
#include <random>

namespace lpvbake {
namespace {

using visibility::Hit;
using visibility::Ray;
using visibility::Visibility;

/// A device that traces rays, with the validation layer on: the first there is, or a driver for the
/// CPU that .ci/install.sh has put beside the system's.
class Rays : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        if (std::filesystem::exists(LPVBAKE_RAYS_DRIVER))
            setenv("VK_DRIVER_FILES", LPVBAKE_RAYS_DRIVER, 0);
        try {
            shared = std::make_unique<gpu::Device>(gpu::DeviceOptions{"", true});
        } catch (const Error& error) {
            if (error.kind != ErrorKind::device)
                throw;
            reason = error.what();
        }
    }
    static void TearDownTestSuite() { shared.reset(); }
    void SetUp() override {
        if (!shared || !shared->info().traces_rays)
            GTEST_SKIP() << (shared ? shared->info().name + " traces no rays" : reason);
    }
    void TearDown() override {
        if (shared)
            try {
                shared->check_validation();
            } catch (const Error& error) {
                ADD_FAILURE() << error.what();
            }
    }
    static gpu::Device& device() { return *shared; }

private:
    inline static std::unique_ptr<gpu::Device> shared;
    inline static std::string reason;
};

/// Rays of any direction from places in a box, some of them short, some through all of it.
std::vector<Ray> random_rays(glm::vec3 lo, glm::vec3 hi, size_t count) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::normal_distribution<float> normal;
    std::vector<Ray> rays;
    while (rays.size() < count) {
        const glm::vec3 from = lo + (hi - lo) * glm::vec3(unit(random), unit(random), unit(random));
        const glm::vec3 way =
            glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
        rays.push_back({from, (0.5f + unit(random)) * way, 0.0f,
                        rays.size() % 3 == 0 ? HUGE_VALF : 4.0f * unit(random)});
    }
    return rays;
}

/// How many answers differ by more than rounding.
size_t differing(const std::vector<Hit>& a, const std::vector<Hit>& b,
                 const std::vector<Ray>& rays) {
    size_t count = 0;
    for (size_t i = 0; i < a.size(); ++i) {
        const auto place = [&](const Hit& hit) {
            return rays[i].origin + hit.t * rays[i].direction;
        };
        const bool met = a[i].instance != visibility::no_hit;
        bool same = met == (b[i].instance != visibility::no_hit);
        if (same && met)
            same = glm::distance(place(a[i]), place(b[i])) < 1e-3f && a[i].facing == b[i].facing
                   && glm::distance(a[i].normal, b[i].normal) < 1e-3f;
        count += !same || glm::distance(a[i].tint, b[i].tint) > 1e-3f;
    }
    return count;
}

struct Compared {
    const char* name;
    Scene scene;
};

/// Solids, a heap of small triangles of both kinds of sides, glass, masks, and culled backs.
std::vector<Compared> compared() {
    std::vector<Compared> all;
    all.push_back({"box", scenes::cornell_box()});
    Scene heap;
    std::mt19937 random(7);
    std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
    const auto anywhere = [&] { return glm::vec3(unit(random), unit(random), unit(random)); };
    for (int i = 0; i < 300; ++i)
        scenes::add_quad(heap,
                         scenes::add_material(heap, glm::vec3(0.5f), glm::vec3(0.0f), i % 2 == 0),
                         2.0f * anywhere(), 0.3f * anywhere(), 0.3f * anywhere());
    all.push_back({"heap", heap});
    Scene culled = heap;
    culled.rules.cull_backfaces = true;
    all.push_back({"culled heap", culled});
    Scene leaves = heap;
    for (size_t i = 0; i < leaves.materials.size(); i += 3) {
        leaves.materials[i].alpha_mode = AlphaMode::blend;
        leaves.materials[i].base_color.w = 0.4f;
    }
    for (size_t i = 1; i < leaves.materials.size(); i += 3) {
        leaves.materials[i].base_color = {0.9f, 0.5f, 0.2f, 1.0f};
        leaves.materials[i].transmission = 0.7f;
    }
    all.push_back({"leaves and glass", leaves});
    all.push_back({"glass room", scenes::glass_room(true)});
    return all;
}

scene::Frame frame_around(const Scene& scene) {
    const Bounds box = bounds_of(scene);
    volume::GridSettings settings;
    settings.resolution = 16;
    return scene::frame_of(volume::fit_grid(box.lo, box.hi, settings));
}

TEST_F(Rays, AgreeWithEmbreeButAtEdges) {
    constexpr size_t count = 200'000; // more than a batch
    for (const Compared& each : compared()) {
        SCOPED_TRACE(each.name);
        const Visibility embree(each.scene, frame_around(each.scene));
        const Visibility both = bake::on_device(embree, device());
        const std::vector<Ray> rays = random_rays(embree.lo(), embree.hi(), count);
        std::vector<Hit> own(count), theirs(count);
        embree.closest(rays, own);
        both.closest_of_many(rays, theirs);
        const size_t hits = differing(own, theirs, rays);
        std::printf("%s: %zu hits of %zu differ\n", each.name, hits, count);
        // Of rays through an edge either side may answer.
        EXPECT_LT(hits, count / 10'000);
    }
}

/// How many bits of what places see are set, and how many differ.
struct Bits {
    size_t set = 0, differing = 0;
};

/// Of places anywhere in a box, which look at the lit surfaces and at the sky.
Bits bits_of_places(const Visibility& embree, const Visibility& both,
                    const surface::LitSurfaces& lit, const Sky& sky, uint64_t& rays) {
    namespace gather = solver::gather;
    const gather::Clusters clusters = gather::make_clusters(lit, embree);
    const std::vector<gather::SkyBin> bins = gather::make_sky_bins(sky, 16, 2);
    const gather::Surroundings one{embree, clusters, bins, 150, 1.0f},
        other{both, clusters, bins, 150, 1.0f};
    const gather::Zone own(one, embree.lo(), embree.hi()), theirs(other, embree.lo(), embree.hi());
    EXPECT_EQ(own.together(), 0u);
    EXPECT_GT(theirs.together(), gather::Zone::most_looks);
    constexpr size_t places = 2000; // more than a batch of rays
    const size_t words = own.words();
    std::mt19937 random(3);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::vector<uint64_t> open(words * places), seen(words * places), sees(words * places);
    std::vector<gather::Zone::Look> looks(places), looking(places);
    for (size_t i = 0; i < places; ++i) {
        for (size_t w = 0; w < words; ++w)
            open[i * words + w] = uint64_t(random()) << 32 | random();
        const glm::vec3 share(unit(random), unit(random), unit(random));
        looks[i] =
            looking[i] = {glm::mix(embree.lo(), embree.hi(), share), uint32_t(random()),
                          i % 2 ? std::span(open).subspan(i * words, words) : std::span<uint64_t>(),
                          seen.data() + i * words};
        looking[i].sees = sees.data() + i * words;
    }
    rays = own.look(looks);
    EXPECT_NEAR(double(theirs.look(looking)), double(rays), double(rays) / 10'000);
    Bits bits;
    for (size_t w = 0; w < seen.size(); ++w) {
        bits.set += size_t(std::popcount(seen[w]));
        bits.differing += size_t(std::popcount(seen[w] ^ sees[w]));
    }
    return bits;
}

TEST_F(Rays, OfPlacesSeeWhatEmbreesDoButAtEdges) {
    for (Compared& each : compared()) {
        SCOPED_TRACE(each.name);
        each.scene.sky.luminance = glm::vec3(100.0f);
        const scene::Frame frame = frame_around(each.scene);
        const Visibility embree(each.scene, frame);
        const Visibility both = bake::on_device(embree, device());
        Progress silent;
        surface::LightingSettings lighting;
        lighting.rays = 1 << 14;
        surface::LitSurfaces lit =
            surface::light_surfaces(each.scene, embree, frame, lighting, silent);
        scene::Frame finer = frame;
        finer.unit *= 0.5;
        finer.origin += 3.0 * frame.unit;
        const auto check = [&](const Visibility& one, const Visibility& other) {
            uint64_t rays = 0;
            const Bits bits = bits_of_places(one, other, lit, each.scene.sky, rays);
            std::printf("%s: %zu of %zu bits differ, of %zu rays\n", each.name, bits.differing,
                        bits.set, size_t(rays));
            EXPECT_LT(bits.differing, rays / 10'000);
            EXPECT_GT(bits.set, rays / 100); // there is something to tell apart
        };
        check(embree, both);
        const Visibility placed = embree.in_frame(frame, finer);
        lit = surface::in_frame(std::move(lit), frame, finer, placed);
        check(placed, both.in_frame(frame, finer));
    }
}

TEST_F(Rays, OfPlacesThatAreGivenGiveTheLightThatEmbreesDo) {
    Scene scene = scenes::cornell_box_with_point();
    scene.sky.luminance = {500.0f, 600.0f, 900.0f};
    const scene::Frame frame = frame_around(scene);
    const Visibility embree(scene, frame);
    Progress silent;
    const surface::LitSurfaces lit = surface::light_surfaces(scene, embree, frame, {}, silent);
    std::vector<glm::vec3> places;
    std::mt19937 random(9);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    while (places.size() < 1001)
        places.push_back(glm::mix(embree.lo(), embree.hi(),
                                  glm::vec3(unit(random), unit(random), unit(random))));
    const solver::gather::GatherProgram program(device(), {});
    const auto light_of = [&](const Visibility& visibility, uint64_t& rays) {
        Volume volume;
        volume.grid.dims = {int(places.size()), 1, 1};
        volume.validity.assign(places.size(), 1.0f);
        rays = program.gather_at(places, lit, scene.sky, visibility, volume, silent).rays;
        return volume;
    };
    uint64_t rays = 0, own_rays = 0;
    const Volume light = light_of(embree, rays);
    const Volume own = light_of(bake::on_device(embree, device()), own_rays);
    EXPECT_NEAR(double(own_rays), double(rays), double(rays) / 10'000);
    double off = 0.0, sum = 0.0;
    for (size_t i = 0; i < places.size(); ++i) {
        off += std::abs(double(own.sh[0][i].y) - double(light.sh[0][i].y));
        sum += double(light.sh[0][i].y);
    }
    EXPECT_GT(sum, 0.0);
    EXPECT_LT(off / sum, 0.005);
}

TEST_F(Rays, OfOneAreTheSameInAnyCompanyAndFrame) {
    const Compared heap = compared()[3];
    const scene::Frame frame = frame_around(heap.scene);
    const Visibility embree(heap.scene, frame);
    const Visibility both = bake::on_device(embree, device());
    const std::vector<Ray> rays = random_rays(embree.lo(), embree.hi(), 30'000);
    std::vector<Hit> together(rays.size()), apart(rays.size());
    both.closest_of_many(rays, together);
    tbb::parallel_for(size_t(0), rays.size() / 1000, [&](size_t i) {
        both.closest_of_many(std::span(rays).subspan(1000 * i, 1000),
                             std::span(apart).subspan(1000 * i, 1000));
    });
    for (size_t i = 0; i < rays.size(); ++i)
        ASSERT_TRUE(together[i].t == apart[i].t && together[i].triangle == apart[i].triangle
                    && together[i].instance == apart[i].instance
                    && together[i].tint == apart[i].tint)
            << i;
    scene::Frame other = frame;
    other.unit *= 2.0;
    const Visibility placed = both.in_frame(frame, other);
    EXPECT_EQ(placed.batch(), both.batch());
    std::vector<Ray> halved = rays;
    for (Ray& ray : halved) {
        ray.origin *= 0.5f;
        ray.direction *= 0.5f;
    }
    std::vector<Hit> there(rays.size());
    placed.closest_of_many(halved, there);
    for (size_t i = 0; i < rays.size(); ++i)
        ASSERT_EQ(there[i].t, together[i].t) << i;
}

TEST_F(Rays, ThatGoNowhereOrMeetNothingAreAnswered) {
    const Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    const Visibility both = bake::on_device(Visibility(scene, frame_around(scene)), device());
    const glm::vec3 above = 0.5f * (both.lo() + both.hi()) + glm::vec3(0, 1, 0);
    const std::vector<Ray> rays{{above, {0, 0, 0}, 0.0f, HUGE_VALF},
                                {above, {0, 1, 0}, 0.0f, HUGE_VALF},
                                {above, {0, -1, 0}, 0.0f, 0.5f},
                                {above, {0, -1, 0}, 2.0f, 1.0f},
                                {above, {0, -1, 0}, 0.0f, HUGE_VALF}};
    std::vector<Hit> hits(rays.size());
    both.closest_of_many(rays, hits);
    for (size_t i = 0; i < 4; ++i)
        EXPECT_EQ(hits[i].instance, visibility::no_hit) << i;
    EXPECT_NEAR(hits[4].t, 1.0f, 1e-5f);
    EXPECT_EQ(hits[4].facing, visibility::Facing::front);
    both.closest_of_many({}, {});
    Scene nothing = scene;
    for (Instance& instance : nothing.instances)
        instance.role = Role::receive_only;
    const Visibility empty = bake::on_device(Visibility(nothing, frame_around(scene)), device());
    EXPECT_EQ(empty.batch(), 0u);
}

TEST_F(Rays, OfBakesGiveTheLightThatEmbreesDo) {
    // Light of a sun, of the sky and of what glows, through amber glass, behind leaves.
    Scene scene = scenes::cornell_box_with_sun();
    scene.sky.luminance = {500.0f, 600.0f, 900.0f};
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(3000.0f)),
                    {-0.9f, 1.2f, -0.9f}, {-0.7f, 1.5f, -0.7f}, scenes::Facing::outward);
    const int glass = scenes::add_material(scene, {0.9f, 0.6f, 0.2f}, {}, true);
    scene.materials[size_t(glass)].transmission = 0.75f;
    scenes::add_quad(scene, glass, {-0.3f, 0.0f, 0.8f}, {0.6f, 0, 0}, {0, 0.9f, 0});
    for (const char* solver : {"gather", "sn"}) {
        SCOPED_TRACE(solver);
        const auto bake_with = [&](bake::Rays rays, int threads) {
            bake::BakeSettings settings(*bake::find_solver(solver));
            settings.grid.resolution = 12;
            settings.solver.set_lighting_rays(1 << 16);
            settings.rays = rays;
            const bake::BakePlan plan =
                bake::plan_bake(bake::survey(scene), settings, device().info());
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                            size_t(threads));
            Progress silent;
            return bake::bake(scene, plan, device(), silent).volume;
        };
        const Volume embree = bake_with(bake::Rays::embree, 2);
        const Volume own = bake_with(bake::Rays::device, 2);
        EXPECT_EQ(embree.metadata.at("tracer").find("rays by"), std::string::npos);
        EXPECT_NE(own.metadata.at("tracer").find(", rays by "), std::string::npos);
        EXPECT_TRUE(own.validity == embree.validity);
        EXPECT_TRUE(own.walls == embree.walls);
        double off = 0.0, sum = 0.0;
        for (size_t cell = 0; cell < own.grid.size(); ++cell) {
            off += std::abs(double(own.sh[0][cell].y) - double(embree.sh[0][cell].y));
            sum += double(embree.sh[0][cell].y);
        }
        std::printf("%s: %.3g %% of the light differs\n", solver, 100 * off / sum);
        EXPECT_GT(sum, 0.0);
        EXPECT_LT(off / sum, 0.005);
        EXPECT_GT(off, 0.0); // the device has traced
        const Volume again = bake_with(bake::Rays::device, 1);
        EXPECT_TRUE(again.sh == own.sh);
        EXPECT_EQ(again.metadata, own.metadata);
    }
}

TEST_F(Rays, TakeTheMemoryThatIsSaid) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    for (const int quads : {2'000, 100'000}) {
        Scene heap;
        std::mt19937 random(5);
        std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
        const auto anywhere = [&] { return glm::vec3(unit(random), unit(random), unit(random)); };
        const int grey = scenes::add_material(heap, glm::vec3(0.5f));
        for (int i = 0; i < quads; ++i)
            scenes::add_quad(heap, grey, 2.0f * anywhere(), 0.3f * anywhere(), 0.3f * anywhere());
        const Visibility embree(heap, frame_around(heap));
        const auto in_use = [] {
            const std::vector<uint64_t>& heaps = device().impl().in_use;
            return std::accumulate(heaps.begin(), heaps.end(), uint64_t(0));
        };
        const uint64_t before = in_use();
        const Visibility both = bake::on_device(embree, device());
        const auto taken = double(in_use() - before);
        const auto bytes = gpu::RayTracer::bytes(device().info(), uint64_t(2 * quads), 1);
        const auto said = double(bytes.device + bytes.host);
        std::printf("%d triangles: said %.1f MiB and %.1f while built, taken %.1f MiB\n", 2 * quads,
                    said / 0x1p20, double(bytes.building) / 0x1p20, taken / 0x1p20);
        EXPECT_NEAR(said, taken, 0.2 * taken);
        // A plan has them, beside the solver's.
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.grid.resolution = 12;
        heap.sky.luminance = glm::vec3(100.0f);
        const bake::SceneFacts facts = bake::survey(heap);
        const bake::BakePlan without = bake::plan_bake(facts, settings, device().info());
        settings.rays = bake::Rays::device;
        const bake::BakePlan with = bake::plan_bake(facts, settings, device().info());
        EXPECT_EQ(with.device_bytes, bytes.device + std::max(bytes.building, without.device_bytes));
        EXPECT_EQ(with.host_bytes, without.host_bytes + bytes.host);
        gpu::DeviceInfo small = device().info();
        small.memory = with.device_bytes - 1;
        EXPECT_THROW((void)bake::plan_bake(facts, settings, small), Error);
        small.type = "discrete";
        settings.rays = bake::Rays::automatic;
        EXPECT_EQ(bake::plan_bake(facts, settings, small).settings.rays, bake::Rays::embree);
        small.memory = with.device_bytes;
        EXPECT_EQ(bake::plan_bake(facts, settings, small).settings.rays,
                  quads > 5000 ? bake::Rays::device : bake::Rays::embree);
    }
}

TEST_F(Rays, AreLeftOutOfDevicesThatAreNotOpenedForThem) {
    bool could = false;
    const gpu::Device without(gpu::DeviceOptions{"", true, [&](const gpu::DeviceInfo& info) {
                                                     could = info.traces_rays;
                                                     return false;
                                                 }});
    EXPECT_TRUE(could);
    EXPECT_FALSE(without.info().traces_rays);
    EXPECT_EQ(without.info().name, device().info().name);
    EXPECT_THROW((void)bake::available(bake::Rays::device, without.info(), true, 1), Error);
}

TEST(RaysOfDevices, AreChosenByWhatTheyCan) {
    gpu::DeviceInfo info;
    info.name = "card";
    info.type = "discrete";
    EXPECT_EQ(bake::available(bake::Rays::automatic, info, true, 10000), bake::Rays::embree);
    EXPECT_EQ(bake::available(bake::Rays::embree, info, true, 10000), bake::Rays::embree);
    try {
        (void)bake::available(bake::Rays::device, info, false, 1);
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::device);
        EXPECT_NE(std::string(error.what()).find("'card' traces none"), std::string::npos);
    }
    info.traces_rays = true;
    EXPECT_EQ(bake::available(bake::Rays::automatic, info, true, 10000), bake::Rays::device);
    EXPECT_EQ(bake::available(bake::Rays::embree, info, true, 10000), bake::Rays::embree);
    EXPECT_EQ(bake::available(bake::Rays::device, info, false, 1), bake::Rays::device);
    EXPECT_EQ(bake::available(bake::Rays::automatic, info, true, 9999), bake::Rays::embree);
    EXPECT_EQ(bake::available(bake::Rays::automatic, info, false, 10000), bake::Rays::embree);
    info.type = "cpu";
    EXPECT_EQ(bake::available(bake::Rays::automatic, info, true, 10000), bake::Rays::embree);
    EXPECT_EQ(bake::available(bake::Rays::device, info, false, 1), bake::Rays::device);
    for (const bake::Rays rays : bake::all_rays)
        EXPECT_EQ(bake::rays_named(bake::name_of(rays)), rays);
    EXPECT_FALSE(bake::rays_named("gpu"));
}

} // namespace
} // namespace lpvbake
