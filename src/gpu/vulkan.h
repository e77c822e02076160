// Vulkan handles behind gpu.h. Only src/gpu and the .cpp of stages that raster include this.
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/error.h"

#include <vulkan/vulkan_raii.hpp>

#include <functional>
#include <mutex>

namespace lpvbake::gpu {

/// Throws the Error that a Vulkan error amounts to; `doing` says what was tried.
[[noreturn]] void fail(const char* doing, const vk::SystemError& error);

/// Bytes that go through staging at a time.
inline constexpr uint64_t staging_bytes = 16ull << 20;

/// Runs `f`; what Vulkan throws in it becomes an Error.
template <class F>
decltype(auto) checked(const char* doing, F&& f) {
    try {
        return f();
    } catch (const vk::SystemError& error) {
        fail(doing, error);
    }
}

/// Device memory that counts towards the device's heaps while it lives.
class Memory {
public:
    Memory() = default;
    Memory(vk::raii::DeviceMemory handle, uint64_t bytes, uint64_t* in_use, bool mappable);
    ~Memory();
    Memory(Memory&& other) noexcept;
    Memory& operator=(Memory&& other) noexcept;

    const vk::raii::DeviceMemory& handle() const { return handle_; }
    bool mappable() const { return mappable_; }

private:
    vk::raii::DeviceMemory handle_{nullptr};
    uint64_t bytes_ = 0;
    uint64_t* in_use_ = nullptr; ///< of the heap
    bool mappable_ = false;
};

enum class Placement {
    device, ///< device-local; also mapped where the host reads that memory through its caches
    host,   ///< host-visible, coherent, cached where possible
};

/// A loaded Vulkan library and an instance; messages of the validation layer end up in `messages`.
struct Instance {
    explicit Instance(bool validation);

    vk::raii::Context context;
    vk::raii::Instance handle{nullptr};
    std::mutex mutex;
    std::vector<std::string> messages; ///< guarded by `mutex`
    vk::raii::DebugUtilsMessengerEXT messenger{nullptr};
};

struct Buffer::Impl {
    Impl(Device::Impl& device, uint64_t bytes, Placement placement);
    /// For these uses; an address is one of them.
    Impl(Device::Impl& device, uint64_t bytes, Placement placement, vk::BufferUsageFlags uses);

    vk::raii::Buffer handle{nullptr};
    Memory memory;
    std::byte* mapped = nullptr; ///< null: reached through staging
};

struct __attribute__((visibility("hidden"))) Device::Impl { // in a class that is shown
    explicit Impl(const DeviceOptions& options);

    Instance instance;
    DeviceInfo info;
    vk::raii::PhysicalDevice physical{nullptr};
    vk::PhysicalDeviceLimits limits;
    vk::PhysicalDeviceMemoryProperties memories;
    std::vector<uint64_t> in_use; ///< bytes a heap
    vk::raii::Device handle{nullptr};
    uint32_t family = 0;
    vk::raii::Queue queue{nullptr};
    mutable std::mutex submitting; ///< guards `queue`
    vk::raii::CommandPool pool{nullptr};
    vk::raii::CommandBuffer commands{nullptr}; ///< for submit_now
    vk::raii::Fence fence{nullptr};
    std::unique_ptr<Buffer::Impl> staging; ///< made when first needed

    /// Host memory for copies to and from what is not mapped; `staging_bytes` long.
    const Buffer::Impl& staging_buffer();
    /// Memory for a buffer or an image; `addressed`: programs have its address. Throws Error
    /// (memory).
    Memory allocate(const vk::MemoryRequirements& needs, Placement placement,
                    bool addressed = false);
    vk::raii::CommandBuffer make_commands() const;
    /// Ends the commands and submits them; the fence tells when they are done.
    void start(const vk::raii::CommandBuffer& recorded, const vk::raii::Fence& done) const;
    /// Waits for a fence, and resets it.
    void wait(const vk::raii::Fence& done) const;
    /// Records, submits and waits.
    void submit_now(const std::function<void(const vk::raii::CommandBuffer&)>& record) const;
};

/// Fills in DeviceInfo::ray_bytes and ray_building_bytes.
void tell_ray_bytes(const vk::raii::Device& device, DeviceInfo& info);

/// Everything written so far is seen by everything that follows, the host included.
void full_barrier(const vk::raii::CommandBuffer& commands);

struct Program::Impl {
    vk::raii::DescriptorSetLayout set_layout{nullptr};
    vk::raii::PipelineLayout layout{nullptr};
    vk::raii::Pipeline pipeline{nullptr};
    std::vector<Binding> bindings;
    uint32_t push_bytes = 0;
};

} // namespace lpvbake::gpu
