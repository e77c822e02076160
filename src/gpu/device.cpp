#include "gpu/vulkan.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <limits>
#include <optional>

#include <sys/mman.h>

namespace lpvbake::gpu {

namespace {

constexpr const char* validation_layer = "VK_LAYER_KHRONOS_validation";
constexpr const char* remedy =
    "install a Vulkan driver (Debian: mesa-vulkan-drivers renders on the CPU)";

std::string gibibytes(uint64_t bytes) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f GiB", double(bytes) / double(1ull << 30));
    return text;
}

/// Room in the address space: of what Mesa's driver for the CPU takes with LLVM, where loaders say
/// nothing; and of what LLVM takes for a few kernels, which ends the process where it finds none.
constexpr std::size_t driver_room = std::size_t(256) << 20, compiler_room = std::size_t(64) << 20;

bool has_addresses(std::size_t bytes) {
    void* const room =
        mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (room == MAP_FAILED)
        return false;
    munmap(room, bytes);
    return true;
}

[[noreturn]] void fail_without(const std::string& what) {
    if (!has_addresses(driver_room))
        throw Error(ErrorKind::memory,
                    what + " in so little address space; allow more (ulimit -v)");
    throw Error(ErrorKind::device, what + "; " + remedy);
}

VKAPI_ATTR VkBool32 VKAPI_CALL collect(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                       VkDebugUtilsMessageTypeFlagsEXT,
                                       const VkDebugUtilsMessengerCallbackDataEXT* data,
                                       void* user) {
    auto& instance = *static_cast<Instance*>(user);
    const std::lock_guard lock(instance.mutex);
    if (instance.messages.size() < 100)
        instance.messages.emplace_back(data->pMessage);
    return VK_FALSE;
}

vk::raii::Context load_vulkan() {
    try {
        return vk::raii::Context();
    } catch (const std::exception&) {
        fail_without("no Vulkan library was found");
    }
}

/// The first queue family for graphics and compute, if the device is fit for use.
std::optional<uint32_t> usable_family(const vk::raii::PhysicalDevice& physical) {
    if (physical.getProperties().apiVersion < VK_API_VERSION_1_2)
        return {};
    constexpr auto both = vk::QueueFlagBits::eGraphics | vk::QueueFlagBits::eCompute;
    const auto families = physical.getQueueFamilyProperties();
    for (uint32_t i = 0; i < families.size(); ++i)
        if ((families[i].queueFlags & both) == both)
            return i;
    return {};
}

std::string type_name(vk::PhysicalDeviceType type) {
    switch (type) {
    case vk::PhysicalDeviceType::eCpu:
        return "cpu";
    case vk::PhysicalDeviceType::eIntegratedGpu:
        return "integrated";
    case vk::PhysicalDeviceType::eDiscreteGpu:
        return "discrete";
    case vk::PhysicalDeviceType::eVirtualGpu:
        return "virtual";
    default:
        return "other";
    }
}

std::string uuid_text(const std::array<uint8_t, VK_UUID_SIZE>& uuid) {
    std::string text;
    for (std::size_t i = 0; i < uuid.size(); ++i) {
        char digits[4];
        std::snprintf(digits, sizeof digits, "%s%02x",
                      i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
        text += digits;
    }
    return text;
}

/// What rays take, beside Vulkan 1.2.
constexpr std::array ray_extensions{VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME,
                                    VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME,
                                    VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME};
using RayFeatures =
    vk::StructureChain<vk::PhysicalDeviceFeatures2, vk::PhysicalDeviceBufferDeviceAddressFeatures,
                       vk::PhysicalDeviceAccelerationStructureFeaturesKHR,
                       vk::PhysicalDeviceRayTracingPipelineFeaturesKHR>;

bool traces_rays(const vk::raii::PhysicalDevice& physical) {
    const auto present = physical.enumerateDeviceExtensionProperties();
    for (const char* const wanted : ray_extensions)
        if (std::ranges::none_of(present, [&](const vk::ExtensionProperties& extension) {
                return std::string_view(extension.extensionName.data()) == wanted;
            }))
            return false;
    const auto has = physical.getFeatures2<vk::PhysicalDeviceFeatures2,
                                           vk::PhysicalDeviceBufferDeviceAddressFeatures,
                                           vk::PhysicalDeviceAccelerationStructureFeaturesKHR,
                                           vk::PhysicalDeviceRayTracingPipelineFeaturesKHR>();
    return has.get<vk::PhysicalDeviceBufferDeviceAddressFeatures>().bufferDeviceAddress
           && has.get<vk::PhysicalDeviceAccelerationStructureFeaturesKHR>().accelerationStructure
           && has.get<vk::PhysicalDeviceRayTracingPipelineFeaturesKHR>().rayTracingPipeline;
}

vk::raii::Device open(const vk::raii::PhysicalDevice& physical, uint32_t family, bool rays) {
    constexpr float priority = 1.0f;
    const vk::DeviceQueueCreateInfo queues({}, family, 1, &priority);
    vk::DeviceCreateInfo info({}, queues);
    RayFeatures wanted;
    if (rays) {
        wanted.get<vk::PhysicalDeviceBufferDeviceAddressFeatures>().bufferDeviceAddress = VK_TRUE;
        wanted.get<vk::PhysicalDeviceAccelerationStructureFeaturesKHR>().accelerationStructure =
            VK_TRUE;
        wanted.get<vk::PhysicalDeviceRayTracingPipelineFeaturesKHR>().rayTracingPipeline = VK_TRUE;
        info.setPEnabledExtensionNames(ray_extensions);
        info.pNext = &wanted.get<vk::PhysicalDeviceFeatures2>();
    }
    return vk::raii::Device(physical, info);
}

DeviceInfo describe(const vk::raii::PhysicalDevice& physical, int index) {
    const auto chain =
        physical.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceVulkan11Properties,
                                vk::PhysicalDeviceDriverProperties>();
    const auto& core = chain.get<vk::PhysicalDeviceProperties2>().properties;
    const auto& ids = chain.get<vk::PhysicalDeviceVulkan11Properties>();
    const auto& driver = chain.get<vk::PhysicalDeviceDriverProperties>();
    DeviceInfo info;
    info.index = index;
    info.name = core.deviceName.data();
    info.type = type_name(core.deviceType);
    info.uuid = uuid_text(ids.deviceUUID);
    info.driver = std::string(driver.driverName.data()) + " " + driver.driverInfo.data();
    info.api = std::to_string(VK_API_VERSION_MAJOR(core.apiVersion)) + "."
               + std::to_string(VK_API_VERSION_MINOR(core.apiVersion)) + "."
               + std::to_string(VK_API_VERSION_PATCH(core.apiVersion));
    const auto memories = physical.getMemoryProperties();
    for (uint32_t i = 0; i < memories.memoryHeapCount; ++i)
        if (memories.memoryHeaps[i].flags & vk::MemoryHeapFlagBits::eDeviceLocal)
            info.memory = std::max<uint64_t>(info.memory, memories.memoryHeaps[i].size);
    info.max_allocation = std::min<uint64_t>(ids.maxMemoryAllocationSize, info.memory);
    info.max_storage_range = core.limits.maxStorageBufferRange;
    info.max_texels = core.limits.maxTexelBufferElements;
    info.window_alignment = std::max({core.limits.minStorageBufferOffsetAlignment,
                                      core.limits.minTexelBufferOffsetAlignment,
                                      core.limits.minUniformBufferOffsetAlignment});
    info.traces_rays = traces_rays(physical);
    return info;
}

struct Candidate {
    vk::raii::PhysicalDevice physical;
    uint32_t family;
    DeviceInfo info;
};

std::vector<Candidate> candidates(const Instance& instance) {
    std::vector<vk::PhysicalDevice> found;
    try {
        for (const auto& physical : vk::raii::PhysicalDevices(instance.handle))
            found.push_back(*physical);
    } catch (const vk::SystemError& error) {
        // Vulkan-Hpp reports "no device at all" as this error.
        if (error.code() != vk::Result::eErrorInitializationFailed)
            fail("listing the Vulkan devices", error);
    }
    std::vector<Candidate> usable;
    for (const vk::PhysicalDevice physical : found) {
        vk::raii::PhysicalDevice handle(instance.handle, physical);
        if (const auto family = usable_family(handle)) {
            DeviceInfo info = describe(handle, int(usable.size()));
            usable.push_back({std::move(handle), *family, std::move(info)});
        }
    }
    if (usable.empty())
        fail_without(found.empty() ? "no Vulkan device was found"
                                   : "no Vulkan device here has version 1.2 and a queue for "
                                     "graphics and compute");
    return usable;
}

std::string lower(std::string text) {
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return text;
}

std::size_t select(const std::vector<Candidate>& devices, const std::string& selector) {
    if (selector.empty())
        return 0;
    const std::string wanted = lower(selector);
    const auto first = [&](auto&& matches) {
        return std::size_t(std::ranges::find_if(devices, matches) - devices.begin());
    };
    for (const std::size_t i :
         {first([&](const Candidate& c) { return std::to_string(c.info.index) == wanted; }),
          first([&](const Candidate& c) { return c.info.uuid == wanted; }),
          first([&](const Candidate& c) {
              return lower(c.info.name).find(wanted) != std::string::npos;
          })})
        if (i < devices.size())
            return i;
    std::string list;
    for (const Candidate& device : devices)
        list += (list.empty() ? "" : ", ") + std::to_string(device.info.index) + " '"
                + device.info.name + "'";
    throw Error(ErrorKind::device,
                "no Vulkan device matches '" + selector + "'; there is: " + list);
}

} // namespace

void fail(const char* doing, const vk::SystemError& error) {
    const vk::Result result = vk::Result(error.code().value());
    ErrorKind kind = ErrorKind::failure;
    if (result == vk::Result::eErrorDeviceLost || result == vk::Result::eErrorInitializationFailed
        || result == vk::Result::eErrorIncompatibleDriver)
        kind = ErrorKind::device;
    else if (result == vk::Result::eErrorOutOfDeviceMemory
             || result == vk::Result::eErrorOutOfHostMemory
             || result == vk::Result::eErrorOutOfPoolMemory)
        kind = ErrorKind::memory;
    const char* what = "";
    if (result == vk::Result::eErrorDeviceLost)
        what = ": the device was lost; try again, or name another with `device`";
    else if (kind == ErrorKind::memory)
        what = ": out of memory; a lower `resolution` needs less";
    else if (result == vk::Result::eErrorUnknown) // of Mesa's driver for the CPU
        what = ": a thread could not be started, or memory is short; allow more processes "
               "(ulimit -u, its limit of PIDs)";
    throw Error(kind, std::string(doing) + " failed" + what + " (" + vk::to_string(result) + ")");
}

Memory::Memory(vk::raii::DeviceMemory handle, uint64_t bytes, uint64_t* in_use, bool mappable)
    : handle_(std::move(handle)),
      bytes_(bytes),
      in_use_(in_use),
      mappable_(mappable) {
    *in_use_ += bytes_;
}

Memory::~Memory() {
    if (in_use_)
        *in_use_ -= bytes_;
}

Memory::Memory(Memory&& other) noexcept
    : handle_(std::move(other.handle_)),
      bytes_(other.bytes_),
      in_use_(std::exchange(other.in_use_, nullptr)),
      mappable_(other.mappable_) {}

Memory& Memory::operator=(Memory&& other) noexcept {
    if (this != &other) {
        if (in_use_)
            *in_use_ -= bytes_;
        handle_ = std::move(other.handle_);
        bytes_ = other.bytes_;
        in_use_ = std::exchange(other.in_use_, nullptr);
        mappable_ = other.mappable_;
    }
    return *this;
}

Instance::Instance(bool validation) : context(load_vulkan()) {
    const uint32_t version = context.enumerateInstanceVersion();
    if (version < VK_API_VERSION_1_2)
        throw Error(ErrorKind::device,
                    std::string("the Vulkan library is older than 1.2; ") + remedy);
    std::vector<const char*> layers, extensions;
    if (validation) {
        const auto present = context.enumerateInstanceLayerProperties();
        if (std::ranges::none_of(present, [](const vk::LayerProperties& layer) {
                return std::string_view(layer.layerName.data()) == validation_layer;
            }))
            throw Error(ErrorKind::device, std::string("the layer ") + validation_layer
                                               + " is missing; install it (Debian: "
                                                 "vulkan-validationlayers)");
        layers = {validation_layer};
        extensions = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};
    }
    const vk::ApplicationInfo application("lpvbake", 0, nullptr, 0, VK_API_VERSION_1_2);
    constexpr auto synchronization = vk::ValidationFeatureEnableEXT::eSynchronizationValidation;
    vk::StructureChain chain{vk::InstanceCreateInfo({}, &application, layers, extensions),
                             vk::DebugUtilsMessengerCreateInfoEXT(
                                 {},
                                 vk::DebugUtilsMessageSeverityFlagBitsEXT::eWarning
                                     | vk::DebugUtilsMessageSeverityFlagBitsEXT::eError,
                                 vk::DebugUtilsMessageTypeFlagBitsEXT::eValidation
                                     | vk::DebugUtilsMessageTypeFlagBitsEXT::ePerformance,
                                 collect, this),
                             vk::ValidationFeaturesEXT(synchronization)};
    if (!validation) {
        chain.unlink<vk::DebugUtilsMessengerCreateInfoEXT>();
        chain.unlink<vk::ValidationFeaturesEXT>();
    }
    try {
        handle = vk::raii::Instance(context, chain.get<vk::InstanceCreateInfo>());
    } catch (const vk::IncompatibleDriverError&) {
        fail_without("no Vulkan driver was found");
    } catch (const vk::SystemError& error) {
        fail("starting Vulkan", error);
    }
    if (validation) {
        auto info = chain.get<vk::DebugUtilsMessengerCreateInfoEXT>();
        info.pNext = nullptr;
        messenger = checked("starting validation",
                            [&] { return vk::raii::DebugUtilsMessengerEXT(handle, info); });
    }
}

Device::Impl::Impl(const DeviceOptions& options) : instance(options.validation) {
    auto devices = candidates(instance);
    Candidate& chosen = devices[select(devices, options.selector)];
    info = chosen.info;
    info.traces_rays = info.traces_rays && (!options.rays || options.rays(info));
    physical = std::move(chosen.physical);
    family = chosen.family;
    limits = physical.getProperties().limits;
    memories = physical.getMemoryProperties();
    in_use.assign(memories.memoryHeapCount, 0);
    checked("opening the Vulkan device", [&] {
        handle = open(physical, family, info.traces_rays);
        if (info.traces_rays)
            tell_ray_bytes(handle, info);
        queue = vk::raii::Queue(handle, family, 0);
        pool = vk::raii::CommandPool(
            handle,
            vk::CommandPoolCreateInfo(vk::CommandPoolCreateFlagBits::eResetCommandBuffer, family));
        commands = make_commands();
        fence = vk::raii::Fence(handle, vk::FenceCreateInfo());
    });
}

Memory Device::Impl::allocate(const vk::MemoryRequirements& needs, Placement placement,
                              bool addressed) {
    using Flag = vk::MemoryPropertyFlagBits;
    constexpr auto mapped = Flag::eHostVisible | Flag::eHostCoherent;
    // Uncached reads through a bus are slower than staging by orders of magnitude: device memory is
    // mapped only where it is cached (CPU devices, unified memory).
    const std::vector<vk::MemoryPropertyFlags> wishes =
        placement == Placement::device
            ? std::vector<vk::MemoryPropertyFlags>{Flag::eDeviceLocal | mapped | Flag::eHostCached,
                                                   Flag::eDeviceLocal}
            : std::vector<vk::MemoryPropertyFlags>{mapped | Flag::eHostCached, mapped};
    const std::string size = gibibytes(needs.size);
    if (needs.size > info.max_allocation)
        throw Error(ErrorKind::memory, "an allocation of " + size + " exceeds the "
                                           + gibibytes(info.max_allocation) + " that '" + info.name
                                           + "' allows");
    uint64_t left = 0;
    for (const vk::MemoryPropertyFlags wish : wishes)
        for (uint32_t type = 0; type < memories.memoryTypeCount; ++type) {
            const vk::MemoryPropertyFlags flags = memories.memoryTypes[type].propertyFlags;
            if (!(needs.memoryTypeBits >> type & 1) || (flags & wish) != wish)
                continue;
            const uint32_t heap = memories.memoryTypes[type].heapIndex;
            left = std::max(
                left, memories.memoryHeaps[heap].size
                          - std::min<uint64_t>(in_use[heap], memories.memoryHeaps[heap].size));
            if (needs.size + in_use[heap] > memories.memoryHeaps[heap].size)
                continue;
            try {
                const bool mappable = (flags & mapped) == mapped
                                      && (wish & Flag::eHostVisible || flags & Flag::eHostCached);
                const vk::MemoryAllocateFlagsInfo flagged(
                    vk::MemoryAllocateFlagBits::eDeviceAddress);
                const vk::MemoryAllocateInfo info_of(needs.size, type,
                                                     addressed ? &flagged : nullptr);
                return Memory(vk::raii::DeviceMemory(handle, info_of), needs.size, &in_use[heap],
                              mappable);
            } catch (const vk::OutOfDeviceMemoryError&) {
            } catch (const vk::OutOfHostMemoryError&) {
            } catch (const vk::SystemError& error) {
                fail("allocating device memory", error);
            }
        }
    throw Error(ErrorKind::memory, "out of memory on '" + info.name + "': " + size
                                       + " more are needed, " + gibibytes(left) + " are left");
}

vk::raii::CommandBuffer Device::Impl::make_commands() const {
    vk::raii::CommandBuffers made(
        handle, vk::CommandBufferAllocateInfo(*pool, vk::CommandBufferLevel::ePrimary, 1));
    return std::move(made.front());
}

void Device::Impl::start(const vk::raii::CommandBuffer& recorded,
                         const vk::raii::Fence& done) const {
    // Kernels are compiled as they run.
    if (info.type == "cpu" && !has_addresses(compiler_room))
        throw Error(ErrorKind::memory, "'" + info.name
                                           + "' has too little address space to compile in; allow "
                                             "more (ulimit -v)");
    checked("running on the Vulkan device", [&] {
        recorded.end();
        const vk::CommandBuffer raw = *recorded;
        const std::lock_guard lock(submitting);
        queue.submit(vk::SubmitInfo({}, {}, raw), *done);
    });
}

void Device::Impl::wait(const vk::raii::Fence& done) const {
    checked("running on the Vulkan device", [&] {
        while (handle.waitForFences(*done, VK_TRUE, std::numeric_limits<uint64_t>::max())
               == vk::Result::eTimeout) {
        }
        handle.resetFences(*done);
    });
}

void Device::Impl::submit_now(
    const std::function<void(const vk::raii::CommandBuffer&)>& record) const {
    checked("recording for the Vulkan device", [&] {
        commands.begin(vk::CommandBufferBeginInfo(vk::CommandBufferUsageFlagBits::eOneTimeSubmit));
        record(commands);
        full_barrier(commands);
    });
    start(commands, fence);
    wait(fence);
}

void full_barrier(const vk::raii::CommandBuffer& commands) {
    constexpr auto everything = vk::PipelineStageFlagBits::eAllCommands;
    const vk::MemoryBarrier barrier(vk::AccessFlagBits::eMemoryWrite,
                                    vk::AccessFlagBits::eMemoryRead
                                        | vk::AccessFlagBits::eMemoryWrite);
    commands.pipelineBarrier(everything, everything | vk::PipelineStageFlagBits::eHost, {}, barrier,
                             {}, {});
}

std::vector<DeviceInfo> list_devices() {
    const Instance instance(false);
    std::vector<DeviceInfo> infos;
    for (const Candidate& device : candidates(instance))
        infos.push_back(device.info);
    return infos;
}

Device::Device(const DeviceOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Device::~Device() = default;

const DeviceInfo& Device::info() const {
    return impl_->info;
}

void Device::check_validation() {
    std::vector<std::string> messages;
    {
        const std::lock_guard lock(impl_->instance.mutex);
        messages.swap(impl_->instance.messages);
    }
    if (!messages.empty())
        throw Error(ErrorKind::failure,
                    "Vulkan validation: " + messages.front()
                        + (messages.size() > 1
                               ? " (and " + std::to_string(messages.size() - 1) + " more)"
                               : ""));
}

} // namespace lpvbake::gpu
