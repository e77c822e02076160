// Jobs for the gathering kernel, a buffer full at a time.
#pragma once

#include "gpu/gpu.h"
#include "solver/gather/zone.h"
#include "volume/volume.h"

#include <memory>
#include <span>
#include <vector>

namespace lpvbake::solver::gather {

/// Sources of one job, in vec4: what exceeds them goes into another job.
inline constexpr size_t job_words = 4096;
inline constexpr uint32_t most_jobs = 8192; ///< of one dispatch

/// Of the buffers, where a list takes so many.
uint64_t batch_bytes(int order, uint64_t list_bytes);

/// Runs jobs on the device, a buffer full at a time, and adds the results to the volume. The same
/// jobs, and the same sums, for any size of the buffer.
class Batcher {
public:
    Batcher(const gpu::Device& device, uint32_t local_size, int order, uint64_t list_bytes,
            Volume& volume);

    /// What runs the jobs from here on; outlives them.
    void use(const gpu::Program& program) { program_ = &program; }
    /// What up to eight cells of the volume gather at these points; `sources` stay until the next
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
    const gpu::Program* program_ = nullptr;
    int order_;
    uint32_t jobs_a_group_;
    Volume& volume_;
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
