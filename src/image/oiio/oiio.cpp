// The image module: everything that sees OpenImageIO and libpng. Images pass through memory, so
// that files, their errors and their atomicity are the business of those who own them.
#include "file_error.h"
#include "image/header.h"
#include "image/oiio/module.h"
#include "lpvbake/error.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <png.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <utility>

namespace lpvbake::image {
namespace {

using OIIO::ImageInput;
using OIIO::ImageOutput;
using OIIO::ImageSpec;
using OIIO::TypeDesc;

[[noreturn]] void reject(const std::string& name, const std::string& why) {
    throw Error(ErrorKind::invalid, name + ": " + why);
}

/// OpenImageIO's messages may span lines and end in a full stop; ours are one line.
std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    while (!text.empty() && (text.back() == ' ' || text.back() == '.'))
        text.pop_back();
    return text.empty() ? "no reason given" : text;
}

/// A PNG reduced to the chunks that make its picture. Without the others libpng has nothing to warn
/// about on stderr and no compressed text or profile to unpack.
std::vector<std::byte> picture_chunks(std::span<const std::byte> png, const std::string& name) {
    std::vector<std::byte> kept(png.begin(), png.begin() + 8);
    for (size_t at = 8;;) {
        const uint64_t length = big_endian(png, at, 4) + 12; // with length, type and CRC
        if (length > png.size() - at)
            reject(name, "the image cannot be decoded: the PNG data end early");
        bool keep = false;
        for (const char* type : {"IHDR", "PLTE", "tRNS", "IDAT", "IEND"})
            keep |= has_bytes(png, at + 4, type);
        if (keep)
            kept.insert(kept.end(), png.begin() + long(at), png.begin() + long(at + length));
        if (has_bytes(png, at + 4, "IEND"))
            return kept;
        at += length;
    }
}

void check_size(uint64_t texels, uint64_t max_texels, const std::string& name) {
    if (texels == 0)
        reject(name, "the image has no valid size in its header");
    if (texels > max_texels)
        reject(name, "the image has " + std::to_string(texels) + " texels, more than the limit of "
                         + std::to_string(max_texels) + "; scale it down");
}

/// Opens `data` with the codec `format`. The reader must outlive the input.
std::unique_ptr<ImageInput> open_input(const char* format, OIIO::Filesystem::IOMemReader& reader,
                                       const std::string& name, uint64_t max_texels) {
    auto input = ImageInput::create(format);
    if (!input)
        throw Error(ErrorKind::unsupported, name + ": this build of OpenImageIO cannot read "
                                                + format
                                                + " images: " + one_line(OIIO::geterror()));
    if (!input->set_ioproxy(&reader))
        throw Error(ErrorKind::unsupported, name + ": this build of OpenImageIO cannot read "
                                                + format + " images from memory");
    ImageSpec config;
    config["oiio:UnassociatedAlpha"] = 1;
    ImageSpec spec;
    if (!input->open(name, spec, config))
        reject(name, "the image cannot be decoded: " + one_line(input->geterror()));
    if (spec.width <= 0 || spec.height <= 0 || spec.depth != 1)
        reject(name, "the image has no valid size in its header");
    check_size(uint64_t(spec.width) * uint64_t(spec.height), max_texels, name);
    return input;
}

/// By libpng itself, in the form that keeps its errors: through OpenImageIO it prints each on
/// stderr. 16 bits a channel are sRGB-encoded like 8 are.
Rgba8 decode_png(std::span<const std::byte> data, const std::string& name) {
    const std::vector<std::byte> chunks = picture_chunks(data, name);
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    const auto check = [&](int ok) {
        if (ok)
            return;
        const std::string why = one_line(png.message);
        png_image_free(&png);
        reject(name, "the image cannot be decoded: " + why);
    };
    check(png_image_begin_read_from_memory(&png, chunks.data(), chunks.size()));
    png.format = PNG_FORMAT_RGBA;
    png.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
    Rgba8 image{int(png.width), int(png.height), {}};
    image.texels.resize(4 * size_t(png.width) * size_t(png.height));
    check(png_image_finish_read(&png, nullptr, image.texels.data(), 0, nullptr));
    return image;
}

Rgba8 decode(std::span<const std::byte> data, const std::string& name, uint64_t max_texels) {
    const ImageHeader header = read_image_header(data);
    if (!header.format)
        reject(name, "the image is neither PNG nor JPEG nor WebP; convert it to one of them");
    // Codecs may take memory for the whole image as soon as they are opened.
    check_size(header.texels(), max_texels, name);
    if (header.format == std::string_view("png"))
        return decode_png(data, name);
    OIIO::Filesystem::IOMemReader reader(const_cast<std::byte*>(data.data()), data.size());
    const auto input = open_input(header.format, reader, name, max_texels);
    const ImageSpec& spec = input->spec();
    const size_t texels = size_t(spec.width) * size_t(spec.height);
    const size_t channels = size_t(spec.nchannels);
    if (channels < 1 || channels > 4)
        reject(name, "the image has " + std::to_string(channels) + " channels");
    std::vector<uint8_t> samples(texels * channels);
    if (!input->read_image(0, 0, 0, -1, TypeDesc::UINT8, samples.data()))
        reject(name, "the image cannot be decoded: " + one_line(input->geterror()));

    Rgba8 image{spec.width, spec.height, {}};
    image.texels.resize(texels * 4);
    const bool grey = channels < 3;
    const bool alpha = channels % 2 == 0;
    for (size_t i = 0; i < texels; ++i) {
        const uint8_t* in = &samples[i * channels];
        uint8_t* out = &image.texels[i * 4];
        for (size_t c = 0; c < 3; ++c)
            out[c] = in[grey ? 0 : c];
        out[3] = alpha ? in[channels - 1] : 255;
    }
    return image;
}

std::vector<std::string> channel_names(int channels) {
    if (channels == 1)
        return {"Y"};
    std::vector<std::string> names{"R", "G", "B", "A"};
    names.resize(size_t(channels));
    return names;
}

std::vector<unsigned char> encode(const char* format, ImageSpec spec, const Pixels& pixels,
                                  const std::string& name) {
    const auto fail = [&](const std::string& why) {
        throw Error(ErrorKind::failure, name + ": the image cannot be encoded: " + one_line(why));
    };
    const int channels = pixels.channels;
    if (pixels.width < 1 || pixels.height < 1 || (channels != 1 && channels != 3 && channels != 4)
        || pixels.samples.size() != size_t(pixels.width) * size_t(pixels.height) * size_t(channels))
        fail("its size and channels do not fit its samples");
    spec.channelnames = channel_names(channels);
    spec.alpha_channel = channels == 4 ? 3 : -1;
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput writer(bytes);
    const auto output = ImageOutput::create(format);
    if (!output || !output->supports("ioproxy"))
        fail(std::string("OpenImageIO lacks ") + format);
    output->set_ioproxy(&writer);
    if (!output->open(name, spec) || !output->write_image(TypeDesc::FLOAT, pixels.samples.data())
        || !output->close())
        fail(output->geterror());
    return bytes;
}

std::vector<unsigned char> encode_png_bytes(const Pixels& pixels, const std::string& name) {
    Pixels clamped = pixels;
    for (float& sample : clamped.samples)
        sample = std::clamp(sample, 0.0f, 1.0f);
    ImageSpec spec(pixels.width, pixels.height, pixels.channels, TypeDesc::UINT8);
    spec["oiio:ColorSpace"] = "sRGB";
    spec["oiio:UnassociatedAlpha"] = 1;
    return encode("png", std::move(spec), clamped, name);
}

Pixels decode_exr_bytes(std::span<const std::byte> data, const std::string& name,
                        uint64_t max_texels) {
    if (!has_bytes(data, 0, "\x76\x2f\x31\x01"))
        reject(name, "this is not an OpenEXR file");
    OIIO::Filesystem::IOMemReader reader(const_cast<std::byte*>(data.data()), data.size());
    const auto input = open_input("openexr", reader, name, max_texels);
    const ImageSpec& spec = input->spec();
    if (spec.deep || spec.nchannels < 1 || spec.nchannels > 64)
        reject(name, "the image is deep or has more than 64 channels");
    Pixels pixels{spec.width, spec.height, spec.nchannels, {}};
    pixels.samples.resize(size_t(spec.width) * size_t(spec.height) * size_t(spec.nchannels));
    if (!input->read_image(0, 0, 0, -1, TypeDesc::FLOAT, pixels.samples.data()))
        reject(name, "the image cannot be decoded: " + one_line(input->geterror()));
    return pixels;
}

Pixels read_picture_file(const std::string& path, uint64_t max_texels) {
    if (FILE* file = std::fopen(path.c_str(), "rb"))
        std::fclose(file);
    else
        throw Error(kind_of_file_error(errno), path + ": " + std::strerror(errno));
    const auto input = ImageInput::open(path);
    if (!input)
        reject(path, "the image cannot be decoded: " + one_line(OIIO::geterror()));
    const ImageSpec& spec = input->spec();
    if (spec.width <= 0 || spec.height <= 0 || spec.depth != 1 || spec.nchannels < 1 || spec.deep)
        reject(path, "the image has no valid size in its header, or is deep");
    check_size(uint64_t(spec.width) * uint64_t(spec.height), max_texels, path);
    const int channels = spec.nchannels < 3 ? 1 : 3;
    Pixels pixels{spec.width, spec.height, 3, {}};
    pixels.samples.resize(3 * size_t(spec.width) * size_t(spec.height));
    if (!input->read_image(0, 0, 0, channels, TypeDesc::FLOAT, pixels.samples.data(),
                           ptrdiff_t(3 * sizeof(float))))
        reject(path, "the image cannot be decoded: " + one_line(input->geterror()));
    const bool encoded = !spec.format.is_floating_point();
    for (size_t i = 0; i < pixels.samples.size(); i += 3)
        for (size_t c = 0; c < 3; ++c) {
            float& sample = pixels.samples[i + c];
            if (c > 0 && channels == 1)
                sample = pixels.samples[i];
            else if (encoded)
                sample = sample <= 0.04045f ? sample / 12.92f
                                            : std::pow((sample + 0.055f) / 1.055f, 2.4f);
        }
    return pixels;
}

} // namespace
} // namespace lpvbake::image

const lpvbake::image::ImageModule* lpvbake_image_module() {
    static const lpvbake::image::ImageModule table = [] {
        // One thread each: images are small, bytes must not depend on threads, and OpenEXR's own
        // pool (-1: none) would outnumber what the user asked for.
        OIIO::attribute("threads", 1);
        OIIO::attribute("exr_threads", -1);
        return lpvbake::image::ImageModule{lpvbake::image::decode, lpvbake::image::decode_exr_bytes,
                                           lpvbake::image::read_picture_file,
                                           lpvbake::image::encode_png_bytes};
    }();
    return &table;
}
