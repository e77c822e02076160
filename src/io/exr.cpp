#include "io/exr.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/layout.h"

#include <map>
#include <span>

namespace lpvbake::io {
namespace {

constexpr int max_side = 16384; ///< what engines and drivers take as a picture
constexpr const char* format_name = "lpvbake flipbook";
constexpr const char* extension_of_sidecar = ".json";

/// The layout with the shortest longer side, and among those the smallest area; or the one with the
/// number of columns that is asked for.
Layout choose_layout(glm::ivec3 dims, const Pictures& pictures, const std::string& path) {
    const int wanted = pictures.columns;
    Layout best;
    auto best_cost = std::pair<int64_t, int64_t>(max_side + 1, 0);
    for (int64_t columns = 1; columns <= dims.z && columns * dims.x <= max_side; ++columns) {
        if (wanted > 0 && columns != std::min(wanted, dims.z))
            continue;
        if (pictures.no_empty_tiles && dims.z % columns != 0)
            continue;
        const int64_t rows = (dims.z + columns - 1) / columns;
        const int64_t width = columns * dims.x, height = rows * dims.y;
        const auto cost = std::pair(std::max(width, height), width * height);
        if (cost < best_cost) {
            best_cost = cost;
            best = {int(columns), int(rows)};
        }
    }
    if (best.columns == 0)
        throw Error(ErrorKind::unsupported,
                    path + ": "
                        + (wanted > 0 ? std::to_string(wanted) + " columns of a texture of "
                                      : std::string("a texture of "))
                        + std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x "
                        + std::to_string(dims.z) + " texels does not fit a picture of 16384 a side"
                        + (pictures.no_empty_tiles ? " without empty tiles" : "") + "; write .vdb");
    return best;
}

/// Of the pictures, then of the sidecar.
std::vector<std::string> names_of(const std::string& path, const std::vector<Texture>& textures) {
    std::vector<std::string> names = texture_names(stem_of(path), ".exr", textures);
    names.push_back(stem_of(path) + extension_of_sidecar);
    return names;
}

using Header = std::map<std::string, std::string>;

/// What the header of a picture repeats of the metadata and the sidecar; `entry` is the picture's.
Header header_of(const Volume& volume, const Json& json, const volume::Encoding& encoding,
                 const Json& entry) {
    Header header;
    const Json metadata = metadata_of(volume);
    for (const auto& [key, value] : metadata.items())
        header["lpv:" + key] = value.get<std::string>();
    for (const auto& fact : field_facts(encoding))
        header["lpv:" + fact.first] = json[fact.first].get<std::string>();
    header["lpv:grid_dims"] = json["grid"]["dims"].dump();
    header["lpv:grid_origin"] = json["grid"]["origin"].dump();
    header["lpv:cell_size"] = json["grid"]["cell"].dump();
    header["lpv:sh_order"] = json["sh_order"].dump();
    header["lpv:columns"] = json["layout"]["columns"].dump();
    header["lpv:rows"] = json["layout"]["rows"].dump();
    for (const char* key : {"channels", "blocks"})
        if (entry.contains(key))
            header[std::string("lpv:") + key] = entry[key].dump();
    for (const char* key : {"quantity", "units"})
        header[std::string("lpv:") + key] = entry[key].get<std::string>();
    return header;
}

std::vector<std::string> files_of(const std::string& path, const Volume& volume,
                                  const Pictures& pictures, volume::ShConvention convention) {
    return names_of(path, textures_of(volume, pictures.packing, convention, path));
}

image::Pixels decode_picture(const std::string& path, glm::ivec3 dims, const Layout& layout,
                             size_t channels) {
    const int width = layout.columns * dims.x, height = layout.rows * dims.y;
    const uint64_t texels = uint64_t(width) * uint64_t(height);
    const std::string bytes = read_file(path, (uint64_t(1) << 20) + texels * channels * 8);
    image::Pixels pixels = image::decode_exr(std::as_bytes(std::span(bytes)), path, texels);
    if (pixels.width != width || pixels.height != height || size_t(pixels.channels) != channels)
        throw Error(ErrorKind::invalid, path + ": has " + std::to_string(pixels.width) + " x "
                                            + std::to_string(pixels.height) + " texels of "
                                            + std::to_string(pixels.channels)
                                            + " channels; the sidecar says " + std::to_string(width)
                                            + " x " + std::to_string(height) + " of "
                                            + std::to_string(channels));
    return pixels;
}

} // namespace

constexpr VolumeFormat exr_format{.extension = ".exr",
                                  .sidecar = extension_of_sidecar,
                                  .help =
                                      "NAME.exr, which becomes NAME_sh_l0.exr, ... and NAME.json",
                                  .has_pictures = true,
                                  .files = files_of,
                                  .write = write_exr,
                                  .read = read_exr};

WriteReport write_exr(const std::string& path, const Stored& stored, Precision wanted,
                      const Pictures& pictures) {
    const Volume& volume = stored.volume();
    const Packing packing = pictures.packing;
    const std::vector<Texture> textures =
        textures_of(volume, packing, stored.encoding().convention, path);
    WriteReport report;
    const bool half = stored.precision(wanted, path, report) == Precision::half;
    const Layout layout = choose_layout(stack_of(packing).dims(volume.grid.dims), pictures, path);
    report.columns = layout.columns;
    report.rows = layout.rows;
    const std::vector<std::string> names = names_of(path, textures);
    Json json = describe(format_name, stored, report.precision, packing, textures, names, layout);
    json["metadata"] = metadata_of(volume);
    const std::vector<std::string> left = left_behind(names.back(), names);
    report.files = write_together(names, [&](AtomicFile& file, size_t i) {
        if (i == textures.size())
            return file.write(text_of(json));
        const auto bytes =
            image::encode_exr(texels_of(textures[i], packing, volume, layout), half,
                              header_of(volume, json, stored.encoding(), json["files"][i]), path);
        file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    });
    remove_files(left);
    return report;
}

Volume read_exr(const std::string& path, volume::GridKinds kinds) {
    const std::string sidecar = sidecar_of(path, extension_of_sidecar);
    const std::string text = read_file(sidecar, uint64_t(16) << 20);
    Volume volume = read_description(sidecar, text, [&](const Json& json) {
        Volume read = read_textures(sidecar, json, format_name, kinds, decode_picture);
        check_listed(path, sidecar, extension_of_sidecar, json);
        return read;
    });
    check_volume(volume, sidecar, ErrorKind::invalid);
    return volume;
}

} // namespace lpvbake::io
