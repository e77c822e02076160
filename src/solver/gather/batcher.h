// Jobs for the gathering kernel, a buffer full at a time.
#pragma once

#include "gpu/gpu.h"
#include "solver/gather/zone.h"

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace lpvbake::solver::gather {

/// Sources of one job, in vec4: what exceeds them goes into another job.
inline constexpr size_t job_words = 4096;
inline constexpr uint32_t most_jobs = 8192; ///< of one dispatch

/// Of the buffers, where a list takes so many; with layers, too.
uint64_t batch_bytes(int order, uint64_t list_bytes, bool layers = false);

/// Coefficients as Volume::sh has them.
using Field = std::vector<std::vector<glm::vec3>>;

/// A program, and what it makes of its lists.
struct Gatherer {
    const gpu::Program& program;
    int order;                   ///< highest band that it solves
    uint32_t layers;             ///< that it solves at a time
    std::array<size_t, 3> words; ///< of a point, a triangle, a bin
};
Gatherer gatherer(const gpu::Program& program, uint32_t part, int order);

/// Runs jobs on the device, a buffer full at a time, and adds the results to fields. The same jobs,
/// and the same sums, for any size of the buffer.
class Batcher {
public:
    /// For programs of that order, and with layers for those of pass_layers, or of one of any
    /// order.
    Batcher(const gpu::Device& device, uint32_t local_size, int order, uint64_t list_bytes,
            bool layers);

    /// What runs the jobs from here on, and the fields to which the first layers are added; both
    /// outlive them. Nothing may be waiting to run.
    void use(const Gatherer& gatherer, std::span<Field* const> fields);
    /// What up to eight cells of the fields gather at these points; `sources` stay until the next
    /// copy_lists() or run().
    void add(std::span<const size_t> cells, std::span<const glm::vec3> points,
             const Sources& sources);
    /// Copies the lists of what was added, which then may change.
    void copy_lists();
    /// Runs what was added.
    void run();

private:
    /// A part of a list on its way into the buffer.
    struct Copy {
        const glm::vec4* from;
        size_t to, words;
    };

    const gpu::Device& device_;
    std::optional<Gatherer> gatherer_;
    std::vector<Field*> fields_;
    uint32_t jobs_a_group_;
    size_t capacity_;
    gpu::Buffer centers_buffer_, jobs_buffer_, list_buffer_, result_buffer_;
    std::vector<Job> jobs_;
    std::vector<Copy> copies_;
    std::unique_ptr<glm::vec4[]> list_;
    size_t used_ = 0; ///< words of the list
    std::vector<glm::vec4> centers_;
    std::vector<int64_t> cells_; ///< a lane of a job; -1: none
    std::vector<float> results_;
};

} // namespace lpvbake::solver::gather
