#include "raster/raster.h"

#include "gpu/vulkan.h"
#include "raster/mips.h"
#include "raster/push.h"
#include "raster/rsm.frag.h"
#include "raster/rsm.vert.h"
#include "scene/material.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

namespace lpvbake::raster {

namespace {

// Of vertices, at a time. Lavapipe takes as much again while it draws them.
constexpr uint64_t chunk_bytes = 256ull << 20, cpu_chunk_bytes = 24ull << 20;
constexpr vk::Format texel_format = vk::Format::eR32G32B32A32Uint;
constexpr vk::Format depth_format = vk::Format::eD32Sfloat;
constexpr vk::Format texture_format = vk::Format::eR8G8B8A8Srgb;

using raster::Push;

struct GpuImage {
    vk::raii::Image handle{nullptr};
    gpu::Memory memory;
    vk::raii::ImageView view{nullptr};
};

GpuImage make_image(gpu::Device::Impl& device, vk::Format format, vk::Extent2D size,
                    uint32_t levels, vk::ImageUsageFlags usage, vk::ImageAspectFlags aspect) {
    GpuImage image;
    image.handle =
        vk::raii::Image(device.handle, vk::ImageCreateInfo({}, vk::ImageType::e2D, format,
                                                           vk::Extent3D(size.width, size.height, 1),
                                                           levels, 1, vk::SampleCountFlagBits::e1,
                                                           vk::ImageTiling::eOptimal, usage));
    image.memory = device.allocate(image.handle.getMemoryRequirements(), gpu::Placement::device);
    image.handle.bindMemory(*image.memory.handle(), 0);
    image.view = vk::raii::ImageView(
        device.handle, vk::ImageViewCreateInfo({}, *image.handle, vk::ImageViewType::e2D, format,
                                               {}, {aspect, 0, levels, 0, 1}));
    return image;
}

void change_layout(const vk::raii::CommandBuffer& commands, const GpuImage& image,
                   vk::ImageLayout from, vk::ImageLayout to) {
    const vk::ImageMemoryBarrier barrier(
        vk::AccessFlagBits::eMemoryWrite,
        vk::AccessFlagBits::eMemoryRead | vk::AccessFlagBits::eMemoryWrite, from, to,
        VK_QUEUE_FAMILY_IGNORED, VK_QUEUE_FAMILY_IGNORED, *image.handle,
        {vk::ImageAspectFlagBits::eColor, 0, VK_REMAINING_MIP_LEVELS, 0, 1});
    commands.pipelineBarrier(vk::PipelineStageFlagBits::eAllCommands,
                             vk::PipelineStageFlagBits::eAllCommands, {}, {}, {}, barrier);
}

/// Uploads all levels, packing as much as fits into each trip through the staging buffer.
GpuImage upload_texture(gpu::Device::Impl& device, const std::vector<Image>& levels) {
    GpuImage image =
        make_image(device, texture_format, vk::Extent2D(levels[0].width, levels[0].height),
                   uint32_t(levels.size()),
                   vk::ImageUsageFlagBits::eSampled | vk::ImageUsageFlagBits::eTransferDst,
                   vk::ImageAspectFlagBits::eColor);
    const gpu::Buffer::Impl& staging = device.staging_buffer();
    std::vector<vk::BufferImageCopy> copies;
    uint64_t used = 0;
    auto layout = vk::ImageLayout::eUndefined;
    const auto flush = [&](bool last) {
        device.submit_now([&](const vk::raii::CommandBuffer& commands) {
            change_layout(commands, image, layout, vk::ImageLayout::eTransferDstOptimal);
            commands.copyBufferToImage(*staging.handle, *image.handle,
                                       vk::ImageLayout::eTransferDstOptimal, copies);
            if (last)
                change_layout(commands, image, vk::ImageLayout::eTransferDstOptimal,
                              vk::ImageLayout::eShaderReadOnlyOptimal);
        });
        layout = vk::ImageLayout::eTransferDstOptimal;
        copies.clear();
        used = 0;
    };
    for (uint32_t level = 0; level < levels.size(); ++level) {
        const Image& texels = levels[level];
        const uint64_t row_bytes = uint64_t(texels.width) * 4;
        for (int row = 0; row < texels.height;) {
            const int rows = int(std::min<uint64_t>(uint64_t(texels.height - row),
                                                    (gpu::staging_bytes - used) / row_bytes));
            if (rows == 0) {
                flush(false);
                continue;
            }
            std::memcpy(staging.mapped + used, &texels.rgba[uint64_t(row) * row_bytes],
                        rows * row_bytes);
            copies.emplace_back(
                used, 0, 0,
                vk::ImageSubresourceLayers(vk::ImageAspectFlagBits::eColor, level, 0, 1),
                vk::Offset3D(0, row, 0), vk::Extent3D(texels.width, uint32_t(rows), 1));
            used += uint64_t(rows) * row_bytes;
            row += rows;
        }
    }
    flush(true);
    return image;
}

vk::SamplerAddressMode address_mode(Wrap wrap) {
    switch (wrap) {
    case Wrap::mirrored_repeat:
        return vk::SamplerAddressMode::eMirroredRepeat;
    case Wrap::clamp_to_edge:
        return vk::SamplerAddressMode::eClampToEdge;
    case Wrap::repeat:
        break;
    }
    return vk::SamplerAddressMode::eRepeat;
}

/// The number of levels to leave out of each image so that none exceeds what the device can hold
/// and all of them together take at most `budget` bytes; the largest give way first.
std::vector<int> levels_to_drop(const Scene& scene, const std::map<std::pair<int, bool>, int>& uses,
                                uint64_t budget, uint32_t max_edge) {
    std::vector<int> drop(scene.images.size(), 0);
    const auto texels = [&](int image) {
        return uint64_t(std::max(scene.images[image].width >> drop[image], 1))
               * uint64_t(std::max(scene.images[image].height >> drop[image], 1));
    };
    for (;;) {
        uint64_t bytes = 0;
        int largest = -1;
        for (const auto& [key, _] : uses) {
            const int image = key.first;
            while (uint32_t(std::max(scene.images[image].width, scene.images[image].height)
                            >> drop[image])
                   > max_edge)
                ++drop[image];
            bytes += texels(image) * 4 * 4 / 3;
            if (largest < 0 || texels(image) > texels(largest))
                largest = image;
        }
        if (largest < 0 || bytes <= budget || texels(largest) == 1)
            return drop;
        ++drop[largest];
    }
}

} // namespace

struct Raster::Impl {
    Impl(const gpu::Device& on, const Scene& scene, const scene::Frame& frame,
         bool (*is_there)(Role));

    void make_textures(const Scene& scene);
    void make_passes();
    const vk::raii::Pipeline& pipeline(bool textured, bool see_through);
    void make_targets(int edge);
    void draw(const scene::RsmView& view, const Tile& tile, bool cull);

    const gpu::Device& shared;
    gpu::Device::Impl& device;
    MaterialRules rules;
    std::vector<Material> materials;
    RsmGeometry geometry;

    gpu::Buffer vertices;         ///< one chunk
    uint64_t chunk_vertices = 0;  ///< at most, a multiple of three
    uint64_t loaded = UINT64_MAX; ///< first vertex of the chunk in `vertices`

    std::vector<GpuImage> images;
    std::vector<vk::raii::Sampler> samplers;
    vk::raii::DescriptorSetLayout set_layout{nullptr};
    vk::raii::DescriptorPool sets{nullptr};
    std::vector<vk::DescriptorSet> set_of_material;
    vk::raii::PipelineLayout layout{nullptr};
    std::array<vk::raii::RenderPass, 2> passes{nullptr, nullptr}; ///< that clears, that goes on
    std::array<vk::raii::Pipeline, 4> pipelines{nullptr, nullptr, nullptr, nullptr};

    int target_edge = 0;
    GpuImage seen, nearest; ///< texels, depths
    vk::raii::Framebuffer framebuffer{nullptr};
    std::optional<gpu::Buffer::Impl> readback;
};

Raster::Impl::Impl(const gpu::Device& on, const Scene& scene, const scene::Frame& frame,
                   bool (*is_there)(Role))
    : shared(on),
      device(on.impl()),
      rules(scene.rules),
      materials(scene.materials),
      geometry(flatten(scene, frame, is_there)) {
    const uint64_t most = on.is_cpu() ? cpu_chunk_bytes : chunk_bytes;
    chunk_vertices =
        std::clamp<uint64_t>(geometry.vertices.size(), 3, most / sizeof(RsmVertex) / 3 * 3);
    vertices = gpu::Buffer(shared, chunk_vertices * sizeof(RsmVertex));
    gpu::checked("preparing to draw the scene", [&] {
        make_textures(scene);
        make_passes();
    });
}

void Raster::Impl::make_textures(const Scene& scene) {
    // An image is held once a way of averaging: colours weighted by alpha, or not.
    std::map<std::pair<int, bool>, int> image_of; ///< to `images`
    const auto key_of = [&](const Material& material) {
        return std::pair(scene.textures[material.base_color_texture].image,
                         material.alpha_mode != AlphaMode::opaque);
    };
    for (const MaterialRun& run : geometry.runs)
        if (materials[run.material].base_color_texture >= 0)
            image_of.emplace(key_of(materials[run.material]), 0);
    const std::vector<int> drop =
        levels_to_drop(scene, image_of, device.info.memory / 4, device.limits.maxImageDimension2D);

    Image white;
    white.width = white.height = 1;
    white.rgba.assign(4, 255);
    images.push_back(upload_texture(device, {white}));
    for (auto& [key, index] : image_of) {
        index = int(images.size());
        images.push_back(upload_texture(
            device, mip_levels(scene.images[key.first], drop[key.first], key.second)));
    }

    const vk::DescriptorSetLayoutBinding binding(0, vk::DescriptorType::eCombinedImageSampler, 1,
                                                 vk::ShaderStageFlagBits::eFragment);
    set_layout = vk::raii::DescriptorSetLayout(device.handle,
                                               vk::DescriptorSetLayoutCreateInfo({}, binding));
    const uint32_t count = uint32_t(geometry.runs.size()) + 1;
    const vk::DescriptorPoolSize pool_size(vk::DescriptorType::eCombinedImageSampler, count);
    sets =
        vk::raii::DescriptorPool(device.handle, vk::DescriptorPoolCreateInfo({}, count, pool_size));
    std::map<std::pair<int, int>, vk::DescriptorSet> set_of; ///< image and texture (its sampler)
    set_of_material.resize(materials.size());
    for (const MaterialRun& run : geometry.runs) {
        const Material& material = materials[run.material];
        const bool textured = material.base_color_texture >= 0;
        const int image = textured ? image_of.at(key_of(material)) : 0;
        const auto [found, is_new] =
            set_of.try_emplace({image, material.base_color_texture}, vk::DescriptorSet());
        if (is_new) {
            const Texture texture =
                textured ? scene.textures[material.base_color_texture] : Texture();
            const auto filter = texture.nearest ? vk::Filter::eNearest : vk::Filter::eLinear;
            samplers.emplace_back(
                device.handle,
                vk::SamplerCreateInfo({}, filter, filter, vk::SamplerMipmapMode::eNearest,
                                      address_mode(texture.wrap_u), address_mode(texture.wrap_v),
                                      vk::SamplerAddressMode::eRepeat, 0, VK_FALSE, 1, VK_FALSE,
                                      vk::CompareOp::eNever, 0, VK_LOD_CLAMP_NONE));
            const vk::DescriptorSetLayout raw = *set_layout;
            found->second = (*device.handle)
                                .allocateDescriptorSets(vk::DescriptorSetAllocateInfo(*sets, raw),
                                                        *device.handle.getDispatcher())
                                .front();
            const vk::DescriptorImageInfo info(*samplers.back(), *images[image].view,
                                               vk::ImageLayout::eShaderReadOnlyOptimal);
            device.handle.updateDescriptorSets(
                vk::WriteDescriptorSet(found->second, 0, 0,
                                       vk::DescriptorType::eCombinedImageSampler, info),
                {});
        }
        set_of_material[run.material] = found->second;
    }
}

void Raster::Impl::make_passes() {
    for (const bool first : {true, false}) {
        const auto load = first ? vk::AttachmentLoadOp::eClear : vk::AttachmentLoadOp::eLoad;
        const auto before = [&](vk::ImageLayout kept) {
            return first ? vk::ImageLayout::eUndefined : kept;
        };
        constexpr auto ignored_load = vk::AttachmentLoadOp::eDontCare;
        constexpr auto ignored_store = vk::AttachmentStoreOp::eDontCare;
        const std::array attachments{
            vk::AttachmentDescription({}, texel_format, vk::SampleCountFlagBits::e1, load,
                                      vk::AttachmentStoreOp::eStore, ignored_load, ignored_store,
                                      before(vk::ImageLayout::eTransferSrcOptimal),
                                      vk::ImageLayout::eTransferSrcOptimal),
            vk::AttachmentDescription({}, depth_format, vk::SampleCountFlagBits::e1, load,
                                      vk::AttachmentStoreOp::eStore, ignored_load, ignored_store,
                                      before(vk::ImageLayout::eDepthStencilAttachmentOptimal),
                                      vk::ImageLayout::eDepthStencilAttachmentOptimal)};
        const vk::AttachmentReference color_slot(0, vk::ImageLayout::eColorAttachmentOptimal);
        const vk::AttachmentReference depth_slot(1,
                                                 vk::ImageLayout::eDepthStencilAttachmentOptimal);
        const vk::SubpassDescription subpass({}, vk::PipelineBindPoint::eGraphics, {}, color_slot,
                                             {}, &depth_slot);
        using Stage = vk::PipelineStageFlagBits;
        using Access = vk::AccessFlagBits;
        constexpr auto drawing =
            Stage::eColorAttachmentOutput | Stage::eEarlyFragmentTests | Stage::eLateFragmentTests;
        constexpr auto writes =
            Access::eColorAttachmentWrite | Access::eDepthStencilAttachmentWrite;
        constexpr auto reads = Access::eColorAttachmentRead | Access::eDepthStencilAttachmentRead;
        const std::array dependencies{
            vk::SubpassDependency(VK_SUBPASS_EXTERNAL, 0, drawing | Stage::eTransfer, drawing,
                                  writes | Access::eTransferRead, writes | reads),
            vk::SubpassDependency(0, VK_SUBPASS_EXTERNAL, drawing, drawing | Stage::eTransfer,
                                  writes, writes | reads | Access::eTransferRead)};
        passes[first ? 0 : 1] = vk::raii::RenderPass(
            device.handle, vk::RenderPassCreateInfo({}, attachments, subpass, dependencies));
    }
    const vk::PushConstantRange push(
        vk::ShaderStageFlagBits::eVertex | vk::ShaderStageFlagBits::eFragment, 0, sizeof(Push));
    layout = vk::raii::PipelineLayout(device.handle,
                                      vk::PipelineLayoutCreateInfo({}, *set_layout, push));
}

/// Compiled when first needed: many scenes have neither textures nor anything to see through.
const vk::raii::Pipeline& Raster::Impl::pipeline(bool textured, bool see_through) {
    vk::raii::Pipeline& made = pipelines[2 * textured + see_through];
    if (*made)
        return made;
    const auto module = [&](std::span<const uint32_t> words) {
        return vk::raii::ShaderModule(
            device.handle, vk::ShaderModuleCreateInfo({}, words.size_bytes(), words.data()));
    };
    const auto vertex_shader = module(shaders::rsm_vert),
               fragment_shader = module(shaders::rsm_frag);
    const std::array<VkBool32, 2> constants{textured, see_through};
    const std::array entries{vk::SpecializationMapEntry(0, 0, sizeof(VkBool32)),
                             vk::SpecializationMapEntry(1, sizeof(VkBool32), sizeof(VkBool32))};
    const vk::SpecializationInfo specialization(uint32_t(entries.size()), entries.data(),
                                                sizeof constants, constants.data());
    const std::array stages{
        vk::PipelineShaderStageCreateInfo({}, vk::ShaderStageFlagBits::eVertex, *vertex_shader,
                                          "main"),
        vk::PipelineShaderStageCreateInfo({}, vk::ShaderStageFlagBits::eFragment, *fragment_shader,
                                          "main", &specialization)};
    const vk::VertexInputBindingDescription stream(0, sizeof(RsmVertex));
    const std::array attributes{
        vk::VertexInputAttributeDescription(0, 0, vk::Format::eR32G32B32Sfloat,
                                            offsetof(RsmVertex, position)),
        vk::VertexInputAttributeDescription(1, 0, vk::Format::eR32G32B32A32Sfloat,
                                            offsetof(RsmVertex, plane)),
        vk::VertexInputAttributeDescription(2, 0, vk::Format::eR32G32Sfloat,
                                            offsetof(RsmVertex, uv)),
        vk::VertexInputAttributeDescription(3, 0, vk::Format::eR32G32B32A32Sfloat,
                                            offsetof(RsmVertex, color))};
    const vk::PipelineVertexInputStateCreateInfo input({}, stream, attributes);
    const vk::PipelineInputAssemblyStateCreateInfo assembly({},
                                                            vk::PrimitiveTopology::eTriangleList);
    const vk::PipelineViewportStateCreateInfo viewport({}, 1, nullptr, 1, nullptr);
    const vk::PipelineRasterizationStateCreateInfo raster(
        {}, VK_FALSE, VK_FALSE, vk::PolygonMode::eFill, vk::CullModeFlagBits::eNone,
        vk::FrontFace::eCounterClockwise, VK_FALSE, 0, 0, 0, 1);
    const vk::PipelineMultisampleStateCreateInfo samples;
    const vk::PipelineDepthStencilStateCreateInfo depth_test({}, VK_TRUE, VK_TRUE,
                                                             vk::CompareOp::eGreater);
    using Component = vk::ColorComponentFlagBits;
    vk::PipelineColorBlendAttachmentState write;
    write.colorWriteMask = Component::eR | Component::eG | Component::eB | Component::eA;
    const vk::PipelineColorBlendStateCreateInfo blend({}, VK_FALSE, vk::LogicOp::eCopy, write);
    const std::array dynamic{vk::DynamicState::eViewport, vk::DynamicState::eScissor};
    const vk::PipelineDynamicStateCreateInfo dynamics({}, dynamic);
    made = vk::raii::Pipeline(device.handle, nullptr,
                              vk::GraphicsPipelineCreateInfo({}, stages, &input, &assembly, nullptr,
                                                             &viewport, &raster, &samples,
                                                             &depth_test, &blend, &dynamics,
                                                             *layout, *passes[0], 0));
    return made;
}

void Raster::Impl::make_targets(int edge) {
    if (edge <= target_edge)
        return;
    target_edge = 0;
    framebuffer = nullptr;
    readback.reset();
    const vk::Extent2D size(edge, edge);
    seen =
        make_image(device, texel_format, size, 1,
                   vk::ImageUsageFlagBits::eColorAttachment | vk::ImageUsageFlagBits::eTransferSrc,
                   vk::ImageAspectFlagBits::eColor);
    nearest =
        make_image(device, depth_format, size, 1, vk::ImageUsageFlagBits::eDepthStencilAttachment,
                   vk::ImageAspectFlagBits::eDepth);
    const std::array views{*seen.view, *nearest.view};
    framebuffer =
        vk::raii::Framebuffer(device.handle, vk::FramebufferCreateInfo({}, *passes[0], views,
                                                                       size.width, size.height, 1));
    readback.emplace(device, uint64_t(edge) * edge * sizeof(RasterTexel), gpu::Placement::host);
    target_edge = edge;
}

void Raster::Impl::draw(const scene::RsmView& view, const Tile& tile, bool cull) {
    const glm::ivec2 extent = tile.extent;
    make_targets(std::max(extent.x, extent.y));
    // The tile's part of the map is stretched to fill clip space.
    glm::dmat4 rows = glm::transpose(view.clip());
    for (int axis = 0; axis < 2; ++axis) {
        const double share = double(extent[axis]) / tile.size[axis];
        const double middle = (2 * tile.corner[axis] + extent[axis]) / tile.size[axis] - 1;
        rows[axis] = (rows[axis] - middle * rows[3]) / share;
    }
    Push push{};
    push.clip = glm::mat4(glm::transpose(rows));
    push.origin = glm::vec4(view.origin, 0);
    push.light = view.perspective ? glm::vec4(view.origin, 1) : glm::vec4(-view.axis, 0);
    push.max_albedo = rules.max_albedo;
    push.seed = tile.seed;
    push.shift = tile.shift;

    const vk::Extent2D area(extent.x, extent.y);
    for (uint64_t chunk = 0; chunk < geometry.vertices.size(); chunk += chunk_vertices) {
        const uint64_t chunk_end =
            std::min<uint64_t>(chunk + chunk_vertices, geometry.vertices.size());
        if (loaded != chunk) {
            gpu::upload(
                shared, vertices, 0,
                std::as_bytes(std::span(geometry.vertices).subspan(chunk, chunk_end - chunk)));
            loaded = chunk;
        }
        device.submit_now([&](const vk::raii::CommandBuffer& commands) {
            const std::array<vk::ClearValue, 2> clears{
                vk::ClearColorValue(std::array<uint32_t, 4>{}), vk::ClearDepthStencilValue(0, 0)};
            commands.beginRenderPass(vk::RenderPassBeginInfo(*passes[chunk == 0 ? 0 : 1],
                                                             *framebuffer, vk::Rect2D({0, 0}, area),
                                                             clears),
                                     vk::SubpassContents::eInline);
            commands.setViewport(0, vk::Viewport(0, 0, float(extent.x), float(extent.y), 0, 1));
            commands.setScissor(0, vk::Rect2D({0, 0}, area));
            commands.bindVertexBuffers(0, *vertices.impl().handle, vk::DeviceSize(0));
            for (const MaterialRun& run : geometry.runs) {
                const uint64_t first = std::max(run.first, chunk);
                const uint64_t last = std::min(run.first + run.count, chunk_end);
                if (first >= last)
                    continue;
                const Material& material = materials[run.material];
                push.cutoff = material.alpha_cutoff;
                push.dense = 1.0f - material.transmission;
                push.flags = (material.alpha_mode == AlphaMode::mask ? raster::flag_mask : 0u)
                             | (material.alpha_mode == AlphaMode::blend ? raster::flag_blend : 0u)
                             | (material.double_sided ? raster::flag_double_sided : 0u)
                             | (cull ? raster::flag_cull : 0u);
                commands.bindPipeline(
                    vk::PipelineBindPoint::eGraphics,
                    *pipeline(material.base_color_texture >= 0, scene::is_partly_clear(material)));
                commands.bindDescriptorSets(vk::PipelineBindPoint::eGraphics, *layout, 0,
                                            set_of_material[run.material], {});
                commands.pushConstants<Push>(
                    *layout, vk::ShaderStageFlagBits::eVertex | vk::ShaderStageFlagBits::eFragment,
                    0, push);
                commands.draw(uint32_t(last - first), 1, uint32_t(first - chunk),
                              uint32_t(chunk / 3));
            }
            commands.endRenderPass();
            if (chunk_end == geometry.vertices.size())
                commands.copyImageToBuffer(
                    *seen.handle, vk::ImageLayout::eTransferSrcOptimal, *readback->handle,
                    vk::BufferImageCopy(0, 0, 0, {vk::ImageAspectFlagBits::eColor, 0, 0, 1},
                                        {0, 0, 0}, {area.width, area.height, 1}));
        });
    }
}

Raster::Raster(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
               bool (*is_there)(Role))
    : impl_(std::make_unique<Impl>(device, scene, frame, is_there)) {}
Raster::~Raster() = default;

const RsmGeometry& Raster::geometry() const {
    return impl_->geometry;
}

std::span<const RasterTexel> Raster::draw(const scene::RsmView& view, const Tile& tile,
                                          bool cull) const {
    gpu::checked("drawing the scene", [&] { impl_->draw(view, tile, cull); });
    return {reinterpret_cast<const RasterTexel*>(impl_->readback->mapped),
            std::size_t(tile.extent.x) * std::size_t(tile.extent.y)};
}

} // namespace lpvbake::raster
