// How a long stage tells how far it is, and how it learns that it should stop.
#pragma once

#include "lpvbake/export.h"

#include <cstdint>
#include <string>
#include <string_view>

namespace lpvbake {

/// What a stage did and cost, or is expected to.
struct StageReport {
    std::string name;
    double seconds = 0;
    std::string detail; ///< one phrase: counts and residuals, or why it will run
    /// Values that were kept from an earlier bake, and that had to be made; both 0 without a cache.
    uint64_t reused = 0, made = 0;
};

/// Told by the stages, drawn by whoever runs them. Calls come from one thread.
class LPVBAKE_API Progress {
public:
    virtual ~Progress() = default;
    /// A stage begins that consists of `steps` steps (0: unknown).
    virtual void begin([[maybe_unused]] std::string_view stage, [[maybe_unused]] uint64_t steps) {}
    /// `done` steps of the current stage are done. May throw Error (interrupted, terminated).
    virtual void advance([[maybe_unused]] uint64_t done) {}
};

} // namespace lpvbake
