// From a scene to a volume:
//
//     const lpvbake::Scene scene = lpvbake::load_gltf("room.glb");
//     const lpvbake::gpu::Device device({}); // the first that Vulkan has
//     lpvbake::BakeRequest request;
//     request.resolution = 48;
//     lpvbake::Baked baked = lpvbake::bake_volume(scene, request, device);
//     lpvbake::write_volume("room.vdb", std::move(baked.volume));
#pragma once

#include "lpvbake/device.h"
#include "lpvbake/progress.h"
#include "lpvbake/scene.h"
#include "lpvbake/volume.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake {

/// What is asked of a bake. What is left open is chosen, as the program chooses it: the first
/// solver that can do what is asked, or the settings that meet `error` and `time_budget` best.
struct BakeRequest {
    std::string solver;                ///< "sn", "gather" or "lpv"; empty: open
    std::optional<int> sh_order;       ///< highest band, 1 to 4 as the solver can; none: open
    std::optional<double> error;       ///< relative error of irradiance to reach, such as 0.04
    std::optional<double> time_budget; ///< seconds to stay in, as estimated
    /// Of the solver, by their names as the program's options have them, without dashes in front:
    /// {"directions", "144"}, {"occlusion", "sh"}.
    std::map<std::string, std::string> parameters;

    int resolution = 32;  ///< cells along the longest axis, margins included; at least 3
    double cell_size = 0; ///< metres; above 0 it overrides `resolution`
    std::optional<int>
        margin; ///< whole cells around the box on each side; none: 1, 0 with `bounds`
    std::optional<Bounds> bounds; ///< what the grid is fitted to; none: all of the scene

    bool emitters = true; ///< emissive surfaces give light
    /// Reflections at most; none: all, or one by lpv.
    std::optional<int> bounces;
    /// Program whose picture of the surfaces the volume is fitted to, by the name of its target
    /// (see write_volume; "generic": read_irradiance with Reading::facing); empty: none, the volume
    /// is the field at the cells' centres.
    std::string fit;
    /// Instruction set that rays are traced with: "sse2", "avx", "avx2" or "avx512"; empty: avx2,
    /// or what an older processor has. Another one may round otherwise.
    std::string isa;
    /// Who traces the rays of lighting and of the solver: "embree", or "device", which has to have
    /// gpu::DeviceInfo::traces_rays; empty: such a device unless it is a CPU.
    std::string rays;
};

/// What a bake is going to be.
struct BakeForecast {
    Grid grid;
    std::string choice; ///< solver and settings in a phrase: "sn, order 2, 144 directions, ..."
    /// Relative error of irradiance at cells, at most in nine of ten scenes: by a look at this
    /// one's light where `error` is asked and a device given, else as in a Cornell box.
    double error = 0;
    double seconds = 0;        ///< on the caller's threads and the device
    uint64_t device_bytes = 0; ///< peak of device memory
    uint64_t host_bytes = 0;   ///< estimate
    std::vector<std::string> warnings;
};

struct Baked {
    Volume volume;
    std::vector<StageReport> stages;
    std::vector<std::string> warnings; ///< a line each
};

/// What `bake` would do. Throws Error: argument (a request that contradicts itself, or a scene
/// whose indices lead nowhere), invalid (no triangle, no light that arrives), memory (names the
/// largest resolution that fits).
LPVBAKE_API BakeForecast forecast(const Scene& scene, const BakeRequest& request,
                                  const gpu::Device& device);
/// The same without a look at its light, which takes as long as lighting its surfaces:
/// `bake_volume` may choose other settings where `error` is asked.
LPVBAKE_API BakeForecast forecast(const Scene& scene, const BakeRequest& request,
                                  const gpu::DeviceInfo& device);

/// Bakes. The same bits for the same scene, request, device and instruction set, on any number of
/// threads. Throws
/// Error: as `forecast`, device (it was lost), and whatever `progress` throws. One bake a device at
/// a time.
LPVBAKE_API Baked bake_volume(const Scene& scene, const BakeRequest& request,
                              const gpu::Device& device, Progress& progress);
LPVBAKE_API Baked bake_volume(const Scene& scene, const BakeRequest& request,
                              const gpu::Device& device);

} // namespace lpvbake
