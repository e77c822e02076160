#include "solver/gather/gather.h"

#include "solver/gather/adaptive_grid.h"
#include "solver/gather/batcher.h"
#include "solver/gather/gather.comp.h"
#include "solver/gather/zone.h"
#include "solver/models.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>

namespace lpvbake::solver::gather {
namespace {

constexpr size_t chunk = 1024; ///< packets whose lists the host makes at a time
constexpr uint64_t usual_list_bytes = uint64_t(32) << 20;

/// Adds the time since it last did to one counter after the other.
class Laps {
public:
    void add_to(double& seconds) {
        const Clock::time_point now = Clock::now();
        seconds += std::chrono::duration<double>(now - last_).count();
        last_ = now;
    }

private:
    using Clock = std::chrono::steady_clock;
    Clock::time_point last_ = Clock::now();
};

/// Eight cells, or fewer, of a zone.
struct Packet {
    uint32_t zone;
    std::vector<glm::ivec3> cells;
    std::vector<glm::vec3> points; ///< where their light is taken
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

/// One gather under way.
class Gathering {
public:
    Gathering(const gpu::Device& device, const GatherSettings& settings,
              const gpu::Program& surfaces, uint32_t local_size, uint64_t list_bytes,
              const Surroundings& world, Volume& volume, Progress& progress, GatherReport& report,
              Laps& laps)
        : settings_(settings),
          surfaces_(surfaces),
          world_(world),
          grid_(world.grid),
          zone_grid_{{}, 1.0, (grid_.dims + zone_edge - 1) / zone_edge},
          zones_(zone_grid_.size()),
          volume_(volume),
          progress_(progress),
          report_(report),
          laps_(laps),
          batcher_(device, local_size, settings.order, list_bytes, volume),
          adaptive_(volume, world.occupied, settings.tolerance) {
        if (!world.sky.empty())
            sky_ = compile(device, local_size, settings.order, part_sky);
    }

    void run() {
        progress_.begin("gather", 3 * zones_.size());
        if (settings_.tolerance > 0.0f) {
            adaptive_.want(adaptive_.all(), coarse_edge);
            solve(0);
            const std::vector<CellBox> rough = adaptive_.leave_smooth(coarse_edge);
            for (const CellBox& box : rough)
                adaptive_.want(box, coarse_edge / 2);
            laps_.add_to(report_.interpolation_seconds);
            solve(1);
            for (const CellBox& half : adaptive_.leave_smooth_halves(rough, coarse_edge / 2))
                adaptive_.want(half, 1);
            laps_.add_to(report_.interpolation_seconds);
        } else {
            adaptive_.want(adaptive_.all(), 1);
        }
        solve(2);
        adaptive_.interpolate(volume_); // what is left lies in a smooth box
        report_.interpolated = adaptive_.interpolated();
        for (const std::unique_ptr<Zone>& zone : zones_)
            report_.rays += zone ? zone->rays() : 0;
        laps_.add_to(report_.interpolation_seconds);
    }

private:
    /// Solves the cells that are wanted; the first, second or third time.
    void solve(int stage) {
        const std::vector<Packet> packets = test_visibility(stage);
        laps_.add_to(report_.visibility_seconds);
        if (!world_.clusters.nodes.empty())
            gather(surfaces_, packets, stage, [&](const Packet& packet, Sources& to) {
                zones_[packet.zone]->gather_surfaces(packet.cells, packet.points, to);
            });
        if (!world_.sky.empty())
            gather(sky_, packets, stage, [&](const Packet& packet, Sources& to) {
                zones_[packet.zone]->gather_sky(packet.cells, settings_.order, to);
            });
        for (const Packet& packet : packets) {
            report_.solved += packet.cells.size();
            for (const glm::ivec3 cell : packet.cells)
                adaptive_.state[grid_.index(cell)] = CellState::solved;
        }
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
        for (int z = base.z; z < end.z; ++z)
            for (int y = base.y; y < end.y; ++y)
                for (int x = base.x; x < end.x; ++x)
                    if (adaptive_.state[grid_.index({x, y, z})] == CellState::wanted)
                        cells.push_back({morton(glm::ivec3(x, y, z) - base), {x, y, z}});
        std::vector<Packet> packets;
        if (cells.empty())
            return packets;
        if (!zones_[zone])
            zones_[zone] = std::make_unique<Zone>(world_, base);
        std::sort(cells.begin(), cells.end(),
                  [](const auto& a, const auto& b) { return a.first < b.first; });
        for (size_t at = 0; at < cells.size(); ++at) {
            // Never from two of the zone's eight parts: a list is as long as its cells lie apart.
            if (at == 0 || packets.back().cells.size() == lanes
                || cells[at].first >> 9 != cells[at - 1].first >> 9)
                packets.push_back({uint32_t(zone), {}, {}});
            packets.back().cells.push_back(cells[at].second);
            packets.back().points.push_back(world_.visibility.capture(cells[at].second).point);
            zones_[zone]->test_visibility(cells[at].second);
        }
        return packets;
    }

    glm::ivec3 base_of(size_t zone) const { return zone_edge * zone_grid_.cell_at(zone); }

    /// Runs `program` on what `list` lists for each packet.
    template <class List>
    void gather(const gpu::Program& program, const std::vector<Packet>& packets, int stage,
                const List& list) {
        batcher_.use(program);
        sources_.resize(std::max(sources_.size(), std::min(chunk, packets.size())));
        for (size_t first = 0; first < packets.size(); first += chunk) {
            progress_.advance(uint64_t(stage + 1) * zones_.size());
            const size_t count = std::min(chunk, packets.size() - first);
            tbb::parallel_for(size_t(0), count, [&](size_t i) {
                sources_[i].clear();
                list(packets[first + i], sources_[i]);
            });
            laps_.add_to(report_.lists_seconds);
            for (size_t i = 0; i < count; ++i) {
                batcher_.add(packets[first + i].cells, packets[first + i].points, sources_[i]);
                report_.sources += lanes
                                   * (sources_[i].points.size() / point_words
                                      + sources_[i].triangles.size() / triangle_words
                                      + sources_[i].bins.size() / bin_words(settings_.order));
            }
            batcher_.copy_lists();
            laps_.add_to(report_.device_seconds);
        }
        batcher_.run();
        laps_.add_to(report_.device_seconds);
    }

    const GatherSettings& settings_;
    const gpu::Program& surfaces_;
    gpu::Program sky_;
    const Surroundings& world_;
    const Grid& grid_;
    Grid zone_grid_; ///< its cells are the zones
    std::vector<std::unique_ptr<Zone>> zones_;
    Volume& volume_;
    Progress& progress_;
    GatherReport& report_;
    Laps& laps_;
    Batcher batcher_;
    AdaptiveGrid adaptive_;
    std::vector<Sources> sources_; ///< of a chunk of packets
};

} // namespace

uint64_t gather_device_bytes(const GatherSettings& settings) {
    return batch_bytes(settings.order, usual_list_bytes) + (uint64_t(1) << 20);
}

uint64_t gather_host_bytes(const Grid& grid, uint64_t patches, const GatherSettings& settings) {
    const uint64_t tests = uint64_t(settings.vpls) + sky_group * uint64_t(sky_groups(settings));
    const uint64_t cell = 1 + 2 + tests / 8 + 32;
    return grid.size() * cell + 2 * patches * (sizeof(Emitter) + 2 * sizeof(Cluster))
           + chunk * 2 * job_words * sizeof(glm::vec4) + 2 * gather_device_bytes(settings);
}

double gather_seconds(const Grid& grid, uint64_t patches, const GatherSettings& settings) {
    // What lies near surfaces is solved, the rest is mostly interpolated.
    namespace seconds = models::seconds;
    const double share =
        models::solved_patch
        + models::solved_tolerance / std::max(double(settings.tolerance), models::least_tolerance);
    const double solved =
        std::min(models::solved_share * double(grid.size()), share * double(patches));
    return seconds::gather + seconds::gather_patch * double(patches)
           + solved * (seconds::gather_cell + seconds::gather_cluster * double(settings.vpls))
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

GatherReport GatherProgram::gather(const surface::LitSurfaces& surfaces, const Sky& sky,
                                   const visibility::Visibility& visibility, Volume& volume,
                                   Progress& progress, float above) const {
    GatherReport report;
    const Grid& grid = volume.grid;
    volume.sh_order = settings_.order;
    volume.sh.assign(terms(settings_.order), std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));
    Laps laps;
    const Clusters clusters = make_clusters(surfaces, visibility, above);
    const std::vector<SkyBin> bins = make_sky_bins(sky, sky_groups(settings_), settings_.order);
    const Occupied occupied(surfaces.patches, grid);
    const Surroundings world{grid,     visibility,      clusters,       bins,
                             occupied, volume.validity, settings_.vpls, settings_.kappa};
    if (clusters.nodes.empty() && bins.empty())
        return report;
    laps.add_to(report.clusters_seconds);
    Gathering(device_, settings_, surfaces_, local_size_, list_bytes_, world, volume, progress,
              report, laps)
        .run();
    return report;
}

} // namespace lpvbake::solver::gather
