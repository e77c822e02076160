// Vulkan devices, which bakes run on. Failures are Error: device (missing or lost), memory (out of
// device or host memory), failure (anything else, validation messages too).
#pragma once

#include "lpvbake/export.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace lpvbake::gpu {

struct DeviceInfo {
    int index = 0;
    std::string name;
    std::string type;               ///< cpu, integrated, discrete, virtual, other
    std::string uuid;               ///< hex digits as vulkaninfo prints them
    std::string driver;             ///< name and version
    std::string api;                ///< Vulkan version
    uint64_t memory = 0;            ///< bytes of the largest device-local heap
    uint64_t max_allocation = 0;    ///< bytes of one buffer
    uint64_t max_storage_range = 0; ///< bytes of one storage-buffer binding
    uint64_t max_texels = 0;        ///< elements of one texel-buffer binding
    uint64_t window_alignment = 0;  ///< bytes that a binding's offset is a multiple of
    bool traces_rays = false;       ///< it has VK_KHR_ray_tracing_pipeline, and was opened for it
    /// Of a triangle in the structure that rays are traced in, and what it takes more while that is
    /// built, as the driver says; 0 before it is opened for rays.
    uint64_t ray_bytes = 0, ray_building_bytes = 0;
};

/// All devices with Vulkan 1.2 and a queue for graphics and compute, in the driver's order.
/// Throws Error (device) where there is no Vulkan at all.
LPVBAKE_API std::vector<gpu::DeviceInfo> list_devices();

struct DeviceOptions {
    std::string selector;    ///< index, UUID or part of the name; empty: the first device
    bool validation = false; ///< load the validation layer; its messages become errors
    /// Asked of a device that traces rays, before it is opened: whether for them, too, which takes
    /// some drivers twice as long. Empty: yes.
    std::function<bool(const DeviceInfo&)> rays = {};
};

/// A logical device with one queue. Not copied. It is for one thread at a time, but for what the
/// library makes of it itself: programs may be made on any number of threads, while others use it.
class LPVBAKE_API Device {
public:
    explicit Device(const gpu::DeviceOptions& options);
    ~Device();
    Device(const gpu::Device&) = delete;
    gpu::Device& operator=(const gpu::Device&) = delete;

    const gpu::DeviceInfo& info() const;
    bool is_cpu() const { return info().type == "cpu"; }
    /// Throws Error (failure) with the first validation message seen since the last call, if any.
    void check_validation();

    struct Impl; ///< Vulkan handles, for the library alone
    Impl& impl() const { return *impl_; }

private:
    std::unique_ptr<Impl> impl_;
};

} // namespace lpvbake::gpu
