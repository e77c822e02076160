#include "solver/sn/sn.h"

#include "solver/models.h"
#include "solver/sn/directions.h"
#include "solver/sn/first_flight.h"
#include "solver/sn/occupancy.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <limits>

namespace lpvbake::solver::sn {
namespace {

/// What is brighter than so many times the mean is gathered, not swept: a bright spot, small as
/// seen from most cells, is what a few directions miss or see as beams. Less than 1 / `peak` of
/// what the cells see is so bright.
constexpr float peak = 1.5f;

/// The sky is either gathered or swept.
bool is_peak(const Sky& sky, float limit) {
    const glm::dvec3 mean = scene::sky_mean(sky, -1.0, 1.0, 0.0, 2.0 * glm::pi<double>());
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
    return scene::averaged_sky(sky, directions);
}

/// True if surfaces lie beyond the places beside the grid.
bool reaches_out(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
                 const Grid& grid) {
    return !lit.patches.empty()
           && (glm::any(glm::lessThan(visibility.lo(), glm::vec3(-0.5f)))
               || glm::any(glm::greaterThan(visibility.hi(), glm::vec3(grid.dims) + 0.5f)));
}

} // namespace

gather::GatherSettings peak_settings(const SnSettings& settings) {
    gather::GatherSettings gather;
    // A window shows little of the sky: its edges are what is seen of the number of bins.
    gather.sky_bins = 8 * settings.directions;
    // What more directions cannot show, edges of shadows, takes more clusters.
    const double finer = double(settings.directions) / double(SnSettings().directions);
    gather.vpls = int(std::clamp(finer * finer, 1.0, 4.0) * gather.vpls);
    gather.order = settings.order == 3 ? 4 : settings.order; // 3 it does not know
    return gather;
}

uint64_t sn_device_bytes(const Grid& grid, const SnSettings& settings) {
    const uint64_t sweep =
        sweep_bytes(grid, sn_direction_count(settings.directions), settings.order);
    return std::max(sweep, gather::gather_device_bytes(peak_settings(settings)));
}

uint64_t sn_host_bytes(const Grid& grid, uint64_t patches, const SnSettings& settings) {
    const uint64_t sweep = grid.size() * (1 + 8 + sizeof(SnPlace)) + 4 * chunk_bytes;
    return grid.size() * uint64_t(volume::sh_count(settings.order)) * 12
           + std::max(sweep, gather::gather_host_bytes(grid, patches, peak_settings(settings)));
}

double sn_seconds(const Grid& grid, const SnSettings& settings, bool gpu) {
    const models::seconds::Device& device = models::seconds::of_device(gpu);
    return device.sweep + device.sweep_cell * double(grid.size()) * settings.directions;
}

SnProgram::SnProgram(const gpu::Device& device, const Grid& grid, const SnSettings& settings,
                     uint64_t window)
    : device_(device),
      grid_(grid),
      settings_{sn_direction_count(settings.directions), settings.order},
      gather_(device, peak_settings(settings)),
      largest_(
          std::min({window ? window : std::numeric_limits<uint64_t>::max(),
                    device.info().max_storage_range, device.info().max_texels * sizeof(glm::vec4)})
          - device.info().window_alignment),
      stride_(swept_directions(SweepLayout(grid.dims), settings_.directions, largest_,
                               device.is_cpu())),
      sweep_(compile_sweep(device, stride_, settings.order)) {}

float SnProgram::gather_peaks(const surface::LitSurfaces& lit,
                              const visibility::Visibility& visibility, const Sky& sky,
                              Progress& progress, Volume& volume) const {
    const float limit = peak * mean_luminance({lit, visibility, sky}, volume.grid, volume.validity);
    gather_.gather(lit, is_peak(sky, limit) ? sky : Sky(), visibility, volume, progress, limit);
    volume.sh_order = settings_.order;
    volume.sh.resize(size_t(volume::sh_count(settings_.order)));
    return limit;
}

void SnProgram::sweep(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
                      const Sky& sky, float limit, Progress& progress, Volume& volume) const {
    if (limit == 0.0f)
        return; // peaks are all there is
    progress.begin("sweep", 100);
    const SnLight light{lit, visibility,
                        is_peak(sky, limit) ? Sky() : sky_along(sky, settings_.directions), limit};
    const SweepPlan plan = plan_sweep(device_, grid_, settings_.order, stride_, largest_);
    const Occupancy occupancy = find_occupied(lit.patches, grid_.dims);
    const bool boundary = reaches_out(lit, visibility, grid_);
    const std::vector<glm::dvec3> positive = sn_octant_directions(settings_.directions);
    const size_t batches = (positive.size() + stride_ - 1) / stride_;
    Sweeper sweeper(device_, grid_, plan, sweep_);
    std::vector<glm::vec4> ring;
    Chunk chunk;
    for (int number = 0; number < 8; ++number) {
        const Octant octant(grid_, plan.layout, number);
        const FrontOrder order = order_fronts(octant, occupancy, boundary, plan.slab);
        for (size_t batch = 0; batch < batches; ++batch) {
            const size_t first = batch * stride_;
            const Directions directions =
                direction_table(octant,
                                std::span(positive).subspan(
                                    first, std::min(size_t(stride_), positive.size() - first)),
                                stride_, settings_.directions, settings_.order);
            fill_ring(light.sky, directions, stride_, plan.ring_texels(), ring);
            sweeper.begin(directions, ring);
            for (int begin = 0; begin < order.fronts(); begin = chunk.end) {
                pack_fronts(order, plan.layout, stride_, plan.chunk, begin, chunk);
                trace_given(order, light, directions, stride_, chunk);
                sweeper.run(order, chunk);
                const double share = double(chunk.end) / order.fronts();
                progress.advance(
                    uint64_t(100.0 * (number + (double(batch) + share) / double(batches)) / 8.0));
            }
        }
    }
    sweeper.add_to(volume);
}

} // namespace lpvbake::solver::sn
