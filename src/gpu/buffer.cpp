#include "gpu/vulkan.h"

#include <algorithm>
#include <cstring>

namespace lpvbake::gpu {

namespace {

using Usage = vk::BufferUsageFlagBits;

const Buffer::Impl& checked_range(const Buffer& buffer, uint64_t offset, uint64_t bytes) {
    if (offset > buffer.bytes() || bytes > buffer.bytes() - offset)
        throw Error(ErrorKind::failure, "a copy of " + std::to_string(bytes) + " bytes at "
                                            + std::to_string(offset) + " leaves its buffer of "
                                            + std::to_string(buffer.bytes()) + " bytes");
    return buffer.impl();
}

} // namespace

Buffer::Impl::Impl(Device::Impl& device, uint64_t bytes, Placement placement)
    : Impl(device, bytes, placement,
           Usage::eStorageBuffer | Usage::eUniformBuffer | Usage::eUniformTexelBuffer
               | Usage::eVertexBuffer | Usage::eIndexBuffer | Usage::eTransferSrc
               | Usage::eTransferDst) {}

Buffer::Impl::Impl(Device::Impl& device, uint64_t bytes, Placement placement,
                   vk::BufferUsageFlags uses) {
    // Fills come in words; nothing is empty for Vulkan.
    const uint64_t size = std::max<uint64_t>((bytes + 3) / 4 * 4, 4);
    if (size < bytes || size > device.info.max_allocation)
        throw Error(ErrorKind::memory, "a buffer of " + std::to_string(bytes)
                                           + " bytes exceeds the "
                                           + std::to_string(device.info.max_allocation) + " that '"
                                           + device.info.name + "' allows");
    checked("making a buffer", [&] {
        handle = vk::raii::Buffer(device.handle, vk::BufferCreateInfo({}, size, uses));
        memory = device.allocate(handle.getMemoryRequirements(), placement,
                                 bool(uses & Usage::eShaderDeviceAddress));
        handle.bindMemory(*memory.handle(), 0);
        if (memory.mappable())
            mapped = static_cast<std::byte*>(memory.handle().mapMemory(0, VK_WHOLE_SIZE));
    });
}

Buffer::Buffer(const Device& device, uint64_t bytes)
    : bytes_(bytes),
      impl_(std::make_unique<Impl>(device.impl(), bytes, Placement::device)) {}
Buffer::Buffer() = default;
Buffer::~Buffer() = default;
Buffer::Buffer(Buffer&&) noexcept = default;
Buffer& Buffer::operator=(Buffer&&) noexcept = default;

const Buffer::Impl& Device::Impl::staging_buffer() {
    if (!staging)
        staging = std::make_unique<Buffer::Impl>(*this, staging_bytes, Placement::host);
    return *staging;
}

void upload(const Device& device, const Buffer& target, uint64_t offset,
            std::span<const std::byte> data) {
    const Buffer::Impl& buffer = checked_range(target, offset, data.size());
    if (data.empty())
        return;
    if (buffer.mapped) {
        std::memcpy(buffer.mapped + offset, data.data(), data.size());
        return;
    }
    const Buffer::Impl& staging = device.impl().staging_buffer();
    for (uint64_t done = 0; done < data.size(); done += staging_bytes) {
        const uint64_t part = std::min(staging_bytes, data.size() - done);
        std::memcpy(staging.mapped, data.data() + done, part);
        device.impl().submit_now([&](const vk::raii::CommandBuffer& commands) {
            commands.copyBuffer(*staging.handle, *buffer.handle,
                                vk::BufferCopy(0, offset + done, part));
        });
    }
}

void download(const Device& device, const Buffer& source, uint64_t offset,
              std::span<std::byte> data) {
    const Buffer::Impl& buffer = checked_range(source, offset, data.size());
    if (data.empty())
        return;
    if (buffer.mapped) {
        std::memcpy(data.data(), buffer.mapped + offset, data.size());
        return;
    }
    const Buffer::Impl& staging = device.impl().staging_buffer();
    for (uint64_t done = 0; done < data.size(); done += staging_bytes) {
        const uint64_t part = std::min(staging_bytes, data.size() - done);
        device.impl().submit_now([&](const vk::raii::CommandBuffer& commands) {
            commands.copyBuffer(*buffer.handle, *staging.handle,
                                vk::BufferCopy(offset + done, 0, part));
        });
        std::memcpy(data.data() + done, staging.mapped, part);
    }
}

void clear(const Device& device, const Buffer& target) {
    device.impl().submit_now([&](const vk::raii::CommandBuffer& commands) {
        commands.fillBuffer(*target.impl().handle, 0, VK_WHOLE_SIZE, 0);
    });
}

Window window_over(const Buffer& buffer, uint64_t first, uint64_t last, uint64_t element,
                   uint64_t alignment, uint32_t& base) {
    const uint64_t offset = first * element / alignment * alignment;
    base = uint32_t((first * element - offset) / element);
    return {&buffer, offset, last * element - offset};
}

} // namespace lpvbake::gpu
