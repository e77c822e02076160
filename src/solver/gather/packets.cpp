#include "solver/gather/packets.h"

#include "solver/gather/gather.comp.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::gather {
namespace {

/// Puts the digits of a number of ten bits two bits apart.
uint32_t spread(uint32_t x) {
    x = (x | x << 16) & 0x030000ffu;
    x = (x | x << 8) & 0x0300f00fu;
    x = (x | x << 4) & 0x030c30c3u;
    return (x | x << 2) & 0x09249249u;
}

} // namespace

uint32_t morton(glm::vec3 local) {
    constexpr float steps = 1024.0f / zone_edge;
    const glm::uvec3 at(glm::clamp(steps * local, 0.0f, 1023.0f));
    return spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2;
}

gpu::Program compile(const gpu::Device& device, uint32_t local_size, int order, uint32_t part) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::storage,
                                    Binding::texels_rgba32, Binding::storage};
    const uint32_t constants[] = {local_size, uint32_t(order), part};
    return gpu::Program(device, shaders::gather_comp, bindings, sizeof(Push), constants);
}

PacketSolver::PacketSolver(const gpu::Device& device, int order, const gpu::Program& surfaces,
                           uint32_t local_size, uint64_t list_bytes, const Surroundings& world,
                           Volume& volume, std::span<Volume> layers, GatherReport& report,
                           Laps& laps)
    : order_(order),
      surfaces_(surfaces),
      world_(world),
      field_(&volume.sh),
      report_(report),
      laps_(laps),
      batcher_(device, local_size, order, list_bytes, !layers.empty()) {
    if (!world.sky.empty())
        sky_ = compile(device, local_size, order, part_sky);
    for (Volume& layer : layers) {
        layers_.push_back(&layer.sh);
        if (!world.sky.empty() && layer.sh_order != order
            && !ordered_skies_.contains(layer.sh_order))
            ordered_skies_.emplace(layer.sh_order,
                                   compile(device, local_size, layer.sh_order, part_sky));
    }
    if (!layers_.empty() && !world.clusters.nodes.empty())
        layered_ = compile(device, local_size, order, part_layers);
}

void PacketSolver::solve(std::span<const Packet> packets, const std::function<void()>& advance) {
    const auto add_surfaces = [](const Packet& packet, Sources& to) {
        packet.zone->gather_surfaces(packet.sees, packet.points, to);
    };
    const auto add_sky = [this](const Packet& packet, Sources& to) {
        packet.zone->gather_sky(packet.sees, order_, to);
    };
    if (!world_.clusters.nodes.empty())
        gather(surfaces_, part_surfaces, {&field_, 1}, order_, packets, add_surfaces, advance);
    if (!world_.sky.empty())
        gather(sky_, part_sky, {&field_, 1}, order_, packets, add_sky, advance);
    for (const Packet& packet : packets)
        report_.solved += packet.cells.size();
    solve_layers(packets, advance);
}

/// The same sources, by the same bits of what is seen.
void PacketSolver::solve_layers(std::span<const Packet> packets,
                                const std::function<void()>& advance) {
    const std::span<Field* const> all(layers_);
    if (!world_.clusters.nodes.empty())
        for (size_t first = 0; first < all.size(); first += pass_layers)
            gather(
                layered_, part_layers,
                all.subspan(first, std::min<size_t>(pass_layers, all.size() - first)), order_,
                packets,
                [&](const Packet& packet, Sources& to) {
                    packet.zone->gather_layers(packet.sees, packet.points, first, to);
                },
                advance);
    for (size_t layer = 0; layer < all.size(); ++layer) {
        if (world_.sky.empty() || world_.sky.front().layers[layer].empty())
            continue;
        const int order = volume::sh_order_of(all[layer]->size());
        gather(
            order == order_ ? sky_ : ordered_skies_.at(order), part_sky, all.subspan(layer, 1),
            order, packets,
            [&](const Packet& packet, Sources& to) {
                packet.zone->gather_sky(packet.sees, order, to, layer);
            },
            advance);
    }
}

/// Runs `program` on what `list` lists for each packet.
template <class List>
void PacketSolver::gather(const gpu::Program& program, uint32_t part,
                          std::span<Field* const> fields, int order,
                          std::span<const Packet> packets, const List& list,
                          const std::function<void()>& advance) {
    const Gatherer with = gatherer(program, part, order);
    batcher_.use(with, fields);
    sources_.resize(std::max(sources_.size(), std::min(chunk, packets.size())));
    for (size_t first = 0; first < packets.size(); first += chunk) {
        advance();
        const size_t count = std::min(chunk, packets.size() - first);
        tbb::parallel_for(size_t(0), count, [&](size_t i) {
            sources_[i].clear();
            list(packets[first + i], sources_[i]);
        });
        laps_.add_to(report_.lists_seconds);
        for (size_t i = 0; i < count; ++i) {
            batcher_.add(packets[first + i].cells, packets[first + i].points, sources_[i]);
            report_.sources += lanes
                               * (sources_[i].points.size() / with.words[0]
                                  + sources_[i].triangles.size() / with.words[1]
                                  + sources_[i].bins.size() / with.words[2]);
        }
        batcher_.copy_lists();
        laps_.add_to(report_.device_seconds);
    }
    batcher_.run();
    laps_.add_to(report_.device_seconds);
}

} // namespace lpvbake::solver::gather
