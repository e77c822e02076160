// Time of every stage by size, and of the propagation kernel beside the same arithmetic as a plain
// loop on the CPU. `lpvbake_bench --benchmark_filter=ratio` runs the latter alone.
#include "bench/propagate_loop.h"
#include "io/io.h"
#include "lpvbake/scene.h"
#include "reference/peer.h"
#include "scenes.h"
#include "solver/lpv/lpv.h"
#include "solver/occlusion.h"
#include "solver/vpl/vpls.h"
#include "surface/patches.h"
#include "visibility/visibility.h"

#include <benchmark/benchmark.h>
#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <optional>
#include <random>
#include <unistd.h>

namespace lpvbake {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int threads = 2; ///< of the kernel (on a CPU device) and of the loop

double seconds_of(const std::function<void()>& work) {
    const Clock::time_point start = Clock::now();
    work();
    return std::chrono::duration<double>(Clock::now() - start).count();
}

const gpu::Device& device() {
    static const gpu::Device shared{gpu::DeviceOptions{}};
    return shared;
}

const char* name_of(solver::lpv::Occlusion mode) {
    return mode == solver::lpv::Occlusion::none   ? "none"
           : mode == solver::lpv::Occlusion::face ? "face"
                                                  : "sh";
}

Grid cube(int n) {
    return {glm::dvec3(0.0), 1.0, glm::ivec3(n)};
}

/// A scene in a grid that is fitted to it.
struct Setting {
    Scene scene;
    Grid grid;
    scene::Frame frame;

    Setting(Scene scene_in, int resolution) : scene(std::move(scene_in)) {
        const Bounds box = bounds_of(scene);
        grid = volume::fit_grid(box.lo, box.hi, {resolution});
        frame = {grid.origin, grid.cell, glm::dvec3(grid.dims)};
    }
};

/// `side`^3 turned boxes of 12 triangles.
Scene many_boxes(int side) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    for (int z = 0; z < side; ++z)
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x) {
                const glm::dmat4 place = glm::translate(glm::dmat4(1.0), glm::dvec3(x, y, z));
                scenes::add_box(scene, material, glm::vec3(-0.3f), glm::vec3(0.3f),
                                scenes::Facing::outward,
                                glm::rotate(place, double(x + 2 * y + 3 * z), glm::dvec3(0, 1, 0)));
            }
    return scene;
}

/// Light in every cell: no share of a loop is spent on zeros or denormal numbers.
solver::lpv::Injection light_everywhere(const Grid& grid) {
    solver::lpv::Injection injection;
    injection.coefficients.resize(12 * grid.size());
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f), both(-1.0f, 1.0f);
    for (size_t i = 0; i < injection.coefficients.size(); i += 4) {
        float* lobe = &injection.coefficients[i];
        lobe[0] = 0.1f + unit(random);
        for (int k = 1; k < 4; ++k)
            lobe[k] = 0.5f * lobe[0] * both(random);
        injection.power += std::sqrt(4.0 * glm::pi<double>()) * double(lobe[0]);
    }
    return injection;
}

/// A third of the links each closed, half open and open.
std::vector<float> some_links(const Grid& grid, solver::lpv::Occlusion mode) {
    const size_t planes = mode == solver::lpv::Occlusion::none   ? 0
                          : mode == solver::lpv::Occlusion::face ? 3
                                                                 : 30;
    std::vector<float> links(planes * grid.size());
    std::mt19937 random(2);
    for (float& link : links)
        link = 0.5f * float(random() % 3);
    return links;
}

solver::lpv::LpvSettings steps(int iterations) {
    solver::lpv::LpvSettings settings;
    settings.iterations = iterations;
    return settings;
}

/// A field without symmetry that a compressor finds as hard as a real one: smooth, with noise of a
/// few bits.
Volume smooth_volume(int n) {
    Volume volume;
    volume.grid = cube(n);
    const size_t cells = volume.grid.size();
    volume.sh.assign(4, std::vector<glm::vec3>(cells));
    volume.occlusion.assign(4, std::vector<float>(cells));
    volume.validity.assign(cells, 1.0f);
    std::mt19937 random(3);
    std::uniform_real_distribution<float> noise(0.999f, 1.001f);
    for (int z = 0; z < n; ++z)
        for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x) {
                const size_t cell = volume.grid.index({x, y, z});
                const glm::vec3 p = (glm::vec3(x, y, z) + 0.5f) / float(n);
                const float light = noise(random) / (0.05f + glm::dot(p - 0.4f, p - 0.4f));
                for (size_t k = 0; k < 4; ++k) {
                    volume.sh[k][cell] = light * glm::vec3(1.0f, p.x, p.y) / float(k + 1);
                    volume.occlusion[k][cell] = 0.1f * light * p.z;
                }
            }
    return volume;
}

/// A folder of its own that goes away with the program.
struct Folder {
    std::filesystem::path path =
        std::filesystem::temp_directory_path() / ("lpvbake_bench_" + std::to_string(getpid()));
    Folder() { std::filesystem::create_directories(path); }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
};

const Folder& folder() {
    static const Folder shared;
    return shared;
}

/// A counter of seconds a unit of work, where one iteration does `units`.
benchmark::Counter time_per(double units) {
    return {units, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert};
}

// Stages.

void load(benchmark::State& state) {
    for (auto _ : state)
        benchmark::DoNotOptimize(load_gltf(LPVBAKE_EXAMPLES "/cornell_box.gltf", {}));
}
BENCHMARK(load)->Unit(benchmark::kMillisecond)->UseRealTime();

void visibility(benchmark::State& state) {
    const Setting setting(many_boxes(int(state.range(0))), 32);
    for (auto _ : state)
        benchmark::DoNotOptimize(visibility::Visibility(setting.scene, setting.frame));
    state.counters["triangles"] = double(scene::triangle_count(setting.scene));
}
BENCHMARK(visibility)
    ->ArgName("side")
    ->Arg(4)
    ->Arg(10)
    ->Arg(25)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void rsm(benchmark::State& state, const Scene& scene) {
    const Setting setting(scene, 32);
    const int size = int(state.range(0));
    solver::vpl::RsmPass pass(device(), setting.scene, setting.frame);
    std::vector<solver::vpl::Vpl> vpls;
    double texels = 0.0, clustering = 0.0;
    const auto render = [&] {
        vpls.clear();
        texels = 0.0;
        pass.render(setting.scene.lights.front(), size, [&](const solver::vpl::Rsm& map) {
            clustering +=
                seconds_of([&] { solver::vpl::cluster_vpls(map, setting.frame, 4, vpls); });
            texels += double(map.power.size());
        });
    };
    render(); // compiles the shaders
    clustering = 0.0;
    for (auto _ : state)
        render();
    state.counters["vpls"] = double(vpls.size());
    state.counters["per_texel"] = time_per(texels);
    state.counters["clustering"] =
        benchmark::Counter(clustering, benchmark::Counter::kAvgIterations);
}
BENCHMARK_CAPTURE(rsm, sun, scenes::cornell_box_with_sun())
    ->ArgName("size")
    ->RangeMultiplier(2)
    ->Range(256, 2048)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(rsm, point, scenes::cornell_box_with_point())
    ->ArgName("size")
    ->RangeMultiplier(2)
    ->Range(256, 1024)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void surfaces(benchmark::State& state) {
    const Setting setting(scenes::cornell_box(), int(state.range(0)));
    size_t patches = 0;
    for (auto _ : state) {
        const std::vector<surface::Patch> cut =
            surface::make_patches(setting.scene, setting.frame, 1.0f);
        benchmark::DoNotOptimize(solver::make_geometry_volume(cut, setting.grid));
        patches = cut.size();
    }
    state.counters["patches"] = double(patches);
    state.counters["per_cell"] = time_per(double(setting.grid.size()));
}
BENCHMARK(surfaces)
    ->ArgName("grid")
    ->RangeMultiplier(2)
    ->Range(16, 128)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void links(benchmark::State& state) {
    const Setting setting(scenes::cornell_box(), int(state.range(0)));
    const visibility::Visibility rays(setting.scene, setting.frame);
    for (auto _ : state)
        benchmark::DoNotOptimize(solver::trace_links(rays, setting.grid));
    state.counters["per_cell"] = time_per(double(setting.grid.size()));
}
BENCHMARK(links)
    ->ArgName("grid")
    ->RangeMultiplier(2)
    ->Range(16, 128)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void injection(benchmark::State& state) {
    const Setting setting(scenes::cornell_box_with_point(), int(state.range(0)));
    const visibility::Visibility rays(setting.scene, setting.frame);
    Progress silent;
    const std::vector<solver::vpl::Vpl> vpls = solver::vpl::render_vpls(
        device(), setting.scene, setting.frame, {std::max(256, 8 * int(state.range(0)))}, silent);
    for (auto _ : state)
        benchmark::DoNotOptimize(solver::lpv::inject(vpls, rays, setting.grid));
    state.counters["vpls"] = double(vpls.size());
}
BENCHMARK(injection)
    ->ArgName("grid")
    ->RangeMultiplier(2)
    ->Range(16, 128)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// From the program's construction to the end of a first step on few cells, less the time of a
/// second one: some drivers compile where a program is made, others where it first runs.
void compile(benchmark::State& state, solver::lpv::Occlusion mode) {
    const Grid grid{glm::dvec3(0.0), 1.0, {64, 2, 2}};
    const solver::lpv::Injection light = light_everywhere(grid);
    const std::vector<float> taus = some_links(grid, mode);
    device();
    Progress silent;
    for (auto _ : state) {
        std::optional<solver::lpv::LpvProgram> program;
        const auto step = [&] { program->propagate(light, taus, steps(1), silent); };
        const double cold = seconds_of([&] {
            program.emplace(device(), grid, mode);
            step();
        });
        state.SetIterationTime(std::max(0.0, cold - seconds_of(step)));
    }
}
BENCHMARK_CAPTURE(compile, none, solver::lpv::Occlusion::none)
    ->Unit(benchmark::kMillisecond)
    ->UseManualTime();
BENCHMARK_CAPTURE(compile, face, solver::lpv::Occlusion::face)
    ->Unit(benchmark::kMillisecond)
    ->UseManualTime();
BENCHMARK_CAPTURE(compile, sh, solver::lpv::Occlusion::sh)
    ->Unit(benchmark::kMillisecond)
    ->UseManualTime();

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const size_t n = values.size();
    return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

/// Half of the values lie this close to the median, as a share of it.
double spread(const std::vector<double>& values) {
    const double middle = median(values);
    std::vector<double> distances;
    for (const double v : values)
        distances.push_back(std::abs(v - middle) / middle);
    return median(distances);
}

double least(const std::vector<double>& values) {
    return *std::min_element(values.begin(), values.end());
}

/// Times `propagate` with two numbers of steps: the difference is free of allocation and transfers.
class KernelClock {
public:
    static constexpr int counted = 40;

    KernelClock(const Grid& grid, solver::lpv::Occlusion mode)
        : cells_(double(grid.size())),
          light_(light_everywhere(grid)),
          taus_(some_links(grid, mode)),
          program_(device(), grid, mode) {
        run(1); // compiles
    }
    solver::lpv::LpvField run(int iterations) const {
        Progress silent;
        return program_.propagate(light_, taus_, steps(iterations), silent);
    }
    void measure() {
        few_.push_back(seconds_of([&] { run(extra); }));
        many_.push_back(seconds_of([&] { run(extra + counted); }));
    }
    /// ns a cell and step of each measurement.
    std::vector<double> ns() const {
        std::vector<double> values;
        for (size_t i = 0; i < few_.size(); ++i)
            values.push_back(per_step(many_[i] - few_[i]));
        return values;
    }
    /// From the least times of both: a disturbed measurement does not count.
    double least_ns() const { return per_step(least(many_) - least(few_)); }
    /// The last measurement's time of all steps with everything around them.
    double whole() const { return many_.back(); }
    const solver::lpv::Injection& light() const { return light_; }
    const std::vector<float>& taus() const { return taus_; }

private:
    static constexpr int extra = 8;
    double per_step(double seconds) const { return 1e9 * seconds / (counted * cells_); }

    double cells_;
    solver::lpv::Injection light_;
    std::vector<float> taus_;
    solver::lpv::LpvProgram program_;
    std::vector<double> few_, many_; ///< s
};

void propagation(benchmark::State& state, solver::lpv::Occlusion mode) {
    const Grid grid = cube(int(state.range(0)));
    KernelClock clock(grid, mode);
    for (auto _ : state) {
        clock.measure();
        state.SetIterationTime(clock.whole());
    }
    state.counters["ns_per_cell_step"] = median(clock.ns());
    state.counters["least_ns"] = clock.least_ns();
}
void grids(benchmark::internal::Benchmark* b) {
    b->ArgName("grid")
        ->RangeMultiplier(2)
        ->Range(16, 128)
        ->Unit(benchmark::kMillisecond)
        ->UseManualTime();
}
BENCHMARK_CAPTURE(propagation, none, solver::lpv::Occlusion::none)->Apply(grids);
BENCHMARK_CAPTURE(propagation, face, solver::lpv::Occlusion::face)->Apply(grids);
BENCHMARK_CAPTURE(propagation, sh, solver::lpv::Occlusion::sh)->Apply(grids);

void write(benchmark::State& state, const char* extension) {
    const Volume volume = smooth_volume(int(state.range(0)));
    const std::string path = folder().path / (std::string("volume.") + extension);
    uint64_t bytes = 0;
    // The first write of a process loads what it needs.
    io::write_volume(path, smooth_volume(8), Precision::full);
    for (auto _ : state)
        bytes = io::write_volume(path, volume, Precision::full).bytes();
    state.counters["bytes"] = benchmark::Counter(double(bytes), benchmark::Counter::kDefaults,
                                                 benchmark::Counter::kIs1024);
    state.counters["per_cell"] = time_per(double(volume.grid.size()));
}
BENCHMARK_CAPTURE(write, vdb, "vdb")
    ->ArgName("grid")
    ->RangeMultiplier(2)
    ->Range(16, 128)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(write, exr, "exr")
    ->ArgName("grid")
    ->RangeMultiplier(2)
    ->Range(16, 128)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

// The peer beside Embree alone.

Scene boxes_around_a_light(int side) {
    Scene scene = many_boxes(side);
    scene.lights.push_back(scenes::point_light(glm::dvec3(0.5 * side + 0.5), 100.0));
    return scene;
}

/// First rays of the points and shadow rays from what they meet, each by a call of its own; returns
/// their number.
uint64_t trace_one_by_one(const visibility::Visibility& visibility,
                          std::span<const glm::vec3> points, glm::vec3 light, uint32_t rays) {
    return tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, points.size()), uint64_t(0),
        [&](const tbb::blocked_range<size_t>& range, uint64_t traced) {
            for (size_t i = range.begin(); i < range.end(); ++i)
                for (uint32_t k = 0; k < rays; ++k) {
                    const float z = 1.0f - (2.0f * float(k) + 1.0f) / float(rays);
                    const float phi = 2.39996323f * float(k), r = std::sqrt(1.0f - z * z);
                    const glm::vec3 w{r * std::cos(phi), r * std::sin(phi), z};
                    const visibility::Hit hit = visibility.closest({points[i], w, 0.0f, HUGE_VALF});
                    ++traced;
                    if (hit.instance == visibility::no_hit)
                        continue;
                    const glm::vec3 from = points[i] + 0.9999f * hit.t * w;
                    benchmark::DoNotOptimize(
                        visibility.transmittance({from, light - from, 0.0f, 1.0f}));
                    ++traced;
                }
            return traced;
        },
        std::plus<uint64_t>());
}

/// Million rays a second, each by its least time over the repeats, taken in turn.
void peer(benchmark::State& state, const Scene& scene, std::optional<int> bounces) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Setting setting(scene, 32);
    const visibility::Visibility rays(setting.scene, setting.frame);
    reference::PeerSettings settings;
    settings.paths.bounces = bounces;
    settings.rays = uint32_t(state.range(0));
    std::vector<glm::vec3> points;
    for (uint32_t i = 0; i < (1u << 16) / settings.rays; ++i)
        points.push_back(glm::fract(glm::vec3(0.81917f, 0.67104f, 0.54970f) * float(i) + 0.5f)
                         * glm::vec3(setting.frame.extent));
    const visibility::PackedRays packed =
        reference::peer_rays(setting.scene, rays, setting.frame, points, settings);
    const glm::vec3 light(setting.frame.from_world(setting.scene.lights[0].position));
    std::vector<double> whole, alone, single;
    uint64_t traced = 0;
    for (auto _ : state) {
        whole.push_back(seconds_of(
            [&] { reference::trace_peer(setting.scene, rays, setting.frame, points, settings); }));
        alone.push_back(seconds_of([&] { packed.trace(rays); }));
        single.push_back(
            seconds_of([&] { traced = trace_one_by_one(rays, points, light, settings.rays); }));
        state.SetIterationTime(whole.back());
    }
    state.counters["peer_Mrays"] = 1e-6 * double(packed.size()) / least(whole);
    state.counters["embree_Mrays"] = 1e-6 * double(packed.size()) / least(alone);
    state.counters["single_Mrays"] = 1e-6 * double(traced) / least(single);
    state.counters["share"] = least(alone) / least(whole);
}
void peer_rays_each(benchmark::internal::Benchmark* b) {
    b->ArgName("rays")
        ->Arg(64)
        ->Arg(256)
        ->Arg(1024)
        ->Unit(benchmark::kMillisecond)
        ->UseManualTime();
}
BENCHMARK_CAPTURE(peer, cornell, scenes::cornell_box_with_point(), 1)->Apply(peer_rays_each);
BENCHMARK_CAPTURE(peer, cornell_all_bounces, scenes::cornell_box_with_point(), std::nullopt)
    ->Apply(peer_rays_each);
BENCHMARK_CAPTURE(peer, boxes, boxes_around_a_light(25), 1)->Apply(peer_rays_each);

// The kernel beside the loop.

/// What a lobe is multiplied with before its first step, so that its 30 faces pass on its power.
double budget(const float* lobe) {
    const double sh_0 = 0.5 / std::sqrt(glm::pi<double>());
    const double sh_1 = 0.5 * std::sqrt(3.0 / glm::pi<double>());
    double leaving = 0.0;
    for (const solver::LpvFace& face : solver::lpv_faces()) {
        const glm::dvec3 w(face.toward);
        const double intensity =
            sh_0 * double(lobe[0])
            + sh_1 * (w.y * double(lobe[1]) + w.z * double(lobe[2]) + w.x * double(lobe[3]));
        leaving +=
            std::max(0.0, intensity) * (face.normal == face.toward ? 0.4006696846 : 0.4234313544);
    }
    return double(lobe[0]) / sh_0 / leaving;
}

/// The clock's scene for the loop.
bench::PropagateLoop loop_like(const KernelClock& clock, const Grid& grid,
                               solver::lpv::Occlusion mode) {
    bench::PropagateLoop loop(grid.dims.x, grid.dims.y, grid.dims.z,
                              mode == solver::lpv::Occlusion::face, threads);
    for (int z = 0; z < grid.dims.z; ++z)
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x) {
                const size_t cell = grid.index({x, y, z});
                for (int k = 0; k < 12; ++k) {
                    const float* lobe = &clock.light().coefficients[12 * cell + size_t(k / 4 * 4)];
                    loop.total(x, y, z, k) = lobe[k % 4];
                    loop.front(x, y, z, k) = float(budget(lobe) * double(lobe[k % 4]));
                }
                if (mode == solver::lpv::Occlusion::face)
                    for (int axis = 0; axis < 3; ++axis)
                        loop.link(x, y, z, axis) = clock.taus()[3 * cell + size_t(axis)];
            }
    return loop;
}

/// Largest difference of the two fields after the same number of steps, over the largest value.
double difference(const KernelClock& clock, bench::PropagateLoop& loop, const Grid& grid) {
    constexpr int iterations = KernelClock::counted;
    const solver::lpv::LpvField field = clock.run(iterations);
    loop.run(iterations);
    double off = 0.0, largest = 0.0;
    for (int z = 0; z < grid.dims.z; ++z)
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x)
                for (int k = 0; k < 12; ++k) {
                    const double value =
                        double(field.coefficients[12 * grid.index({x, y, z}) + size_t(k)]);
                    off = std::max(off, std::abs(value - double(loop.total(x, y, z, k))));
                    largest = std::max(largest, std::abs(value));
                }
    return off / largest;
}

struct Ratio {
    solver::lpv::Occlusion mode;
    int n;
    std::vector<double> kernel, loop; ///< ns a cell and step, one pair a repeat
    double least_kernel, least_loop;
    double difference; ///< of the two fields, over the largest value
};
std::vector<Ratio> ratios;
bool differ = false; ///< kernel and loop, in some case

void ratio(benchmark::State& state, solver::lpv::Occlusion mode) {
    constexpr int repeats = 9;
    const Grid grid = cube(int(state.range(0)));
    KernelClock clock(grid, mode);
    Ratio result{mode, grid.dims.x, {}, {}, 0.0, 0.0, 0.0};
    {
        bench::PropagateLoop loop = loop_like(clock, grid, mode);
        result.difference = difference(clock, loop, grid);
        if (!(result.difference < 1e-5)) {
            differ = true;
            state.SkipWithError("kernel and loop differ");
            return;
        }
    }
    for (auto _ : state)
        for (int repeat = 0; repeat < repeats; ++repeat) {
            clock.measure();
            // Its light anew: a front that has decayed to denormal numbers is slow.
            bench::PropagateLoop loop = loop_like(clock, grid, mode);
            loop.run(2);
            const double seconds = seconds_of([&] { loop.run(KernelClock::counted); });
            result.loop.push_back(1e9 * seconds / (KernelClock::counted * double(grid.size())));
        }
    result.kernel = clock.ns();
    result.least_kernel = clock.least_ns();
    result.least_loop = least(result.loop);
    state.counters["kernel_ns"] = median(result.kernel);
    state.counters["kernel_least_ns"] = result.least_kernel;
    state.counters["kernel_spread"] = spread(result.kernel);
    state.counters["loop_ns"] = median(result.loop);
    state.counters["loop_least_ns"] = result.least_loop;
    state.counters["loop_spread"] = spread(result.loop);
    state.counters["ratio"] = median(result.kernel) / median(result.loop);
    state.counters["ratio_of_least"] = result.least_kernel / result.least_loop;
    state.counters["difference"] = result.difference;
    ratios.push_back(std::move(result));
}
void ratio_grids(benchmark::internal::Benchmark* b) {
    b->ArgName("grid")->Arg(32)->Arg(64)->Arg(96)->Unit(benchmark::kMillisecond)->Iterations(1);
}
BENCHMARK_CAPTURE(ratio, none, solver::lpv::Occlusion::none)->Apply(ratio_grids);
BENCHMARK_CAPTURE(ratio, face, solver::lpv::Occlusion::face)->Apply(ratio_grids);

/// On stderr, where it is in nobody's way if the rest is JSON.
void print_ratios() {
    if (ratios.empty())
        return;
    std::fprintf(stderr,
                 "\nPropagation, ns a cell and step: kernel on %s, loop with %d threads (%s)\n"
                 "              kernel                  loop                    kernel / loop\n"
                 "              median  spread   least  median  spread   least  medians  least\n",
                 device().info().name.c_str(), threads, LPVBAKE_LOOP_FLAGS);
    for (const Ratio& r : ratios)
        std::fprintf(stderr, "%-4s %3d^3  %8.2f  %5.1f%%  %6.2f%8.2f  %5.1f%%  %6.2f%9.2f%7.2f\n",
                     name_of(r.mode), r.n, median(r.kernel), 100.0 * spread(r.kernel),
                     r.least_kernel, median(r.loop), 100.0 * spread(r.loop), r.least_loop,
                     median(r.kernel) / median(r.loop), r.least_kernel / r.least_loop);
    std::fprintf(stderr, "Spread: half of the repeats lie that close to the median.\n");
}

} // namespace
} // namespace lpvbake

int main(int argc, char** argv) {
    // Before the driver is loaded: compile for real each time, with as many threads as the loop.
    setenv("MESA_SHADER_CACHE_DISABLE", "true", 0);
    setenv("LP_NUM_THREADS", std::to_string(lpvbake::threads).c_str(), 0);
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv))
        return 1;
    benchmark::AddCustomContext("loop_flags", LPVBAKE_LOOP_FLAGS);
    benchmark::AddCustomContext("device", lpvbake::device().info().name);
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
    lpvbake::print_ratios();
    return lpvbake::differ ? 1 : 0;
}
