// Parts of a bake, as anybody may have written them: files that OpenVDB reads, of which metadata
// and lattices say anything. What is merged of them is a volume that can be read.
#include "fuzz.h"

#include "io/layout.h"
#include "io/parts.h"
#include "io/vdb.h"
#include "text.h"

#include <fuzzer/FuzzedDataProvider.h>
#include <tbb/global_control.h>

#include <vector>

namespace lpvbake {
namespace {

bool odd(FuzzedDataProvider& data) {
    return data.ConsumeIntegralInRange(0, 63) == 63;
}

/// Mostly the number that it should be.
int number_from(FuzzedDataProvider& data, int right) {
    return !odd(data)           ? right
           : data.ConsumeBool() ? right + data.ConsumeIntegralInRange(-2, 2)
                                : data.ConsumeIntegral<int>();
}

float value_from(FuzzedDataProvider& data) {
    return odd(data) ? data.ConsumeFloatingPoint<float>() : float(data.ConsumeIntegral<uint8_t>());
}

/// A part of these layers; each of what tells where it belongs is now and then something else.
Volume part_from(FuzzedDataProvider& data, volume::Shard shard, volume::Slab layers,
                 const Grid& whole, int order) {
    Volume part;
    const glm::ivec3 dims = whole.dims;
    part.grid = volume::grid_of(layers, whole);
    for (int axis = 0; axis < 3; ++axis)
        if (odd(data))
            part.grid.dims[axis] = data.ConsumeIntegralInRange(1, 6);
    part.sh_order = odd(data) ? data.ConsumeIntegralInRange(0, 4) : order;
    part.sh.assign(std::size_t((part.sh_order + 1) * (part.sh_order + 1)),
                   std::vector<glm::vec3>(part.grid.size()));
    for (std::vector<glm::vec3>& grid : part.sh)
        grid[data.ConsumeIntegralInRange<std::size_t>(0, grid.size() - 1)].y = value_from(data);
    part.validity.assign(part.grid.size(), value_from(data));
    if (!odd(data))
        part.walls.assign(2, std::vector<glm::vec3>(part.grid.size()));
    const auto put = [&](const char* key, const std::string& right) {
        if (!odd(data))
            part.metadata[key] = right;
        else if (data.ConsumeBool())
            part.metadata[key] = data.ConsumeRandomLengthString(60);
    };
    put("tracer", "Embree");
    put("shard", format("%d/%d", number_from(data, shard.index), number_from(data, shard.count)));
    put("shard_layers",
        format("%d,%d", number_from(data, layers.begin), number_from(data, layers.end)));
    put("shard_grid",
        format("%.17g,%.17g,%.17g,%d,%d,%d", whole.origin.x, whole.origin.y,
               odd(data) ? data.ConsumeFloatingPoint<double>() : whole.origin.z,
               number_from(data, dims.x), number_from(data, dims.y), number_from(data, dims.z)));
    return part;
}

/// Whether they claim to be parts of a large volume: how much memory a machine has is not at stake
/// here.
bool claims_much(const std::vector<std::string>& paths) {
    try {
        const glm::ivec3 dims = io::Parts(paths).whole().grid.dims;
        return double(dims.x) * dims.y * dims.z > 1e6;
    } catch (const Error&) {
        return false;
    }
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    using namespace lpvbake;
    static const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    FuzzedDataProvider data(bytes, size);
    const Grid whole{{1, 2, 3}, 0.25, {2, 3, data.ConsumeIntegralInRange(1, 8)}};
    const int count = std::min(data.ConsumeIntegralInRange(1, 3), whole.dims.z);
    const int order = data.ConsumeIntegralInRange(0, 2);
    const fuzz::Folder& folder = fuzz::Folder::own();
    std::vector<std::string> paths;
    for (int i = 1; i <= count; ++i) {
        const volume::Shard shard{i, count};
        const Volume part = part_from(data, shard, volume::slab_of(shard, whole, 1), whole, order);
        const std::string path = folder.write(format("p%d", i).c_str(), "");
        try {
            io::write_vdb(path, io::Stored(part, {}, path), Precision::full);
        } catch (const Error&) {
            return 0; // what is not finite is not written
        }
        if (!odd(data))
            paths.push_back(path);
        if (odd(data))
            paths.push_back(path);
    }
    if (paths.empty() || claims_much(paths))
        return 0;
    fuzz::accepts([&] {
        Progress silent;
        io::Parts parts(paths);
        const Volume volume = parts.read(silent);
        io::check_volume(volume, "parts", ErrorKind::invalid);
        fuzz::require(parts.read_first_band().sh[0] == volume.sh[0], "a band is the volume's");
        const std::string merged = folder.write("merged.vdb", "");
        io::write_merged(merged, parts, data.ConsumeBool() ? Precision::half : Precision::full,
                         silent);
        fuzz::require(fuzz::accepts([&] { io::read_vdb(merged); }), "what is merged can be read");
    });
    return 0;
}
