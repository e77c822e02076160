// The stages of a bake: what they are called, what they cost, and what they have to say.
#pragma once

#include "cache/cache.h"
#include "lpvbake/progress.h"
#include "text.h"

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace lpvbake::solver {

/// What a bake has no need of.
struct SkippedStage {
    std::string name;
    std::string why;
};

/// Names and times the stages of one bake, one after the other.
class Stages {
public:
    /// All outlive this. `scene` is its file; without a cache: null.
    Stages(Progress& progress, std::vector<std::string>& warnings, std::string scene,
           cache::Cache* cache = nullptr)
        : progress_(progress),
          warnings_(warnings),
          scene_(std::move(scene)),
          cache_(cache) {}
    /// A stage begins that consists of `steps` steps (0: unknown); `name` is a literal.
    void begin(const char* name, uint64_t steps = 0);
    /// Begins the details of the stages that follow, as "level 1: ".
    void set_of(std::string of) { of_ = std::move(of); }
    /// It ends, with `detail` as StageReport has it.
    void end(const std::string& detail);
    /// Of the scene, which it names.
    void warn(const std::string& text) { warnings_.push_back(about(scene_, text)); }
    /// Where the current stage tells how far it is.
    Progress& progress() const { return progress_; }
    const std::vector<StageReport>& reports() const { return reports_; }

private:
    Progress& progress_;
    std::vector<std::string>& warnings_;
    std::string scene_, of_;
    cache::Cache* cache_;
    cache::Cache::Counts counts_; ///< where the stage began
    std::vector<StageReport> reports_;
    const char* name_ = "";
    std::chrono::steady_clock::time_point start_;
};

} // namespace lpvbake::solver
