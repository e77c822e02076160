#include "io/ktx2.h"

#include "io/atomic_file.h"
#include "io/blocks.h"
#include "io/layout.h"
#include "io/texture_files.h"
#include "lpvbake/error.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>

namespace lpvbake::io {
namespace {

// The KTX File Format Specification, version 2.0: header, index, one level, the data format
// descriptor (Khronos Data Format Specification 1.3, a basic descriptor block), key/value data.
constexpr std::string_view identifier("\xABKTX 20\xBB\r\n\x1A\n", 12);
constexpr size_t head_size = 80, level_size = 24, descriptor_offset = head_size + level_size;
constexpr uint32_t zstandard = 2; ///< supercompressionScheme
constexpr int compression_level = 9;
constexpr std::string_view writer_key = "KTXwriter", own_key = "lpvbake";
constexpr std::string_view writer = "lpvbake " LPVBAKE_VERSION;

struct Sample {
    uint32_t bit, bits, channel, lower, upper;
};

std::vector<Sample> samples_of(const TexelForm& form) {
    constexpr uint32_t exponent = 0x20, is_signed = 0x40, is_float = 0x80;
    std::vector<Sample> samples;
    if (form.is_block())
        return form.coding == Coding::bc7 ? std::vector{Sample{0, 128, 0, 0, 0xffffffff}}
                                          : std::vector{Sample{0, 128, is_float, 0, 0x3f800000}};
    if (form.coding == Coding::rgb9e5) {
        for (uint32_t c = 0; c < 3; ++c) {
            samples.push_back({9 * c, 9, c, 0, 8448});
            samples.push_back({27, 5, c | exponent, 15, 31});
        }
        return samples;
    }
    const auto bits = uint32_t(8 * form.scalar());
    const Sample sample = form.coding == Coding::unorm8 ? Sample{0, bits, 0, 0, 255}
                                                        : Sample{0, bits, is_signed | is_float,
                                                                 0xbf800000, 0x3f800000}; // -1, 1
    for (const uint32_t channel : {0u, 1u, 2u, 15u}) // red, green, blue, alpha
        if (samples.size() < size_t(form.channels)) {
            const auto bit = bits * uint32_t(samples.size());
            samples.push_back(sample);
            samples.back().bit = bit;
            samples.back().channel |= channel;
        }
    return samples;
}

std::string descriptor_of(const TexelForm& form) {
    constexpr uint32_t rgbsda = 1, bc6h = 133, bc7 = 134, bt709 = 1, linear = 1;
    const uint32_t model = form.coding == Coding::bc6h  ? bc6h
                           : form.coding == Coding::bc7 ? bc7
                                                        : rgbsda;
    const std::vector<Sample> samples = samples_of(form);
    const auto size = uint32_t(24 + 16 * samples.size());
    std::string bytes;
    const auto add = [&](uint32_t word) { append_number(bytes, word); };
    add(4 + size);
    add(0);              // vendor Khronos, basic block
    add(2 | size << 16); // version 1.3
    add(model | bt709 << 8 | linear << 16);
    add(form.is_block() ? (block_side - 1) * 0x101u : 0); // blocks of 4 x 4 or 1 x 1 texels
    add(uint32_t(form.bytes()));
    add(0);
    for (const Sample& sample : samples) {
        add(sample.bit | (sample.bits - 1) << 16 | sample.channel << 24);
        add(0); // where in the block
        add(sample.lower);
        add(sample.upper);
    }
    return bytes;
}

std::string compress(std::string_view texels) {
    const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                       ZSTD_freeCCtx);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, compression_level);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
    std::string bytes(ZSTD_compressBound(texels.size()), '\0');
    const size_t size =
        ZSTD_compress2(context.get(), bytes.data(), bytes.size(), texels.data(), texels.size());
    if (ZSTD_isError(size))
        throw Error(ErrorKind::failure, std::string("cannot compress: ") + ZSTD_getErrorName(size));
    bytes.resize(size);
    return bytes;
}

} // namespace

std::string encode_ktx2(const TexelForm& form, glm::ivec3 dims, std::string_view texels,
                        std::string_view description) {
    const std::string descriptor = descriptor_of(form), level = compress(texels);
    std::string pairs;
    for (const auto& [key, value] : {std::pair(writer_key, writer), {own_key, description}}) {
        if (value.empty())
            continue;
        append_number(pairs, uint32_t(key.size() + value.size() + 2)); // both end in a 0
        (pairs += key).push_back('\0');
        (pairs += value).push_back('\0');
        pairs.resize((pairs.size() + 3) / 4 * 4);
    }
    std::string bytes(identifier);
    for (const uint32_t word :
         {form.vulkan, uint32_t(form.scalar()), uint32_t(dims.x), uint32_t(dims.y),
          uint32_t(dims.z), 0u /* no array */, 1u /* face */, 1u /* level */, zstandard,
          uint32_t(descriptor_offset), uint32_t(descriptor.size()),
          uint32_t(descriptor_offset + descriptor.size()), uint32_t(pairs.size())})
        append_number(bytes, word);
    for (const uint64_t word :
         {uint64_t(0), uint64_t(0), uint64_t(descriptor_offset + descriptor.size() + pairs.size()),
          uint64_t(level.size()), uint64_t(texels.size())})
        append_number(bytes, word);
    return bytes + descriptor + pairs + level;
}

// ---- reading ----

namespace {

struct Ktx2 : TextureContent {
    bool is_compressed;
    std::string_view level; ///< of the bytes that were parsed
};

/// The part of a file, which has to be there.
std::string_view part(std::string_view bytes, uint64_t offset, uint64_t size,
                      const std::string& path) {
    if (offset > bytes.size() || size > bytes.size() - offset)
        reject(path, cut_off);
    return bytes.substr(size_t(offset), size_t(size));
}

/// The value of our own key without the 0 at its end; empty if there is none.
std::string_view description_in(std::string_view pairs, const std::string& path) {
    while (pairs.size() >= 4) {
        const auto size = number_at<uint32_t>(pairs, 0);
        std::string_view pair = part(pairs, 4, size, path);
        if (pair.starts_with(own_key) && pair.size() > own_key.size() + 1
            && pair[own_key.size()] == '\0') {
            pair.remove_prefix(own_key.size() + 1);
            if (pair.ends_with('\0'))
                pair.remove_suffix(1);
            return pair;
        }
        pairs.remove_prefix(std::min<size_t>(pairs.size(), 4 + (size_t(size) + 3) / 4 * 4));
    }
    return {};
}

Ktx2 parse(std::string_view bytes, const std::string& path) {
    if (!bytes.starts_with(identifier))
        reject(path, "is not a KTX 2.0 file");
    part(bytes, 0, descriptor_offset, path);
    std::array<uint32_t, 13> words{};
    for (size_t i = 0; i < words.size(); ++i)
        words[i] = number_at<uint32_t>(bytes, identifier.size() + 4 * i);
    const auto [format, type_size, x, y, z, layers, faces, levels, scheme, unused_offset,
                unused_size, pairs_offset, pairs_size] = words;
    Ktx2 ktx{};
    ktx.form = form_numbered(&TexelForm::vulkan, format);
    if (!ktx.form || layers > 1 || faces != 1 || levels != 1
        || (scheme != 0 && scheme != zstandard))
        reject(path, "is not a 3D texture as lpvbake writes them: format " + std::to_string(format)
                         + ", " + std::to_string(layers) + " layers, " + std::to_string(faces)
                         + " faces, " + std::to_string(levels) + " levels, compression "
                         + std::to_string(scheme));
    for (const uint32_t side : {x, y, z})
        if (side < 1 || side > uint32_t(max_texture_side))
            reject(path, "is no 3D texture of 1 to 2048 texels a side");
    ktx.dims = glm::ivec3(int(x), int(y), int(z));
    ktx.is_compressed = scheme == zstandard;
    ktx.description = description_in(part(bytes, pairs_offset, pairs_size, path), path);
    ktx.level = part(bytes, number_at<uint64_t>(bytes, head_size),
                     number_at<uint64_t>(bytes, head_size + 8), path);
    return ktx;
}

/// Throws Error (invalid).
std::string texels_in(const Ktx2& ktx, const std::string& path) {
    const size_t size = ktx.form->size(ktx.dims);
    if (!ktx.is_compressed) {
        if (ktx.level.size() != size)
            reject(path, "has " + std::to_string(ktx.level.size()) + " bytes of texels, expected "
                             + std::to_string(size));
        return std::string(ktx.level);
    }
    std::string texels(size, '\0');
    const size_t got = ZSTD_decompress(texels.data(), size, ktx.level.data(), ktx.level.size());
    if (ZSTD_isError(got) || got != size)
        reject(path, std::string("its texels cannot be decompressed: ")
                         + (ZSTD_isError(got) ? ZSTD_getErrorName(got) : "they are too few"));
    return texels;
}

image::Pixels pixels_of(const Ktx2& ktx, const std::string& path, glm::ivec3 dims,
                        size_t channels) {
    check_texture(ktx, path, dims, channels);
    return unpack(texels_in(ktx, path), *ktx.form, dims, channels);
}

/// A file of the volume: the path itself or, where there is no such file, the first of its
/// textures.
std::string one_file(const std::string& path) {
    std::error_code ignored;
    if (std::filesystem::exists(path, ignored))
        return path;
    std::vector<std::string> found;
    for (const char* suffix : {"sh_l0", "r", "0", "atlas", "cube"})
        if (const std::string file = stem_of(path) + "_" + suffix + ".ktx2";
            std::filesystem::exists(file, ignored))
            found.push_back(file);
    if (found.size() > 1)
        reject(path, "may be the volume of " + found[0] + " or that of " + found[1]
                         + "; name one of these");
    return found.empty() ? path : found[0];
}

const TextureContainer container{&ktx2_format, "lpvbake textures", encode_ktx2};

} // namespace

constexpr VolumeFormat ktx2_format{
    .extension = ".ktx2",
    .help = "NAME.ktx2, which becomes 3D textures: NAME_sh_l0.ktx2, ...",
    .has_pictures = true,
    .has_rgb9e5 = true,
    .has_ratios = true,
    .files =
        [](const std::string& path, const Volume& grids, const Pictures& pictures,
           volume::ShConvention convention) {
            return texture_files(container, path, grids, pictures, convention);
        },
    .write = write_ktx2,
    .read = read_ktx2};

WriteReport write_ktx2(const std::string& path, const Stored& stored, Precision precision,
                       const Pictures& pictures) {
    return write_textures(container, path, stored, precision, pictures);
}

Volume read_ktx2(const std::string& path, volume::GridKinds kinds) {
    const std::string first = one_file(path);
    const std::string description = parse(read_texture_file(first), first).description;
    if (description.empty())
        reject(first, "has no value of the key \"lpvbake\": it is not a volume of lpvbake");
    Volume volume = read_description(first, description, [&](const Json& json) {
        const bool is_alone = json.at("files").size() == 1;
        return read_textures(
            first, json, container.description, kinds,
            [&](const std::string& listed, glm::ivec3 dims, const Layout&, size_t channels) {
                const std::string& file = is_alone ? first : listed;
                const std::string bytes = read_texture_file(file);
                const Ktx2 ktx = parse(bytes, file);
                if (ktx.description != description)
                    reject(file, "is not of the volume that " + first + " is of");
                return pixels_of(ktx, file, dims, channels);
            });
    });
    check_volume(volume, first, ErrorKind::invalid);
    return volume;
}

image::Pixels decode_ktx2(std::string_view bytes, const std::string& place, glm::ivec3 dims,
                          size_t channels) {
    return pixels_of(parse(bytes, place), place, dims, channels);
}

} // namespace lpvbake::io
