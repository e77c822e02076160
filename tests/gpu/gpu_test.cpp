// Buffers, programs and batches, and what they refuse.
#include "gpu/gpu.h"

#include "device.h"
#include "gpu/affine.comp.h"
#include "gpu/texels.comp.h"

#include <array>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace lpvbake::gpu {
namespace {

using Words = std::vector<uint32_t>;

class GpuTest : public testing::DeviceTest {
protected:
    static gpu::Program affine(uint32_t factor) {
        constexpr std::array bindings{gpu::Binding::storage, gpu::Binding::storage};
        return gpu::Program(device(), shaders::affine_comp, bindings, 8,
                            std::array<uint32_t, 2>{64, factor});
    }
    static gpu::Buffer filled(const Words& words) {
        gpu::Buffer buffer(device(), words.size() * 4);
        gpu::upload(device(), buffer, 0, std::as_bytes(std::span(words)));
        return buffer;
    }
    static Words contents(const gpu::Buffer& buffer) {
        Words words(buffer.bytes() / 4);
        gpu::download(device(), buffer, 0, std::as_writable_bytes(std::span(words)));
        return words;
    }
    static gpu::Window all(const gpu::Buffer& buffer) { return {&buffer, 0, buffer.bytes()}; }
    static void add(gpu::Batch& batch, const gpu::Program& program, gpu::Window source,
                    gpu::Window target, uint32_t summand) {
        const std::array<uint32_t, 2> push{uint32_t(target.bytes / 4), summand};
        const std::array windows{source, target};
        batch.dispatch(program, windows, std::as_bytes(std::span(push)),
                       {uint32_t(target.bytes / 4 + 63) / 64, 1, 1});
    }
};

template <class F>
void expect_error(ErrorKind kind, const std::string& part, F&& f) {
    try {
        f();
        ADD_FAILURE() << "no error; expected one with '" << part << "'";
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, kind) << error.what();
        EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    }
}

TEST_F(GpuTest, DevicesAreListedAndSelected) {
    const std::vector<gpu::DeviceInfo> devices = gpu::list_devices();
    ASSERT_FALSE(devices.empty());
    for (std::size_t i = 0; i < devices.size(); ++i) {
        const gpu::DeviceInfo& info = devices[i];
        EXPECT_EQ(info.index, int(i));
        EXPECT_EQ(info.uuid.size(), 36u);
        EXPECT_GT(info.memory, 0u);
        EXPECT_GE(info.max_storage_range, 1u << 27);
        EXPECT_GT(info.window_alignment, 0u);
        EXPECT_EQ(gpu::Device({std::to_string(i)}).info().uuid, info.uuid);
        EXPECT_EQ(gpu::Device({info.uuid}).info().uuid, info.uuid);
    }
    EXPECT_EQ(gpu::Device({devices[0].name.substr(1)}).info().name, devices[0].name);
    expect_error(ErrorKind::device, devices[0].name, [] { gpu::Device({"no such device"}); });
    expect_error(ErrorKind::device, "'99'", [] { gpu::Device({"99"}); });
}

TEST_F(GpuTest, BytesComeBackAsTheyWent) {
    // More than goes through staging at once, and no whole number of words.
    gpu::Buffer buffer(device(), (40u << 20) + 3);
    std::vector<std::byte> data(buffer.bytes());
    for (std::size_t i = 0; i < data.size(); ++i)
        data[i] = std::byte((i * 2654435761u) >> 24);
    gpu::upload(device(), buffer, 0, data);
    std::vector<std::byte> back(data.size());
    gpu::download(device(), buffer, 0, back);
    EXPECT_TRUE(data == back);

    gpu::upload(device(), buffer, 1001, std::span(data).first(5));
    std::vector<std::byte> part(7);
    gpu::download(device(), buffer, 1000, part);
    EXPECT_EQ(part[0], data[1000]);
    EXPECT_EQ(part[1], data[0]);
    EXPECT_EQ(part[5], data[4]);
    EXPECT_EQ(part[6], data[1006]);

    gpu::clear(device(), buffer);
    gpu::download(device(), buffer, 0, back);
    EXPECT_TRUE(back == std::vector<std::byte>(back.size()));
}

TEST_F(GpuTest, CopiesStayInsideTheirBuffer) {
    gpu::Buffer buffer(device(), 64);
    std::vector<std::byte> data(65);
    expect_error(ErrorKind::failure, "64 bytes", [&] { gpu::upload(device(), buffer, 0, data); });
    expect_error(ErrorKind::failure, "64 bytes",
                 [&] { gpu::download(device(), buffer, 64, data); });
    expect_error(ErrorKind::failure, "64 bytes",
                 [&] { gpu::upload(device(), buffer, ~uint64_t(0), std::span(data).first(4)); });
    gpu::Buffer empty(device(), 0);
    gpu::upload(device(), empty, 0, {});
    gpu::clear(device(), empty);
}

TEST_F(GpuTest, ProgramsSeeConstantsPushesAndWindows) {
    Words numbers(1000);
    std::iota(numbers.begin(), numbers.end(), 0u);
    const gpu::Buffer source = filled(numbers), target = filled(Words(1000, 7));
    const gpu::Program triple = affine(3);
    const uint64_t skip = device().info().window_alignment; // bytes
    gpu::Batch batch(device());
    add(batch, triple, {&source, skip, 4 * 100}, {&target, 2 * skip, 4 * 100}, 5);
    batch.run();
    const Words result = contents(target);
    for (uint32_t i = 0; i < 1000; ++i) {
        const uint32_t first = uint32_t(2 * skip / 4);
        const bool inside = i >= first && i < first + 100;
        ASSERT_EQ(result[i], inside ? 3 * (i - first + uint32_t(skip / 4)) + 5 : 7) << i;
    }
}

TEST_F(GpuTest, TexelWindowsAreReadAsFloats) {
    constexpr std::array bindings{gpu::Binding::texels_r32, gpu::Binding::texels_rgba32,
                                  gpu::Binding::storage};
    const gpu::Program sum(device(), shaders::texels_comp, bindings, 0, {});
    const uint64_t skip = device().info().window_alignment;
    std::vector<float> numbers(512);
    std::iota(numbers.begin(), numbers.end(), 0.0f);
    gpu::Buffer source(device(), numbers.size() * 4), target(device(), 16 * 4);
    gpu::upload(device(), source, 0, std::as_bytes(std::span(numbers)));
    gpu::Batch batch(device());
    const std::array windows{gpu::Window{&source, skip, 16 * 4},
                             gpu::Window{&source, 2 * skip, 16 * 16}, all(target)};
    batch.dispatch(sum, windows, {}, {});
    batch.run();
    std::vector<float> result(16);
    gpu::download(device(), target, 0, std::as_writable_bytes(std::span(result)));
    for (int i = 0; i < 16; ++i) {
        const float one = float(skip) / 4 + float(i), first = float(skip) / 2 + 4 * float(i);
        EXPECT_EQ(result[i], 1000 * one + 4 * first + 6) << i;
    }
}

TEST_F(GpuTest, StepsOfABatchRunInOrder) {
    const gpu::Program twice = affine(2), once = affine(1);
    const Words start{1, 2, 3, 4};
    gpu::Buffer a = filled(start), b(device(), 16), c(device(), 16);
    gpu::Batch batch(device());
    for (int round = 0; round < 2; ++round) { // the second with the pools of the first
        gpu::upload(device(), a, 0, std::as_bytes(std::span(start)));
        Words expected = start;
        for (uint32_t step = 0; step < 700; ++step) {
            add(batch, step % 3 ? once : twice, all(a), all(b), step);
            batch.copy(all(b), all(c));
            add(batch, once, all(c), all(a), 1);
            for (uint32_t& word : expected)
                word = (step % 3 ? word : 2 * word) + step + 1;
        }
        EXPECT_EQ(contents(a), start) << "nothing runs before run()";
        batch.run();
        EXPECT_EQ(contents(a), expected);
        batch.run(); // empty
        EXPECT_EQ(contents(a), expected);
    }
}

TEST_F(GpuTest, BatchesRunWhileOthersAreFilled) {
    const gpu::Program once = affine(1), twice = affine(2);
    constexpr size_t words = 4'000'000; // twice as much is more than a piece of staging
    gpu::Buffer sum = filled(Words(words, 1)), before(device(), 4 * words);
    struct Stream {
        gpu::Buffer summands, kept;
        gpu::Batch batch{device()};
    };
    std::array<Stream, 2> streams;
    for (Stream& stream : streams) {
        stream.summands = gpu::Buffer(device(), 4 * words);
        stream.kept = gpu::Buffer(device(), 4 * words);
    }
    Words expected(words, 1);
    for (uint32_t round = 0; round < 6; ++round) {
        Stream& stream = streams[round % 2];
        stream.batch.wait();
        for (size_t part = 0; part < 2; ++part) {
            const std::span<std::byte> bytes =
                stream.batch.stage(stream.summands, part * 2 * words, 2 * words);
            Words own(words / 2);
            std::iota(own.begin(), own.end(), round + uint32_t(part * words / 2));
            std::ranges::copy(std::as_bytes(std::span(own)), bytes.begin());
        }
        std::ranges::fill(stream.batch.stage(stream.kept, 0, 4 * words), std::byte(9));
        // Of the same windows again, and of others between.
        const auto& program = round % 3 ? once : twice;
        add(stream.batch, program, all(stream.summands), all(stream.kept), 3);
        add(stream.batch, once, all(sum), all(before), 1);
        add(stream.batch, program, all(stream.summands), all(stream.kept), 4);
        add(stream.batch, twice, all(before), all(sum), round);
        stream.batch.submit();
        expect_error(ErrorKind::failure, "runs",
                     [&] { add(stream.batch, once, all(sum), all(before), 1); });
        for (uint32_t& word : expected)
            word = 2 * (word + 1) + round;
    }
    for (Stream& stream : streams)
        stream.batch.wait();
    EXPECT_EQ(contents(sum), expected);
    for (uint32_t round : {4u, 5u}) {
        const Words kept = contents(streams[round % 2].kept);
        for (uint32_t i = 0; i < words; i += 1000)
            ASSERT_EQ(kept[i], (round % 3 ? 1 : 2) * (i + round) + 4) << round << " " << i;
    }
}

TEST_F(GpuTest, BatchesRefuseWhatDoesNotFit) {
    const gpu::Program program = affine(1);
    gpu::Buffer buffer(device(), 1024), other(device(), 1024);
    gpu::Batch batch(device());
    const auto run = [&](gpu::Window window) { add(batch, program, window, all(other), 0); };
    expect_error(ErrorKind::failure, "window", [&] { run({&buffer, 0, 1028}); });
    expect_error(ErrorKind::failure, "window", [&] { run({&buffer, 1024, 4}); });
    expect_error(ErrorKind::failure, "window", [&] { run({&buffer, 0, 0}); });
    expect_error(ErrorKind::failure, "window", [&] { run({nullptr, 0, 4}); });
    expect_error(ErrorKind::failure, "alignment", [&] { run({&buffer, 2, 4}); });
    expect_error(ErrorKind::failure, "program has 2 and 8", [&] {
        const std::array windows{all(buffer)};
        batch.dispatch(program, windows, {}, {});
    });
    expect_error(ErrorKind::failure, "different sizes", [&] {
        batch.copy({&buffer, 0, 8}, {&other, 0, 4});
    });
    expect_error(ErrorKind::failure, "more groups", [&] {
        const std::array windows{all(buffer), all(other)};
        const std::array<uint32_t, 2> push{};
        batch.dispatch(program, windows, std::as_bytes(std::span(push)), {~0u, 1, 1});
    });
    const uint64_t range = device().info().max_storage_range;
    if (device().is_cpu() && range < device().info().max_allocation) {
        gpu::Buffer large(device(), range + 4);
        expect_error(ErrorKind::failure, "allows", [&] { run(all(large)); });
    }
    batch.run();
}

TEST_F(GpuTest, MemoryRunsOutWithItsOwnError) {
    expect_error(ErrorKind::memory, "allows", [] { gpu::Buffer(device(), uint64_t(1) << 50); });
    expect_error(ErrorKind::memory, "allows", [] { gpu::Buffer(device(), ~uint64_t(0)); });
    if (!device().is_cpu())
        return; // takes all of a shared device
    const uint64_t size = device().info().memory / 4 + 1;
    for (int round = 0; round < 2; ++round) { // what was freed is there again
        std::vector<gpu::Buffer> buffers;
        expect_error(ErrorKind::memory, "are left", [&] {
            for (int i = 0; i < 5; ++i)
                buffers.emplace_back(device(), size);
        });
        EXPECT_EQ(buffers.size(), 3u);
        buffers[0] = std::move(buffers[2]);
        buffers[1] = gpu::Buffer(device(), size);
    }
}

TEST_F(GpuTest, ValidationMessagesBecomeErrors) {
    gpu::Buffer buffer(device(), 64);
    gpu::Batch batch(device());
    batch.copy({&buffer, 0, 32}, {&buffer, 16, 32}); // overlaps, which Vulkan forbids
    batch.run();
    expect_error(ErrorKind::failure, "vkCmdCopyBuffer", [] { device().check_validation(); });
    device().check_validation();
}

} // namespace
} // namespace lpvbake::gpu
