// Sums in a loop of TBB: each task in a place of its own, or, asked for it, all in one, which is a
// race.
#include <tbb/parallel_for.h>

#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>

int main(int arguments, char**) {
    const bool race = arguments > 1;
    std::vector<int> sums(64);
    for (int round = 0; round < 20; ++round)
        tbb::parallel_for(0, int(sums.size()), [&](int i) {
            std::this_thread::sleep_for(std::chrono::microseconds(200)); // others get some
            sums[race ? 0 : std::size_t(i)] += i;
        });
    std::printf("%d\n", sums[0]);
}
