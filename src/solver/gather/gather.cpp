#include "solver/gather/gather.h"

#include "solver/gather/adaptive_grid.h"
#include "solver/gather/blocks.h"
#include "solver/gather/cell_zone.h"
#include "solver/gather/packets.h"
#include "solver/gather/places.h"
#include "solver/models.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::gather {
namespace {

constexpr uint64_t usual_list_bytes = uint64_t(32) << 20;

/// Cells along the edge of a part of a zone, from which packets are filled (part_of).
constexpr int part_edge = zone_edge / 2;

/// Whether a cell is interpolated, and what it is made from, goes by the cells that the first pass
/// solves up to two parts away: those that fill a packet in the second pass depend on boxes around
/// the part, and these on packets of the first. Who is in a packet shows in its cells' last bits:
/// bins of sky that all of them see are one source.
volume::Slab with_halo(volume::Slab own, const Grid& grid) {
    return volume::widened(own, 2 * part_edge, grid);
}

int sky_groups(const GatherSettings& settings) {
    return settings.sky_bins > 0 ? settings.sky_bins / int(sky_group) : settings.vpls;
}

/// What lies near surfaces is solved, the rest is mostly interpolated.
double solved_cells(const Grid& grid, uint64_t patches, const GatherSettings& settings) {
    const double share =
        models::solved_patch
        + models::solved_tolerance / std::max(double(settings.tolerance), models::least_tolerance);
    return std::min(models::solved_share * double(grid.size()), share * double(patches));
}

/// One gather under way.
class Gathering {
public:
    Gathering(const gpu::Device& device, const GatherSettings& settings,
              const gpu::Program& surfaces, uint32_t local_size, uint64_t list_bytes,
              const Surroundings& world, const Cells& cells, volume::Slab own, Volume& volume,
              std::span<Volume> layers, Progress& progress, GatherReport& report, Laps& laps)
        : settings_(settings),
          world_(world),
          cells_(cells),
          grid_(cells.grid),
          own_(own),
          known_(with_halo(own, grid_)),
          zone_grid_{{}, 1.0, (grid_.dims + zone_edge - 1) / zone_edge},
          zones_(zone_grid_.size()),
          volume_(volume),
          layers_(layers),
          progress_(progress),
          report_(report),
          laps_(laps),
          solver_(device, settings.order, surfaces, local_size, list_bytes, world, volume, layers,
                  report, laps),
          adaptive_(volume, known_, cells.occupied, settings.tolerance) {}

    void run() {
        progress_.begin("gather", 3 * zones_.size());
        if (settings_.tolerance > 0.0f) {
            adaptive_.want(adaptive_.all(), coarse_edge, known_);
            solve(0);
            const std::vector<CellBox> rough = adaptive_.leave_smooth(coarse_edge);
            const volume::Slab beside = volume::widened(own_, part_edge, grid_);
            for (const CellBox& box : rough)
                adaptive_.want(box, coarse_edge / 2, beside);
            laps_.add_to(report_.interpolation_seconds);
            solve(1);
            for (const CellBox& half : adaptive_.leave_smooth_halves(rough, coarse_edge / 2))
                adaptive_.want(half, 1, own_);
            laps_.add_to(report_.interpolation_seconds);
        } else {
            adaptive_.want(adaptive_.all(), 1, own_);
        }
        solve(2);
        adaptive_.interpolate(own_, volume_); // what is left lies in a smooth box
        for (Volume& layer : layers_)
            adaptive_.interpolate(own_, layer);
        report_.interpolated = adaptive_.interpolated(own_);
        for (const std::unique_ptr<CellZone>& zone : zones_)
            report_.rays += zone ? zone->rays() : 0;
        laps_.add_to(report_.interpolation_seconds);
    }

private:
    /// Solves the cells that are wanted; the first, second or third time.
    void solve(int stage) {
        const std::vector<Packet> packets = test_visibility(stage);
        laps_.add_to(report_.visibility_seconds);
        solver_.solve(packets, [&] { progress_.advance(uint64_t(stage + 1) * zones_.size()); });
        for (const Packet& packet : packets)
            for (const size_t cell : packet.cells)
                adaptive_.state[cell] = CellState::solved;
    }

    /// What the wanted cells see, a zone at a time; returns them, zone by zone.
    std::vector<Packet> test_visibility(int stage) {
        std::vector<std::vector<Packet>> packets(zones_.size());
        constexpr size_t block = 32;
        for (size_t first = 0; first < zones_.size(); first += block) {
            progress_.advance(uint64_t(stage) * zones_.size() + first);
            tbb::parallel_for(first, std::min(zones_.size(), first + block),
                              [&](size_t i) { packets[i] = test_visibility_in(i); });
        }
        std::vector<Packet> all;
        for (std::vector<Packet>& own : packets)
            std::ranges::move(own, std::back_inserter(all));
        return all;
    }

    std::vector<Packet> test_visibility_in(size_t zone) {
        const glm::ivec3 base = base_of(zone);
        const glm::ivec3 end = glm::min(base + zone_edge, grid_.dims);
        std::vector<std::pair<uint32_t, glm::ivec3>> cells;
        for (int z = std::max(base.z, known_.begin); z < std::min(end.z, known_.end); ++z)
            for (int y = base.y; y < end.y; ++y)
                for (int x = base.x; x < end.x; ++x)
                    if (adaptive_.state[adaptive_.index({x, y, z})] == CellState::wanted)
                        cells.push_back({morton(glm::vec3(x, y, z) - glm::vec3(base)), {x, y, z}});
        std::vector<Packet> packets;
        if (cells.empty())
            return packets;
        if (!zones_[zone])
            zones_[zone] = std::make_unique<CellZone>(world_, cells_, base, end - 1);
        std::sort(cells.begin(), cells.end(),
                  [](const auto& a, const auto& b) { return a.first < b.first; });
        std::vector<glm::ivec3> places(cells.size());
        std::ranges::transform(cells, places.begin(), [](const auto& cell) { return cell.second; });
        zones_[zone]->find(places);
        for (size_t at = 0; at < cells.size(); ++at) {
            if (at == 0 || packets.back().cells.size() == lanes
                || part_of(cells[at].first) != part_of(cells[at - 1].first))
                packets.push_back({zones_[zone].get(), {}, {}, {}});
            const glm::ivec3 cell = cells[at].second;
            packets.back().cells.push_back(adaptive_.index(cell));
            packets.back().points.push_back(world_.visibility.capture(cell).point);
            packets.back().sees.push_back(zones_[zone]->sees(cell));
        }
        return packets;
    }

    glm::ivec3 base_of(size_t zone) const { return zone_edge * zone_grid_.cell_at(zone); }

    const GatherSettings& settings_;
    const Surroundings& world_;
    const Cells& cells_;
    const Grid& grid_;
    volume::Slab own_, known_; ///< layers that are wanted, and those that they are made from
    Grid zone_grid_;           ///< its cells are the zones
    std::vector<std::unique_ptr<CellZone>> zones_;
    Volume& volume_;
    std::span<Volume> layers_;
    Progress& progress_;
    GatherReport& report_;
    Laps& laps_;
    PacketSolver solver_;
    AdaptiveGrid adaptive_;
};

} // namespace

uint64_t gather_device_bytes(const GatherSettings& settings, bool layers) {
    return batch_bytes(settings.order, usual_list_bytes, layers) + (uint64_t(1) << 20);
}

uint64_t gather_host_bytes(const Grid& grid, uint64_t patches, const GatherSettings& settings,
                           bool gpu, uint64_t layers, bool two_sided) {
    const uint64_t tests = uint64_t(settings.vpls) + sky_group * uint64_t(sky_groups(settings));
    const double solved =
        settings.tolerance > 0.0f ? solved_cells(grid, patches, settings) : double(grid.size());
    const double seen = double(tests / 8) * solved;
    namespace bytes = models::bytes;
    return grid.size() * bytes::gather_cell + uint64_t(seen)
           + (two_sided ? 2 : 1) * patches * (bytes::gather_patch + layers * 2 * sizeof(glm::vec3))
           + std::min<uint64_t>(bytes::gather_lists, bytes::gather_lists_cell * grid.size())
           + (gpu ? gather_device_bytes(settings, layers > 0) : 0); // to carry it there
}

double gather_seconds(const Grid& grid, uint64_t patches, const GatherSettings& settings,
                      bool gpu) {
    namespace seconds = models::seconds;
    const seconds::Device& device = seconds::of_device(gpu);
    const double solved = solved_cells(grid, patches, settings);
    return seconds::gather + seconds::gather_patch * double(patches)
           + solved * (device.gather_cell + device.gather_cluster * double(settings.vpls))
                 * (settings.order > 2 ? seconds::gather_above_2 : 1.0);
}

double gather_seconds_at(uint64_t places, bool blocks, uint64_t patches,
                         const GatherSettings& settings) {
    namespace seconds = models::seconds;
    const double own = blocks ? seconds::gather_sample : seconds::gather_place;
    const double ray = blocks ? seconds::gather_shared_ray : seconds::gather_ray;
    return seconds::gather + seconds::gather_patch * double(patches)
           + double(places) * (own + ray * double(settings.vpls))
                 * (settings.order > 2 ? seconds::gather_above_2 : 1.0);
}

GatherProgram::GatherProgram(const gpu::Device& device, const GatherSettings& settings,
                             uint64_t window)
    : device_(device),
      settings_(settings),
      list_bytes_(
          std::max<uint64_t>(window ? window : usual_list_bytes, job_words * sizeof(glm::vec4))),
      local_size_(device.is_cpu() ? lanes : 64),
      surfaces_(compile(device, local_size_, settings.order, part_surfaces)) {}

Senders GatherProgram::senders(const surface::LitSurfaces& surfaces, const Sky& sky,
                               const visibility::Visibility& visibility, float above,
                               std::span<const scene::LightLayer> layers) const {
    Laps laps;
    Senders senders{make_clusters(surfaces, visibility, above),
                    make_sky_bins(sky, sky_groups(settings_), settings_.order, layers)};
    laps.add_to(senders.seconds);
    return senders;
}

/// Sizes the volumes and calls `run` with what sends light, unless nothing does.
template <class Run>
GatherReport GatherProgram::with_senders(const Senders& senders,
                                         const visibility::Visibility& visibility, size_t cells,
                                         Volume& volume, const Layers& layers,
                                         const Run& run) const {
    GatherReport report;
    report.clusters_seconds = senders.seconds;
    const auto size = [&](Volume& of, int order) {
        of.sh_order = order;
        of.sh.assign(terms(order), std::vector<glm::vec3>(cells, glm::vec3(0.0f)));
    };
    size(volume, settings_.order);
    for (size_t i = 0; i < layers.volumes.size(); ++i)
        size(layers.volumes[i], layers.light[i].order.value_or(settings_.order));
    if (senders.empty())
        return report;
    Laps laps;
    run(Surroundings{visibility, senders.clusters, senders.bins, settings_.vpls, settings_.kappa},
        report, laps);
    return report;
}

/// The same with what solves eight places at a time.
template <class Run>
GatherReport GatherProgram::with_packets(const Senders& senders,
                                         const visibility::Visibility& visibility, Volume& volume,
                                         const Layers& layers, const Run& run) const {
    return with_senders(senders, visibility, volume.grid.size(), volume, layers,
                        [&](const Surroundings& world, GatherReport& report, Laps& laps) {
                            PacketSolver solver(device_, settings_.order, surfaces_, local_size_,
                                                list_bytes_, world, volume, layers.volumes, report,
                                                laps);
                            run(world, solver, report, laps);
                        });
}

GatherReport GatherProgram::gather(const surface::LitSurfaces& surfaces, const Sky& sky,
                                   const visibility::Visibility& visibility, Volume& volume,
                                   Progress& progress, float above, const Layers& layers,
                                   std::optional<volume::Slab> slab) const {
    const Grid& grid = volume.grid;
    const volume::Slab own = slab.value_or(volume::all_of(grid)), known = with_halo(own, grid);
    const Occupied occupied(surfaces.patches, grid);
    const Cells cells{grid, occupied, volume.validity};
    const GatherReport report =
        with_senders(senders(surfaces, sky, visibility, above, layers.light), visibility,
                     volume::grid_of(known, grid).size(), volume, layers,
                     [&](const Surroundings& world, GatherReport& done, Laps& laps) {
                         Gathering(device_, settings_, surfaces_, local_size_, list_bytes_, world,
                                   cells, own, volume, layers.volumes, progress, done, laps)
                             .run();
                     });
    const auto keep = [&](Volume& of) {
        for (std::vector<glm::vec3>& values : of.sh)
            volume::cut(known, own, grid, values);
    };
    keep(volume);
    std::ranges::for_each(layers.volumes, keep);
    return report;
}

GatherReport GatherProgram::gather_at(std::span<const glm::vec3> places,
                                      const surface::LitSurfaces& surfaces, const Sky& sky,
                                      const visibility::Visibility& visibility, Volume& volume,
                                      Progress& progress, const Layers& layers) const {
    return with_packets(
        senders(surfaces, sky, visibility, 0.0f, layers.light), visibility, volume, layers,
        [&](const Surroundings& world, PacketSolver& solver, GatherReport& report, Laps& laps) {
            solve_places(places, world, solver, volume, layers.volumes, progress, report, laps);
        });
}

GatherReport GatherProgram::gather_blocks(std::span<const Block> blocks,
                                          const surface::LitSurfaces& surfaces,
                                          const Senders& senders,
                                          const visibility::Visibility& visibility, Volume& volume,
                                          Progress& progress) const {
    return with_packets(
        senders, visibility, volume, {},
        [&](const Surroundings& world, PacketSolver& solver, GatherReport& report, Laps& laps) {
            solve_blocks(blocks, surfaces.patches, world, solver, progress, report, laps);
        });
}

} // namespace lpvbake::solver::gather
