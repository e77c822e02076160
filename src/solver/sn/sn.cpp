#include "solver/sn/sn.h"

#include "solver/models.h"
#include "solver/sn/directions.h"
#include "solver/sn/first_flight.h"
#include "solver/sn/host_sweeper.h"
#include "solver/sn/occupancy.h"
#include "surface/kept.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>

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

/// The layers, of skies only where those are wanted.
std::vector<scene::LightLayer> sky_layers(std::span<const scene::LightLayer> layers, bool skies) {
    std::vector<scene::LightLayer> wanted(layers.begin(), layers.end());
    for (scene::LightLayer& layer : wanted)
        if (!skies) {
            layer.sky = glm::vec3(0.0f);
            layer.beyond = {};
        }
    return wanted;
}

/// True if surfaces lie beyond the places beside the tile.
bool reaches_out(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
                 const Tile& tile) {
    const glm::vec3 lo(tile.begin), hi(tile.begin + tile.cells.dims);
    return !lit.patches.empty()
           && (glm::any(glm::lessThan(visibility.lo(), lo - 0.5f))
               || glm::any(glm::greaterThan(visibility.hi(), hi + 0.5f)));
}

/// Those of some layers of a grid.
std::vector<Tile> tiles_of(const Grid& grid, volume::Slab slab, const SnSettings& settings) {
    const glm::ivec3 edges = tile_of(grid, settings).dims;
    std::vector<Tile> tiles;
    for (int z = slab.begin; z < slab.end; z += edges.z)
        for (int y = 0; y < grid.dims.y; y += edges.y)
            for (int x = 0; x < grid.dims.x; x += edges.x) {
                const glm::ivec3 begin(x, y, z);
                tiles.push_back({begin, {{}, 1.0, glm::min(edges, grid.dims - begin)}});
            }
    return tiles;
}

/// More than this are not kept: 256 MiB in memory.
constexpr uint64_t most_kept_rays = uint64_t(1) << 26;

/// Of what is tinted only what has passed something.
void write_sights(const Sights& of, cache::Writer& out) {
    std::vector<uint32_t> tinted;
    std::vector<glm::vec3> tints;
    for (size_t i = 0; i < of.tints.size(); ++i)
        if (of.tints[i] != glm::vec3(1.0f)) {
            tinted.push_back(uint32_t(i));
            tints.push_back(of.tints[i]);
        }
    out.put(of.sides);
    out.put(uint8_t(of.tints.empty() ? 0 : 1));
    out.put(tinted);
    out.put(tints);
}

bool read_sights(cache::Reader& in, size_t sides, Sights& of) {
    std::vector<uint32_t> tinted;
    std::vector<glm::vec3> tints;
    uint8_t has_tints = 0;
    if (!in.get(of.sides) || !in.get(has_tints) || !in.get(tinted) || !in.get(tints)
        || tinted.size() != tints.size() || (has_tints == 0 && !tints.empty())
        || std::ranges::any_of(of.sides,
                               [&](uint32_t side) { return side < Sight::sky && side >= sides; }))
        return false;
    of.tints.assign(has_tints ? of.sides.size() : 0, glm::vec3(1.0f));
    for (size_t i = 0; i < tinted.size(); ++i) {
        if (tinted[i] >= of.tints.size())
            return false;
        of.tints[tinted[i]] = tints[i];
    }
    return true;
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

Grid tile_of(const Grid& grid, const SnSettings& settings) {
    return settings.tile == 0 ? grid
                              : Grid{{}, 1.0, glm::min(grid.dims, glm::ivec3(settings.tile))};
}

uint64_t sn_device_bytes(const Grid& grid, const SnSettings& settings, bool layers) {
    const uint64_t sweep = sweep_bytes(tile_of(grid, settings),
                                       sn_direction_count(settings.directions), settings.order);
    return std::max(sweep, gather::gather_device_bytes(peak_settings(settings), layers));
}

uint64_t sn_host_bytes(const Grid& grid, uint64_t patches, uint64_t bright,
                       const SnSettings& settings, bool gpu, uint64_t layers, bool two_sided) {
    const Grid tile = tile_of(grid, settings);
    const uint64_t directions = uint64_t(sn_direction_count(settings.directions));
    // Half of the directions come from where the surface is, in half of the quadrants of a course.
    const uint64_t of_near = sizeof(NearCell) + quadrants / 2 * sizeof(SnPlace)
                             + (layers > 0 ? sizeof(uint32_t) * directions / 2 : 0);
    uint64_t sweep = 2 * grid.size() + std::min(tile.size(), patches) * of_near + 2 * chunk_bytes;
    uint64_t peaks =
        gather::gather_host_bytes(grid, bright, peak_settings(settings), gpu, layers, two_sided);
    // Lists of what is bright are half as long.
    peaks -= std::min<uint64_t>(models::bytes::gather_lists,
                                models::bytes::gather_lists_cell * grid.size())
             / 2;
    if (!gpu) { // the device's memory is the host's, and neither takes what the other does
        const uint64_t device = sn_device_bytes(grid, settings, layers > 0);
        sweep += host_sweep_bytes(tile, int(directions), settings.order);
        sweep -= std::min(sweep, device);
        peaks += gather::gather_device_bytes(peak_settings(settings), layers > 0);
        peaks -= std::min(peaks, device);
    }
    return std::max(sweep, peaks);
}

double sn_seconds(const Grid& grid, const SnSettings& settings, bool gpu) {
    const models::seconds::Device& device = models::seconds::of_device(gpu);
    return device.sweep + device.sweep_cell * double(grid.size()) * settings.directions;
}

SnProgram::SnProgram(const gpu::Device& device, const Grid& grid, const SnSettings& settings,
                     uint64_t window)
    : device_(device),
      grid_(grid),
      settings_{sn_direction_count(settings.directions), settings.order, settings.tile},
      gather_(device, peak_settings(settings)),
      largest_(
          std::min({window ? window : std::numeric_limits<uint64_t>::max(),
                    device.info().max_storage_range, device.info().max_texels * sizeof(glm::vec4)})
          - device.info().window_alignment),
      stride_(swept_directions(tile_of(grid, settings), settings_.directions, largest_)),
      on_host_(device.is_cpu() && window == 0),
      sweep_(on_host_ ? std::nullopt
                      : std::optional(compile_sweep(device, tile_of(grid, settings), stride_,
                                                    settings.order))) {}

float SnProgram::gather_peaks(const surface::LitSurfaces& lit,
                              const visibility::Visibility& visibility, const Sky& sky,
                              Progress& progress, Volume& volume, const gather::Layers& layers,
                              std::optional<volume::Slab> slab) const {
    if (visibility.air()) { // the gather knows of none: all is swept
        const Grid cells = volume::grid_of(slab.value_or(volume::all_of(grid_)), grid_);
        volume.sh_order = settings_.order;
        volume.sh.assign(size_t(volume::sh_count(settings_.order)),
                         std::vector(cells.size(), glm::vec3(0.0f)));
        return HUGE_VALF;
    }
    const float limit = peak * mean_luminance({lit, visibility, sky}, volume.grid, volume.validity);
    const bool bright = is_peak(sky, limit);
    const std::vector<scene::LightLayer> gathered = sky_layers(layers.light, bright);
    gather_.gather(lit, bright ? sky : Sky(), visibility, volume, progress, limit,
                   {gathered, layers.volumes}, slab);
    const auto cut = [&](Volume& of) {
        of.sh_order = settings_.order;
        of.sh.resize(size_t(volume::sh_count(settings_.order)));
    };
    cut(volume);
    std::ranges::for_each(layers.volumes, cut);
    return limit;
}

/// How far all sweeps are together.
struct SnProgram::Done {
    Progress& progress;
    size_t sweeps;
    size_t done = 0;

    /// A share of the one that is under way.
    void tell(double share) const {
        progress.advance(uint64_t(100.0 * (double(done) + share) / double(sweeps)));
    }
};

/// How a sweep goes through the tiles.
struct SnProgram::Way {
    const SweepPrograms* programs; ///< null: on the host
    uint32_t stride;               ///< directions of a course that are swept at once
};

/// What all sweeps of a tile share: of the light, and of its layers by what its rays met.
class SnProgram::Sweeping {
public:
    /// `layer` is the first in the volumes' cells. The arguments outlive it.
    Sweeping(const SnProgram& program, const Way& way, const Tile& tile, int layer,
             const Occupancy& occupancy, const std::vector<uint8_t>& feeding,
             const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
             size_t sweeps, Done& done)
        : program_(program),
          way_(way),
          tile_(tile),
          at_(tile.begin - glm::ivec3(0, 0, layer)),
          visibility_(visibility),
          feeding_(feeding),
          near_(find_near(tile, occupancy, feeding, visibility)),
          boundary_(visibility.air() || reaches_out(lit, visibility, tile)),
          sweeps_(sweeps),
          done_(done) {
        if (way.programs)
            plan_ = plan_sweep(program.device_, tile.cells, program.settings_.order, way.stride,
                               program.largest_);
    }

    /// Takes what the rays of the first sweep meet from a cache, or keeps it there after that.
    void use(const KeptSights& kept, const surface::LitSurfaces& lit) {
        cache_ = kept.cache;
        if (!cache_)
            return;
        key_ = cache_->key("sights");
        surface::add_patches(lit, *key_);
        key_->add_all(feeding_);
        key_->add(kept.frame.origin, kept.frame.unit, tile_.begin, tile_.cells.dims, boundary_,
                  program_.settings_.directions, way_.stride, most_of_chunk());
        known_ = cache_->get(*key_, [&](cache::Reader& in) {
            uint64_t chunks = 0;
            if (!in.get(chunks))
                return false;
            for (; chunks > 0; --chunks)
                if (!read_sights(in, 2 * lit.patches.size(), sights_.emplace_back()))
                    return false;
            return true;
        });
        if (known_)
            cache_ = nullptr;
        else
            sights_.clear();
    }

    void run(const SnLight& light, Volume& volume) {
        const uint32_t of_each = way_.stride / quadrants;
        const int total = program_.settings_.directions;
        const std::vector<glm::dvec3> octant = sn_octant_directions(total);
        std::optional<SweptAir> air;
        if (light.air)
            air.emplace(program_.device_, *light.air, light.part,
                        tile_of(program_.grid_, program_.settings_), way_.stride,
                        program_.settings_.order);
        const std::unique_ptr<Sweeper> sweeper = make_sweeper(air ? &*air : nullptr);
        size_t chunks = 0;
        for (int number = 0; number < Course::count; ++number) {
            const Course course(tile_, number);
            const PlaneOrder order = order_planes(course, near_, boundary_, visibility_);
            const std::vector<glm::dvec3> positive = of_course(course, octant);
            const size_t batches = (positive.size() + of_each - 1) / of_each;
            for (size_t batch = 0; batch < batches; ++batch) {
                const size_t first = batch * of_each;
                const Directions directions =
                    direction_table(course,
                                    std::span(positive).subspan(
                                        first, std::min(size_t(of_each), positive.size() - first)),
                                    way_.stride, total, program_.settings_.order);
                sweeper->begin(course, directions,
                               luminance_beyond(light, directions, way_.stride));
                for (int begin = 0; begin < order.planes(); begin = chunk_.end) {
                    choose_planes(course, order, way_.stride, most_of_chunk(),
                                  air ? air_vec4s(air->coefficients) : 0, begin, chunk_);
                    if (air)
                        pack_air(course, directions, air->air, air->coefficients, chunk_);
                    find_given(light, order, directions, chunks++);
                    sweeper->run(order, chunk_);
                    const double share = double(chunk_.end) / order.planes();
                    done_.tell((number + (double(batch) + share) / double(batches))
                               / Course::count);
                }
            }
        }
        sweeper->add_to(program_.grid_, at_, volume.sh);
        ++done_.done;
        keep();
    }

private:
    /// Bytes of each list of a chunk.
    uint64_t most_of_chunk() const { return plan_ ? plan_->chunk : chunk_bytes; }

    std::unique_ptr<Sweeper> make_sweeper(const SweptAir* air) const {
        if (!way_.programs)
            return std::make_unique<HostSweeper>(tile_.cells, way_.stride,
                                                 program_.settings_.order);
        return std::make_unique<DeviceSweeper>(program_.device_, tile_.cells, *plan_,
                                               *way_.programs, air);
    }

    /// The luminance of what is given in a chunk.
    void find_given(const SnLight& light, const PlaneOrder& order, const Directions& directions,
                    size_t chunk) {
        const uint32_t stride = way_.stride;
        const size_t rays = size_t(order.given_of(chunk_.begin, chunk_.end)) * (stride / quadrants);
        if (light.layer
            || (known_ && chunk < sights_.size() && sights_[chunk].sides.size() == rays)) {
            recall_given(order, light, directions, stride, sights_[chunk], chunk_);
            return;
        }
        kept_rays_ += rays;
        if (sweeps_ == 1 && cache_ && kept_rays_ > most_kept_rays) {
            cache_ = nullptr;
            sights_.clear();
        }
        const bool records = sweeps_ > 1 || cache_;
        if (records)
            sights_.resize(std::max(sights_.size(), chunk + 1));
        trace_given(order, light, directions, stride, chunk_, records ? &sights_[chunk] : nullptr);
    }

    /// After the first sweep.
    void keep() {
        if (cache_ && kept_rays_ <= most_kept_rays)
            cache_->put(*key_, [&](cache::Writer& out) {
                out.put(uint64_t(sights_.size()));
                for (const Sights& of : sights_)
                    write_sights(of, out);
            });
        cache_ = nullptr;
    }

    const SnProgram& program_;
    const Way way_;
    const Tile& tile_;
    const glm::ivec3 at_; ///< in the volumes' cells
    const visibility::Visibility& visibility_;
    const std::vector<uint8_t>& feeding_;
    const std::vector<NearCell> near_;
    std::optional<SweepPlan> plan_; ///< on the device
    const bool boundary_;
    size_t sweeps_; ///< of this tile
    Done& done_;
    std::vector<Sights> sights_;    ///< of the first sweep's chunks, one after the other
    cache::Cache* cache_ = nullptr; ///< null: nothing is to be kept, any more
    std::optional<cache::Key> key_;
    bool known_ = false; ///< sights_ are there before the first sweep
    uint64_t kept_rays_ = 0;
    Chunk chunk_;
};

void SnProgram::sweep(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
                      const Sky& sky, float limit, Progress& progress, Volume& volume,
                      const gather::Layers& layers, const KeptSights& kept,
                      std::optional<volume::Slab> slab) const {
    if (limit == 0.0f)
        return; // peaks are all there is
    progress.begin("sweep", 100);
    const bool bright = is_peak(sky, limit);
    const visibility::Visibility clear = visibility.in_air(nullptr);
    SnLight light{lit, clear, bright ? Sky() : sky_along(sky, settings_.directions), limit};
    light.air = visibility.air();
    const bool lit_air = light.air && light.air->is_lit();
    const std::vector<scene::LightLayer> swept = sky_layers(layers.light, !bright);
    const Occupancy occupancy = find_occupied(lit.patches, grid_.dims);
    const std::vector<uint8_t> feeding = find_feeding(occupancy, volume.validity);
    // Air is for the kernels.
    std::optional<SweepPrograms> in_air;
    if (on_host_ && light.air)
        in_air = compile_sweep(device_, tile_of(grid_, settings_), stride_, settings_.order);
    const Way way =
        on_host_ && !light.air
            ? Way{nullptr, host_directions(tile_of(grid_, settings_), settings_.directions)}
            : Way{in_air ? &*in_air : &*sweep_, stride_};
    const volume::Slab own = slab.value_or(volume::all_of(grid_));
    const std::vector<Tile> tiles = tiles_of(grid_, own, settings_);
    Done done{progress, tiles.size() * (1 + (lit_air ? 1 : 0) + swept.size())};
    for (const Tile& tile : tiles) {
        const auto sweeping = [&](size_t sweeps) {
            return Sweeping(*this, way, tile, own.begin, occupancy, feeding, lit, visibility,
                            sweeps, done);
        };
        Sweeping of_all = sweeping(1 + swept.size());
        light.layer = nullptr;
        light.part = LightPart::surfaces;
        of_all.use(kept, lit);
        of_all.run(light, volume);
        if (lit_air) {
            light.part = LightPart::air;
            sweeping(1).run(light, volume);
        }
        for (light.index = 0; light.index < swept.size(); ++light.index) {
            light.layer = &swept[light.index];
            of_all.run(light, layers.volumes[light.index]);
        }
    }
}

} // namespace lpvbake::solver::sn
