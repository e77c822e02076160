#include "io/dds.h"

#include "io/atomic_file.h"
#include "io/layout.h"
#include "io/texture_files.h"
#include "lpvbake/error.h"

#include <algorithm>
#include <array>

namespace lpvbake::io {
namespace {

// DDS_HEADER and DDS_HEADER_DXT10 of Microsoft's "Programming Guide for DDS", in words of 4 bytes.
constexpr uint32_t magic = 0x20534444, dx10 = 0x30315844; // "DDS ", "DX10"
constexpr size_t head_words = 37;
constexpr uint32_t header_size = 124, pixel_format_size = 32, four_cc = 4, texture_3d = 4;
/// Caps, height, width, pitch, pixel format, depth.
constexpr uint32_t flags = 0x1 | 0x2 | 0x4 | 0x8 | 0x1000 | 0x800000;
constexpr uint32_t pitch = 0x8, linear_size = 0x80000;
constexpr uint32_t caps = 0x8 | 0x1000, caps2_volume = 0x200000; ///< complex, texture

std::string encode(const TexelForm& form, glm::ivec3 dims, std::string_view texels,
                   std::string_view) {
    std::array<uint32_t, head_words> words{};
    words[0] = magic;
    words[1] = header_size;
    words[2] = form.is_block() ? (flags & ~pitch) | linear_size : flags;
    words[3] = uint32_t(dims.y);
    words[4] = uint32_t(dims.x);
    words[5] =
        form.is_block() ? uint32_t(texels.size()) : uint32_t(dims.x) * uint32_t(form.bytes());
    words[6] = uint32_t(dims.z);
    words[7] = 1; // level
    words[19] = pixel_format_size;
    words[20] = four_cc;
    words[21] = dx10;
    words[27] = caps;
    words[28] = caps2_volume;
    words[32] = form.dxgi;
    words[33] = texture_3d;
    words[35] = 1; // no array
    std::string bytes;
    for (const uint32_t word : words)
        append_number(bytes, word);
    return bytes.append(texels);
}

/// The texels are what follows the head, and are as many as the form and dims say.
TextureContent parse(std::string_view bytes, const std::string& path) {
    if (bytes.size() < 4 * head_words || number_at<uint32_t>(bytes, 0) != magic)
        reject(path, "is not a DDS file");
    const auto word = [&](size_t i) { return number_at<uint32_t>(bytes, 4 * i); };
    TextureContent content{form_numbered(&TexelForm::dxgi, word(32)), {}, {}};
    if (word(21) != dx10 || word(33) != texture_3d || word(35) != 1 || word(7) > 1 || !content.form)
        reject(path, "is not a 3D texture as lpvbake writes them");
    for (const size_t side : {4, 3, 6})
        if (word(side) < 1 || word(side) > uint32_t(max_texture_side))
            reject(path, "is no 3D texture of 1 to 2048 texels a side");
    content.dims = glm::ivec3(int(word(4)), int(word(3)), int(word(6)));
    const size_t size = content.form->size(content.dims);
    if (bytes.size() - 4 * head_words != size)
        reject(path, "has " + std::to_string(bytes.size() - 4 * head_words)
                         + " bytes of texels, expected " + std::to_string(size));
    return content;
}

constexpr const char* sidecar = ".dds.json";

const TextureContainer container{&dds_format, "lpvbake textures", encode};

} // namespace

constexpr VolumeFormat dds_format{
    .extension = ".dds",
    .sidecar = sidecar,
    .help = "NAME.dds, 3D textures too, and NAME.dds.json",
    .has_pictures = true,
    .has_rgb9e5 = true,
    .has_ratios = true,
    .files =
        [](const std::string& path, const Volume& grids, const Pictures& pictures,
           volume::ShConvention convention) {
            return texture_files(container, path, grids, pictures, convention);
        },
    .write = write_dds,
    .read = read_dds};

WriteReport write_dds(const std::string& path, const Stored& stored, Precision precision,
                      const Pictures& pictures) {
    return write_textures(container, path, stored, precision, pictures);
}

Volume read_dds(const std::string& path, volume::GridKinds kinds) {
    const std::string described = sidecar_of(path, sidecar);
    const std::string text = read_file(described, uint64_t(16) << 20);
    Volume volume = read_description(described, text, [&](const Json& json) {
        Volume read = read_textures(
            described, json, container.description, kinds,
            [](const std::string& file, glm::ivec3 dims, const Layout&, size_t channels) {
                const std::string bytes = read_texture_file(file);
                const TextureContent content = parse(bytes, file);
                check_texture(content, file, dims, channels);
                return unpack(std::string_view(bytes).substr(4 * head_words), *content.form, dims,
                              channels);
            });
        check_listed(path, described, sidecar, json);
        return read;
    });
    check_volume(volume, described, ErrorKind::invalid);
    return volume;
}

} // namespace lpvbake::io
