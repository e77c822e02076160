// What control groups leave of a machine, read from files as the system has them.
#include "machine.h"

#include "unit/volumes.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

class Machine : public ::testing::Test {
protected:
    void file(const std::string& path, const std::string& text) {
        const std::filesystem::path whole = folder_ / path;
        std::filesystem::create_directories(whole.parent_path());
        std::ofstream(whole) << text;
    }
    int threads() { return machine_threads(std::string(folder_ / "")); }
    uint64_t memory() { return machine_memory(std::string(folder_ / "")); }

    TemporaryFolder folder_;
};

TEST_F(Machine, WithoutGroupsItIsTheWholeOne) {
    const int threads_there = threads();
    EXPECT_GE(threads_there, 1);
    EXPECT_GE(memory(), 1u << 28);
    file("proc/self/cgroup", "0::/user.slice\nno group\n");
    file("sys/fs/cgroup/user.slice/cpu.max", "max 100000\n");
    file("sys/fs/cgroup/user.slice/memory.max", "max\n");
    EXPECT_EQ(threads(), threads_there);
    file("sys/fs/cgroup/user.slice/cpu.max", "broken\n");
    EXPECT_EQ(threads(), threads_there);
}

TEST_F(Machine, TheLeastOfAllGroupsAboveCounts) {
    file("proc/self/cgroup", "0::/slurm/job_7/step_0\n");
    file("sys/fs/cgroup/slurm/job_7/step_0/cpu.max", "max 100000\n");
    file("sys/fs/cgroup/slurm/job_7/cpu.max", "50000 100000\n");
    file("sys/fs/cgroup/slurm/job_7/memory.max", "123456789\n");
    file("sys/fs/cgroup/slurm/memory.max", "999999999999999\n");
    EXPECT_EQ(threads(), 1);
    EXPECT_EQ(memory(), 123456789u);
}

TEST_F(Machine, ContainersAndTheFirstVersionOfGroupsAreKnown) {
    file("proc/self/cgroup", "0::/\n");
    file("sys/fs/cgroup/cpu.max", "30000 100000\n");
    EXPECT_EQ(threads(), 1);
    file("sys/fs/cgroup/cpu.max", "max 100000\n");
    file("proc/self/cgroup", "5:memory:/docker/a\n4:cpu,cpuacct:/docker/a\n");
    file("sys/fs/cgroup/cpu/docker/a/cpu.cfs_quota_us", "20000\n");
    file("sys/fs/cgroup/cpu/docker/a/cpu.cfs_period_us", "100000\n");
    file("sys/fs/cgroup/memory/docker/a/memory.limit_in_bytes", "1000000000\n");
    EXPECT_EQ(threads(), 1);
    EXPECT_EQ(memory(), 1000000000u);
}

} // namespace
} // namespace lpvbake
