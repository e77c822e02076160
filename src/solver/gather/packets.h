// Places of a zone that are solved together, and how they are.
#pragma once

#include "solver/gather/batcher.h"
#include "solver/gather/gather.h"
#include "solver/gather/zone.h"

#include <chrono>
#include <functional>
#include <map>
#include <span>
#include <vector>

namespace lpvbake::solver::gather {

inline constexpr size_t chunk = 1024; ///< packets whose lists the host makes at a time

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

/// Eight places, or fewer, of a zone.
struct Packet {
    const Zone* zone;
    std::vector<size_t> cells;         ///< of the volume, to which their light is added
    std::vector<glm::vec3> points;     ///< where it is taken
    std::vector<const uint64_t*> sees; ///< what they see, as Zone::look has it
};

/// The place in Morton's order of a point of a zone, from its corner: of 30 bits, of which the
/// first three say in which of its eight parts it lies.
uint32_t morton(glm::vec3 local);
/// That part. No packet is from two: a list is as long as its places lie apart.
constexpr uint32_t part_of(uint32_t morton) {
    return morton >> 27;
}

/// The kernel for one kind of sources (layout.h) and terms up to `order`.
gpu::Program compile(const gpu::Device& device, uint32_t local_size, int order, uint32_t part);

/// Solves packets on the device.
class PacketSolver {
public:
    /// The arguments outlive it; the numbers are those of GatherProgram.
    PacketSolver(const gpu::Device& device, int order, const gpu::Program& surfaces,
                 uint32_t local_size, uint64_t list_bytes, const Surroundings& world,
                 Volume& volume, std::span<Volume> layers, GatherReport& report, Laps& laps);

    /// Adds what they gather to the volume and to its layers, which are sized; calls `advance` now
    /// and then.
    void solve(std::span<const Packet> packets, const std::function<void()>& advance);

private:
    template <class List>
    void gather(const gpu::Program& program, uint32_t part, std::span<Field* const> fields,
                int order, std::span<const Packet> packets, const List& list,
                const std::function<void()>& advance);
    void solve_layers(std::span<const Packet> packets, const std::function<void()>& advance);

    int order_;
    const gpu::Program& surfaces_;
    gpu::Program sky_, layered_;
    std::map<int, gpu::Program>
        ordered_skies_; ///< of layers that have another order than the light
    const Surroundings& world_;
    Field* field_;
    std::vector<Field*> layers_;
    GatherReport& report_;
    Laps& laps_;
    Batcher batcher_;
    std::vector<Sources> sources_; ///< of a chunk of packets
};

} // namespace lpvbake::solver::gather
