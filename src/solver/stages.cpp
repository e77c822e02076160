#include "solver/stages.h"

namespace lpvbake::solver {

void Stages::begin(const char* name, uint64_t steps) {
    name_ = name;
    start_ = std::chrono::steady_clock::now();
    progress_.begin(name, steps);
}

void Stages::end(const std::string& detail) {
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start_;
    reports_.push_back({name_, seconds.count(), of_ + detail});
}

} // namespace lpvbake::solver
