#include "solver/stages.h"

namespace lpvbake::solver {

void Stages::begin(const char* name, uint64_t steps) {
    name_ = name;
    start_ = std::chrono::steady_clock::now();
    if (cache_)
        counts_ = cache_->counts();
    progress_.begin(name, steps);
}

void Stages::end(const std::string& detail) {
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start_;
    StageReport& report = reports_.emplace_back(StageReport{name_, seconds.count(), of_ + detail});
    if (!cache_)
        return;
    report.reused = cache_->counts().reused - counts_.reused;
    report.made = cache_->counts().made - counts_.made;
    const std::vector<std::string> notes = cache_->take_notes();
    warnings_.insert(warnings_.end(), notes.begin(), notes.end());
}

} // namespace lpvbake::solver
