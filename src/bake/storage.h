// How a volume is stored in so many bytes: order, resolution and precision with the least error.
#pragma once

#include "io/target.h"
#include "scene/scene.h"
#include "volume/grid.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::bake {

/// What may be chosen, and what bounds it.
struct StorageWish {
    uint64_t bytes = 0; ///< of the numbers of each output at most
    std::vector<std::string> paths;
    io::Target target;
    std::optional<Precision> precision; ///< none: any that paths and target take
    std::vector<int> orders;
    bool any_resolution = true;
};

struct Storage {
    int order = 0;
    int resolution = 0; ///< as GridSettings has it
    Precision precision = Precision::full;
    uint64_t bytes = 0; ///< of the largest output
    double error = 0;   ///< expected of all together, with that of the bake
    std::string text;   ///< "order 2, resolution 48, unorm8"
};

/// The storage of least expected error; of equal ones that of fewer bytes. `grids` gives a volume
/// of one cell with the grids of an order, `error` what a bake of that order errs. At most 128
/// cells along the longest axis are chosen. Throws Error: argument (nothing fits, or an output
/// whose bytes are not known before).
Storage choose_storage(const Bounds& box, const volume::GridSettings& grid, const StorageWish& wish,
                       const std::function<Volume(int order)>& grids,
                       const std::function<double(int order)>& error);

} // namespace lpvbake::bake
