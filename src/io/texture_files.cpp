#include "io/texture_files.h"

#include "io/atomic_file.h"
#include "io/ratios.h"
#include "lpvbake/error.h"
#include "text.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdlib>

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

/// How much an error of each texel of a texture of light counts, where blocks weigh them; else
/// nothing. `light` has its texels.
std::vector<float> weights_of(const Texture& texture, const TexelForm& form, const Volume& light) {
    if (!form.is_block())
        return {};
    std::vector<float> weights;
    const std::vector<float> cells = cell_weights(light);
    const volume::ConstGridView base = volume::grids_of(light, base_kind)[0];
    for (size_t cell = 0; cell < cells.size(); ++cell)
        for (size_t c = 0; c < 3; ++c) {
            const Range range = texture.blocks[0][c].range.value_or(Range{});
            const float scale = base.data[3 * cell + c] * (range.high - range.low);
            weights.push_back(texture.kind == &base_kind ? cells[cell]
                                                         : cells[cell] * scale * scale);
        }
    return weights;
}

/// Texels of all textures. `light` is what they are made of.
std::vector<std::string> pack_all(const std::vector<Texture>& textures, const Volume& light,
                                  Packing packing, Precision precision) {
    std::vector<std::string> packed(textures.size());
    const glm::ivec3 dims = light.grid.dims;
    tbb::parallel_for(size_t(0), textures.size(), [&](size_t t) {
        const TexelForm& form = form_of(textures[t], precision);
        packed[t] = pack(texels_of(textures[t], packing, light, {1, dims.z}), form, dims,
                         weights_of(textures[t], form, light));
    });
    return packed;
}

/// Reads the texels of light as a reader of the files does, and adds to the metadata what they err.
PackingError measure(const Stored& stored, const std::vector<std::string>& names,
                     const std::vector<Texture>& textures, const std::vector<std::string>& packed,
                     Precision precision, Json& json) {
    const GridKind* const light[] = {&volume::light_kind()};
    Ranges ranges;
    const std::string kind = json["format"];
    Volume texels = read_texels(
        names[0], json, kind.c_str(), light,
        [&](const std::string& file, glm::ivec3 dims, const Layout&, size_t channels) {
            const size_t t = size_t(std::ranges::find(names, file) - names.begin());
            return unpack(packed[t], form_of(textures[t], precision), dims, channels);
        },
        ranges);
    const PackingError error =
        packing_error(stored.volume(), stored.encoding(), ranges, std::move(texels));
    // What it was read from may have been packed, too: errors add up at most.
    Json& metadata = json["metadata"];
    const auto add = [&](const char* key, double value) {
        if (metadata.contains(key))
            value += std::strtod(metadata[key].get<std::string>().c_str(), nullptr);
        metadata[key] = format("%.3g", value);
    };
    add("packing_error", error.cells);
    add("packing_error_filtered", error.filtered);
    return error;
}

WriteReport write_textures(const TextureContainer& container, const std::string& path,
                           const Stored& stored, Precision wanted, const Pictures& pictures) {
    const Volume& volume = stored.volume();
    const Packing packing = pictures.packing;
    const volume::ShConvention convention = stored.encoding().convention;
    const std::vector<std::string> names =
        texture_files(container, path, volume, pictures, convention);
    const glm::ivec3 dims = stack_of(packing).dims(volume.grid.dims);
    WriteReport report;
    const Precision precision = stored.precision(wanted, path, report);
    Volume ratios;
    Ranges ranges;
    if (has_ratios(precision)) {
        ratios = volume;
        const Texture mean = textures_of(ratios, packing, convention, path).front();
        ranges = to_ratios(form_of(mean, precision), ratios);
    }
    const Volume& texels = has_ratios(precision) ? ratios : volume;
    const std::vector<Texture> textures = textures_of(texels, packing, convention, path, ranges);
    Json json = describe(container.description, stored, precision, packing, textures, names);
    json["metadata"] = metadata_of(volume);
    std::vector<std::string> packed;
    if (has_ratios(precision)) {
        packed = pack_all(textures, ratios, packing, precision);
        report.packing = measure(stored, names, textures, packed, precision, json);
    }
    const std::string description = text_of(json);
    std::vector<std::string> left;
    if (container.format->sidecar[0] != '\0')
        left = left_behind(names.back(), names);
    report.files = write_together(names, [&](AtomicFile& file, size_t i) {
        if (i == textures.size()) // the sidecar
            return file.write(description);
        const TexelForm& form = form_of(textures[i], precision);
        file.write(container.encode(
            form, form.whole(dims),
            packed.empty() ? pack(texels_of(textures[i], packing, volume, {1, dims.z}), form, dims)
                           : packed[i],
            description));
    });
    remove_files(left);
    return report;
}

std::string read_texture_file(const std::string& path) {
    return read_file(path, uint64_t(1) << 40);
}

void check_texture(const TextureContent& content, const std::string& path, glm::ivec3 dims,
                   size_t channels) {
    if (content.dims != content.form->whole(dims) || !holds(*content.form, channels))
        throw Error(ErrorKind::invalid, path + ": has " + text_of(content.dims) + " texels of "
                                            + std::to_string(content.form->channels)
                                            + " channels; its description says " + text_of(dims)
                                            + " of " + std::to_string(channels));
}

} // namespace lpvbake::io
