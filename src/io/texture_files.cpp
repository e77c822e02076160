#include "io/texture_files.h"

#include "io/atomic_file.h"
#include "lpvbake/error.h"

#include <algorithm>

namespace lpvbake::io {
namespace {

std::string text_of(glm::ivec3 dims) {
    return std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x " + std::to_string(dims.z);
}

} // namespace

glm::ivec3 texture_dims(const std::string& path, glm::ivec3 cells, Packing packing) {
    const glm::ivec3 dims = stack_of(packing).dims(cells);
    if (std::max({dims.x, dims.y, dims.z}) > max_texture_side)
        throw Error(ErrorKind::unsupported,
                    path + ": a 3D texture of " + text_of(dims) + " texels has more than "
                        + std::to_string(max_texture_side)
                        + " a side, the most that graphics APIs promise; write .vdb");
    return dims;
}

std::vector<std::string> texture_files(const TextureContainer& container, const std::string& path,
                                       const Volume& volume, const Pictures& pictures,
                                       volume::ShConvention convention) {
    const std::vector<Texture> textures = textures_of(volume, pictures.packing, convention, path);
    texture_dims(path, volume.grid.dims, pictures.packing);
    const std::string stem = stem_of(path);
    std::vector<std::string> names = texture_names(stem, container.format->extension, textures);
    if (container.format->sidecar[0] != '\0')
        names.push_back(stem + container.format->sidecar);
    return names;
}

WriteReport write_textures(const TextureContainer& container, const std::string& path,
                           const Stored& stored, Precision wanted, const Pictures& pictures) {
    const Volume& volume = stored.volume();
    const Packing packing = pictures.packing;
    const volume::ShConvention convention = stored.encoding().convention;
    const std::vector<std::string> names =
        texture_files(container, path, volume, pictures, convention);
    const std::vector<Texture> textures = textures_of(volume, packing, convention, path);
    const glm::ivec3 dims = stack_of(packing).dims(volume.grid.dims);
    WriteReport report;
    const Precision precision = stored.precision(wanted, path, report);
    const std::string description = with_metadata(
        describe(container.description, stored, precision, packing, textures, names), volume);
    report.files = write_together(names, [&](AtomicFile& file, size_t i) {
        if (i == textures.size()) // the sidecar
            return file.write(description);
        const TexelForm& form = form_of(textures[i], precision);
        file.write(container.encode(
            form, dims, pack(texels_of(textures[i], packing, volume, {1, dims.z}), form),
            description));
    });
    return report;
}

std::string read_texture_file(const std::string& path) {
    return read_file(path, uint64_t(1) << 40);
}

void check_texture(const TextureContent& content, const std::string& path, glm::ivec3 dims,
                   size_t channels) {
    if (content.dims != dims || !holds(*content.form, channels))
        throw Error(ErrorKind::invalid, path + ": has " + text_of(content.dims) + " texels of "
                                            + std::to_string(content.form->channels)
                                            + " channels; its description says " + text_of(dims)
                                            + " of " + std::to_string(channels));
}

} // namespace lpvbake::io
