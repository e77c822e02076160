#include "bake/storage.h"

#include "lpvbake/error.h"
#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::bake {
namespace {

constexpr int finest =
    128; ///< what finer cells save is below all else that is expected to be wrong

/// What cells of this many along the longest axis cost on surfaces between them: `--verify` of the
/// Cornell box at 8 to 64 cells, order 2, by our own sampler, without the bands' 3 %.
double error_of_cells(int resolution) {
    return 0.061 * std::pow(16.0 / resolution, 1.15);
}

/// What precisions cost at valid cells: the worst of the Cornell box and three rooms, 48 cells.
constexpr std::pair<Precision, double> errors_of_precisions[] = {{Precision::half, 0.0003},
                                                                 {Precision::rgb9e5, 0.001},
                                                                 {Precision::unorm8, 0.003},
                                                                 {Precision::bc6h, 0.01}};

double error_of(Precision precision) {
    for (const auto& [known, error] : errors_of_precisions)
        if (known == precision)
            return error;
    return 0;
}

std::vector<Precision> precisions_of(const StorageWish& wish) {
    if (wish.precision)
        return {*wish.precision};
    std::vector<Precision> all;
    for (const Precision precision :
         {Precision::full, Precision::half, Precision::unorm8, Precision::bc6h}) {
        const io::Target target = io::with_precision(wish.target, precision);
        const auto takes = [&](const std::string& path) {
            try {
                io::check_precision(path, precision, target.pictures.packing);
                return true;
            } catch (const Error&) {
                return false;
            }
        };
        if (std::ranges::all_of(wish.paths, takes))
            all.push_back(precision);
    }
    return all;
}

uint64_t bytes_of(const StorageWish& wish, Precision precision, const Volume& grids,
                  glm::ivec3 dims) {
    const io::Target target = io::with_precision(wish.target, precision);
    uint64_t most = 0;
    for (const std::string& path : wish.paths)
        most = std::max(most, io::stored_bytes(target, path, grids, dims));
    return most;
}

} // namespace

Storage choose_storage(const Bounds& box, const volume::GridSettings& grid, const StorageWish& wish,
                       const std::function<Volume(int order)>& grids,
                       const std::function<double(int order)>& error) {
    const auto dims = [&](int resolution) {
        volume::GridSettings settings = grid;
        settings.resolution = resolution;
        return volume::fit_grid(box.lo, box.hi, settings).dims;
    };
    constexpr int coarsest = 3;
    std::optional<Storage> best;
    uint64_t least = UINT64_MAX; // that anything takes
    for (const int order : wish.orders) {
        const Volume volume = grids(order);
        for (const Precision precision : precisions_of(wish)) {
            const auto bytes = [&](int n) { return bytes_of(wish, precision, volume, dims(n)); };
            int resolution = wish.any_resolution ? finest : grid.resolution;
            const int lowest = wish.any_resolution ? coarsest : resolution;
            while (resolution > lowest && bytes(resolution) > wish.bytes)
                --resolution;
            const uint64_t taken = bytes(resolution);
            least = std::min(least, taken);
            if (taken > wish.bytes)
                continue;
            const glm::ivec3 cells = dims(resolution);
            const double expected =
                std::hypot(error(order), error_of(precision),
                           error_of_cells(std::max({cells.x, cells.y, cells.z})));
            if (!best || std::pair(expected, taken) < std::pair(best->error, best->bytes))
                best = {order, resolution, precision, taken, expected, ""};
        }
    }
    if (!best)
        throw Error(
            ErrorKind::argument,
            format("`bytes` %llu: in bytes, of which a volume takes %llu here at least; give "
                   "more, such as 8M",
                   (unsigned long long)wish.bytes, (unsigned long long)least));
    const glm::ivec3 cells = dims(best->resolution);
    best->text = format("order %d, %d x %d x %d cells, %s", best->order, cells.x, cells.y, cells.z,
                        io::name_of(best->precision));
    return *best;
}

} // namespace lpvbake::bake
