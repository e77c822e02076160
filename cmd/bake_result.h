// What `bake` prints: of its plan, and of what it made.
#pragma once

#include "bake/bricks.h"
#include "bake/storage.h"
#include "bake_options.h"
#include "gpu/gpu.h"
#include "lpvbake/volume.h"
#include "report/verify.h"
#include "terminal.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// What a bake made, beside the stages of its run.
struct BakeResult {
    const bake::Choice& choice;
    std::vector<Written> outputs;
    const Volume* volume = nullptr; ///< the finest level; null: of points or bricks
    std::optional<bake::Storage> storage = {};
    std::optional<report::Verified> verified = {};
    const bake::BakedBricks* bricks = nullptr;
    std::optional<bake::HeldOut> suns = {};
};

/// Of --dry-run.
void print_plan(const BakeOptions& o, const gpu::DeviceInfo& device, const bake::Choice& choice,
                const std::optional<bake::Storage>& storage,
                const std::vector<std::string>& warnings);

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, const BakeResult& result,
                  const Run& run);

} // namespace lpvbake::cmd
