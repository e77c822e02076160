#include "gpu/rays.h"

#include "gpu/rays_layout.h"
#include "gpu/trace.rahit.h"
#include "gpu/trace.rchit.h"
#include "gpu/trace.rgen.h"
#include "gpu/trace.rmiss.h"
#include "gpu/vulkan.h"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <cstring>
#include <optional>

namespace lpvbake::gpu {
namespace {

using Usage = vk::BufferUsageFlagBits;

static_assert(sizeof(DeviceRay) == 32 && sizeof(DeviceHit) == 16);
static_assert(DeviceHit::none == met_none && DeviceHit::unsure == met_unsure);

/// Batches that are on their way at a time, at most: some are traced, others written and read.
constexpr int most_slots = 8;
constexpr uint64_t given_bytes = RayTracer::batch * sizeof(DeviceRay),
                   answer_bytes = RayTracer::batch * sizeof(DeviceHit);

uint64_t aligned(uint64_t bytes, uint64_t alignment) {
    return (bytes + alignment - 1) / alignment * alignment;
}

/// Memory that programs reach by its address, filled from the host.
template <class T>
Buffer::Impl filled(const Device& device, std::span<const T> data, vk::BufferUsageFlags uses) {
    const uint64_t bytes = data.size_bytes();
    Buffer::Impl buffer(device.impl(), bytes, Placement::device,
                        uses | Usage::eShaderDeviceAddress | Usage::eTransferDst);
    if (buffer.mapped) {
        std::memcpy(buffer.mapped, data.data(), bytes);
        return buffer;
    }
    const Buffer::Impl& staging = device.impl().staging_buffer();
    for (uint64_t done = 0; done < bytes; done += staging_bytes) {
        const uint64_t part = std::min(staging_bytes, bytes - done);
        std::memcpy(staging.mapped, reinterpret_cast<const std::byte*>(data.data()) + done, part);
        device.impl().submit_now([&](const vk::raii::CommandBuffer& commands) {
            commands.copyBuffer(*staging.handle, *buffer.handle, vk::BufferCopy(0, done, part));
        });
    }
    return buffer;
}

uint64_t address_of(const Device& device, const Buffer::Impl& buffer) {
    return device.impl().handle.getBufferAddress(vk::BufferDeviceAddressInfo(*buffer.handle));
}

/// An acceleration structure and its memory.
struct Structure {
    Buffer::Impl memory;
    vk::raii::AccelerationStructureKHR handle;
};

vk::AccelerationStructureBuildGeometryInfoKHR
build_info(vk::AccelerationStructureTypeKHR type,
           std::span<const vk::AccelerationStructureGeometryKHR> geometries) {
    vk::AccelerationStructureBuildGeometryInfoKHR info(
        type, vk::BuildAccelerationStructureFlagBitsKHR::ePreferFastTrace,
        vk::BuildAccelerationStructureModeKHR::eBuild);
    info.geometryCount = uint32_t(geometries.size());
    info.pGeometries = geometries.data();
    return info;
}

/// Of so many primitives in each geometry.
vk::AccelerationStructureBuildSizesInfoKHR
sizes_of(const vk::raii::Device& device, const vk::AccelerationStructureBuildGeometryInfoKHR& info,
         const std::vector<uint32_t>& counts) {
    return device.getAccelerationStructureBuildSizesKHR(
        vk::AccelerationStructureBuildTypeKHR::eDevice, info, counts);
}

/// Builds one of so many primitives in each geometry, and waits.
Structure build(const Device& device, vk::AccelerationStructureTypeKHR type,
                std::span<const vk::AccelerationStructureGeometryKHR> geometries,
                const std::vector<uint32_t>& counts) {
    const Device::Impl& gpu = device.impl();
    vk::AccelerationStructureBuildGeometryInfoKHR info = build_info(type, geometries);
    const vk::AccelerationStructureBuildSizesInfoKHR sizes = sizes_of(gpu.handle, info, counts);
    Buffer::Impl memory(device.impl(), sizes.accelerationStructureSize, Placement::device,
                        Usage::eAccelerationStructureStorageKHR | Usage::eShaderDeviceAddress);
    vk::raii::AccelerationStructureKHR handle(
        gpu.handle, vk::AccelerationStructureCreateInfoKHR({}, *memory.handle, 0,
                                                           sizes.accelerationStructureSize, type));
    const auto limits =
        gpu.physical.getProperties2<vk::PhysicalDeviceProperties2,
                                    vk::PhysicalDeviceAccelerationStructurePropertiesKHR>();
    const uint64_t alignment = limits.get<vk::PhysicalDeviceAccelerationStructurePropertiesKHR>()
                                   .minAccelerationStructureScratchOffsetAlignment;
    const Buffer::Impl scratch(device.impl(), sizes.buildScratchSize + alignment, Placement::device,
                               Usage::eStorageBuffer | Usage::eShaderDeviceAddress);
    info.dstAccelerationStructure = *handle;
    info.scratchData.deviceAddress = aligned(address_of(device, scratch), alignment);
    std::vector<vk::AccelerationStructureBuildRangeInfoKHR> ranges;
    for (const uint32_t count : counts)
        ranges.emplace_back(count, 0, 0, 0);
    gpu.submit_now([&](const vk::raii::CommandBuffer& commands) {
        commands.buildAccelerationStructuresKHR(info, ranges.data());
    });
    return {std::move(memory), std::move(handle)};
}

/// Triangles of which only the addresses of positions and corners are missing.
vk::AccelerationStructureGeometryTrianglesDataKHR triangles_data(uint64_t positions) {
    vk::AccelerationStructureGeometryTrianglesDataKHR data;
    data.vertexFormat = vk::Format::eR32G32B32Sfloat;
    data.vertexStride = sizeof(glm::vec3);
    data.maxVertex = uint32_t(positions - 1);
    data.indexType = vk::IndexType::eUint32;
    return data;
}

/// The parts of the structure: one geometry of what is opaque, and one of what has facts.
Structure build_triangles(const Device& device, std::span<const glm::vec3> positions,
                          std::span<const glm::uvec3> corners, size_t opaque) {
    constexpr auto inputs = Usage::eAccelerationStructureBuildInputReadOnlyKHR;
    const Buffer::Impl points = filled(device, positions, inputs);
    const Buffer::Impl indices = filled(device, corners, inputs);
    std::vector<vk::AccelerationStructureGeometryKHR> geometries;
    std::vector<uint32_t> counts;
    const auto add = [&](size_t first, size_t count, vk::GeometryFlagsKHR flags) {
        auto data = triangles_data(positions.size());
        data.vertexData.deviceAddress = address_of(device, points);
        data.indexData.deviceAddress = address_of(device, indices) + first * sizeof(glm::uvec3);
        geometries.emplace_back(vk::GeometryTypeKHR::eTriangles, data, flags);
        counts.push_back(uint32_t(count));
    };
    add(0, opaque, vk::GeometryFlagBitsKHR::eOpaque);
    if (corners.size() > opaque)
        add(opaque, corners.size() - opaque, {});
    return build(device, vk::AccelerationStructureTypeKHR::eBottomLevel, geometries, counts);
}

/// One instance of those.
Structure build_instance(const Device& device, const Structure& triangles) {
    vk::AccelerationStructureInstanceKHR instance;
    instance.transform.matrix[0][0] = instance.transform.matrix[1][1] =
        instance.transform.matrix[2][2] = 1.0f;
    instance.mask = 0xff;
    instance.flags =
        VkGeometryInstanceFlagsKHR(VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR);
    instance.accelerationStructureReference =
        device.impl().handle.getAccelerationStructureAddressKHR(
            vk::AccelerationStructureDeviceAddressInfoKHR(*triangles.handle));
    const Buffer::Impl instances =
        filled(device, std::span<const vk::AccelerationStructureInstanceKHR>(&instance, 1),
               Usage::eAccelerationStructureBuildInputReadOnlyKHR);
    vk::AccelerationStructureGeometryInstancesDataKHR data;
    data.data.deviceAddress = address_of(device, instances);
    const vk::AccelerationStructureGeometryKHR geometry(vk::GeometryTypeKHR::eInstances, data);
    return build(device, vk::AccelerationStructureTypeKHR::eTopLevel, {&geometry, 1}, {1});
}

constexpr auto of_rays = vk::ShaderStageFlagBits::eRaygenKHR | vk::ShaderStageFlagBits::eAnyHitKHR
                         | vk::ShaderStageFlagBits::eClosestHitKHR;

/// Groups of the pipeline, which start with the ways to form rays.
enum Group : uint32_t { group_trace, group_look, group_miss, group_hit, groups_in_all };

/// The programs, and the table that finds them.
struct Pipeline {
    vk::raii::DescriptorSetLayout set_layout{nullptr};
    vk::raii::PipelineLayout layout{nullptr};
    vk::raii::Pipeline pipeline{nullptr};
    std::optional<Buffer::Impl> table;
    std::array<vk::StridedDeviceAddressRegionKHR, groups_in_all> regions;

    Pipeline(const Device& device, std::span<const uint32_t> looking);

private:
    void link(const Device& device, std::span<const uint32_t> looking);
    void fill_table(const Device& device);
};

Pipeline::Pipeline(const Device& device, std::span<const uint32_t> looking) {
    const vk::raii::Device& handle = device.impl().handle;
    const std::array bindings{
        vk::DescriptorSetLayoutBinding(binding_tree, vk::DescriptorType::eAccelerationStructureKHR,
                                       1, of_rays),
        vk::DescriptorSetLayoutBinding(binding_given, vk::DescriptorType::eStorageBuffer, 1,
                                       of_rays),
        vk::DescriptorSetLayoutBinding(binding_answers, vk::DescriptorType::eStorageBuffer, 1,
                                       of_rays),
        vk::DescriptorSetLayoutBinding(binding_facts, vk::DescriptorType::eStorageBuffer, 1,
                                       of_rays)};
    set_layout =
        vk::raii::DescriptorSetLayout(handle, vk::DescriptorSetLayoutCreateInfo({}, bindings));
    const vk::PushConstantRange push(of_rays, 0, sizeof(RaysPush));
    layout = vk::raii::PipelineLayout(handle, vk::PipelineLayoutCreateInfo({}, *set_layout, push));
    link(device, looking);
    fill_table(device);
}

void Pipeline::link(const Device& device, std::span<const uint32_t> looking) {
    const vk::raii::Device& handle = device.impl().handle;
    const auto shader = [&](std::span<const uint32_t> spirv) {
        return vk::raii::ShaderModule(
            handle, vk::ShaderModuleCreateInfo({}, spirv.size_bytes(), spirv.data()));
    };
    const std::array modules{shader(shaders::trace_rgen), shader(looking),
                             shader(shaders::trace_rmiss), shader(shaders::trace_rchit),
                             shader(shaders::trace_rahit)};
    using Stage = vk::ShaderStageFlagBits;
    const std::array kinds{Stage::eRaygenKHR, Stage::eRaygenKHR, Stage::eMissKHR,
                           Stage::eClosestHitKHR, Stage::eAnyHitKHR};
    std::vector<vk::PipelineShaderStageCreateInfo> stages;
    for (size_t i = 0; i < modules.size(); ++i)
        stages.emplace_back(vk::PipelineShaderStageCreateFlags(), kinds[i], *modules[i], "main");
    using Info = vk::RayTracingShaderGroupCreateInfoKHR;
    using Kind = vk::RayTracingShaderGroupTypeKHR;
    constexpr uint32_t unused = VK_SHADER_UNUSED_KHR;
    const std::array<Info, groups_in_all> groups{
        Info(Kind::eGeneral, 0, unused, unused, unused),
        Info(Kind::eGeneral, 1, unused, unused, unused),
        Info(Kind::eGeneral, 2, unused, unused, unused),
        Info(Kind::eTrianglesHitGroup, unused, 3, 4, unused)};
    vk::RayTracingPipelineCreateInfoKHR info({}, stages, groups, 1);
    info.layout = *layout;
    pipeline = vk::raii::Pipeline(handle, nullptr, nullptr, info);
}

void Pipeline::fill_table(const Device& device) {
    const auto limits =
        device.impl()
            .physical.getProperties2<vk::PhysicalDeviceProperties2,
                                     vk::PhysicalDeviceRayTracingPipelinePropertiesKHR>();
    const auto& of_table = limits.get<vk::PhysicalDeviceRayTracingPipelinePropertiesKHR>();
    const uint32_t size = of_table.shaderGroupHandleSize;
    const uint64_t stride = aligned(aligned(size, of_table.shaderGroupHandleAlignment),
                                    of_table.shaderGroupBaseAlignment);
    const std::vector<std::byte> handles = pipeline.getRayTracingShaderGroupHandlesKHR<std::byte>(
        0, uint32_t(regions.size()), regions.size() * size);
    // The memory's address need not be a multiple.
    Buffer::Impl& memory =
        table.emplace(device.impl(), stride * (regions.size() + 1), Placement::host,
                      Usage::eShaderBindingTableKHR | Usage::eShaderDeviceAddress);
    const uint64_t address = address_of(device, memory), first = aligned(address, stride);
    for (size_t i = 0; i < regions.size(); ++i) {
        const uint64_t at = first + i * stride;
        std::memcpy(memory.mapped + (at - address), handles.data() + i * size, size);
        regions[i] = vk::StridedDeviceAddressRegionKHR(at, stride, stride);
    }
}

int slots_of(int threads) {
    return std::clamp(threads, 1, most_slots);
}

/// A batch on its way.
struct Slot {
    Buffer::Impl written; ///< by the host, to be copied to what is given
    Buffer::Impl given;   ///< which programs may read many times
    Buffer::Impl answers; ///< which they write where the host reads them
    vk::raii::CommandPool pool;
    vk::raii::CommandBuffer commands{nullptr};
    vk::raii::Fence done;
    vk::DescriptorSet set;

    explicit Slot(const Device& device)
        : written(device.impl(), given_bytes, Placement::host, Usage::eTransferSrc),
          given(device.impl(), given_bytes, Placement::device,
                Usage::eStorageBuffer | Usage::eTransferDst),
          answers(device.impl(), answer_bytes, Placement::host, Usage::eStorageBuffer),
          pool(device.impl().handle,
               vk::CommandPoolCreateInfo(vk::CommandPoolCreateFlagBits::eResetCommandBuffer,
                                         device.impl().family)),
          done(device.impl().handle, vk::FenceCreateInfo()) {
        vk::raii::CommandBuffers made(
            device.impl().handle,
            vk::CommandBufferAllocateInfo(*pool, vk::CommandBufferLevel::ePrimary, 1));
        commands = std::move(made.front());
    }
};

/// Opaque ones first, the others as they come.
std::vector<uint32_t> opaque_first(std::span<const DeviceTriangle> triangles, size_t& opaque) {
    std::vector<uint32_t> order(triangles.size());
    for (uint32_t i = 0; i < order.size(); ++i)
        order[i] = i;
    const auto rest = std::stable_partition(order.begin(), order.end(), [&](uint32_t i) {
        return !triangles[i].unsure && !triangles[i].culled;
    });
    opaque = size_t(rest - order.begin());
    return order;
}

} // namespace

void tell_ray_bytes(const vk::raii::Device& device, DeviceInfo& info) {
    constexpr uint32_t many = 1 << 20, vertices_each = 2; // more than most scenes have
    const vk::AccelerationStructureGeometryKHR triangles(vk::GeometryTypeKHR::eTriangles,
                                                         triangles_data(vertices_each * many));
    const auto sizes = sizes_of(
        device, build_info(vk::AccelerationStructureTypeKHR::eBottomLevel, {&triangles, 1}),
        {many});
    info.ray_bytes = sizes.accelerationStructureSize / many;
    info.ray_building_bytes =
        sizes.buildScratchSize / many + sizeof(glm::uvec3) + vertices_each * sizeof(glm::vec3);
}

struct RayTracer::Impl {
    Impl(const Device& of, std::span<const glm::vec3> positions,
         std::span<const DeviceTriangle> triangles, std::span<const uint32_t> looking, int threads)
        : device(of),
          order(opaque_first(triangles, opaque)),
          pipeline(of, looking) {
        std::vector<glm::uvec3> corners;
        std::vector<glm::vec4> of_others;
        corners.reserve(order.size());
        for (const uint32_t i : order) {
            const DeviceTriangle& triangle = triangles[i];
            const glm::uvec3 v = triangle.corners;
            corners.push_back(v);
            if (corners.size() > opaque)
                of_others.push_back(glm::vec4(
                    glm::cross(positions[v.y] - positions[v.x], positions[v.z] - positions[v.x]),
                    (triangle.unsure ? fact_unsure : 0u) | (triangle.culled ? fact_culled : 0u)));
        }
        if (of_others.empty())
            of_others.resize(1);
        facts.emplace(filled(device, std::span<const glm::vec4>(of_others), Usage::eStorageBuffer));
        parts.emplace(build_triangles(device, positions, corners, opaque));
        tree.emplace(build_instance(device, *parts));
        for (int i = 0; i < slots_of(threads); ++i)
            all.push_back(std::make_unique<Slot>(device));
        make_sets();
        for (const std::unique_ptr<Slot>& slot : all)
            idle.push_back(slot.get());
        if (opaque == order.size())
            order.clear(); // they are as they came
    }

    void make_sets() {
        const vk::raii::Device& handle = device.impl().handle;
        const auto slots = uint32_t(all.size());
        const std::array sizes{
            vk::DescriptorPoolSize(vk::DescriptorType::eAccelerationStructureKHR, slots),
            vk::DescriptorPoolSize(vk::DescriptorType::eStorageBuffer, 3 * slots)};
        sets = vk::raii::DescriptorPool(handle, vk::DescriptorPoolCreateInfo({}, slots, sizes));
        for (const std::unique_ptr<Slot>& slot : all) {
            const vk::DescriptorSetLayout layout = *pipeline.set_layout;
            slot->set = (*handle)
                            .allocateDescriptorSets(vk::DescriptorSetAllocateInfo(*sets, layout),
                                                    *handle.getDispatcher())
                            .front();
            const vk::AccelerationStructureKHR of = *tree->handle;
            const vk::WriteDescriptorSetAccelerationStructureKHR shown(of);
            vk::WriteDescriptorSet first(slot->set, binding_tree, 0, 1,
                                         vk::DescriptorType::eAccelerationStructureKHR);
            first.pNext = &shown;
            std::vector<vk::WriteDescriptorSet> writes{first};
            const std::array buffers{
                vk::DescriptorBufferInfo(*slot->given.handle, 0, VK_WHOLE_SIZE),
                vk::DescriptorBufferInfo(*slot->answers.handle, 0, VK_WHOLE_SIZE),
                vk::DescriptorBufferInfo(*facts->handle, 0, VK_WHOLE_SIZE)};
            for (uint32_t i = 0; i < buffers.size(); ++i)
                writes.emplace_back(slot->set, binding_given + i, 0, 1,
                                    vk::DescriptorType::eStorageBuffer, nullptr, &buffers[i]);
            handle.updateDescriptorSets(writes, {});
        }
    }

    /// Takes a slot, and gives it back.
    class Taken {
    public:
        explicit Taken(Impl& impl) : impl_(impl) {
            std::unique_lock lock(impl_.mutex);
            impl_.freed.wait(lock, [&] { return !impl_.idle.empty(); });
            slot_ = impl_.idle.back();
            impl_.idle.pop_back();
        }
        ~Taken() {
            {
                const std::lock_guard lock(impl_.mutex);
                impl_.idle.push_back(slot_);
            }
            impl_.freed.notify_one();
        }
        Taken(const Taken&) = delete;
        Slot& operator*() const { return *slot_; }

    private:
        Impl& impl_;
        Slot* slot_;
    };

    /// Has a group form a ray of what is given for each answer.
    template <class Answer>
    void run(Group group, std::span<const std::byte> given, std::span<Answer> answers) {
        const Taken taken(*this);
        Slot& slot = *taken;
        std::memcpy(slot.written.mapped, given.data(), given.size());
        checked("tracing rays on the Vulkan device", [&] {
            const vk::raii::CommandBuffer& commands = slot.commands;
            commands.begin(
                vk::CommandBufferBeginInfo(vk::CommandBufferUsageFlagBits::eOneTimeSubmit));
            commands.copyBuffer(*slot.written.handle, *slot.given.handle,
                                vk::BufferCopy(0, 0, given.size()));
            using Stage = vk::PipelineStageFlagBits;
            using Access = vk::AccessFlagBits;
            const vk::MemoryBarrier copied(Access::eTransferWrite, Access::eShaderRead);
            commands.pipelineBarrier(Stage::eTransfer, Stage::eRayTracingShaderKHR, {}, copied, {},
                                     {});
            constexpr auto point = vk::PipelineBindPoint::eRayTracingKHR;
            commands.bindPipeline(point, *pipeline.pipeline);
            commands.bindDescriptorSets(point, *pipeline.layout, 0, slot.set, {});
            commands.pushConstants<RaysPush>(*pipeline.layout, of_rays, 0,
                                             RaysPush{uint32_t(opaque)});
            const auto& regions = pipeline.regions;
            commands.traceRaysKHR(regions[group], regions[group_miss], regions[group_hit], {},
                                  uint32_t(answers.size()), 1, 1);
            // For the host alone: batches of other slots do not wait for this one.
            const vk::MemoryBarrier answered(Access::eShaderWrite, Access::eHostRead);
            commands.pipelineBarrier(Stage::eRayTracingShaderKHR, Stage::eHost, {}, answered, {},
                                     {});
        });
        device.impl().start(slot.commands, slot.done);
        device.impl().wait(slot.done);
        std::memcpy(answers.data(), slot.answers.mapped, answers.size_bytes());
    }

    const Device& device;
    size_t opaque = 0;
    std::vector<uint32_t> order; ///< the structure's triangles; empty: as they came
    Pipeline pipeline;
    std::optional<Buffer::Impl> facts;
    std::optional<Structure> parts, tree;
    vk::raii::DescriptorPool sets{nullptr};
    std::vector<std::unique_ptr<Slot>> all;
    std::mutex mutex;
    std::condition_variable freed;
    std::vector<Slot*> idle; ///< guarded by `mutex`
};

RayTracer::RayTracer(const Device& device, std::span<const glm::vec3> positions,
                     std::span<const DeviceTriangle> triangles, std::span<const uint32_t> looking,
                     int threads)
    : impl_(checked("building the structure of rays", [&] {
          return std::make_unique<Impl>(device, positions, triangles, looking, threads);
      })) {}
RayTracer::~RayTracer() = default;

RayTracer::Bytes RayTracer::bytes(const DeviceInfo& device, uint64_t triangles, int threads) {
    const auto slots = uint64_t(slots_of(threads));
    return {triangles * device.ray_bytes + slots * given_bytes,
            triangles * device.ray_building_bytes, slots * (given_bytes + answer_bytes)};
}

void RayTracer::nearest(std::span<const DeviceRay> rays, std::span<DeviceHit> hits) const {
    for (size_t first = 0; first < rays.size(); first += batch) {
        const size_t count = std::min(batch, rays.size() - first);
        impl_->run(group_trace, std::as_bytes(rays.subspan(first, count)),
                   hits.subspan(first, count));
    }
    if (!impl_->order.empty())
        for (DeviceHit& hit : hits.first(rays.size()))
            if (hit.triangle < impl_->order.size())
                hit.triangle = impl_->order[hit.triangle];
}

void RayTracer::look(std::span<const std::byte> given, std::span<uint32_t> answers) const {
    impl_->run(group_look, given, answers);
}

} // namespace lpvbake::gpu
