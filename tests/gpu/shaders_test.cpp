// examples/shaders on the device, from 3D textures, against the sampler of src/volume.
#include "device.h"
#include "gpu/read_bricks.comp.h"
#include "gpu/read_bricks.hlsl.h"
#include "gpu/read_fog.comp.h"
#include "gpu/read_fog.hlsl.h"
#include "gpu/read_fog_sh.comp.h"
#include "gpu/read_fog_sh.hlsl.h"
#include "gpu/read_levels.comp.h"
#include "gpu/read_levels.hlsl.h"
#include "gpu/read_volume_bc6h_l1.comp.h"
#include "gpu/read_volume_bc6h_l1.hlsl.h"
#include "gpu/read_volume_bc6h_l2.comp.h"
#include "gpu/read_volume_bc6h_l2.hlsl.h"
#include "gpu/read_volume_l1.comp.h"
#include "gpu/read_volume_l1.hlsl.h"
#include "gpu/read_volume_l2.comp.h"
#include "gpu/read_volume_l2.hlsl.h"
#include "gpu/read_volume_unity.hlsl.h"
#include "gpu/read_volume_unorm8_l1.comp.h"
#include "gpu/read_volume_unorm8_l1.hlsl.h"
#include "gpu/read_volume_unorm8_l2.comp.h"
#include "gpu/read_volume_unorm8_l2.hlsl.h"
#include "gpu/vulkan.h"
#include "io/texel.h"
#include "readers/readers.h"
#include "unit/volumes.h"
#include "volume/convention.h"
#include "volume/levels.h"
#include "volume/sampler.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <array>
#include <numbers>
#include <random>

namespace lpvbake::gpu {
namespace {

using std::numbers::pi;

struct Surface {
    glm::vec4 point;
    glm::vec4 normal;
};

/// What the shaders make of one surface, lux.
struct Irradiances {
    glm::vec4 trilinear_l1, l1, nonlinear, zh3, l2;
};

struct Texture {
    vk::raii::Image image{nullptr};
    gpu::Memory memory;
    vk::raii::ImageView view{nullptr};
};

struct Shader {
    const char* name;
    int order; ///< 2: with walls, too
    bool hlsl;
    std::span<const uint32_t> words;
};
const std::array<Shader, 4> all_shaders{
    Shader{"GLSL of order 1", 1, false, shaders::read_volume_l1_comp},
    Shader{"GLSL of order 2", 2, false, shaders::read_volume_l2_comp},
    Shader{"HLSL of order 1", 1, true, shaders::read_volume_l1_hlsl},
    Shader{"HLSL of order 2", 2, true, shaders::read_volume_l2_hlsl},
};

class ShadersTest : public testing::DeviceTest {
protected:
    template <class T>
    static gpu::Buffer filled(const std::vector<T>& values) {
        gpu::Buffer buffer(device(), values.size() * sizeof(T));
        gpu::upload(device(), buffer, 0, std::as_bytes(std::span(values)));
        return buffer;
    }

    template <class Value>
    static Texture texture(const Grid& grid, const Value& value) {
        std::vector<glm::vec4> texels(grid.size());
        for (std::size_t i = 0; i < texels.size(); ++i)
            texels[i] = value(i);
        return texture(vk::Format::eR32G32B32A32Sfloat, grid.dims, filled(texels));
    }

    static Texture texture(vk::Format format, glm::ivec3 dims, const gpu::Buffer& source) {
        gpu::Device::Impl& d = device().impl();
        const vk::Extent3D extent(uint32_t(dims.x), uint32_t(dims.y), uint32_t(dims.z));
        Texture made;
        made.image = vk::raii::Image(
            d.handle, {{},
                       vk::ImageType::e3D,
                       format,
                       extent,
                       1,
                       1,
                       vk::SampleCountFlagBits::e1,
                       vk::ImageTiling::eOptimal,
                       vk::ImageUsageFlagBits::eSampled | vk::ImageUsageFlagBits::eTransferDst});
        made.memory = d.allocate(made.image.getMemoryRequirements(), gpu::Placement::device);
        made.image.bindMemory(*made.memory.handle(), 0);
        const vk::ImageSubresourceRange range(vk::ImageAspectFlagBits::eColor, 0, 1, 0, 1);
        d.submit_now([&](const vk::raii::CommandBuffer& commands) {
            vk::ImageMemoryBarrier barrier(
                {}, vk::AccessFlagBits::eTransferWrite, vk::ImageLayout::eUndefined,
                vk::ImageLayout::eTransferDstOptimal, VK_QUEUE_FAMILY_IGNORED,
                VK_QUEUE_FAMILY_IGNORED, *made.image, range);
            commands.pipelineBarrier(vk::PipelineStageFlagBits::eTopOfPipe,
                                     vk::PipelineStageFlagBits::eTransfer, {}, {}, {}, barrier);
            commands.copyBufferToImage(
                *source.impl().handle, *made.image, vk::ImageLayout::eTransferDstOptimal,
                vk::BufferImageCopy(0, 0, 0, {vk::ImageAspectFlagBits::eColor, 0, 0, 1}, {},
                                    extent));
            barrier.srcAccessMask = vk::AccessFlagBits::eTransferWrite;
            barrier.dstAccessMask = vk::AccessFlagBits::eShaderRead;
            barrier.oldLayout = vk::ImageLayout::eTransferDstOptimal;
            barrier.newLayout = vk::ImageLayout::eShaderReadOnlyOptimal;
            commands.pipelineBarrier(vk::PipelineStageFlagBits::eTransfer,
                                     vk::PipelineStageFlagBits::eComputeShader, {}, {}, {},
                                     barrier);
        });
        made.view = vk::raii::ImageView(
            d.handle, {{}, *made.image, vk::ImageViewType::e3D, format, {}, range});
        return made;
    }

    /// As the file has it, in its own form.
    static Texture texture_of_dds(const std::string& path) {
        const std::string bytes = slurp(path);
        const auto word = [&](std::size_t i) { return io::number_at<uint32_t>(bytes, 4 * i); };
        const io::TexelForm* form = io::form_numbered(&io::TexelForm::dxgi, word(32));
        const std::vector<char> texels(bytes.begin() + 148, bytes.end());
        return texture(vk::Format(form->vulkan), {word(4), word(3), word(6)}, filled(texels));
    }

    static std::vector<Irradiances> run(const Shader& shader, const Volume& volume,
                                        const std::vector<Surface>& surfaces) {
        std::vector<Texture> textures; // the coefficients, the validity, the walls
        for (int k = 0; k < volume::sh_count(shader.order); ++k)
            textures.push_back(texture(volume.grid, [&](std::size_t i) {
                return glm::vec4(volume.sh[std::size_t(k)][i], 1.0f);
            }));
        textures.push_back(
            texture(volume.grid, [&](std::size_t i) { return glm::vec4(volume.validity[i]); }));
        for (std::size_t k = 0; k < 3; ++k)
            textures.push_back(texture(volume.grid, [&](std::size_t i) {
                return volume.walls.empty() ? glm::vec4(0.0f) : glm::vec4(volume.walls[k][i], 0.0f);
            }));
        return run(shader, volume.grid, textures, surfaces);
    }

    /// The last four textures are the validity and the walls. Of light over its mean there are
    /// the ranges, all `low` before all `high`; the base is another's texture where it has none.
    static std::vector<Irradiances> run(const Shader& shader, const Grid& grid,
                                        const std::vector<Texture>& textures,
                                        const std::vector<Surface>& surfaces,
                                        const std::vector<glm::vec4>& ranges = {{}},
                                        const Texture* base = nullptr) {
        struct Push {
            glm::vec3 origin;
            float cell;
            uint32_t count;
        } const push{glm::vec3(grid.origin), float(grid.cell), uint32_t(surfaces.size())};
        return run(shader, push, textures, surfaces, ranges, base);
    }

    template <class Push>
    static std::vector<Irradiances>
    run(const Shader& shader, const Push& push, const std::vector<Texture>& textures,
        const std::vector<Surface>& surfaces, const std::vector<glm::vec4>& ranges,
        const Texture* base = nullptr) {
        gpu::Device::Impl& d = device().impl();
        const auto coefficients = uint32_t(textures.size() - 4);
        const gpu::Buffer low_high = filled(ranges);
        const vk::raii::Sampler sampler(d.handle, {{},
                                                   vk::Filter::eLinear,
                                                   vk::Filter::eLinear,
                                                   vk::SamplerMipmapMode::eNearest,
                                                   vk::SamplerAddressMode::eClampToEdge,
                                                   vk::SamplerAddressMode::eClampToEdge,
                                                   vk::SamplerAddressMode::eClampToEdge});
        const gpu::Buffer source = filled(surfaces);
        const gpu::Buffer target = filled(std::vector<Irradiances>(surfaces.size()));

        const vk::DescriptorType image = shader.hlsl ? vk::DescriptorType::eSampledImage
                                                     : vk::DescriptorType::eCombinedImageSampler;
        const auto stage = vk::ShaderStageFlagBits::eCompute;
        const std::array bindings{
            vk::DescriptorSetLayoutBinding(0, image, coefficients, stage),
            vk::DescriptorSetLayoutBinding(1, image, 1, stage),
            vk::DescriptorSetLayoutBinding(2, vk::DescriptorType::eSampler, 1, stage),
            vk::DescriptorSetLayoutBinding(3, vk::DescriptorType::eStorageBuffer, 1, stage),
            vk::DescriptorSetLayoutBinding(4, vk::DescriptorType::eStorageBuffer, 1, stage),
            vk::DescriptorSetLayoutBinding(5, image, 3, stage),
            vk::DescriptorSetLayoutBinding(6, vk::DescriptorType::eUniformBuffer, 1, stage),
            vk::DescriptorSetLayoutBinding(7, image, 1, stage)};
        const vk::raii::DescriptorSetLayout set_layout(d.handle, {{}, bindings});
        const vk::PushConstantRange pushed(stage, 0, sizeof push);
        const vk::raii::PipelineLayout layout(d.handle, {{}, *set_layout, pushed});
        const vk::raii::ShaderModule module(d.handle,
                                            {{}, shader.words.size_bytes(), shader.words.data()});
        const vk::raii::Pipeline pipeline(d.handle, nullptr,
                                          {{}, {{}, stage, *module, "main"}, *layout});
        const std::array sizes{vk::DescriptorPoolSize(image, coefficients + 5),
                               vk::DescriptorPoolSize(vk::DescriptorType::eUniformBuffer, 1),
                               vk::DescriptorPoolSize(vk::DescriptorType::eSampler, 1),
                               vk::DescriptorPoolSize(vk::DescriptorType::eStorageBuffer, 2)};
        const vk::raii::DescriptorPool pool(
            d.handle, {vk::DescriptorPoolCreateFlagBits::eFreeDescriptorSet, 1, sizes});
        const vk::raii::DescriptorSets sets(d.handle, {*pool, *set_layout});
        std::vector<vk::DescriptorImageInfo> images;
        for (const Texture& each : textures)
            images.emplace_back(*sampler, *each.view, vk::ImageLayout::eShaderReadOnlyOptimal);
        const vk::DescriptorImageInfo sampling(*sampler);
        const vk::DescriptorImageInfo over(*sampler, *(base ? *base : textures.front()).view,
                                           vk::ImageLayout::eShaderReadOnlyOptimal);
        const vk::DescriptorBufferInfo bounds(*low_high.impl().handle, 0, low_high.bytes());
        const vk::DescriptorBufferInfo in(*source.impl().handle, 0, source.bytes());
        const vk::DescriptorBufferInfo out(*target.impl().handle, 0, target.bytes());
        const vk::DescriptorSet set = *sets.front();
        const auto storage = vk::DescriptorType::eStorageBuffer;
        d.handle.updateDescriptorSets(
            std::array{
                vk::WriteDescriptorSet(set, 0, 0, coefficients, image, images.data()),
                vk::WriteDescriptorSet(set, 1, 0, 1, image, &images[coefficients]),
                vk::WriteDescriptorSet(set, 2, 0, 1, vk::DescriptorType::eSampler, &sampling),
                vk::WriteDescriptorSet(set, 3, 0, 1, storage, nullptr, &in),
                vk::WriteDescriptorSet(set, 4, 0, 1, storage, nullptr, &out),
                vk::WriteDescriptorSet(set, 5, 0, 3, image, &images[coefficients + 1]),
                vk::WriteDescriptorSet(set, 6, 0, 1, vk::DescriptorType::eUniformBuffer, nullptr,
                                       &bounds),
                vk::WriteDescriptorSet(set, 7, 0, 1, image, &over)},
            {});
        d.submit_now([&](const vk::raii::CommandBuffer& commands) {
            commands.bindPipeline(vk::PipelineBindPoint::eCompute, *pipeline);
            commands.bindDescriptorSets(vk::PipelineBindPoint::eCompute, *layout, 0, set, {});
            commands.pushConstants<Push>(*layout, stage, 0, push);
            commands.dispatch(uint32_t(surfaces.size() + 63) / 64, 1, 1);
            gpu::full_barrier(commands);
        });
        std::vector<Irradiances> result(surfaces.size());
        gpu::download(device(), target, 0, std::as_writable_bytes(std::span(result)));
        return result;
    }
};

std::vector<Surface> random_surfaces(const Grid& grid, std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> share(-0.1f, 1.1f); // beyond the edges, too
    std::normal_distribution<float> normal;
    std::vector<Surface> surfaces(count);
    for (Surface& surface : surfaces) {
        const glm::vec3 p(share(random), share(random), share(random));
        const glm::vec3 n(normal(random), normal(random), normal(random));
        surface.point =
            glm::vec4(glm::vec3(grid.origin) + float(grid.cell) * glm::vec3(grid.dims) * p, 0);
        surface.normal = glm::vec4(glm::normalize(n), 0);
    }
    return surfaces;
}

Volume of_order(Volume volume, int order) {
    volume.sh_order = order;
    volume.sh.resize(std::size_t(volume::sh_count(order)));
    return volume;
}

/// The non-linear form by its definition: mean irradiance and the share that comes from one side.
double nonlinear(double mean, glm::dvec3 slope, glm::dvec3 n) {
    if (mean <= 0)
        return 0;
    const double r = std::min(1.0, glm::length(slope) / (2 * mean));
    const double q = r > 0 ? (1 + glm::dot(glm::normalize(slope), n)) / 2 : 0.5;
    const double p = 1 + 2 * r, low = (1 - r) / (1 + r);
    return mean * (low + (1 - low) * (p + 1) * std::pow(q, p));
}

TEST_F(ShadersTest, ReadWhatTheSamplerReads) {
    Volume volume = random_volume({7, 5, 6}, 2, false, 5);
    volume.walls.clear(); // the shaders know none
    // A block of cells without light, so that the nearest of more than eight counts.
    glm::ivec3 c;
    for (c.z = 1; c.z < 5; ++c.z)
        for (c.y = 0; c.y < 4; ++c.y)
            for (c.x = 3; c.x < 7; ++c.x)
                volume.validity[volume.grid.index(c)] = 0;
    Volume first = of_order(volume, 1);
    // Walls in some cells, near enough to leave none of the eight now and then.
    std::mt19937 random(7);
    std::normal_distribution<float> way(0, 0.6f);
    volume.walls.assign(3, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0)));
    for (auto& wall : volume.walls)
        for (glm::vec3& w : wall)
            if (random() % 2 == 0)
                w = glm::vec3(way(random), way(random), way(random));
    const std::vector<Surface> surfaces = random_surfaces(volume.grid, 5000, 6);
    const double filtering = device().is_cpu() ? 0.05 : 50; // GPUs weight by 1/256
    for (const Shader& shader : all_shaders) {
        SCOPED_TRACE(shader.name);
        const std::vector<Irradiances> found = run(shader, volume, surfaces);
        const Volume& held = shader.order == 1 ? first : volume; // with walls, or without
        int dark = 0, walled = 0, bent_otherwise = 0;
        for (std::size_t i = 0; i < surfaces.size(); ++i) {
            const glm::dvec3 p(surfaces[i].point), n(surfaces[i].normal);
            const auto expect = [&](glm::dvec3 expected, glm::vec4 got, double tolerance) {
                for (int axis = 0; axis < 3; ++axis)
                    ASSERT_NEAR(expected[axis], got[axis], tolerance) << i << ' ' << axis;
            };
            const volume::CellWeights weights = volume::weights_at(held, p, n, Reading::facing);
            walled += weights.weight != volume::weights_at(first, p, n, Reading::facing).weight;
            const glm::dvec3 facing = read_irradiance(first, p, n, Reading::facing);
            dark += facing == glm::dvec3(0);
            if (shader.order == 1)
                expect(facing, found[i].l1, 0.05);
            expect(read_irradiance(first, p, n, Reading::trilinear), found[i].trilinear_l1,
                   filtering);
            if (shader.order == 2)
                expect(read_irradiance(volume, p, n, Reading::facing), found[i].l2, 0.05);
            glm::dvec3 sum[4]{};
            for (std::size_t k = 0; k < 4; ++k)
                for (std::size_t w = 0; w < 8; ++w)
                    sum[k] += weights.weight[w] * glm::dvec3(volume.sh[k][weights.cell[w]]);
            glm::dvec3 bent;
            for (int axis = 0; axis < 3; ++axis)
                bent[axis] = nonlinear(
                    std::sqrt(pi) / 2 * sum[0][axis],
                    std::sqrt(pi / 3) * glm::dvec3(sum[3][axis], sum[1][axis], sum[2][axis]), n);
            expect(bent, found[i].nonlinear, 0.2);
            std::array<glm::vec3, 4> mixed;
            std::ranges::copy(sum, mixed.begin());
            const auto model = [&](readers::Evaluation evaluation) {
                return glm::max(readers::evaluate(evaluation, mixed, n), 0.0);
            };
            expect(model(readers::Evaluation::geomerics), found[i].nonlinear, 0.2);
            if (glm::all(glm::greaterThan(glm::abs(sum[0]), glm::dvec3(200)))) { // it divides by it
                expect(model(readers::Evaluation::zh3), found[i].zh3, 0.5);
                const double apart =
                    glm::distance(glm::dvec3(found[i].zh3), glm::dvec3(found[i].nonlinear));
                bent_otherwise += apart > 10;
            }
            if (HasFatalFailure())
                return;
        }
        EXPECT_LT(dark, int(surfaces.size()) / 2); // else this would compare nothing with nothing
        EXPECT_GT(bent_otherwise, int(surfaces.size()) / 4);
        EXPECT_EQ(walled > int(surfaces.size()) / 10, shader.order == 2);
    }
}

/// Light of one sign: the mean rises, all else is a part of it.
Volume bright_volume(glm::ivec3 dims, int order) {
    Volume volume = random_volume(dims, order, false, 5);
    volume.walls.resize(3, std::vector<glm::vec3>(volume.grid.size()));
    volume.validity.assign(volume.grid.size(), 1.0f);
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const glm::vec3 at = glm::vec3(volume.grid.cell_at(i)) / glm::vec3(dims);
        volume.sh[0][i] = 1000.0f * glm::vec3(1 + at.x, 1.5f + at.x * at.y, 0.5f + at.z);
        for (std::size_t k = 1; k < volume.sh.size(); ++k)
            volume.sh[k][i] =
                volume.sh[0][i] * glm::sin(3 * at.x + 2 * at.y + 4 * at.z + float(k) + at);
    }
    return volume;
}

/// What a texture unit makes of it at a point: the mean and all that is over it, each by itself.
glm::dvec3 filtered_irradiance(const Volume& volume, glm::dvec3 p, glm::dvec3 n) {
    const volume::CellWeights weights = volume::weights_at(volume, p, n, Reading::trilinear);
    std::array<glm::dvec3, 4> sum{};
    for (std::size_t w = 0; w < 8; ++w)
        for (std::size_t k = 0; k < 4; ++k) {
            const glm::dvec3 mean(volume.sh[0][weights.cell[w]]);
            const glm::dvec3 value(volume.sh[k][weights.cell[w]]);
            sum[k] += weights.weight[w] * (k == 0 ? mean : value / mean);
        }
    return sum[0]
           * (std::sqrt(pi) / 2 + std::sqrt(pi / 3) * (sum[1] * n.y + sum[2] * n.z + sum[3] * n.x));
}

TEST_F(ShadersTest, UnpackWhatIsReadOfTheFiles) {
    struct Packed {
        Shader shader;
        Precision precision;
    };
    const Packed all[] = {
        {{"GLSL, unorm8, order 1", 1, false, shaders::read_volume_unorm8_l1_comp},
         Precision::unorm8},
        {{"GLSL, unorm8, order 2", 2, false, shaders::read_volume_unorm8_l2_comp},
         Precision::unorm8},
        {{"HLSL, unorm8, order 1", 1, true, shaders::read_volume_unorm8_l1_hlsl},
         Precision::unorm8},
        {{"HLSL, unorm8, order 2", 2, true, shaders::read_volume_unorm8_l2_hlsl},
         Precision::unorm8},
        {{"GLSL, bc6h, order 1", 1, false, shaders::read_volume_bc6h_l1_comp}, Precision::bc6h},
        {{"GLSL, bc6h, order 2", 2, false, shaders::read_volume_bc6h_l2_comp}, Precision::bc6h},
        {{"HLSL, bc6h, order 1", 1, true, shaders::read_volume_bc6h_l1_hlsl}, Precision::bc6h},
        {{"HLSL, bc6h, order 2", 2, true, shaders::read_volume_bc6h_l2_hlsl}, Precision::bc6h}};
    const TemporaryFolder folder;
    for (const auto& [shader, precision] : all) {
        SCOPED_TRACE(shader.name);
        const std::string path = folder / "volume.dds";
        write_volume(path, bright_volume({10, 7, 5}, shader.order), "generic", precision);
        const Volume held = read_volume(path);
        std::vector<Texture> light, walls, base;
        std::vector<glm::vec4> low, high;
        const auto description = nlohmann::json::parse(slurp(folder / "volume.dds.json"));
        for (const nlohmann::json& entry : description.at("files")) {
            const std::string name = entry.at("file");
            Texture made = texture_of_dds(folder / name);
            if (entry.contains("low")) {
                light.push_back(std::move(made));
                low.emplace_back();
                high.emplace_back();
                for (glm::length_t c = 0; c < glm::length_t(entry["low"].size()); ++c) {
                    low.back()[c] = entry["low"][std::size_t(c)];
                    high.back()[c] = entry["high"][std::size_t(c)];
                }
            } else {
                (name == "volume_base.dds" ? base : walls).push_back(std::move(made));
            }
        }
        ASSERT_EQ(walls.size(), 4U); // and the validity
        ASSERT_EQ(base.size(), precision == Precision::bc6h ? 1U : 0U);
        std::ranges::move(walls, std::back_inserter(light));
        low.insert(low.end(), high.begin(), high.end());
        const std::vector<Surface> surfaces = random_surfaces(held.grid, 2000, 6);
        const std::vector<Irradiances> found =
            run(shader, held.grid, light, surfaces, low, base.empty() ? nullptr : base.data());
        double brightest = 0;
        for (std::size_t i = 0; i < surfaces.size(); ++i) {
            const glm::dvec3 p(surfaces[i].point), n(surfaces[i].normal);
            const glm::dvec3 facing = read_irradiance(held, p, n, Reading::facing);
            const glm::dvec3 got(shader.order == 1 ? found[i].l1 : found[i].l2);
            const glm::dvec3 trilinear = glm::max(filtered_irradiance(held, p, n), 0.0);
            for (int axis = 0; axis < 3; ++axis) {
                ASSERT_NEAR(facing[axis], got[axis], 0.5) << i << ' ' << axis;
                // Units filter 8 bits, and blocks' base is not their mean.
                ASSERT_NEAR(trilinear[axis], found[i].trilinear_l1[axis], 60) << i << ' ' << axis;
            }
            brightest = std::max(brightest, facing.y);
        }
        EXPECT_GT(brightest, 4000);
    }
}

// What examples/unity shows, in Unity's axes, of textures that stand as those of --target unity.
TEST_F(ShadersTest, UnitysShaderReadsTheTargetsTextures) {
    const Volume volume = random_volume({7, 5, 6}, 2, false, 5);
    const Volume first = of_order(volume, 1);
    const glm::dmat3 turn = volume::from_gltf(volume::Axes::unity);
    const double filtering = device().is_cpu() ? 0.05 : 50;
    for (const Volume* held : {&first, &volume}) {
        Volume stored = *held;
        volume::turn_axes(turn, stored);
        volume::encode(volume::ShConvention::unity, stored.sh_order, stored.sh);
        stored.sh.resize(9, std::vector<glm::vec3>(stored.grid.size(), glm::vec3(NAN)));
        std::vector<Texture> textures;
        const auto add = [&](std::array<std::size_t, 4> order) {
            for (int colour = 0; colour < 3; ++colour)
                textures.push_back(texture(stored.grid, [&](std::size_t i) {
                    return glm::vec4(stored.sh[order[0]][i][colour], stored.sh[order[1]][i][colour],
                                     stored.sh[order[2]][i][colour],
                                     stored.sh[order[3]][i][colour]);
                }));
        };
        add({3, 1, 2, 0});
        add({4, 5, 6, 7});
        for (int unused = 0; unused < 5; ++unused) // after x2y2, of which there is one
            textures.push_back(texture(
                stored.grid, [&](std::size_t i) { return glm::vec4(stored.sh[8][i], 1.0f); }));
        const std::vector<Surface> surfaces = random_surfaces(stored.grid, 2000, 6);
        const std::vector<Irradiances> found = run(
            {"Unity", 2, true, shaders::read_volume_unity_hlsl}, stored.grid, textures, surfaces);
        int lit = 0;
        for (std::size_t i = 0; i < surfaces.size(); ++i) {
            const glm::dvec3 p(surfaces[i].point), n(surfaces[i].normal);
            const glm::dvec3 expected =
                0.5 / pi
                * read_irradiance(*held, glm::transpose(turn) * p, glm::transpose(turn) * n,
                                  Reading::trilinear);
            const glm::dvec3 got(held->sh_order == 1 ? found[i].trilinear_l1 : found[i].l1);
            for (int axis = 0; axis < 3; ++axis)
                ASSERT_NEAR(expected[axis], got[axis], filtering) << i << ' ' << axis;
            lit += expected.y > 100 * filtering;
        }
        EXPECT_GT(lit, int(surfaces.size()) / 3);
    }
}

/// Air by its cells, as shaders take it, and rays through it.
struct Air {
    Grid grid{{-1.0, 0.5, 2.0}, 0.25, {8, 5, 6}, {1, 0, 0, 0}};
    std::vector<glm::vec3> scatter, extinction;
    std::vector<std::vector<glm::vec3>> scattered;
};

/// Rays from in and around the grid, some of which end in it; `steps` of each.
std::vector<Surface> view_rays(const Grid& grid, std::size_t count, float steps) {
    std::vector<Surface> rays = random_surfaces(grid, count, 11);
    std::mt19937 random(12);
    std::uniform_real_distribution<float> end(0.0f, 3.0f);
    for (std::size_t i = 0; i < count; ++i) {
        if (i % 3 == 0) // from far away, to its middle
            rays[i].point = glm::vec4(
                glm::vec3(grid.center(grid.dims / 2)) - 5.0f * glm::vec3(rays[i].normal), 0.0f);
        if (i % 7 == 0)
            rays[i].normal = glm::vec4(0, i % 2 == 0 ? 1 : -1, 0, 0);
        rays[i].point.w = i % 2 == 0 ? 100.0f : end(random);
        rays[i].normal.w = steps;
    }
    return rays;
}

/// Where a ray is in a box, from x to y; x >= y: nowhere.
glm::dvec2 part_in(glm::dvec3 lo, glm::dvec3 hi, const Surface& ray) {
    glm::dvec2 part(0.0, ray.point.w);
    for (int axis = 0; axis < 3; ++axis) {
        const double from = lo[axis] - double(ray.point[axis]);
        const double to = hi[axis] - double(ray.point[axis]), along = ray.normal[axis];
        if (along == 0 && (from > 0 || to < 0))
            return {0.0, 0.0};
        if (along == 0)
            continue;
        part.x = std::max(part.x, std::min(from / along, to / along));
        part.y = std::min(part.y, std::max(from / along, to / along));
    }
    return part;
}

struct FogShader {
    Shader shader;
    bool directed; ///< reads scattered_l0, ...
};
const std::array<FogShader, 4> fog_shaders{
    FogShader{{"GLSL", 1, false, shaders::read_fog_comp}, false},
    FogShader{{"HLSL", 1, true, shaders::read_fog_hlsl}, false},
    FogShader{{"GLSL by direction", 2, false, shaders::read_fog_sh_comp}, true},
    FogShader{{"HLSL by direction", 2, true, shaders::read_fog_sh_hlsl}, true}};

class FogShadersTest : public ShadersTest {
protected:
    static std::vector<Irradiances> march(const FogShader& fog, const Air& air,
                                          const std::vector<Surface>& rays) {
        std::vector<Texture> textures;
        const auto add = [&](const std::vector<glm::vec3>& cells) {
            textures.push_back(
                texture(air.grid, [&](std::size_t i) { return glm::vec4(cells[i], 1.0f); }));
        };
        for (int k = 0; k < volume::sh_count(fog.shader.order); ++k)
            add(fog.directed ? air.scattered[std::size_t(k)] : air.extinction);
        add(air.extinction); // in the validity's place, which is not read
        add(air.scatter);
        add(air.extinction);
        add(air.extinction);
        return run(fog.shader, air.grid, textures, rays);
    }
};

// Light that is added: S (1 - e^(-s L)) / s over the way L through even air, in any number of
// steps.
TEST_F(FogShadersTest, EvenAirIsExactInAnyNumberOfSteps) {
    const glm::dvec3 scatter(3, 0.5, 2), extinction(0.8, 0, 1e-4);
    Air air;
    air.scatter.assign(air.grid.size(), glm::vec3(scatter));
    air.extinction.assign(air.grid.size(), glm::vec3(extinction));
    const glm::dvec3 lo = air.grid.origin, hi = lo + air.grid.cell * glm::dvec3(air.grid.dims);
    for (const FogShader& fog : fog_shaders) {
        SCOPED_TRACE(fog.shader.name);
        // The same from everywhere but for band 1 along +y, by which one looks.
        air.scattered.assign(9, std::vector<glm::vec3>(air.grid.size(), glm::vec3(0)));
        air.scattered[0].assign(air.grid.size(), glm::vec3(scatter / 0.28209479177387814));
        air.scattered[1].assign(air.grid.size(), glm::vec3(0.2 * scatter / 0.4886025119029199));
        for (const float steps : {1.0f, 3.0f, 50.0f}) {
            const std::vector<Surface> rays = view_rays(air.grid, 1000, steps);
            const std::vector<Irradiances> found = march(fog, air, rays);
            int missed = 0;
            for (std::size_t i = 0; i < rays.size(); ++i) {
                const glm::dvec2 part = part_in(lo, hi, rays[i]);
                const double way = std::max(0.0, part.y - part.x);
                missed += way == 0;
                const double directed = fog.directed ? 1 + 0.2 * double(rays[i].normal.y) : 1;
                for (int c = 0; c < 3; ++c) {
                    const double lost = extinction[c] * way;
                    const double light = directed * scatter[c]
                                         * (lost > 0 ? -std::expm1(-lost) / extinction[c] : way);
                    ASSERT_NEAR(found[i].trilinear_l1[c], light, 2e-5 * (1 + light)) << i;
                    ASSERT_NEAR(found[i].l1[c], std::exp(-lost), 2e-5) << i;
                }
            }
            EXPECT_GT(missed, 50);
            EXPECT_LT(missed, 600);
        }
    }
}

TEST_F(FogShadersTest, UnevenAirIsAsACpuMarchesIt) {
    Air air;
    air.scattered.resize(9);
    for (std::size_t i = 0; i < air.grid.size(); ++i) {
        const glm::vec3 p(air.grid.center(air.grid.cell_at(i)));
        air.scatter.push_back(2.0f + glm::sin(3.0f * p + p.y));
        air.extinction.push_back(0.7f * (1.0f + glm::cos(2.0f * p.z + p)));
        for (std::size_t k = 0; k < 9; ++k)
            air.scattered[k].push_back((k == 0 ? 3.0f : 0.3f) * air.scatter.back()
                                       * (1.0f + 0.3f * glm::sin(float(k) + p)));
    }
    Volume lattice; // to interpolate by
    lattice.grid = air.grid;
    lattice.validity.assign(air.grid.size(), 1.0f);
    lattice.sh_order = 0;
    lattice.sh.assign(1, air.scatter);
    const glm::dvec3 lo = air.grid.origin, hi = lo + air.grid.cell * glm::dvec3(air.grid.dims);
    const double filtering = device().is_cpu() ? 1e-3 : 0.02;
    const std::vector<Surface> rays = view_rays(air.grid, 200, 200);
    for (const FogShader& fog : fog_shaders) {
        SCOPED_TRACE(fog.shader.name);
        const std::vector<Irradiances> found = march(fog, air, rays);
        for (std::size_t i = 0; i < rays.size(); ++i) {
            const glm::dvec2 part = part_in(lo, hi, rays[i]);
            const glm::dvec3 view(rays[i].normal);
            const volume::ShValues y = volume::sh_basis(2, glm::vec3(view));
            glm::dvec3 light(0), left(1);
            constexpr int steps = 2000;
            const double step = std::max(0.0, part.y - part.x) / steps;
            for (int s = 0; step > 0 && s < steps; ++s) {
                const glm::dvec3 p = glm::dvec3(rays[i].point) + (part.x + (s + 0.5) * step) * view;
                const volume::CellWeights weights =
                    volume::weights_at(lattice, p, {0, 1, 0}, Reading::trilinear);
                glm::dvec3 scatter(0), lost(0);
                for (std::size_t w = 0; w < 8; ++w) {
                    const std::size_t cell = weights.cell[w];
                    const double weight = weights.weight[w];
                    lost += weight * glm::dvec3(air.extinction[cell]);
                    for (std::size_t k = 0; fog.directed && k < 9; ++k)
                        scatter += weight * double(y[k]) * glm::dvec3(air.scattered[k][cell]);
                    if (!fog.directed)
                        scatter += weight * glm::dvec3(air.scatter[cell]);
                }
                light += step * left * glm::exp(-0.5 * step * lost) * glm::max(scatter, 0.0);
                left *= glm::exp(-step * lost);
            }
            for (int c = 0; c < 3; ++c) {
                ASSERT_NEAR(found[i].trilinear_l1[c], light[c], filtering * (1 + light[c])) << i;
                ASSERT_NEAR(found[i].l1[c], left[c], filtering) << i;
            }
        }
    }
}

// Levels of an affine field, and of random light and walls: what the library reads.
TEST_F(ShadersTest, NestedLevelsAreReadAsTheLibraryReadsThem) {
    struct Level { // as LpvLevel
        glm::vec3 origin;
        float cell;
        glm::ivec3 dims;
        int slice;
        glm::vec3 lo;
        float unused;
        glm::vec3 hi;
        float fade;
    };
    const std::vector<volume::LevelBox> boxes{{{0, 0, 1}, {1, 1, 2}, 0.25},
                                              {{-1, 0, 0}, {3, 2, 3}, 0.5}};
    std::mt19937 random(9);
    std::uniform_real_distribution<float> share;
    volume::VolumeSet affine, walled;
    for (const Grid& grid : volume::nest_grids(boxes)) {
        Volume level;
        level.grid = grid;
        level.sh_order = 1;
        level.sh.resize(4);
        for (std::size_t i = 0; i < grid.size(); ++i) {
            const glm::vec3 p(grid.center(grid.cell_at(i)));
            for (std::size_t k = 0; k < 4; ++k)
                level.sh[k].push_back(glm::vec3(k == 0 ? 10.0f : 1.0f)
                                      + glm::vec3(0.3f, 0.2f, 0.1f) * (p.x + 2.0f * p.y - p.z));
        }
        level.validity.assign(grid.size(), 1.0f);
        level.walls.assign(3, std::vector<glm::vec3>(grid.size(), glm::vec3(0)));
        affine.levels.push_back(level);
        for (std::size_t i = 0; i < grid.size(); ++i) {
            level.validity[i] = float(random() % 3 != 0);
            level.sh[0][i] = glm::vec3(5.0f + share(random));
            level.walls[0][i] = glm::vec3(share(random) - 0.5f, share(random), share(random));
        }
        walled.levels.push_back(level);
    }
    const Grid& outer = affine.levels[1].grid;
    std::vector<Surface> surfaces = random_surfaces(outer, 4000, 11);
    const std::vector<Surface> inner = random_surfaces(affine.levels[0].grid, 4000, 12);
    surfaces.insert(surfaces.end(), inner.begin(), inner.end());
    const auto level = [&](const Grid& grid, int slice, float fade) {
        Level one{glm::vec3(grid.origin),
                  float(grid.cell),
                  grid.dims,
                  slice,
                  glm::vec3(grid.center({0, 0, 0})),
                  0,
                  glm::vec3(grid.center(grid.dims - 1)),
                  fade};
        one.lo.y = -1e30f; // the floor is that of both
        return one;
    };
    const Grid& own = affine.levels[0].grid;
    const std::array levels{level(own, 0, 0.5f), level(outer, own.dims.z, 0)};
    // One after the other along z.
    Grid both = outer;
    both.dims = glm::max(own.dims, outer.dims);
    both.dims.z = own.dims.z + outer.dims.z;
    const auto stacked = [&](const volume::VolumeSet& set, const auto& value) {
        return texture(both, [&](std::size_t i) {
            glm::ivec3 cell = both.cell_at(i);
            const bool fine = cell.z < own.dims.z;
            cell.z -= fine ? 0 : own.dims.z;
            const Volume& of = set.levels[fine ? 0 : 1];
            return glm::all(glm::lessThan(cell, of.grid.dims)) ? value(of, of.grid.index(cell))
                                                               : glm::vec4(1e9f);
        });
    };
    const auto textures_of = [&](const volume::VolumeSet& set) {
        std::vector<Texture> textures;
        for (std::size_t k = 0; k < 4; ++k)
            textures.push_back(stacked(set, [k](const Volume& of, std::size_t i) {
                return glm::vec4(of.sh[k][i], 1.0f);
            }));
        textures.push_back(stacked(
            set, [](const Volume& of, std::size_t i) { return glm::vec4(of.validity[i]); }));
        for (std::size_t k = 0; k < 3; ++k)
            textures.push_back(stacked(set, [k](const Volume& of, std::size_t i) {
                return glm::vec4(of.walls[k][i], 0.0f);
            }));
        return textures;
    };
    const std::array shaders{
        Shader{"GLSL of levels", 1, false, shaders::read_levels_comp},
        Shader{"HLSL of levels", 1, true, shaders::read_levels_hlsl},
    };
    const readers::Reader& reader = *readers::reader_named("lpvbake");
    for (const Shader& shader : shaders)
        for (const volume::VolumeSet* set : {&affine, &walled}) {
            SCOPED_TRACE(shader.name);
            const std::vector<Irradiances> found =
                run(shader, levels, textures_of(*set), surfaces, {{}});
            int blended = 0, coarse = 0;
            for (std::size_t i = 0; i < surfaces.size(); ++i) {
                const glm::dvec3 p(surfaces[i].point), n(surfaces[i].normal);
                const glm::dvec3 expected = readers::irradiance(reader, *set, p, n);
                for (int axis = 0; axis < 3; ++axis)
                    ASSERT_NEAR(expected[axis], found[i].l1[axis], 2e-3) << i;
                const double of_fine = volume::share_of(*set, 0, p);
                blended += of_fine > 0.01 && of_fine < 0.99;
                coarse += of_fine == 0;
            }
            EXPECT_GT(blended, 1000);
            EXPECT_GT(coarse, 1000);
        }
}

TEST_F(ShadersTest, BricksAreReadFromTheirAtlas) {
    const volume::BrickLevels levels = volume::brick_levels(0.25, 1, {-3, 0.5, 7}, {5, 8.5, 23});
    std::vector<volume::Brick> places{{2, {0, 0, 0}}, {2, {0, 0, 1}}};
    for (int i = 0; i < 8; ++i)
        places.push_back({1, {i & 1, i >> 1 & 1, i >> 2}});
    for (const int z : {0, 1})
        for (const int y : {0, 1})
            places.push_back({1, {0, y, 2 + z}});
    places.push_back({0, {0, 0, 0}});
    places.push_back({0, {1, 2, 1}});
    volume::VolumeSet set;
    set.bricks.emplace(levels, places);
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    for (const volume::Brick& brick : set.bricks->bricks()) {
        Volume& own = set.levels.emplace_back(random_volume(glm::ivec3(9), 1, false, random()));
        own.grid = levels.grid_of(brick);
        own.walls.resize(3, std::vector<glm::vec3>(own.grid.size(), glm::vec3(0)));
        for (std::size_t i = 0; i < own.grid.size(); ++i) {
            own.validity[i] = random() % 10 != 0;
            for (auto& c : own.sh)
                c[i] = glm::vec3(normal(random), normal(random), normal(random));
        }
        for (auto& c : own.sh[0])
            c += glm::vec3(5);
    }
    volume::stitch(*set.bricks, set.levels);
    const Volume atlas = volume::stacked(set.levels);
    std::vector<Texture> textures;
    for (std::size_t k = 0; k < 4; ++k)
        textures.push_back(
            texture(atlas.grid, [&](std::size_t i) { return glm::vec4(atlas.sh[k][i], 1.0f); }));
    textures.push_back(
        texture(atlas.grid, [&](std::size_t i) { return glm::vec4(atlas.validity[i]); }));
    for (std::size_t k = 0; k < 3; ++k)
        textures.push_back(
            texture(atlas.grid, [&](std::size_t i) { return glm::vec4(atlas.walls[k][i], 0.0f); }));
    const volume::BrickStack stack(set.levels.size());
    const Texture index = texture(Grid{{}, 1, levels.places(0)}, [&](std::size_t i) {
        const uint32_t brick = set.bricks->finest()[i];
        return glm::vec4(stack.first(brick), 1 << set.bricks->bricks()[brick].level);
    });
    Grid box = levels.finest;
    std::vector<Surface> surfaces = random_surfaces(box, 8000, 8);
    struct {
        glm::vec3 lo;
        float cell;
    } const push{glm::vec3(box.center({0, 0, 0})), float(box.cell)};
    const readers::Reader trilinear{.name = "trilinear", .clamped = true};
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    for (const Shader& shader : {Shader{"GLSL of bricks", 1, false, shaders::read_bricks_comp},
                                 Shader{"HLSL of bricks", 1, true, shaders::read_bricks_hlsl}}) {
        SCOPED_TRACE(shader.name);
        const std::vector<Irradiances> found = run(shader, push, textures, surfaces, {{}}, &index);
        std::array<int, 3> met{};
        double coarser = 0; // what the brick around would show instead
        for (std::size_t i = 0; i < surfaces.size(); ++i) {
            const glm::dvec3 p(surfaces[i].point), n(surfaces[i].normal);
            const glm::dvec3 plain = readers::irradiance(trilinear, set, p, n);
            const std::size_t brick = set.bricks->at(p);
            const glm::dvec3 faced = readers::irradiance(facing, set.levels[brick], p, n);
            const double filtering = device().is_cpu() ? 2e-3 : 0.5; // GPUs weight by 1/256
            for (int axis = 0; axis < 3; ++axis) {
                ASSERT_NEAR(found[i].trilinear_l1[axis], plain[axis], filtering) << i;
                ASSERT_NEAR(found[i].l1[axis], faced[axis], 2e-3) << i;
            }
            ++met[std::size_t(set.bricks->bricks()[brick].level)];
            if (const auto up = set.bricks->parent(brick))
                coarser = std::max(
                    coarser,
                    std::abs(readers::irradiance(trilinear, set.levels[*up], p, n).x - plain.x));
        }
        EXPECT_GT(*std::ranges::min_element(met), 100);
        EXPECT_GT(coarser, 1.0);
    }
}

// Light from everywhere, from one point, and between: mean and extremes in closed form.
TEST_F(ShadersTest, NonlinearKeepsTheMeanAndStaysAboveZero) {
    const glm::dvec3 axis = glm::normalize(glm::dvec3(1, -2, 0.5));
    const glm::dvec3 u = glm::normalize(glm::cross(axis, glm::dvec3(0, 0, 1)));
    const std::array ratios{0.0, 0.3, 0.5, 0.8, 1.0, 1.7}; // 1: all light from one point
    // A cell for each; at its centre normals at midpoints in the cosine with the axis, around it,
    // and then along it both ways.
    Volume volume;
    volume.grid = {glm::dvec3(0), 1.0, {int(ratios.size()), 1, 1}};
    volume.sh_order = 2;
    volume.sh.assign(9, std::vector<glm::vec3>(ratios.size(), glm::vec3(0)));
    volume.validity.assign(ratios.size(), 1);
    constexpr int heights = 200, turns = 8, normals = heights * turns + 2;
    std::vector<Surface> surfaces;
    for (std::size_t cell = 0; cell < ratios.size(); ++cell) {
        const double c1 = std::sqrt(3.0) * ratios[cell]; // where c0 = 1
        volume.sh[0][cell] = glm::vec3(1);
        volume.sh[1][cell] = glm::vec3(c1 * axis.y);
        volume.sh[2][cell] = glm::vec3(c1 * axis.z);
        volume.sh[3][cell] = glm::vec3(c1 * axis.x);
        const auto add = [&](glm::dvec3 n) {
            surfaces.push_back({glm::vec4(float(cell) + 0.5f, 0.5f, 0.5f, 0), glm::vec4(n, 0)});
        };
        for (int i = 0; i < heights; ++i)
            for (int j = 0; j < turns; ++j) {
                const double z = (i + 0.5) * 2 / heights - 1, phi = 2 * pi * j / turns;
                add(z * axis
                    + std::sqrt(1 - z * z)
                          * (std::cos(phi) * u + std::sin(phi) * glm::cross(axis, u)));
            }
        add(axis);
        add(-axis);
    }
    for (const Shader& shader : all_shaders) {
        const std::vector<Irradiances> found = run(shader, volume, surfaces);
        for (std::size_t cell = 0; cell < ratios.size(); ++cell) {
            SCOPED_TRACE(std::string(shader.name) + ", " + std::to_string(ratios[cell]));
            const Irradiances* here = &found[cell * normals];
            const double mean = std::sqrt(pi) / 2, r = std::min(ratios[cell], 1.0);
            double sum = 0;
            for (int i = 0; i < heights * turns; ++i) {
                EXPECT_GE(here[i].nonlinear.x, 0);
                sum += double(here[i].nonlinear.x);
            }
            EXPECT_NEAR(sum / (heights * turns), mean, 1e-4);
            EXPECT_NEAR(here[normals - 2].nonlinear.y, mean * (1 + 3 * r + 4 * r * r) / (1 + r),
                        1e-4);
            EXPECT_NEAR(here[normals - 1].nonlinear.z, mean * (1 - r) / (1 + r), 1e-4);
        }
    }
}

} // namespace
} // namespace lpvbake::gpu
