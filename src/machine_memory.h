// What the machine has.
#pragma once

#include <cstdint>

#include <unistd.h>

namespace lpvbake {

/// Bytes of memory, however much of it is free.
inline uint64_t machine_memory() {
    return uint64_t(sysconf(_SC_PHYS_PAGES)) * uint64_t(sysconf(_SC_PAGESIZE));
}

} // namespace lpvbake
