// How a long stage tells how far it is, and how it learns that it should stop.
#pragma once

#include <cstdint>
#include <string_view>

namespace lpvbake {

/// Told by the stages, drawn by whoever runs them. Calls come from one thread.
class Progress {
public:
    virtual ~Progress() = default;
    /// A stage begins that consists of `steps` steps (0: unknown).
    virtual void begin([[maybe_unused]] std::string_view stage, [[maybe_unused]] uint64_t steps) {}
    /// `done` steps of the current stage are done. May throw Error (interrupted, terminated).
    virtual void advance([[maybe_unused]] uint64_t done) {}
};

} // namespace lpvbake
