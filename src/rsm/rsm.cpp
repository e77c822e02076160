#include "rsm/rsm.h"

#include "gpu/vulkan.h"
#include "rsm/geometry.h"
#include "rsm/mips.h"
#include "rsm/rsm.frag.h"
#include "rsm/rsm.vert.h"
#include "rsm/view.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

namespace lpvbake {

namespace {

constexpr int max_tile = 1024;                 ///< texels a side
constexpr uint64_t chunk_bytes = 256ull << 20; ///< of vertices, at a time
constexpr vk::Format texel_format = vk::Format::eR32G32B32A32Uint;
constexpr vk::Format depth_format = vk::Format::eD32Sfloat;
constexpr vk::Format texture_format = vk::Format::eR8G8B8A8Srgb;

/// Mirrors push.glsl.
struct Push {
    glm::mat4 clip;
    glm::vec4 origin;
    glm::vec4 light;
    float max_albedo;
    float cutoff;
    uint32_t flags;
    uint32_t seed;
};
static_assert(sizeof(Push) == 112 && offsetof(Push, origin) == 64 && offsetof(Push, flags) == 104);

enum Flag : uint32_t { flag_mask = 1, flag_blend = 2, flag_double_sided = 4, flag_cull = 8 };

/// What the fragment shader writes.
struct Texel {
    std::array<float, 3> albedo;
    uint32_t triangle; ///< from one; 0: nothing was seen
};

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

struct RsmPass::Impl {
    Impl(const gpu::Device& on, const Scene& scene, const Frame& in);

    void make_textures(const Scene& scene);
    void make_passes();
    const vk::raii::Pipeline& pipeline(bool textured, bool see_through);
    void make_targets(int edge);
    void draw(const RsmView& view, glm::ivec2 corner, glm::ivec2 extent, int size);
    void resolve(const RsmView& view, const Light& light, glm::ivec2 corner, int size,
                 Rsm& rsm) const;

    const gpu::Device& shared;
    gpu::Device::Impl& device;
    Frame frame;
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

RsmPass::Impl::Impl(const gpu::Device& on, const Scene& scene, const Frame& in)
    : shared(on),
      device(on.impl()),
      frame(in),
      rules(scene.rules),
      materials(scene.materials),
      geometry(flatten(scene, in)) {
    chunk_vertices =
        std::min<uint64_t>(geometry.vertices.size(), chunk_bytes / sizeof(RsmVertex) / 3 * 3);
    vertices = gpu::Buffer(shared, chunk_vertices * sizeof(RsmVertex));
    gpu::checked("preparing reflective shadow maps", [&] {
        make_textures(scene);
        make_passes();
    });
}

void RsmPass::Impl::make_textures(const Scene& scene) {
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

void RsmPass::Impl::make_passes() {
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
const vk::raii::Pipeline& RsmPass::Impl::pipeline(bool textured, bool see_through) {
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

void RsmPass::Impl::make_targets(int edge) {
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
    readback.emplace(device, uint64_t(edge) * edge * sizeof(Texel), gpu::Placement::host);
    target_edge = edge;
}

void RsmPass::Impl::draw(const RsmView& view, glm::ivec2 corner, glm::ivec2 extent, int size) {
    make_targets(std::max(extent.x, extent.y));
    // The tile's part of the map is stretched to fill clip space.
    glm::dmat4 rows = glm::transpose(view.clip());
    for (int axis = 0; axis < 2; ++axis) {
        const double share = double(extent[axis]) / size;
        const double middle = double(2 * corner[axis] + extent[axis]) / size - 1;
        rows[axis] = (rows[axis] - middle * rows[3]) / share;
    }
    Push push{};
    push.clip = glm::mat4(glm::transpose(rows));
    push.origin = glm::vec4(view.origin, 0);
    push.light = view.perspective ? glm::vec4(view.origin, 1) : glm::vec4(-view.axis, 0);
    push.max_albedo = rules.max_albedo;
    push.seed = uint32_t(corner.y / max_tile) * 65536u + uint32_t(corner.x / max_tile);

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
                push.flags = (material.alpha_mode == AlphaMode::mask ? flag_mask : 0u)
                             | (material.alpha_mode == AlphaMode::blend ? flag_blend : 0u)
                             | (material.double_sided ? flag_double_sided : 0u)
                             | (rules.cull_backfaces ? flag_cull : 0u);
                commands.bindPipeline(vk::PipelineBindPoint::eGraphics,
                                      *pipeline(material.base_color_texture >= 0,
                                                material.alpha_mode != AlphaMode::opaque));
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

/// Moves a point of a triangle a hair towards the centroid: by a thousandth of the way, at most a
/// hundredth of a cell. A point on an edge may otherwise lie, by rounding, behind the wall that
/// meets its own there, and would light what is behind that wall.
glm::vec3 pulled_inward(const RsmVertex* vertex, glm::dvec3 point) {
    const glm::dvec3 centroid = (glm::dvec3(vertex[0].position) + glm::dvec3(vertex[1].position)
                                 + glm::dvec3(vertex[2].position))
                                / 3.0;
    const glm::dvec3 way = centroid - point;
    return glm::vec3(point + way * std::min(1e-3, 1e-2 / std::max(glm::length(way), 1e-9)));
}

/// From reflectance and triangle to position, normal and power: the texel's ray meets the
/// triangle's plane in double precision.
void RsmPass::Impl::resolve(const RsmView& view, const Light& light, glm::ivec2 corner, int size,
                            Rsm& rsm) const {
    const Texel* texels = reinterpret_cast<const Texel*>(readback->mapped);
    const glm::dvec3 color(light.color);
    const TexelFlux texel_flux(light, frame, view, size);
    tbb::parallel_for(0, rsm.height, [&](int row) {
        for (int column = 0; column < rsm.width; ++column) {
            const std::size_t i = std::size_t(row) * rsm.width + column;
            const Texel& texel = texels[i];
            rsm.position[i] = rsm.normal[i] = rsm.power[i] = glm::vec3(0);
            if (texel.triangle == 0)
                continue;
            const RsmVertex* vertex = &geometry.vertices[3 * uint64_t(texel.triangle - 1)];
            const glm::dvec2 at =
                (glm::dvec2(corner.x + column, corner.y + row) + 0.5) * (2.0 / size) - 1.0;
            const glm::dvec3 aside = at.x * view.u + at.y * view.v;
            const glm::dvec3 start = view.perspective ? view.origin : view.origin + aside;
            const glm::dvec3 along = view.perspective ? view.axis + aside : view.axis;
            const glm::dvec3 normal(vertex->plane);
            const double slope = glm::dot(normal, along);
            // Seen edge-on the plane may be met far away: the triangle's own depths are the limit.
            glm::dvec3 depths;
            for (int k = 0; k < 3; ++k)
                depths[k] = glm::dot(glm::dvec3(vertex[k].position) - view.origin, view.axis);
            const double least = std::max(std::min({depths.x, depths.y, depths.z}), view.nearest);
            const double most = std::max({depths.x, depths.y, depths.z, least});
            const double meets = glm::dot(normal, glm::dvec3(vertex->position) - start) / slope;
            const double depth = slope == 0 ? 0.5 * (least + most) : std::clamp(meets, least, most);
            rsm.position[i] = pulled_inward(vertex, start + depth * along);
            rsm.normal[i] = glm::vec3(slope > 0 ? -normal : normal);
            const glm::dvec3 albedo(texel.albedo[0], texel.albedo[1], texel.albedo[2]);
            if (albedo == glm::dvec3(0))
                continue;
            double flux = texel_flux(corner.x + column, corner.y + row);
            if (view.perspective && light.range > 0) {
                const double ratio = depth * glm::length(along) * frame.unit / light.range;
                flux *= std::clamp(1 - ratio * ratio * ratio * ratio, 0.0, 1.0);
            }
            rsm.power[i] = glm::vec3(flux * color * albedo);
        }
    });
}

RsmPass::RsmPass(const gpu::Device& device, const Scene& scene, const Frame& frame)
    : impl_(std::make_unique<Impl>(device, scene, frame)) {}
RsmPass::~RsmPass() = default;

void RsmPass::render(const Light& light, int size, const std::function<void(const Rsm&)>& consume) {
    Rsm rsm;
    for (const RsmView& view :
         views_of(light, impl_->frame, impl_->geometry.lo, impl_->geometry.hi))
        for (int y = 0; y < size; y += max_tile)
            for (int x = 0; x < size; x += max_tile) {
                rsm.width = std::min(max_tile, size - x);
                rsm.height = std::min(max_tile, size - y);
                rsm.view = view;
                const std::size_t texels = std::size_t(rsm.width) * rsm.height;
                rsm.position.resize(texels);
                rsm.normal.resize(texels);
                rsm.power.resize(texels);
                gpu::checked("rendering a reflective shadow map", [&] {
                    impl_->draw(view, {x, y}, {rsm.width, rsm.height}, size);
                });
                impl_->resolve(view, light, {x, y}, size, rsm);
                consume(rsm);
            }
}

} // namespace lpvbake
