// What `bake` does, for `rebake` too.
#pragma once

#include "bake/storage.h"
#include "bake_options.h"
#include "gpu/gpu.h"
#include "scene/surroundings.h"

#include <memory>
#include <span>

namespace lpvbake::cmd {

/// What bakes of several boxes in one scene and light have in common.
struct SharedScene {
    Scene scene;
    scene::Around around; ///< of the scene
    std::unique_ptr<gpu::Device> device;
};
/// For bakes by these options, but for their box and output. Throws Error.
SharedScene load_shared(BakeOptions o, std::span<const scene::Surroundings> boxes);

/// Sets what of the options --bytes chooses. Throws Error as bake::choose_storage.
bake::Storage choose_storage(const Scene& scene, const bake::BakeSettings& base,
                             const bake::Wish& wish, BakeOptions& o);

/// Bakes, writes the outputs and prints the result. `options` are those of add_bake_options, which
/// `o` was read by. With `shared` the scene is not loaded anew: the result is the same. Throws
/// Error.
void run_bake(BakeOptions o, const options::Options& options, const SharedScene* shared = nullptr);

} // namespace lpvbake::cmd
