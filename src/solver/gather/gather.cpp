#include "solver/gather/gather.h"

#include "solver/gather/gather.comp.h"
#include "solver/gather/zone.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

namespace lpvbake {
namespace {

using namespace gather;

constexpr int stride = 4; ///< between the cells that are solved first

/// Sources of one job, in vec4: what exceeds them goes into another job.
constexpr size_t job_words = 4096;
constexpr uint32_t most_jobs = 8192; ///< of one dispatch
constexpr size_t chunk = 1024;       ///< packs whose lists the host makes at a time
constexpr uint64_t usual_list_bytes = uint64_t(32) << 20;

double now() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

/// Eight cells, or fewer, of a zone.
struct Pack {
    uint32_t zone;
    std::vector<glm::ivec3> cells;
};

/// Puts the digits of a local coordinate two bits apart.
uint32_t spread(int i) {
    uint32_t x = uint32_t(i);
    x = (x | x << 8) & 0x0300f00fu;
    x = (x | x << 4) & 0x030c30c3u;
    return (x | x << 2) & 0x09249249u;
}

uint32_t morton(glm::ivec3 local) {
    return spread(local.x) | spread(local.y) << 1 | spread(local.z) << 2;
}

/// Runs jobs on the device, a buffer full at a time, and adds the results to the volume.
class Queue {
public:
    Queue(const gpu::Device& device, uint32_t local_size, int order, uint64_t list_bytes,
          Volume& volume)
        : device_(device),
          order_(order),
          jobs_a_group_(local_size / lanes),
          volume_(volume),
          capacity_(list_bytes / sizeof(glm::vec4)),
          centers_buffer_(device, most_jobs * lanes * sizeof(glm::vec4)),
          jobs_buffer_(device, most_jobs * sizeof(Job)),
          list_buffer_(device, list_bytes),
          result_buffer_(device, uint64_t(most_jobs) * result_floats(order) * sizeof(float)),
          list_(std::make_unique_for_overwrite<glm::vec4[]>(capacity_)) {
        gpu::clear(device, centers_buffer_);
    }

    /// What runs the jobs from here on.
    void use(const gpu::Program& program) { program_ = &program; }

    void add(std::span<const glm::ivec3> cells, const Sources& sources) {
        // In runs of at most job_words, the same whatever else is in the buffer.
        const size_t per[3] = {point_words, triangle_words, bin_words(order_)};
        const std::vector<glm::vec4>* lists[3] = {&sources.points, &sources.triangles,
                                                  &sources.bins};
        size_t at[3] = {0, 0, 0};
        while (at[0] < lists[0]->size() || at[1] < lists[1]->size() || at[2] < lists[2]->size()) {
            size_t take[3], left = job_words;
            for (int i = 0; i < 3; ++i) {
                take[i] = std::min((lists[i]->size() - at[i]) / per[i], left / per[i]);
                left -= take[i] * per[i];
            }
            if (jobs_.size() == most_jobs || used_ + job_words - left > capacity_)
                run();
            jobs_.push_back(
                {uint32_t(used_), uint32_t(take[0]), uint32_t(take[1]), uint32_t(take[2])});
            for (int i = 0; i < 3; ++i) {
                const size_t words = take[i] * per[i];
                copies_.push_back({lists[i]->data() + at[i], used_, words});
                used_ += words;
                at[i] += words;
            }
            for (size_t lane = 0; lane < lanes; ++lane) {
                const glm::ivec3 cell = cells[std::min(lane, cells.size() - 1)];
                centers_.push_back(glm::vec4(glm::vec3(cell) + 0.5f, 0.0f));
                cells_.push_back(lane < cells.size() ? int64_t(volume_.grid.index(cell)) : -1);
            }
        }
    }

    /// Copies the lists of what was added, which then may change.
    void take() {
        tbb::parallel_for(size_t(0), copies_.size(), [&](size_t i) {
            const Copy& copy = copies_[i];
            std::copy_n(copy.from, copy.words, &list_[copy.to]);
        });
        copies_.clear();
    }

    void run() {
        if (jobs_.empty())
            return;
        take();
        gpu::upload(device_, centers_buffer_, 0, std::as_bytes(std::span(centers_)));
        gpu::upload(device_, jobs_buffer_, 0, std::as_bytes(std::span(jobs_)));
        gpu::upload(device_, list_buffer_, 0, std::as_bytes(std::span(list_.get(), used_)));
        const Push push{uint32_t(jobs_.size())};
        const gpu::Window windows[] = {
            {&centers_buffer_, 0, centers_.size() * sizeof(glm::vec4)},
            {&jobs_buffer_, 0, jobs_.size() * sizeof(Job)},
            {&list_buffer_, 0, used_ * sizeof(glm::vec4)},
            {&result_buffer_, 0, jobs_.size() * result_floats(order_) * sizeof(float)}};
        gpu::Batch batch(device_);
        batch.dispatch(*program_, windows, std::as_bytes(std::span(&push, 1)),
                       {(push.jobs + jobs_a_group_ - 1) / jobs_a_group_, 1, 1});
        batch.run();
        results_.resize(jobs_.size() * result_floats(order_));
        gpu::download(device_, result_buffer_, 0, std::as_writable_bytes(std::span(results_)));
        const size_t count = terms(order_);
        tbb::parallel_for(size_t(0), count, [&](size_t k) {
            for (size_t job = 0; job < jobs_.size(); ++job) {
                const float* result = &results_[(job * count + k) * 3 * lanes];
                for (size_t lane = 0; lane < lanes; ++lane)
                    if (const int64_t cell = cells_[job * lanes + lane]; cell >= 0)
                        volume_.sh[k][size_t(cell)] +=
                            glm::vec3(result[lane], result[lanes + lane], result[2 * lanes + lane]);
            }
        });
        jobs_.clear();
        used_ = 0;
        centers_.clear();
        cells_.clear();
    }

private:
    const gpu::Device& device_;
    const gpu::Program* program_ = nullptr;
    int order_;
    uint32_t jobs_a_group_;
    Volume& volume_;
    size_t capacity_;
    gpu::Buffer centers_buffer_, jobs_buffer_, list_buffer_, result_buffer_;
    std::vector<Job> jobs_;
    struct Copy {
        const glm::vec4* from;
        size_t to, words;
    };
    std::vector<Copy> copies_;
    std::unique_ptr<glm::vec4[]> list_;
    size_t used_ = 0; ///< words of the list
    std::vector<glm::vec4> centers_;
    std::vector<int64_t> cells_; ///< a lane of a job; -1: none
    std::vector<float> results_;
};

/// Where a cell's light comes from.
enum class State : uint8_t {
    open,
    between_4, ///< interpolated over a box of this edge
    between_2,
    wanted,
    solved,
};

/// Which cells are solved and which lie between them.
class Lattice {
public:
    Lattice(const Volume& volume, const Occupied& occupied, float tolerance)
        : volume_(volume),
          grid_(volume.grid),
          occupied_(occupied),
          tolerance_(tolerance),
          state(grid_.size(), State::open) {}

private:
    const Volume& volume_;
    const Grid& grid_;
    const Occupied& occupied_;
    float tolerance_;

public:
    std::vector<State> state;

    /// A box of cells from lo to hi, both included.
    struct Box {
        glm::ivec3 lo, hi;
    };

    /// The box of this edge (a power of two) that a cell belongs to, cut off by the grid's end.
    Box box_around(glm::ivec3 cell, int edge) const {
        // The last cells belong to the box before them.
        const glm::ivec3 last = grid_.dims - 1;
        glm::ivec3 lo = cell & ~(edge - 1);
        for (int i = 0; i < 3; ++i)
            if (lo[i] == last[i] && lo[i] > 0)
                lo[i] -= edge;
        return {lo, glm::min(lo + edge, last)};
    }

    /// Wants the valid cells of a box at multiples of `step` and at its corners.
    void want(const Box& box, int step) {
        const glm::ivec3 last = grid_.dims - 1;
        const auto on = [&](int i, int axis) { return i % step == 0 || i == last[axis]; };
        for (int z = box.lo.z; z <= box.hi.z; ++z)
            for (int y = box.lo.y; y <= box.hi.y; ++y)
                for (int x = box.lo.x; x <= box.hi.x; ++x)
                    if (on(x, 0) && on(y, 1) && on(z, 2)) {
                        const size_t cell = grid_.index({x, y, z});
                        if (state[cell] != State::solved && volume_.validity[cell] > 0.0f)
                            state[cell] = State::wanted;
                    }
    }

    /// Leaves the valid cells of a box that are not solved to interpolation.
    void leave(const Box& box, int edge) {
        for (int z = box.lo.z; z <= box.hi.z; ++z)
            for (int y = box.lo.y; y <= box.hi.y; ++y)
                for (int x = box.lo.x; x <= box.hi.x; ++x) {
                    const size_t cell = grid_.index({x, y, z});
                    if (state[cell] == State::open && volume_.validity[cell] > 0.0f)
                        state[cell] = edge == stride ? State::between_4 : State::between_2;
                }
    }

    /// Calls visit(box) for all boxes of this edge, in order.
    template <class Visit>
    void for_boxes(int edge, const Visit& visit) const {
        const glm::ivec3 last = grid_.dims - 1;
        for (int z = 0; z == 0 || z < last.z; z += edge)
            for (int y = 0; y == 0 || y < last.y; y += edge)
                for (int x = 0; x == 0 || x < last.x; x += edge)
                    visit(Box{{x, y, z}, glm::min(glm::ivec3(x, y, z) + edge, last)});
    }

    /// True if what lies in the box may be interpolated from its corners.
    bool smooth(const Box& box, int edge) const {
        if (occupied_(box.lo, edge == 4 ? 2 : 1))
            return false;
        std::array<size_t, 8> corners;
        for (size_t i = 0; i < 8; ++i) {
            corners[i] = grid_.index(corner(box, i));
            if (state[corners[i]] != State::solved)
                return false;
        }
        const int bands = std::min(volume_.sh_order, 2);
        for (int channel = 0; channel < 3; ++channel) {
            std::array<double, 8> square{};
            double mean_0 = 0.0;
            size_t k = 0;
            for (int l = 0; l <= bands; ++l)
                for (const size_t end = size_t(sh_count(l)); k < end; ++k) {
                    double mean = 0.0;
                    for (const size_t cell : corners)
                        mean += double(volume_.sh[k][cell][channel]) / 8.0;
                    if (k == 0)
                        mean_0 = mean;
                    for (size_t i = 0; i < 8; ++i) {
                        const double off = sh_cosine_factor(l)
                                           * (double(volume_.sh[k][corners[i]][channel]) - mean);
                        square[i] += off * off;
                    }
                }
            // Mean over the sphere: of the square, sum / 4 pi; of irradiance, A_0 c_0 Y_0.
            const double bound = double(tolerance_) * sh_cosine_factor(0) * mean_0;
            for (const double s : square)
                if (!(s <= bound * bound))
                    return false;
        }
        return true;
    }

    static glm::ivec3 corner(const Box& box, size_t i) {
        return {i & 1 ? box.hi.x : box.lo.x, i & 2 ? box.hi.y : box.lo.y,
                i & 4 ? box.hi.z : box.lo.z};
    }
};

/// Trilinear, from the corners of a box.
glm::vec3 between(const std::vector<glm::vec3>& values, const Grid& grid, const Lattice::Box& box,
                  glm::ivec3 cell) {
    const glm::vec3 f =
        glm::vec3(cell - box.lo) / glm::max(glm::vec3(box.hi - box.lo), glm::vec3(1.0f));
    glm::vec3 sum{0.0f};
    for (size_t i = 0; i < 8; ++i) {
        const glm::vec3 w{i & 1 ? f.x : 1.0f - f.x, i & 2 ? f.y : 1.0f - f.y,
                          i & 4 ? f.z : 1.0f - f.z};
        sum += w.x * w.y * w.z * values[grid.index(Lattice::corner(box, i))];
    }
    return sum;
}

gpu::Program compile(const gpu::Device& device, uint32_t local_size, int order, uint32_t part) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::storage,
                                    Binding::texels_rgba32, Binding::storage};
    const uint32_t constants[] = {local_size, uint32_t(order), part};
    return gpu::Program(device, shaders::gather_comp, bindings, sizeof(Push), constants);
}

int sky_groups(const GatherSettings& settings) {
    return settings.sky_bins > 0 ? settings.sky_bins / int(sky_group) : settings.vpls;
}

} // namespace

uint64_t gather_device_bytes(const GatherSettings& settings) {
    return usual_list_bytes + most_jobs * (lanes * sizeof(glm::vec4) + sizeof(Job))
           + uint64_t(most_jobs) * result_floats(settings.order) * sizeof(float)
           + (uint64_t(1) << 20);
}

uint64_t gather_host_bytes(const Grid& grid, uint64_t patches, const GatherSettings& settings) {
    const uint64_t tests = uint64_t(settings.vpls) + sky_group * uint64_t(sky_groups(settings));
    const uint64_t cell = 1 + 2 + tests / 8 + 32;
    return grid.size() * cell + 2 * patches * (sizeof(Emitter) + 2 * sizeof(Cluster))
           + chunk * 2 * job_words * sizeof(glm::vec4) + 2 * gather_device_bytes(settings);
}

double gather_seconds(const Grid& grid, uint64_t patches, const GatherSettings& settings) {
    // What lies near surfaces is solved, the rest is mostly interpolated.
    const double share = 0.24 + 0.045 / std::max(double(settings.tolerance), 0.01);
    const double solved = std::min(0.8 * double(grid.size()), share * double(patches));
    return 0.05 + 3e-6 * double(patches)
           + solved * (1.2e-5 + 6.5e-8 * double(settings.vpls)) * (settings.order > 2 ? 1.35 : 1.0);
}

GatherProgram::GatherProgram(const gpu::Device& device, const GatherSettings& settings,
                             uint64_t window)
    : device_(device),
      settings_(settings),
      list_bytes_(
          std::max<uint64_t>(window ? window : usual_list_bytes, job_words * sizeof(glm::vec4))),
      local_size_(device.is_cpu() ? lanes : 64),
      surfaces_(compile(device, local_size_, settings.order, part_surfaces)) {}

GatherReport GatherProgram::gather(const LitSurfaces& surfaces, const Sky& sky,
                                   const Visibility& visibility, Volume& volume, Progress& progress,
                                   float above) const {
    GatherReport report;
    const Grid& grid = volume.grid;
    volume.sh_order = settings_.order;
    volume.sh.assign(terms(settings_.order), std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));

    double last = now();
    const auto lap = [&](double& seconds) {
        const double time = now();
        seconds += time - last;
        last = time;
    };
    const Clusters clusters = make_clusters(surfaces, visibility, above);
    const std::vector<SkyBin> bins = make_sky_bins(sky, sky_groups(settings_), settings_.order);
    const Occupied occupied(surfaces.patches, grid);
    const Surroundings world{grid,     visibility,      clusters,       bins,
                             occupied, volume.validity, settings_.vpls, settings_.kappa};
    if (clusters.nodes.empty() && bins.empty())
        return report;

    const Grid zone_grid{{}, 1.0, (grid.dims + zone_edge - 1) / zone_edge};
    std::vector<std::unique_ptr<Zone>> zones(zone_grid.size());
    lap(report.clusters_seconds);

    gpu::Program sky_program;
    if (!bins.empty())
        sky_program = compile(device_, local_size_, settings_.order, part_sky);
    Queue queue(device_, local_size_, settings_.order, list_bytes_, volume);
    Lattice lattice(volume, occupied, settings_.tolerance);

    const auto solve = [&](int stage) {
        // What they see, a zone at a time.
        std::vector<std::vector<Pack>> packs(zones.size());
        const auto zone_of = [&](size_t i) {
            const int x = int(i) % zone_grid.dims.x, rest = int(i) / zone_grid.dims.x;
            return zone_edge * glm::ivec3(x, rest % zone_grid.dims.y, rest / zone_grid.dims.y);
        };
        constexpr size_t block = 32;
        for (size_t first = 0; first < zones.size(); first += block) {
            progress.advance(uint64_t(stage) * zones.size() + first);
            tbb::parallel_for(first, std::min(zones.size(), first + block), [&](size_t i) {
                const glm::ivec3 base = zone_of(i);
                const glm::ivec3 end = glm::min(base + zone_edge, grid.dims);
                std::vector<std::pair<uint32_t, glm::ivec3>> cells;
                for (int z = base.z; z < end.z; ++z)
                    for (int y = base.y; y < end.y; ++y)
                        for (int x = base.x; x < end.x; ++x)
                            if (lattice.state[grid.index({x, y, z})] == State::wanted)
                                cells.push_back({morton(glm::ivec3(x, y, z) - base), {x, y, z}});
                if (cells.empty())
                    return;
                if (!zones[i])
                    zones[i] = std::make_unique<Zone>(world, base);
                std::sort(cells.begin(), cells.end(),
                          [](const auto& a, const auto& b) { return a.first < b.first; });
                for (size_t at = 0; at < cells.size(); ++at) {
                    // Never from two of the zone's eight parts: a list is as long as its cells
                    // lie apart.
                    if (at == 0 || packs[i].back().cells.size() == lanes
                        || cells[at].first >> 9 != cells[at - 1].first >> 9)
                        packs[i].push_back({uint32_t(i), {}});
                    packs[i].back().cells.push_back(cells[at].second);
                    zones[i]->look(cells[at].second);
                }
            });
        }
        lap(report.visibility_seconds);

        std::vector<const Pack*> all;
        for (const std::vector<Pack>& own : packs)
            for (const Pack& pack : own)
                all.push_back(&pack);
        std::vector<Sources> sources(std::min(chunk, all.size()));
        const auto run = [&](const gpu::Program& program, const auto& list) {
            queue.use(program);
            for (size_t first = 0; first < all.size(); first += chunk) {
                progress.advance(uint64_t(stage + 1) * zones.size());
                const size_t count = std::min(chunk, all.size() - first);
                tbb::parallel_for(size_t(0), count, [&](size_t i) {
                    sources[i].clear();
                    list(*all[first + i], sources[i]);
                });
                lap(report.lists_seconds);
                for (size_t i = 0; i < count; ++i) {
                    queue.add(all[first + i]->cells, sources[i]);
                    report.sources += lanes
                                      * (sources[i].points.size() / point_words
                                         + sources[i].triangles.size() / triangle_words
                                         + sources[i].bins.size() / bin_words(settings_.order));
                }
                queue.take();
                lap(report.device_seconds);
            }
            queue.run();
            lap(report.device_seconds);
        };
        if (!clusters.nodes.empty())
            run(surfaces_, [&](const Pack& pack, Sources& to) {
                zones[pack.zone]->gather_surfaces(pack.cells, to);
            });
        if (!bins.empty())
            run(sky_program, [&](const Pack& pack, Sources& to) {
                zones[pack.zone]->gather_sky(pack.cells, settings_.order, to);
            });
        for (const Pack* pack : all) {
            report.solved += pack->cells.size();
            for (const glm::ivec3 cell : pack->cells)
                lattice.state[grid.index(cell)] = State::solved;
        }
    };

    progress.begin("gather", 3 * zones.size());
    const Lattice::Box whole{glm::ivec3(0), grid.dims - 1};
    if (settings_.tolerance > 0.0f) {
        lattice.want(whole, stride);
        solve(0);
        std::vector<Lattice::Box> rough;
        lattice.for_boxes(stride, [&](const Lattice::Box& box) {
            if (lattice.smooth(box, stride))
                lattice.leave(box, stride);
            else
                rough.push_back(box);
        });
        for (const Lattice::Box& box : rough)
            lattice.want(box, stride / 2);
        lap(report.interpolation_seconds);
        solve(1);
        std::vector<Lattice::Box> open;
        for (const Lattice::Box& box : rough)
            for (int i = 0; i < 8; ++i) {
                const glm::ivec3 lo = box.lo + stride / 2 * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
                if (glm::any(glm::greaterThan(lo, box.hi)))
                    continue;
                const Lattice::Box half{lo, glm::min(lo + stride / 2, box.hi)};
                if (lattice.smooth(half, stride / 2))
                    lattice.leave(half, stride / 2);
                else
                    open.push_back(half);
            }
        for (const Lattice::Box& half : open)
            lattice.want(half, 1);
        lap(report.interpolation_seconds);
    } else {
        lattice.want(whole, 1);
    }
    solve(2);

    // What is left lies in a smooth box.
    tbb::parallel_for(0, grid.dims.z, [&](int z) {
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x) {
                const size_t cell = grid.index({x, y, z});
                const State state = lattice.state[cell];
                if (state != State::between_4 && state != State::between_2)
                    continue;
                const Lattice::Box box =
                    lattice.box_around({x, y, z}, state == State::between_4 ? 4 : 2);
                for (std::vector<glm::vec3>& values : volume.sh)
                    values[cell] = between(values, grid, box, {x, y, z});
            }
    });
    for (const State state : lattice.state)
        report.interpolated += state == State::between_4 || state == State::between_2;
    for (const std::unique_ptr<Zone>& zone : zones)
        report.rays += zone ? zone->rays() : 0;
    lap(report.interpolation_seconds);
    return report;
}

} // namespace lpvbake
