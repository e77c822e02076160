// NanoVDB files: one of ours of which words are changed, and which is cut off. The words that say
// where something is, or how much, are tried most.
#include "fuzz.h"

#include "io/layout.h"
#include "io/nvdb.h"

#include <fuzzer/FuzzedDataProvider.h>
#include <tbb/global_control.h>

#include <cstring>
#include <sstream>

namespace lpvbake {
namespace {

std::string whole_file() {
    Volume volume;
    volume.grid.dims = {9, 2, 2};
    volume.sh_order = 0;
    volume.sh.assign(1, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(1, 2, 3)));
    volume.validity.assign(volume.grid.size(), 1);
    volume.validity[7] = 0;
    const std::string path = fuzz::Folder::own().write("whole.nvdb", "");
    io::write_nvdb(path, io::Stored(volume, {}, path), Precision::full);
    std::ostringstream text;
    text << std::ifstream(path, std::ios::binary).rdbuf();
    return text.str();
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    static const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    static const std::string whole = whole_file();
    static const size_t grid = whole.find(whole.substr(0, 8), 8); // of the same magic
    static const size_t dims = whole.find("\"dims\"");
    FuzzedDataProvider input(data, size);
    std::string bytes = whole;
    for (int count = input.ConsumeIntegralInRange(0, 8); count > 0; --count) {
        // Heads of the file and of the first grid, its tree and root; the masks and the table of
        // its first node; anywhere.
        const size_t first =
            input.PickValueInArray({size_t(0), grid, grid + 800, grid + 8900, size_t(0)});
        const size_t range = input.PickValueInArray({size_t(1024), whole.size()});
        const size_t at = std::min(first + 4 * input.ConsumeIntegralInRange<size_t>(0, range / 4),
                                   whole.size() - 8);
        const uint64_t value = input.ConsumeBool()
                                   ? input.ConsumeIntegral<uint64_t>()
                                   : input.ConsumeIntegralInRange<uint64_t>(0, 2 * whole.size());
        std::memcpy(&bytes[at], &value, input.ConsumeBool() ? 8 : 4);
    }
    if (input.ConsumeBool())
        bytes.resize(input.ConsumeIntegralInRange<size_t>(0, bytes.size()));
    // How much memory the machine has is not at stake here: the description keeps its dims.
    if (bytes.size() > dims + 20)
        bytes.replace(dims, 20, whole, dims, 20);
    const std::string path = fuzz::Folder::own().write("a.nvdb", bytes);
    fuzz::accepts([&] { io::check_volume(io::read_nvdb(path), path, ErrorKind::failure); });
    return 0;
}
