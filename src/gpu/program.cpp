#include "gpu/vulkan.h"

#include <algorithm>
#include <array>

namespace lpvbake::gpu {

namespace {

vk::DescriptorType type_of(Binding binding) {
    return binding == Binding::storage   ? vk::DescriptorType::eStorageBuffer
           : binding == Binding::uniform ? vk::DescriptorType::eUniformBuffer
                                         : vk::DescriptorType::eUniformTexelBuffer;
}

uint64_t texel_bytes(Binding binding) {
    return binding == Binding::texels_rgba32 ? 16 : 4;
}

} // namespace

Program::Program(const Device& device, std::span<const uint32_t> spirv,
                 std::span<const Binding> bindings, uint32_t push_bytes,
                 std::span<const uint32_t> constants)
    : impl_(std::make_unique<Impl>()) {
    const Device::Impl& gpu = device.impl();
    impl_->bindings.assign(bindings.begin(), bindings.end());
    impl_->push_bytes = push_bytes;
    const auto storage = uint32_t(std::ranges::count(bindings, Binding::storage));
    const auto uniform = uint32_t(std::ranges::count(bindings, Binding::uniform));
    if (push_bytes > gpu.limits.maxPushConstantsSize
        || storage > gpu.limits.maxPerStageDescriptorStorageBuffers
        || uniform > gpu.limits.maxPerStageDescriptorUniformBuffers
        || bindings.size() - storage - uniform > gpu.limits.maxPerStageDescriptorSampledImages)
        throw Error(ErrorKind::device, "'" + gpu.info.name + "' cannot bind "
                                           + std::to_string(bindings.size()) + " buffers and "
                                           + std::to_string(push_bytes)
                                           + " bytes of push constants; choose another device");
    checked("compiling a shader", [&] {
        std::vector<vk::DescriptorSetLayoutBinding> layouts;
        for (const Binding binding : bindings)
            layouts.emplace_back(uint32_t(layouts.size()), type_of(binding), 1,
                                 vk::ShaderStageFlagBits::eCompute);
        impl_->set_layout = vk::raii::DescriptorSetLayout(
            gpu.handle, vk::DescriptorSetLayoutCreateInfo({}, layouts));
        const vk::PushConstantRange push(vk::ShaderStageFlagBits::eCompute, 0, push_bytes);
        vk::PipelineLayoutCreateInfo layout({}, *impl_->set_layout);
        if (push_bytes)
            layout.setPushConstantRanges(push);
        impl_->layout = vk::raii::PipelineLayout(gpu.handle, layout);

        std::vector<vk::SpecializationMapEntry> entries;
        for (uint32_t i = 0; i < constants.size(); ++i)
            entries.emplace_back(i, i * uint32_t(sizeof(uint32_t)), sizeof(uint32_t));
        const vk::SpecializationInfo specialization(uint32_t(entries.size()), entries.data(),
                                                    constants.size_bytes(), constants.data());
        const vk::raii::ShaderModule shader(
            gpu.handle, vk::ShaderModuleCreateInfo({}, spirv.size_bytes(), spirv.data()));
        const vk::PipelineShaderStageCreateInfo stage({}, vk::ShaderStageFlagBits::eCompute,
                                                      *shader, "main", &specialization);
        impl_->pipeline = vk::raii::Pipeline(
            gpu.handle, nullptr, vk::ComputePipelineCreateInfo({}, stage, *impl_->layout));
    });
}
Program::Program() = default;
Program::~Program() = default;
Program::Program(Program&&) noexcept = default;
Program& Program::operator=(Program&&) noexcept = default;

struct Batch::Impl {
    static constexpr uint32_t sets_per_pool = 256;
    static constexpr uint32_t buffers_per_set = 8; ///< on average
    static constexpr size_t sets_known = 16;       ///< of them, that are looked through

    /// A set that dispatches to come may use, too.
    struct KnownSet {
        const Program::Impl* program;
        std::vector<Window> windows;
        vk::DescriptorSet set;
    };
    /// Memory that the host writes and the device copies from.
    struct Staging {
        Buffer::Impl buffer;
        uint64_t bytes, used = 0;

        Staging(Device::Impl& device, uint64_t size)
            : buffer(device, size, Placement::host),
              bytes(size) {}
    };

    explicit Impl(Device::Impl& device)
        : gpu(device),
          commands(device.make_commands()),
          done(device.handle, vk::FenceCreateInfo()) {}

    void begin_step() {
        if (running)
            throw Error(ErrorKind::failure, "a batch that runs cannot be recorded");
        if (recording) {
            full_barrier(commands);
        } else {
            sets.clear();
            next_known = 0;
            commands.begin(
                vk::CommandBufferBeginInfo(vk::CommandBufferUsageFlagBits::eOneTimeSubmit));
        }
        recording = true;
    }

    vk::DescriptorSet make_set(const Program::Impl& program) {
        const auto wanted = uint32_t(program.bindings.size());
        const vk::DescriptorSetLayout layout = *program.set_layout;
        for (;; ++pool) {
            if (pool == pools.size()) {
                const uint32_t count = std::max(sets_per_pool * buffers_per_set, wanted);
                const std::array sizes{
                    vk::DescriptorPoolSize(vk::DescriptorType::eStorageBuffer, count),
                    vk::DescriptorPoolSize(vk::DescriptorType::eUniformBuffer, count),
                    vk::DescriptorPoolSize(vk::DescriptorType::eUniformTexelBuffer, count)};
                pools.emplace_back(gpu.handle,
                                   vk::DescriptorPoolCreateInfo({}, sets_per_pool, sizes));
                sets_left = sets_per_pool;
                buffers_left = count;
            }
            if (sets_left > 0 && buffers_left >= wanted) {
                --sets_left;
                buffers_left -= wanted;
                const vk::DescriptorSetAllocateInfo info(*pools[pool], layout);
                return (*gpu.handle)
                    .allocateDescriptorSets(info, *gpu.handle.getDispatcher())
                    .front();
            }
            // Reused pools are as large as new ones.
            sets_left = sets_per_pool;
            buffers_left = sets_per_pool * buffers_per_set;
        }
    }

    /// The set of a program that shows it these windows.
    vk::DescriptorSet set_of(const Program::Impl& program, std::span<const Window> windows) {
        const auto known = std::ranges::find_if(sets, [&](const KnownSet& each) {
            return each.program == &program && std::ranges::equal(each.windows, windows);
        });
        if (known != sets.end())
            return known->set;
        const vk::DescriptorSet set = make_set(program);
        std::vector<vk::DescriptorBufferInfo> buffers(windows.size());
        std::vector<vk::BufferView> shown(windows.size());
        std::vector<vk::WriteDescriptorSet> writes;
        for (uint32_t i = 0; i < windows.size(); ++i) {
            const Window& window = windows[i];
            const Binding binding = program.bindings[i];
            const vk::Buffer buffer = *window.buffer->impl().handle;
            writes.emplace_back(set, i, 0, 1, type_of(binding));
            if (binding == Binding::storage || binding == Binding::uniform) {
                buffers[i] = vk::DescriptorBufferInfo(buffer, window.offset, window.bytes);
                writes.back().pBufferInfo = &buffers[i];
            } else {
                const vk::Format format = binding == Binding::texels_rgba32
                                              ? vk::Format::eR32G32B32A32Sfloat
                                              : vk::Format::eR32Sfloat;
                views.emplace_back(
                    gpu.handle,
                    vk::BufferViewCreateInfo({}, buffer, format, window.offset, window.bytes));
                shown[i] = *views.back();
                writes.back().pTexelBufferView = &shown[i];
            }
        }
        gpu.handle.updateDescriptorSets(writes, {});
        if (sets.size() < sets_known)
            sets.emplace_back();
        KnownSet& kept = sets[next_known++ % sets_known];
        kept = {&program, {windows.begin(), windows.end()}, set};
        return set;
    }

    Device::Impl& gpu;
    vk::raii::CommandBuffer commands;
    vk::raii::Fence done;
    bool recording = false, running = false;
    std::vector<vk::raii::BufferView> views; ///< of the texel buffers in use
    std::vector<vk::raii::DescriptorPool> pools;
    std::size_t pool = 0; ///< the one in use
    uint32_t sets_left = 0;
    uint32_t buffers_left = 0;
    std::vector<KnownSet> sets; ///< the last that were made
    size_t next_known = 0;
    std::vector<Staging> staged;
};

namespace {

void check_window(const Window& window, uint64_t alignment) {
    if (!window.buffer || window.bytes == 0 || window.offset > window.buffer->bytes()
        || window.bytes > window.buffer->bytes() - window.offset || window.offset % alignment)
        throw Error(ErrorKind::failure,
                    "a window of " + std::to_string(window.bytes) + " bytes at "
                        + std::to_string(window.offset) + " does not fit its buffer of "
                        + std::to_string(window.buffer ? window.buffer->bytes() : 0)
                        + " bytes and an alignment of " + std::to_string(alignment));
}

} // namespace

Batch::Batch(const Device& device)
    : impl_(checked("starting a batch", [&] { return std::make_unique<Impl>(device.impl()); })) {}
Batch::~Batch() {
    try {
        wait();
    } catch (const Error&) { // a lost device runs nothing any more
    }
}

void Batch::dispatch(const Program& program, std::span<const Window> windows,
                     std::span<const std::byte> push, Groups groups) {
    const Program::Impl& kernel = program.impl();
    const DeviceInfo& info = impl_->gpu.info;
    if (windows.size() != kernel.bindings.size() || push.size() != kernel.push_bytes)
        throw Error(ErrorKind::failure, "a dispatch with " + std::to_string(windows.size())
                                            + " buffers and " + std::to_string(push.size())
                                            + " bytes of push constants; its program has "
                                            + std::to_string(kernel.bindings.size()) + " and "
                                            + std::to_string(kernel.push_bytes));
    const auto& most = impl_->gpu.limits.maxComputeWorkGroupCount;
    if (groups.x > most[0] || groups.y > most[1] || groups.z > most[2])
        throw Error(ErrorKind::failure,
                    "a dispatch of more groups than '" + info.name + "' allows");
    if (groups.x == 0 || groups.y == 0 || groups.z == 0)
        return;
    for (size_t i = 0; i < windows.size(); ++i) {
        check_window(windows[i], info.window_alignment);
        const Binding binding = kernel.bindings[i];
        const uint64_t limit = binding == Binding::storage ? info.max_storage_range
                               : binding == Binding::uniform
                                   ? max_uniform_bytes
                                   : info.max_texels * texel_bytes(binding);
        if (windows[i].bytes > limit)
            throw Error(ErrorKind::failure, "a window of " + std::to_string(windows[i].bytes)
                                                + " bytes exceeds the " + std::to_string(limit)
                                                + " that '" + info.name + "' allows");
    }
    checked("recording a dispatch", [&] {
        impl_->begin_step();
        const vk::raii::CommandBuffer& commands = impl_->commands;
        commands.bindPipeline(vk::PipelineBindPoint::eCompute, *kernel.pipeline);
        if (!windows.empty()) {
            const vk::DescriptorSet set = impl_->set_of(kernel, windows);
            commands.bindDescriptorSets(vk::PipelineBindPoint::eCompute, *kernel.layout, 0, set,
                                        {});
        }
        if (!push.empty())
            commands.pushConstants<std::byte>(
                *kernel.layout, vk::ShaderStageFlagBits::eCompute, 0,
                vk::ArrayProxy<const std::byte>(uint32_t(push.size()), push.data()));
        commands.dispatch(groups.x, groups.y, groups.z);
    });
}

void Batch::copy(const Window& source, const Window& target) {
    check_window(source, 1);
    check_window(target, 1);
    if (source.bytes != target.bytes)
        throw Error(ErrorKind::failure, "a copy between windows of different sizes");
    checked("recording a copy", [&] {
        impl_->begin_step();
        impl_->commands.copyBuffer(*source.buffer->impl().handle, *target.buffer->impl().handle,
                                   vk::BufferCopy(source.offset, target.offset, source.bytes));
    });
}

std::span<std::byte> Batch::stage(const Buffer& target, uint64_t offset, uint64_t bytes) {
    if (bytes == 0)
        return {};
    check_window({&target, offset, bytes}, 1);
    const Buffer::Impl& buffer = target.impl();
    if (buffer.mapped)
        return {buffer.mapped + offset, bytes};
    return checked("recording a copy", [&] {
        auto room = std::ranges::find_if(impl_->staged, [&](const Impl::Staging& each) {
            return bytes <= each.bytes - each.used;
        });
        if (room == impl_->staged.end())
            room = impl_->staged.emplace(room, impl_->gpu, std::max(staging_bytes, bytes));
        impl_->begin_step();
        impl_->commands.copyBuffer(*room->buffer.handle, *buffer.handle,
                                   vk::BufferCopy(room->used, offset, bytes));
        std::byte* const place = room->buffer.mapped + room->used;
        room->used += bytes;
        return std::span(place, bytes);
    });
}

void Batch::submit() {
    if (!impl_->recording)
        return;
    impl_->recording = false;
    full_barrier(impl_->commands);
    impl_->gpu.start(impl_->commands, impl_->done);
    impl_->running = true;
}

void Batch::wait() {
    if (!impl_->running)
        return;
    impl_->running = false;
    impl_->gpu.wait(impl_->done);
    for (Impl::Staging& staging : impl_->staged)
        staging.used = 0;
    impl_->views.clear();
    for (const vk::raii::DescriptorPool& pool : impl_->pools)
        pool.reset();
    impl_->pool = 0;
    impl_->sets_left = impl_->pools.empty() ? 0 : Impl::sets_per_pool;
    impl_->buffers_left = impl_->sets_left * Impl::buffers_per_set;
}

void Batch::run() {
    submit();
    wait();
}

} // namespace lpvbake::gpu
