#include "solver/gather/batcher.h"

#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::gather {

namespace {

uint64_t result_bytes(int order, bool layers) {
    const uint64_t floats =
        layers ? std::max(result_floats(order, pass_layers), result_floats(volume::sh_max_order))
               : result_floats(order);
    return most_jobs * floats * sizeof(float);
}

} // namespace

uint64_t batch_bytes(int order, uint64_t list_bytes, bool layers) {
    return list_bytes + most_jobs * (lanes * sizeof(glm::vec4) + sizeof(Job))
           + result_bytes(order, layers);
}

Gatherer gatherer(const gpu::Program& program, uint32_t part, int order) {
    if (part == part_layers)
        return {program, order, pass_layers, {layered_words, layered_words, bin_words(order)}};
    return {program, order, 1, {point_words, triangle_words, bin_words(order)}};
}

Batcher::Batcher(const gpu::Device& device, uint32_t local_size, int order, uint64_t list_bytes,
                 bool layers)
    : device_(device),
      jobs_a_group_(local_size / lanes),
      capacity_(list_bytes / sizeof(glm::vec4)),
      centers_buffer_(device, most_jobs * lanes * sizeof(glm::vec4)),
      jobs_buffer_(device, most_jobs * sizeof(Job)),
      list_buffer_(device, list_bytes),
      result_buffer_(device, result_bytes(order, layers)),
      list_(std::make_unique_for_overwrite<glm::vec4[]>(capacity_)) {
    gpu::clear(device, centers_buffer_);
}

void Batcher::use(const Gatherer& gatherer, std::span<Field* const> fields) {
    gatherer_.emplace(gatherer);
    fields_.assign(fields.begin(), fields.end());
}

void Batcher::add(std::span<const size_t> cells, std::span<const glm::vec3> points,
                  const Sources& sources) {
    // In runs of at most job_words, the same whatever else is in the buffer.
    const std::array<size_t, 3>& per = gatherer_->words;
    const std::vector<glm::vec4>* lists[3] = {&sources.points, &sources.triangles, &sources.bins};
    size_t at[3] = {0, 0, 0};
    while (at[0] < lists[0]->size() || at[1] < lists[1]->size() || at[2] < lists[2]->size()) {
        size_t take[3], left = job_words;
        for (size_t i = 0; i < 3; ++i) {
            take[i] = std::min((lists[i]->size() - at[i]) / per[i], left / per[i]);
            left -= take[i] * per[i];
        }
        if (jobs_.size() == most_jobs || used_ + job_words - left > capacity_)
            run();
        jobs_.push_back({uint32_t(used_), uint32_t(take[0]), uint32_t(take[1]), uint32_t(take[2])});
        for (size_t i = 0; i < 3; ++i) {
            const size_t words = take[i] * per[i];
            copies_.push_back({lists[i]->data() + at[i], used_, words});
            used_ += words;
            at[i] += words;
        }
        for (size_t lane = 0; lane < lanes; ++lane) {
            centers_.push_back(glm::vec4(points[std::min(lane, cells.size() - 1)], 0.0f));
            cells_.push_back(lane < cells.size() ? int64_t(cells[lane]) : -1);
        }
    }
}

void Batcher::copy_lists() {
    tbb::parallel_for(size_t(0), copies_.size(), [&](size_t i) {
        const Copy& copy = copies_[i];
        std::copy_n(copy.from, copy.words, &list_[copy.to]);
    });
    copies_.clear();
}

void Batcher::run() {
    if (jobs_.empty())
        return;
    copy_lists();
    gpu::upload(device_, centers_buffer_, 0, std::as_bytes(std::span(centers_)));
    gpu::upload(device_, jobs_buffer_, 0, std::as_bytes(std::span(jobs_)));
    gpu::upload(device_, list_buffer_, 0, std::as_bytes(std::span(list_.get(), used_)));
    const Push push{uint32_t(jobs_.size())};
    const size_t floats = result_floats(gatherer_->order, gatherer_->layers);
    const gpu::Window windows[] = {{&centers_buffer_, 0, centers_.size() * sizeof(glm::vec4)},
                                   {&jobs_buffer_, 0, jobs_.size() * sizeof(Job)},
                                   {&list_buffer_, 0, used_ * sizeof(glm::vec4)},
                                   {&result_buffer_, 0, jobs_.size() * floats * sizeof(float)}};
    gpu::Batch batch(device_);
    batch.dispatch(gatherer_->program, windows, std::as_bytes(std::span(&push, 1)),
                   {(push.jobs + jobs_a_group_ - 1) / jobs_a_group_, 1, 1});
    batch.run();
    results_.resize(jobs_.size() * floats);
    gpu::download(device_, result_buffer_, 0, std::as_writable_bytes(std::span(results_)));
    const size_t layers = gatherer_->layers;
    tbb::parallel_for(size_t(0), terms(gatherer_->order) * fields_.size(), [&](size_t i) {
        const size_t k = i / fields_.size(), layer = i % fields_.size();
        std::vector<glm::vec3>& values = (*fields_[layer])[k];
        for (size_t job = 0; job < jobs_.size(); ++job) {
            const float* result = &results_[job * floats + (k * layers + layer) * 3 * lanes];
            for (size_t lane = 0; lane < lanes; ++lane)
                if (const int64_t cell = cells_[job * lanes + lane]; cell >= 0)
                    values[size_t(cell)] +=
                        glm::vec3(result[lane], result[lanes + lane], result[2 * lanes + lane]);
        }
    });
    jobs_.clear();
    used_ = 0;
    centers_.clear();
    cells_.clear();
}

} // namespace lpvbake::solver::gather
