// A Vulkan layer that makes a device fail: with LPVBAKE_TEST_FAULT=lost:N the N-th submission (from
// 1) and all later ones tell that the device is lost, with memory:N there is no device memory from
// the N-th allocation on.
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

PFN_vkGetInstanceProcAddr next_instance = nullptr;
PFN_vkGetDeviceProcAddr next_device = nullptr;
PFN_vkQueueSubmit next_submit = nullptr;
PFN_vkAllocateMemory next_allocate = nullptr;

/// True from the N-th call on where the environment asks for `kind`:N.
bool fails(const std::string& kind, std::atomic<int>& calls) {
    const char* const fault = std::getenv("LPVBAKE_TEST_FAULT");
    const int call = ++calls;
    return fault && std::strncmp(fault, (kind + ":").c_str(), kind.size() + 1) == 0
           && call >= std::atoi(fault + kind.size() + 1);
}

VkResult submit(VkQueue queue, uint32_t count, const VkSubmitInfo* infos, VkFence fence) {
    static std::atomic<int> calls = 0;
    return fails("lost", calls) ? VK_ERROR_DEVICE_LOST : next_submit(queue, count, infos, fence);
}

VkResult allocate(VkDevice device, const VkMemoryAllocateInfo* info,
                  const VkAllocationCallbacks* callbacks, VkDeviceMemory* memory) {
    static std::atomic<int> calls = 0;
    return fails("memory", calls) ? VK_ERROR_OUT_OF_DEVICE_MEMORY
                                  : next_allocate(device, info, callbacks, memory);
}

/// The loader's link to the next layer in a chain of structures.
template <class Link, class Info>
Link* link_of(const Info* info, VkStructureType type) {
    auto* link = static_cast<Link*>(const_cast<void*>(info->pNext));
    while (link && (link->sType != type || link->function != VK_LAYER_LINK_INFO))
        link = static_cast<Link*>(const_cast<void*>(link->pNext));
    return link;
}

VkResult create_instance(const VkInstanceCreateInfo* info, const VkAllocationCallbacks* callbacks,
                         VkInstance* instance) {
    auto* link =
        link_of<VkLayerInstanceCreateInfo>(info, VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO);
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    next_instance = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    return reinterpret_cast<PFN_vkCreateInstance>(next_instance(nullptr, "vkCreateInstance"))(
        info, callbacks, instance);
}

VkResult create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo* info,
                       const VkAllocationCallbacks* callbacks, VkDevice* device) {
    auto* link =
        link_of<VkLayerDeviceCreateInfo>(info, VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO);
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    const auto create = reinterpret_cast<PFN_vkCreateDevice>(
        link->u.pLayerInfo->pfnNextGetInstanceProcAddr(nullptr, "vkCreateDevice"));
    next_device = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    const VkResult result = create(physical, info, callbacks, device);
    if (result == VK_SUCCESS) {
        next_submit = reinterpret_cast<PFN_vkQueueSubmit>(next_device(*device, "vkQueueSubmit"));
        next_allocate =
            reinterpret_cast<PFN_vkAllocateMemory>(next_device(*device, "vkAllocateMemory"));
    }
    return result;
}

template <class Function>
PFN_vkVoidFunction any(Function* function) {
    return reinterpret_cast<PFN_vkVoidFunction>(function);
}

} // namespace

extern "C" {

VK_LAYER_EXPORT PFN_vkVoidFunction vkGetDeviceProcAddr(VkDevice device, const char* name) {
    if (std::strcmp(name, "vkGetDeviceProcAddr") == 0)
        return any(vkGetDeviceProcAddr);
    if (std::strcmp(name, "vkQueueSubmit") == 0)
        return any(submit);
    if (std::strcmp(name, "vkAllocateMemory") == 0)
        return any(allocate);
    return next_device(device, name);
}

VK_LAYER_EXPORT PFN_vkVoidFunction vkGetInstanceProcAddr(VkInstance instance, const char* name) {
    if (std::strcmp(name, "vkGetInstanceProcAddr") == 0)
        return any(vkGetInstanceProcAddr);
    if (std::strcmp(name, "vkGetDeviceProcAddr") == 0)
        return any(vkGetDeviceProcAddr);
    if (std::strcmp(name, "vkCreateInstance") == 0)
        return any(create_instance);
    if (std::strcmp(name, "vkCreateDevice") == 0)
        return any(create_device);
    return next_instance(instance, name);
}

} // extern "C"
