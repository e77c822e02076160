#include "solver/sn/sn.h"

#include "error.h"
#include "solver/sn/directions.h"
#include "solver/sn/first_flight.h"
#include "solver/sn/given.comp.h"
#include "solver/sn/project.comp.h"
#include "solver/sn/sweep.h"
#include "solver/sn/transport.comp.h"
#include "solver/sn/walls.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake {
namespace {

constexpr uint64_t texel = sizeof(glm::vec4);
/// Of what is streamed: lists of cells, known luminances.
constexpr uint64_t chunk_bytes = uint64_t(20) << 20;
/// Of the ring of fronts, where all directions of an octant do not fit.
constexpr uint64_t ring_bytes = uint64_t(64) << 20;
/// The same on a CPU device, whose caches should hold them.
constexpr uint64_t cpu_ring_bytes = uint64_t(6) << 20;

using sn::SweepLayout;

/// What is brighter than so many times the mean is gathered, not swept: a bright spot, small as
/// seen from most cells, is what a few directions miss or see as beams. Less than 1 / `peak` of
/// what the cells see is so bright.
constexpr float peak = 1.5f;

/// The sky is either gathered or swept.
bool is_peak(const Sky& sky, float limit) {
    const glm::dvec3 mean = sky_mean(sky, -1.0, 1.0, 0.0, 2.0 * glm::pi<double>());
    return (mean.x + mean.y + mean.z) / 3.0 > double(limit);
}

/// The sky as the directions of a sweep stand for it.
Sky sky_along(const Sky& sky, int count) {
    std::vector<glm::vec3> directions;
    for (const glm::dvec3& d : sn_octant_directions(count))
        for (int signs = 0; signs < 8; ++signs)
            directions.push_back(glm::vec3(d)
                                 * glm::vec3(signs & 1 ? -1.0f : 1.0f, signs & 2 ? -1.0f : 1.0f,
                                             signs & 4 ? -1.0f : 1.0f));
    return averaged_sky(sky, directions);
}

GatherSettings peak_settings(const SnSettings& settings) {
    GatherSettings gather;
    // A window shows little of the sky: its edges are what is seen of the number of bins.
    gather.sky_bins = 8 * settings.directions;
    gather.order = settings.order == 3 ? 4 : settings.order; // 3 it does not know
    return gather;
}

uint32_t padded_directions(int directions) {
    return (uint32_t(directions) / 8 + sn::lanes - 1) / sn::lanes * sn::lanes;
}

/// Directions of an octant that are swept at once.
uint32_t batch_directions(const SweepLayout& layout, int directions, uint64_t most_bytes,
                          bool cpu) {
    const uint64_t group = layout.ring_texels(sn::lanes) * texel;
    const uint64_t groups = std::min(most_bytes, cpu ? cpu_ring_bytes : ring_bytes) / group;
    return uint32_t(std::clamp<uint64_t>(groups, 1, padded_directions(directions) / sn::lanes))
           * sn::lanes;
}

/// Directions that a dispatch of project.comp adds: a divisor of the batch's, so few that the
/// unrolled code stays small.
uint32_t projected_directions(uint32_t stride, int order) {
    const uint32_t most = sn::max_project_weights / uint32_t(sh_count(order));
    for (uint32_t parts = 1;; ++parts)
        if (stride % (parts * sn::lanes) == 0 && stride / parts <= most)
            return stride / parts;
}

sn::SweepTiling tiling_for(const gpu::Device& device) {
    return device.is_cpu() ? sn::cpu_tiling : sn::gpu_tiling;
}

/// The coordinates of an octant, along the way of its light.
struct Octant {
    const Grid& grid;
    const SweepLayout& layout;
    glm::ivec3 sign; ///< of the directions' x, y, z

    Octant(const Grid& g, const SweepLayout& l, int number)
        : grid(g),
          layout(l),
          sign(number & 1 ? -1 : 1, number & 2 ? -1 : 1, number & 4 ? -1 : 1) {}

    /// The cell at (p, q, r); outside the grid where these are.
    glm::ivec3 cell(int p, int q, int r) const {
        glm::ivec3 c;
        const int along[] = {p, q, r};
        for (int i = 0; i < 3; ++i) {
            const int axis = layout.axes[i];
            c[axis] = sign[axis] > 0 ? along[i] : grid.dims[axis] - 1 - along[i];
        }
        return c;
    }
    /// The cube of SnWalls upstream of a cell.
    glm::ivec3 cube(glm::ivec3 c) const { return c + (1 - sign) / 2; }
};

struct Entry {
    uint32_t slot; ///< of the ring
    uint32_t cell;
};
static_assert(sizeof(Entry) == 8);

/// Everything of an octant, front by front.
struct Order {
    std::vector<Entry> cells;     ///< of a front those that are given first
    std::vector<uint32_t> first;  ///< a front's first entry of `cells`; ends with their number
    std::vector<uint32_t> middle; ///< its first entry that is not given
    std::vector<SnPlace> given;   ///< cells beside surfaces, and places beside the grid
    std::vector<uint32_t> first_given;
};

/// Calls visit(p, q, r) for the places of a front whose coordinates are not below `lowest`.
template <class Visit>
void visit_front(const SweepLayout& layout, int front, int lowest, const Visit& visit) {
    const glm::ivec3 n = layout.dims;
    const int sum = front - 3;
    for (int q = std::max(lowest, sum - (n.x - 1) - (n.z - 1)); q < n.y; ++q)
        for (int p = std::max(lowest, sum - q - (n.z - 1)); p < n.x && sum - p - q >= lowest; ++p)
            visit(p, q, sum - p - q);
}

/// Orders the cells of a front by the slab of coefficients that they lie in, too.
Order order_cells(const Octant& octant, const SnWalls& walls, bool boundary, int slab_layers) {
    const SweepLayout& layout = octant.layout;
    const int fronts = layout.fronts();
    struct Front {
        std::vector<Entry> near, interior;
        std::vector<SnPlace> given;
    };
    std::vector<Front> parts(static_cast<size_t>(fronts));
    tbb::parallel_for(0, fronts, [&](int front) {
        Front& part = parts[size_t(front)];
        visit_front(layout, front, 0, [&](int p, int q, int r) {
            const glm::ivec3 c = octant.cell(p, q, r);
            const bool near = walls.is_occupied(octant.cube(c));
            const uint32_t slot = layout.slot(p, q);
            (near ? part.near : part.interior)
                .push_back({layout.base(front) + slot, uint32_t(octant.grid.index(c))});
            if (near)
                part.given.push_back({slot, c});
        });
        const uint64_t slab =
            uint64_t(slab_layers) * uint64_t(octant.grid.dims.x) * uint64_t(octant.grid.dims.y);
        if (slab_layers < octant.grid.dims.z)
            for (std::vector<Entry>* list : {&part.near, &part.interior})
                std::stable_sort(list->begin(), list->end(), [&](const Entry& a, const Entry& b) {
                    return a.cell / slab < b.cell / slab;
                });
        // Places outside the grid, beside its upstream faces.
        if (boundary)
            visit_front(layout, front, -1, [&](int p, int q, int r) {
                if (p < 0 || q < 0 || r < 0)
                    part.given.push_back({layout.slot(p, q), octant.cell(p, q, r)});
            });
    });
    Order order;
    for (const Front& part : parts) {
        order.first.push_back(uint32_t(order.cells.size()));
        order.cells.insert(order.cells.end(), part.near.begin(), part.near.end());
        order.middle.push_back(uint32_t(order.cells.size()));
        order.cells.insert(order.cells.end(), part.interior.begin(), part.interior.end());
        order.first_given.push_back(uint32_t(order.given.size()));
        order.given.insert(order.given.end(), part.given.begin(), part.given.end());
    }
    order.first.push_back(uint32_t(order.cells.size()));
    order.first_given.push_back(uint32_t(order.given.size()));
    return order;
}

/// The directions of a batch, for the kernels.
struct Directions {
    std::vector<glm::vec3> travel; ///< unit, world axes; fewer than `stride`: the rest is padding
    std::vector<glm::vec4> table;  ///< sn::direction_vec4s each
    std::vector<float> weights;    ///< of the coefficients
};

Directions direction_table(const Octant& octant, std::span<const glm::dvec3> positive,
                           uint32_t stride, int total, int order) {
    const SweepLayout& layout = octant.layout;
    const size_t coefficients = size_t(sh_count(order));
    const uint32_t back[] = {1, layout.pitch(), 0};
    Directions directions;
    directions.table.assign(stride * sn::direction_vec4s, glm::vec4(0.0f));
    directions.weights.assign(stride * coefficients, 0.0f);
    for (size_t i = 0; i < positive.size(); ++i) {
        const glm::dvec3 d = positive[i];
        const int along = d.x > d.y ? d.x > d.z ? 0 : 2 : d.y > d.z ? 1 : 2;
        const int u = (along + 1) % 3, v = (along + 2) % 3;
        const double du = d[u] / d[along], dv = d[v] / d[along];
        const glm::uvec4 slots{back[along], back[along] + back[u], back[along] + back[v],
                               back[along] + back[u] + back[v]};
        glm::vec4* row = &directions.table[sn::direction_vec4s * i];
        row[0] = glm::dvec4((1 - du) * (1 - dv), du * (1 - dv), (1 - du) * dv, du * dv);
        row[1] = glm::vec4(slots); // exact: fewer than 2^24
        glm::vec3 travel;
        for (int a = 0; a < 3; ++a)
            travel[layout.axes[a]] = float(d[a] * octant.sign[layout.axes[a]]);
        directions.travel.push_back(travel);
        const ShValues basis = sh_basis(order, -travel);
        for (size_t k = 0; k < coefficients; ++k)
            directions.weights[coefficients * i + k] =
                float(4.0 * glm::pi<double>() / total * double(basis[k]));
    }
    return directions;
}

/// A window over elements [first, last) of a buffer of vec4s, widened to the device's alignment;
/// `base` is where `first` lies in it.
gpu::Window window_over(const gpu::Buffer& buffer, uint64_t first, uint64_t last,
                        uint64_t alignment, uint32_t& base) {
    const uint64_t offset = first * texel / alignment * alignment;
    base = uint32_t((first * texel - offset) / texel);
    return {&buffer, offset, last * texel - offset};
}

gpu::Window whole(const gpu::Buffer& buffer) {
    return {&buffer, 0, buffer.bytes()};
}

template <class T>
void put(const gpu::Device& device, const gpu::Buffer& buffer, std::span<const T> values) {
    gpu::upload(device, buffer, 0, std::as_bytes(values));
}

/// Makes a buffer at least so large.
void reserve(const gpu::Device& device, gpu::Buffer& buffer, uint64_t bytes) {
    if (buffer.bytes() < bytes)
        buffer = gpu::Buffer(device, bytes);
}

} // namespace

uint64_t sn_device_bytes(const Grid& grid, const SnSettings& settings) {
    const SweepLayout layout(grid.dims);
    const uint32_t stride = batch_directions(layout, sn_direction_count(settings.directions),
                                             std::numeric_limits<uint64_t>::max(), false);
    const uint64_t sweep = grid.size() * sn::sh_vec4s(uint32_t(sh_count(settings.order))) * texel
                           + layout.ring_texels(stride) * texel + 3 * chunk_bytes;
    return std::max(sweep, gather_device_bytes(peak_settings(settings)));
}

uint64_t sn_host_bytes(const Grid& grid, uint64_t patches, const SnSettings& settings) {
    const uint64_t sweep = grid.size() * (1 + 8 + sizeof(SnPlace)) + 4 * chunk_bytes;
    return grid.size() * uint64_t(sh_count(settings.order)) * 12
           + std::max(sweep, gather_host_bytes(grid, patches, peak_settings(settings)));
}

double sn_seconds(const Grid& grid, const SnSettings& settings) {
    // Where a tenth of the cells lie beside surfaces.
    return 0.05 + 7.5e-8 * double(grid.size()) * settings.directions;
}

SnProgram::SnProgram(const gpu::Device& device, const Grid& grid, const SnSettings& settings,
                     uint64_t window)
    : device_(device),
      grid_(grid),
      settings_(settings),
      gather_(device, peak_settings(settings)),
      largest_(std::min({window ? window : std::numeric_limits<uint64_t>::max(),
                         device.info().max_storage_range, device.info().max_texels * texel})
               - device.info().window_alignment),
      stride_(batch_directions(SweepLayout(grid.dims), sn_direction_count(settings.directions),
                               largest_, device.is_cpu())) {
    settings_.directions = sn_direction_count(settings.directions);
    using gpu::Binding;
    const sn::SweepTiling tiling = tiling_for(device);
    constexpr Binding transport[] = {Binding::texels_rgba32, Binding::storage, Binding::texels_r32,
                                     Binding::texels_rgba32};
    const uint32_t constants[] = {tiling.local_size, tiling.march};
    transport_ = gpu::Program(device, shaders::transport_comp, transport, sizeof(sn::TransportPush),
                              constants);
    constexpr Binding given[] = {Binding::storage, Binding::storage, Binding::texels_rgba32};
    given_ = gpu::Program(device, shaders::given_comp, given, sizeof(sn::GivenPush), constants);
    constexpr Binding project[] = {Binding::texels_rgba32, Binding::storage, Binding::uniform,
                                   Binding::texels_rgba32, Binding::storage};
    const uint32_t project_constants[] = {tiling.local_size, tiling.project_march,
                                          uint32_t(sh_count(settings.order)),
                                          projected_directions(stride_, settings.order)};
    project_ = gpu::Program(device, shaders::project_comp, project, sizeof(sn::ProjectPush),
                            project_constants);
}

float SnProgram::gather_peaks(const LitSurfaces& lit, const Visibility& visibility, const Sky& sky,
                              Progress& progress, Volume& volume) const {
    const float limit = peak * mean_luminance({lit, visibility, sky}, volume.grid, volume.validity);
    gather_.gather(lit, is_peak(sky, limit) ? sky : Sky(), visibility, volume, progress, limit);
    volume.sh_order = settings_.order;
    volume.sh.resize(size_t(sh_count(settings_.order)));
    return limit;
}

void SnProgram::sweep(const LitSurfaces& lit, const Visibility& visibility, const Sky& sky,
                      float limit, Progress& progress, Volume& volume) const {
    if (limit == 0.0f)
        return; // peaks are all there is
    progress.begin("sweep", 100);
    const SnLight light{lit, visibility,
                        is_peak(sky, limit) ? Sky() : sky_along(sky, settings_.directions), limit};
    const SweepLayout layout(grid_.dims);
    const sn::SweepTiling tiling = tiling_for(device_);
    const gpu::DeviceInfo& info = device_.info();
    const uint64_t largest = largest_;
    const uint32_t coefficients = uint32_t(sh_count(settings_.order));
    const uint64_t cell_bytes = sn::sh_vec4s(coefficients) * texel;
    const uint64_t layer_cells = uint64_t(grid_.dims.x) * uint64_t(grid_.dims.y);
    const uint64_t chunk = std::min(chunk_bytes, largest);
    const uint32_t stride = stride_;
    const uint32_t at_once = projected_directions(stride, settings_.order);
    // The largest front has at most so many cells.
    const uint64_t front_cells = layout.slots();
    if (layer_cells * cell_bytes > largest || layout.ring_texels(stride) * texel > largest
        || front_cells * stride * texel > largest)
        throw Error(ExitCode::memory, "a layer of " + std::to_string(grid_.dims.x) + " x "
                                          + std::to_string(grid_.dims.y) + " cells exceeds what '"
                                          + info.name + "' can bind; lower --resolution");
    const int slab = int(std::min(largest / (layer_cells * cell_bytes), uint64_t(grid_.dims.z)));
    const uint64_t slab_cells = uint64_t(slab) * layer_cells;

    const SnWalls walls = find_walls(lit.patches, grid_.dims);
    // Surfaces beyond the places beside the grid?
    const bool boundary =
        !lit.patches.empty()
        && (glm::any(glm::lessThan(visibility.lo(), glm::vec3(-0.5f)))
            || glm::any(glm::greaterThan(visibility.hi(), glm::vec3(grid_.dims) + 0.5f)));

    const gpu::Buffer sh(device_, grid_.size() * cell_bytes);
    const gpu::Buffer ring(device_, layout.ring_texels(stride) * texel);
    const gpu::Buffer table(device_, stride * sn::direction_vec4s * texel);
    // Each dispatch of project.comp sees the weights of its directions at the start of a window.
    const uint64_t weight_bytes =
        (sn::max_project_weights * sizeof(float) + info.window_alignment - 1)
        / info.window_alignment * info.window_alignment;
    const gpu::Buffer weights(device_, stride / at_once * weight_bytes);
    gpu::Buffer cells(device_, texel), cell_slots(device_, texel), slots(device_, texel),
        values(device_, texel);
    gpu::clear(device_, sh);

    const std::vector<glm::dvec3> positive = sn_octant_directions(settings_.directions);
    const int batches = int((positive.size() + stride - 1) / stride);
    std::vector<glm::vec4> fill(layout.ring_texels(stride)), staged;
    gpu::Batch batch(device_);

    for (int number = 0; number < 8; ++number) {
        const Octant octant(grid_, layout, number);
        const Order order = order_cells(octant, walls, boundary, slab);
        const int fronts = layout.fronts();
        for (int part = 0; part < batches; ++part) {
            const std::span<const glm::dvec3> some = std::span(positive).subspan(
                size_t(part) * stride,
                std::min(size_t(stride), positive.size() - size_t(part) * stride));
            const Directions directions =
                direction_table(octant, some, stride, settings_.directions, settings_.order);
            put(device_, table, std::span<const glm::vec4>(directions.table));
            for (uint32_t d = 0; d < stride; d += at_once)
                gpu::upload(device_, weights, d / at_once * weight_bytes,
                            std::as_bytes(std::span(directions.weights)
                                              .subspan(d * coefficients, at_once * coefficients)));
            // A slot is read before it is written where its place lies outside the grid.
            for (size_t i = 0; i < fill.size(); ++i) {
                const size_t d = i % stride;
                fill[i] = d < some.size()
                              ? glm::vec4(sky_luminance(light.sky, -directions.travel[d]), 0.0f)
                              : glm::vec4(0.0f);
            }
            put(device_, ring, std::span<const glm::vec4>(fill));

            for (int begin = 0; begin < fronts;) {
                // As many fronts as may be streamed at once.
                const auto fits = [&](int end) {
                    const uint64_t traced =
                        order.first_given[size_t(end)] - order.first_given[size_t(begin)];
                    const uint64_t all = order.first[size_t(end)] - order.first[size_t(begin)];
                    return all * sizeof(Entry) <= chunk && traced * stride * texel <= chunk;
                };
                int end = begin + 1;
                while (end < fronts && fits(end + 1))
                    ++end;
                const uint32_t first_cell = order.first[size_t(begin)];
                const uint32_t first_given = order.first_given[size_t(begin)];
                const uint32_t count = order.first[size_t(end)] - first_cell;
                const uint32_t given = order.first_given[size_t(end)] - first_given;
                reserve(device_, cells, count * sizeof(Entry));
                put(device_, cells, std::span(order.cells).subspan(first_cell, count));
                std::vector<float> slots_as_floats(count);
                std::transform(
                    order.cells.begin() + first_cell, order.cells.begin() + first_cell + count,
                    slots_as_floats.begin(),
                    [&](const Entry& entry) { return float(entry.slot % layout.slots()); });
                reserve(device_, cell_slots, count * sizeof(float));
                put(device_, cell_slots, std::span<const float>(slots_as_floats));

                if (given > 0) {
                    std::vector<uint32_t> places(given);
                    std::vector<uint32_t> eights; // of places of a front
                    for (int f = begin; f < end; ++f)
                        for (uint32_t i = order.first_given[size_t(f)];
                             i < order.first_given[size_t(f + 1)]; i += 8)
                            eights.push_back(i);
                    eights.push_back(order.first_given[size_t(end)]);
                    staged.assign(size_t(given) * stride, glm::vec4(0.0f));
                    const std::span<const SnPlace> all(order.given);
                    tbb::parallel_for(size_t(0), eights.size() - 1, [&](size_t i) {
                        const uint32_t from = eights[i], eight = eights[i + 1] - from;
                        for (uint32_t k = from; k < from + eight; ++k)
                            places[k - first_given] = all[k].slot;
                        look(light, all.subspan(from, eight), directions.travel, stride,
                             std::span(staged).subspan(size_t(from - first_given) * stride));
                    });
                    reserve(device_, slots, places.size() * sizeof(uint32_t));
                    reserve(device_, values, staged.size() * texel);
                    put(device_, slots, std::span<const uint32_t>(places));
                    put(device_, values, std::span<const glm::vec4>(staged));
                }

                const auto groups_of = [&](uint32_t entries) {
                    const uint32_t a_group = tiling.local_size / sn::lanes * tiling.march;
                    return gpu::Groups{(entries + a_group - 1) / a_group, stride / sn::lanes, 1};
                };
                uint32_t projected = 0; // entries that are in the coefficients
                for (int f = begin; f < end; ++f) {
                    const auto base = [&](int lag) {
                        return layout.base(f + int(sn::ring_fronts) - lag);
                    };
                    const uint32_t swept = order.middle[size_t(f)] - first_cell,
                                   last = order.first[size_t(f + 1)] - first_cell;
                    const uint32_t given_first = order.first_given[size_t(f)] - first_given,
                                   given_last = order.first_given[size_t(f + 1)] - first_given;
                    if (given_last > given_first) {
                        const gpu::Window windows[] = {whole(ring), whole(slots), whole(values)};
                        const sn::GivenPush push{given_first, given_last, given_first * stride,
                                                 stride, base(0)};
                        batch.dispatch(given_, windows, std::as_bytes(std::span(&push, 1)),
                                       groups_of(given_last - given_first));
                    }
                    if (last > swept) {
                        const gpu::Window windows[] = {whole(ring), whole(ring), whole(cell_slots),
                                                       whole(table)};
                        const sn::TransportPush push{swept,   last,    stride, base(0),
                                                     base(1), base(2), base(3)};
                        batch.dispatch(transport_, windows, std::as_bytes(std::span(&push, 1)),
                                       groups_of(last - swept));
                    }
                    const auto record_project = [&](uint32_t from, uint32_t to) {
                        while (from < to) {
                            const uint64_t number_of_slab =
                                order.cells[first_cell + from].cell / slab_cells;
                            uint32_t until = to;
                            if (slab < grid_.dims.z) {
                                until = from;
                                while (until < to
                                       && order.cells[first_cell + until].cell / slab_cells
                                              == number_of_slab)
                                    ++until;
                            }
                            const uint64_t start = number_of_slab * slab_cells;
                            sn::ProjectPush projection{from, until, stride, 0, uint32_t(start), 0};
                            const uint64_t stop =
                                std::min(start + slab_cells, uint64_t(grid_.size()));
                            const uint64_t quads = sn::sh_vec4s(coefficients);
                            const gpu::Window coefficients_window =
                                window_over(sh, start * quads, stop * quads, info.window_alignment,
                                            projection.sh_base);
                            const uint32_t a_group = tiling.local_size * tiling.project_march;
                            for (uint32_t d = 0; d < stride; d += at_once) {
                                projection.ring_base = d;
                                const gpu::Window all[] = {
                                    whole(ring),
                                    whole(cells),
                                    {&weights, d / at_once * weight_bytes, weight_bytes},
                                    coefficients_window,
                                    coefficients_window};
                                batch.dispatch(project_, all,
                                               std::as_bytes(std::span(&projection, 1)),
                                               {(until - from + a_group - 1) / a_group, 1, 1});
                            }
                            from = until;
                        }
                    };
                    if (f + 1 == end || (f + 1 - begin) % int(sn::projected_fronts) == 0) {
                        record_project(projected, last);
                        projected = last;
                    }
                }
                batch.run();
                begin = end;
                progress.advance(
                    uint64_t(100.0 * (number + (part + double(end) / fronts) / batches) / 8.0));
            }
        }
    }

    std::vector<float> layer(layer_cells * cell_bytes / sizeof(float));
    for (int z = 0; z < grid_.dims.z; ++z) {
        const uint64_t start = uint64_t(z) * layer_cells;
        gpu::download(device_, sh, start * cell_bytes, std::as_writable_bytes(std::span(layer)));
        tbb::parallel_for(uint64_t(0), layer_cells, [&](uint64_t cell) {
            const float* c = &layer[cell * cell_bytes / sizeof(float)];
            for (size_t k = 0; k < coefficients; ++k)
                volume.sh[k][start + cell] += glm::vec3(c[3 * k], c[3 * k + 1], c[3 * k + 2]);
        });
    }
}

} // namespace lpvbake
