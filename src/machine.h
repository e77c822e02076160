// What the machine has, and what of that this process may use: containers and batch systems give
// shares by control groups, which the numbers of the machine do not show.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

#include <sched.h>
#include <unistd.h>

namespace lpvbake {

/// Calls `look` with the folder of each control group that this process is in, its own first: of
/// version 2, and of version 1's `controller`. `root` is the system's root, for tests.
template <class Look>
void each_control_group(const std::filesystem::path& root, const std::string& controller,
                        const Look& look) {
    std::ifstream groups(root / "proc/self/cgroup");
    for (std::string line; std::getline(groups, line);) { // "0::/a/b", "4:cpu,cpuacct:/a/b"
        const std::size_t first = line.find(':'), second = line.find(':', first + 1);
        if (second == std::string::npos)
            continue;
        const std::string names = line.substr(first + 1, second - first - 1);
        if (!names.empty() && (',' + names + ',').find(',' + controller + ',') == std::string::npos)
            continue;
        const std::filesystem::path mount =
            names.empty() ? root / "sys/fs/cgroup" : root / "sys/fs/cgroup" / controller;
        std::filesystem::path group =
            std::filesystem::path(line.substr(second + 1)).relative_path();
        for (; !group.empty(); group = group.parent_path())
            look(mount / group);
        look(mount); // of a container, that is its own
    }
}

/// The first number of a control group's file, the second where there is one; none for "max", -1
/// and what is no number.
inline std::optional<std::pair<double, double>> read_limit(const std::filesystem::path& file) {
    std::ifstream stream(file);
    double limit = 0, period = 0;
    if (!(stream >> limit) || !(limit > 0))
        return std::nullopt;
    stream >> period;
    return std::pair(limit, period);
}

/// Bytes of memory, however much of it is free: the machine's, or what control groups leave of it.
inline uint64_t machine_memory(const std::filesystem::path& root) {
    double bytes = double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGESIZE));
    each_control_group(root, "memory", [&](const std::filesystem::path& group) {
        for (const char* file : {"memory.max", "memory.limit_in_bytes"})
            if (const auto limit = read_limit(group / file))
                bytes = std::min(bytes, limit->first);
    });
    return uint64_t(bytes);
}
/// An amount of memory, in the unit in which it is a number to read: "5.6 GiB", "1.0 MiB".
inline std::string memory_text(double bytes) {
    const char* unit = bytes >= 0x1p30 / 10 ? "GiB" : bytes >= 0x1p20 / 10 ? "MiB" : "KiB";
    const double in_unit = bytes / (*unit == 'G' ? 0x1p30 : *unit == 'M' ? 0x1p20 : 0x1p10);
    std::ostringstream text;
    text << std::fixed << std::setprecision(1) << in_unit << " " << unit;
    return text.str();
}

/// The same of this system, looked up once.
inline uint64_t machine_memory() {
    static const uint64_t bytes = machine_memory("/");
    return bytes;
}

/// Threads that may run at once: those of the processors that the process is bound to, or of the
/// time that control groups leave of theirs; at least 1.
inline int machine_threads(const std::filesystem::path& root = "/") {
    double threads = double(sysconf(_SC_NPROCESSORS_ONLN));
    constexpr std::size_t most = 1 << 16; // processors
    if (cpu_set_t* set = CPU_ALLOC(most)) {
        if (sched_getaffinity(0, CPU_ALLOC_SIZE(most), set) == 0)
            threads = CPU_COUNT_S(CPU_ALLOC_SIZE(most), set);
        CPU_FREE(set);
    }
    each_control_group(root, "cpu", [&](const std::filesystem::path& group) {
        if (const auto quota = read_limit(group / "cpu.max"); quota && quota->second > 0)
            threads = std::min(threads, quota->first / quota->second);
        if (const auto quota = read_limit(group / "cpu.cfs_quota_us"))
            if (const auto period = read_limit(group / "cpu.cfs_period_us"))
                threads = std::min(threads, quota->first / period->first);
    });
    return std::max(1, int(std::ceil(threads)));
}

} // namespace lpvbake
