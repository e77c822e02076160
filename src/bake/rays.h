// Who traces the rays of a bake: Embree, or the device.
#pragma once

#include "gpu/gpu.h"
#include "visibility/visibility.h"

#include <array>
#include <optional>
#include <string_view>

namespace lpvbake::bake {

/// `device`: the rays of lighting and of solvers, where they are many; validity, walls and how
/// surfaces are cut are Embree's. `automatic`: the device where it traces rays, is no CPU and was
/// measured to be faster.
enum class Rays { automatic, embree, device };
inline constexpr std::array<Rays, 3> all_rays{Rays::automatic, Rays::embree, Rays::device};

/// "auto", "embree" or "device".
const char* name_of(Rays rays);
std::optional<Rays> rays_named(std::string_view name);

/// Who traces on a device: embree or device. Throws Error (device) where it is asked for rays that
/// it cannot trace. Automatic: it is gather of a scene of so many triangles, or another solver.
Rays available(Rays rays, const gpu::DeviceInfo& device, bool is_gather, uint64_t triangles);

/// As the device calls itself, but for the width of llvmpipe's vectors, "(LLVM 15.0.6, 256 bits)":
/// it goes by the processor, and values do not go by it.
std::string recorded_name(const gpu::DeviceInfo& device);

/// The surfaces with what answers for the device, in memory of it. Throws Error (memory, device).
visibility::Visibility on_device(const visibility::Visibility& visibility,
                                 const gpu::Device& device);

} // namespace lpvbake::bake
