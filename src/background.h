// Work beside the rest, and what comes of it where there is no thread for that.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <future>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace lpvbake {

/// How std::async runs what would be ready by the time that it is asked for: on a thread of its own
/// if there may be more than one and one can be had, else once it is asked for.
inline std::launch in_background() {
    using tbb::global_control;
    return global_control::active_value(global_control::max_allowed_parallelism) > 1
               ? std::launch::async | std::launch::deferred
               : std::launch::deferred;
}

/// Threads that share the caller's work: those of its arena, and no more than are allowed.
inline int threads_at_work() {
    using tbb::global_control;
    const auto allowed = global_control::active_value(global_control::max_allowed_parallelism);
    return std::min(tbb::this_task_arena::max_concurrency(), int(allowed));
}

/// True for what is thrown where no thread can be started: by the standard library, and by TBB.
inline bool is_want_of_threads(const std::exception& thrown) {
    if (const auto* error = dynamic_cast<const std::system_error*>(&thrown))
        return error->code() == std::errc::resource_unavailable_try_again;
    return std::string_view(thrown.what()).find("pthread_create") != std::string_view::npos;
}

inline constexpr const char* want_of_threads =
    "no thread could be started; allow this user or container more processes (ulimit -u, its limit "
    "of PIDs)";

} // namespace lpvbake
