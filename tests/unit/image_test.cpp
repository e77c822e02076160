// Image codecs, against a PNG writer of our own that knows nothing of libpng.
#include "image/image.h"

#include "lpvbake/error.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <dlfcn.h>
#include <link.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <thread>

using namespace lpvbake;

namespace {

using Bytes = std::vector<uint8_t>;

void append_big_endian(Bytes& out, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8)
        out.push_back(uint8_t(value >> shift));
}

uint32_t crc32_of(const Bytes& data, size_t from) {
    uint32_t crc = ~0u;
    for (size_t i = from; i < data.size(); ++i) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0u);
    }
    return ~crc;
}

void append_chunk(Bytes& png, const char* type, const Bytes& body) {
    append_big_endian(png, uint32_t(body.size()));
    const size_t from = png.size();
    png.insert(png.end(), type, type + 4);
    png.insert(png.end(), body.begin(), body.end());
    append_big_endian(png, crc32_of(png, from));
}

/// A PNG of `rows` (unfiltered, at most 65535 bytes in all) as one stored deflate block.
Bytes make_png(uint32_t width, uint32_t height, int depth, int colour_type, const Bytes& rows,
               const Bytes& palette = {}, const Bytes& transparency = {}) {
    Bytes png{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    Bytes header;
    append_big_endian(header, width);
    append_big_endian(header, height);
    for (int byte : {depth, colour_type, 0, 0, 0})
        header.push_back(uint8_t(byte));
    append_chunk(png, "IHDR", header);
    if (!palette.empty())
        append_chunk(png, "PLTE", palette);
    if (!transparency.empty())
        append_chunk(png, "tRNS", transparency);
    Bytes filtered;
    const size_t stride = rows.size() / height;
    for (size_t y = 0; y < height && stride; ++y) {
        filtered.push_back(0);
        filtered.insert(filtered.end(), rows.begin() + long(y * stride),
                        rows.begin() + long((y + 1) * stride));
    }
    const size_t n = filtered.size();
    Bytes zlib{0x78, 0x01, 0x01, uint8_t(n), uint8_t(n >> 8), uint8_t(~n), uint8_t(~n >> 8)};
    uint32_t a = 1, b = 0;
    for (uint8_t byte : filtered) {
        zlib.push_back(byte);
        a = (a + byte) % 65521;
        b = (b + a) % 65521;
    }
    append_big_endian(zlib, b << 16 | a);
    append_chunk(png, "IDAT", zlib);
    append_chunk(png, "IEND", {});
    return png;
}

image::Rgba8 decode(const Bytes& bytes, uint64_t max_texels = 1 << 20) {
    return image::decode_image(std::as_bytes(std::span(bytes)), "picture", max_texels);
}

std::string rejection(const Bytes& bytes, uint64_t max_texels = 1 << 20) {
    try {
        decode(bytes, max_texels);
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
        EXPECT_EQ(std::string(error.what()).find("picture"), 0u) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

int open_image_io(dl_phdr_info* info, size_t, void* found) {
    *static_cast<bool*>(found) |= std::strstr(info->dlpi_name, "OpenImageIO") != nullptr;
    return 0;
}

bool open_image_io_is_loaded() {
    bool found = false;
    dl_iterate_phdr(open_image_io, &found);
    return found;
}

} // namespace

// Runs first: the whole point of the module is that programs which need no image do not pay.
TEST(Image, ModuleIsLoadedOnFirstUseOnly) {
    EXPECT_FALSE(open_image_io_is_loaded());
    { const image::ImageModulePreload preload = image::preload_image_module(); }
    EXPECT_TRUE(open_image_io_is_loaded());
}

TEST(Image, DecodesTrueColour) {
    const image::Rgba8 image = decode(make_png(2, 1, 8, 2, {1, 2, 3, 250, 251, 252}));
    EXPECT_EQ(image.width, 2);
    EXPECT_EQ(image.height, 1);
    EXPECT_EQ(image.texels, (Bytes{1, 2, 3, 255, 250, 251, 252, 255}));
}

TEST(Image, RowsRunFromTheTop) {
    EXPECT_EQ(decode(make_png(1, 2, 8, 2, {1, 2, 3, 4, 5, 6})).texels,
              (Bytes{1, 2, 3, 255, 4, 5, 6, 255}));
}

TEST(Image, AlphaStaysStraight) {
    EXPECT_EQ(decode(make_png(2, 1, 8, 6, {200, 100, 50, 10, 9, 8, 7, 0})).texels,
              (Bytes{200, 100, 50, 10, 9, 8, 7, 0}));
}

TEST(Image, DecodesGreyAndGreyAlpha) {
    EXPECT_EQ(decode(make_png(2, 1, 8, 0, {7, 99})).texels, (Bytes{7, 7, 7, 255, 99, 99, 99, 255}));
    EXPECT_EQ(decode(make_png(1, 1, 8, 4, {77, 3})).texels, (Bytes{77, 77, 77, 3}));
    EXPECT_EQ(decode(make_png(8, 1, 1, 0, {0b10100000})).texels[0], 255);
}

TEST(Image, DecodesPaletteWithTransparency) {
    // Two texels of 4 bits: entries 1 and 0; entry 1 is half transparent.
    const Bytes png = make_png(2, 1, 4, 3, {0x10}, {10, 20, 30, 40, 50, 60}, {255, 128});
    EXPECT_EQ(decode(png).texels, (Bytes{40, 50, 60, 128, 10, 20, 30, 255}));
}

TEST(Image, DecodesColourKey) {
    const Bytes png = make_png(2, 1, 8, 2, {1, 2, 3, 4, 5, 6}, {}, {0, 4, 0, 5, 0, 6});
    EXPECT_EQ(decode(png).texels, (Bytes{1, 2, 3, 255, 4, 5, 6, 0}));
}

TEST(Image, RoundsSixteenBits) {
    // 0x8080 is exactly 128 of 255; 0x00ff is 0.992 of one step.
    const Bytes png = make_png(1, 1, 16, 2, {0xff, 0xff, 0x80, 0x80, 0x00, 0xff});
    EXPECT_EQ(decode(png).texels, (Bytes{255, 128, 1, 255}));
}

TEST(Image, IgnoresWhatIsNotThePicture) {
    Bytes png = make_png(1, 1, 8, 2, {1, 2, 3});
    Bytes extra;
    append_chunk(extra, "gAMA", {0, 0, 0, 1});
    append_chunk(extra, "iCCP", {'x', 0, 0, 9, 9, 9});
    png.insert(png.begin() + 33, extra.begin(), extra.end());
    testing::internal::CaptureStderr();
    EXPECT_EQ(decode(png).texels, (Bytes{1, 2, 3, 255}));
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(Image, DecodesJpeg) {
    // An 8x8 baseline grey JPEG written by hand: one Huffman kind each, DC difference 64 with a
    // quantiser of 8 gives 128 + 64 * 8 / 8 = 192 everywhere.
    Bytes jpeg{0xff, 0xd8, 0xff, 0xdb, 0x00, 0x43, 0x00};
    jpeg.insert(jpeg.end(), 64, 8);
    const Bytes rest{0xff, 0xc0, 0x00, 0x0b, 0x08, 0x00, 0x08, 0x00, 0x08, 0x01, 0x01, 0x11, 0x00,
                     // DC table: one kind of 1 bit for category 7
                     0xff, 0xc4, 0x00, 0x14, 0x00, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                     7,
                     // AC table: one kind of 1 bit for the end of the block
                     0xff, 0xc4, 0x00, 0x14, 0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                     0, 0xff, 0xda, 0x00, 0x08, 0x01, 0x01, 0x00, 0x00, 0x3f, 0x00,
                     // 0, 1000000 (64), 0, padded with ones
                     0b01000000, 0b01111111, 0xff, 0xd9};
    jpeg.insert(jpeg.end(), rest.begin(), rest.end());
    const image::Rgba8 image = decode(jpeg);
    ASSERT_EQ(image.texels.size(), 256u);
    for (size_t i = 0; i < 64; ++i)
        EXPECT_EQ((std::array{image.texels[4 * i], image.texels[4 * i + 1], image.texels[4 * i + 2],
                              image.texels[4 * i + 3]}),
                  (std::array<uint8_t, 4>{192, 192, 192, 255}));
}

TEST(Image, RejectsBadData) {
    EXPECT_NE(rejection({}).find("neither PNG nor JPEG"), std::string::npos);
    EXPECT_NE(rejection({'G', 'I', 'F', '8'}).find("neither PNG nor JPEG"), std::string::npos);
    rejection({0xff, 0xd8, 0xff, 0xd9});
    const Bytes png = make_png(2, 2, 8, 2, Bytes(12, 9));
    testing::internal::CaptureStderr();
    for (size_t length = 0; length < png.size(); ++length)
        rejection(Bytes(png.begin(), png.begin() + long(length)));
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    Bytes broken = png;
    broken[45] ^= 0xff;
    rejection(broken);
}

TEST(Image, RejectsBombsByTheirHeader) {
    const Bytes png = make_png(60000, 60000, 8, 2, {});
    EXPECT_NE(rejection(png).find("3600000000 texels, more than the limit of 1048576"),
              std::string::npos);
    const Bytes progressive{0xff, 0xd8, 0xff, 0xe0, 0,    4,    0, 0, 0xff, 0xc2, 0, 11,
                            8,    0xff, 0xff, 0xff, 0xff, 0xff, 1, 1, 0x11, 0,    0, 0};
    EXPECT_NE(rejection(progressive).find("4294836225 texels"), std::string::npos);
    rejection(make_png(0, 1, 8, 2, {}));
    rejection(make_png(3, 1, 8, 0, {1, 2, 3}), 2);
    EXPECT_EQ(decode(make_png(3, 1, 8, 0, {1, 2, 3}), 3).width, 3);
}

/// Blocks of sixteen lines are compressed side by side: the file has them in their order.
TEST(Image, ExrIsTheSameForAnyNumberOfThreads) {
    image::Pixels pixels{64, 200, 3, std::vector<float>(64 * 200 * 3)};
    for (size_t i = 0; i < pixels.samples.size(); ++i)
        pixels.samples[i] = std::sin(float(i * i % 9973));
    const auto encoded = [&](int threads) {
        tbb::task_arena arena(threads);
        return arena.execute([&] { return image::encode_exr(pixels, false, {}, "x"); });
    };
    const auto bytes = encoded(1);
    for (int threads : {2, 3, 7})
        EXPECT_EQ(bytes, encoded(threads));
}

TEST(Image, ExrRoundTripsExactly) {
    for (int channels : {1, 3, 4}) {
        image::Pixels pixels{5, 3, channels, {}};
        for (int i = 0; i < 15 * channels; ++i)
            pixels.samples.push_back(1e-20f * std::pow(-7.3f, float(i % 41)));
        const auto bytes = image::encode_exr(pixels, false, {{"lpv:solver", "none"}}, "x");
        const image::Pixels back = image::decode_exr(std::as_bytes(std::span(bytes)), "x", 100);
        EXPECT_EQ(back.width, 5);
        EXPECT_EQ(back.height, 3);
        EXPECT_EQ(back.channels, channels);
        EXPECT_EQ(back.samples, pixels.samples);
        EXPECT_EQ(bytes, image::encode_exr(pixels, false, {{"lpv:solver", "none"}}, "x"));
        const std::string text(bytes.begin(), bytes.end());
        EXPECT_NE(text.find("lpv:solver"), std::string::npos);
    }
}

TEST(Image, BytesDoNotTellTheTime) {
    const image::Pixels pixels{2, 2, 3, std::vector<float>(12, 0.5f)};
    const auto exr = image::encode_exr(pixels, true, {}, "x");
    const auto png = image::encode_png(pixels, "x");
    std::this_thread::sleep_for(std::chrono::milliseconds(1100));
    EXPECT_EQ(exr, image::encode_exr(pixels, true, {}, "x"));
    EXPECT_EQ(png, image::encode_png(pixels, "x"));
}

TEST(Image, ExrHalfRoundsToNearest) {
    const image::Pixels pixels{2, 1, 1, {1.0f + 0.6f / 1024, 65504.0f}};
    const auto bytes = image::encode_exr(pixels, true, {}, "x");
    EXPECT_EQ(image::decode_exr(std::as_bytes(std::span(bytes)), "x", 2).samples,
              (std::vector<float>{1.0f + 1.0f / 1024, 65504.0f}));
}

TEST(Image, ExrRejections) {
    const auto bytes = image::encode_exr({4, 4, 3, std::vector<float>(48, 0.5f)}, false, {}, "x");
    const auto data = std::as_bytes(std::span(bytes));
    const auto refused = [&](std::span<const std::byte> part,
                             uint64_t max_texels) -> std::optional<ErrorKind> {
        try {
            image::decode_exr(part, "x", max_texels);
        } catch (const Error& error) {
            return error.kind;
        }
        return std::nullopt;
    };
    EXPECT_EQ(refused(data, 16), std::nullopt);
    EXPECT_EQ(refused(data, 15), ErrorKind::invalid);
    for (size_t length = 0; length < data.size(); length += 7)
        EXPECT_EQ(refused(data.first(length), 16), ErrorKind::invalid) << length;
    EXPECT_THROW(image::encode_exr({4, 4, 3, {}}, false, {}, "x"), Error);
    EXPECT_THROW(image::encode_exr({1, 1, 2, {0, 0}}, false, {}, "x"), Error);
}

TEST(Image, PngRoundTripsAndClamps) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const auto bytes = image::encode_png({2, 1, 3, {0.0f, 0.2f, 1.0f, -3.0f, 7.0f, nan}}, "x");
    const image::Rgba8 image = decode(bytes);
    EXPECT_EQ(image.texels, (Bytes{0, 51, 255, 255, 0, 255, 0, 255}));
}
