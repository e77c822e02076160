#include "io/exr.h"

#include "image/image.h"
#include "io/atomic_file.h"
#include "io/layout.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <deque>
#include <filesystem>
#include <map>

namespace lpvbake {
namespace {

using Json = nlohmann::ordered_json;

constexpr int max_side = 16384; ///< what engines and drivers take as a texture
constexpr const char* format_name = "lpvbake flipbook";
constexpr int format_version = 1;

/// STEM of STEM.exr or STEM.json.
std::string stem_of(const std::string& path) {
    return std::filesystem::path(path).replace_extension().string();
}

/// STEM.json of STEM.exr and, where that is missing, of one of its pictures STEM_sh_l1_y.exr.
std::string sidecar_of(const std::string& path) {
    const std::filesystem::path stem = stem_of(path);
    std::string name = stem.filename().string();
    const auto beside = [&] { return stem.parent_path() / (name + ".json"); };
    std::error_code ignored;
    while (!std::filesystem::exists(beside(), ignored)) {
        const size_t end = name.rfind('_');
        if (end == std::string::npos || end == 0)
            return stem.string() + ".json";
        name.resize(end);
    }
    return beside().string();
}

// ---- layout ----

struct Layout {
    int columns = 0;
    int rows = 0;

    /// Row-major texel index of a cell in the picture of dims.x * columns texels a row.
    size_t texel(glm::ivec3 dims, glm::ivec3 cell) const {
        const size_t x = size_t(cell.z % columns) * size_t(dims.x) + size_t(cell.x);
        const size_t y = size_t(cell.z / columns) * size_t(dims.y) + size_t(cell.y);
        return y * size_t(columns) * size_t(dims.x) + x;
    }
};

/// The layout with the shortest longer side, and among those the smallest area; or the one with
/// `wanted` columns, if that is not 0.
Layout choose_layout(glm::ivec3 dims, int wanted, const std::string& path) {
    Layout best;
    auto best_cost = std::pair<int64_t, int64_t>(max_side + 1, 0);
    for (int64_t columns = 1; columns <= dims.z && columns * dims.x <= max_side; ++columns) {
        if (wanted > 0 && columns != std::min(wanted, dims.z))
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
        throw Error(ExitCode::unsupported,
                    path + ": "
                        + (wanted > 0 ? std::to_string(wanted) + " columns of a grid of "
                                      : std::string("a grid of "))
                        + std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x "
                        + std::to_string(dims.z)
                        + " cells does not fit a picture of 16384 texels a side; write .vdb");
    return best;
}

// ---- which channel of which file holds what ----

/// A scalar of the volume: the floats of one grid, or of one colour of an RGB grid.
struct Component {
    std::string name; ///< e.g. sh_l1_y.g
    const float* first = nullptr;
    size_t stride = 0; ///< floats from cell to cell
};

struct Texture {
    std::string suffix; ///< of the file's name: STEM_suffix.exr
    std::vector<Component> channels;
};

Component colour(const Volume& volume, size_t k, int c) {
    return {std::string("sh_") + coefficient_name(int(k)) + "." + "rgb"[c], &volume.sh[k][0].x + c,
            3};
}

std::vector<Texture> textures_of(const Volume& volume, Packing packing, ShConvention convention) {
    std::vector<Texture> textures;
    const auto add_band = [&](size_t k) {
        textures.push_back({std::string("sh_") + coefficient_name(int(k)),
                            {colour(volume, k, 0), colour(volume, k, 1), colour(volume, k, 2)}});
    };
    const auto add_channels = [&](const char* suffix, std::array<size_t, 4> order) {
        for (int c = 0; c < 3; ++c) {
            textures.push_back({"rgb"[c] + std::string(suffix), {}});
            for (const size_t k : order)
                textures.back().channels.push_back(colour(volume, k, c));
        }
    };
    if (packing == Packing::band) {
        for (size_t k = 0; k < volume.sh.size(); ++k)
            add_band(k);
    } else {
        add_channels("", convention == ShConvention::unity ? std::array<size_t, 4>{3, 1, 2, 0}
                                                           : std::array<size_t, 4>{0, 1, 2, 3});
        if (volume.sh_order == 2) {
            add_channels("2", {4, 5, 6, 7});
            add_band(8);
        }
    }
    if (!volume.occlusion.empty()) {
        Texture texture{"occlusion", {}};
        for (size_t k = 0; k < 4; ++k)
            texture.channels.push_back({std::string("occlusion_") + coefficient_name(int(k)),
                                        volume.occlusion[k].data(), 1});
        textures.push_back(texture);
    }
    if (!volume.validity.empty())
        textures.push_back({"validity", {{"validity", volume.validity.data(), 1}}});
    return textures;
}

Pixels picture_of(const Texture& texture, glm::ivec3 dims, const Layout& layout) {
    const size_t n = texture.channels.size();
    Pixels pixels{layout.columns * dims.x, layout.rows * dims.y, int(n), {}};
    pixels.samples.resize(size_t(pixels.width) * size_t(pixels.height) * n);
    size_t cell = 0;
    for (int z = 0; z < dims.z; ++z)
        for (int y = 0; y < dims.y; ++y)
            for (int x = 0; x < dims.x; ++x, ++cell)
                for (size_t c = 0; c < n; ++c)
                    pixels.samples[layout.texel(dims, {x, y, z}) * n + c] =
                        texture.channels[c].first[cell * texture.channels[c].stride];
    return pixels;
}

// ---- reading ----

[[noreturn]] void reject(const std::string& path, const std::string& why) {
    throw Error(ExitCode::invalid, path + ": " + why);
}

/// A whole number within [lo, hi]. (nlohmann's own conversion from reals has no defined range.)
int integer(const Json& json, int lo, int hi) {
    if (!json.is_number_integer() || json < lo || json > hi)
        throw std::out_of_range(json.dump() + " is not a whole number from " + std::to_string(lo)
                                + " to " + std::to_string(hi));
    return json.get<int>();
}

void expect(const Json& json, const char* key, const std::string& value) {
    if (const Json& found = json.at(key); found != value)
        throw std::out_of_range(std::string(key) + " is " + found.dump() + ", expected \"" + value
                                + "\"");
}

/// Where a channel's values go: name -> component, of a volume whose grids have been sized.
std::map<std::string, std::pair<float*, size_t>> destinations(Volume& volume) {
    std::map<std::string, std::pair<float*, size_t>> all;
    for (size_t k = 0; k < volume.sh.size(); ++k)
        for (int c = 0; c < 3; ++c)
            all[colour(volume, k, c).name] = {&volume.sh[k][0].x + c, 3};
    for (size_t k = 0; k < volume.occlusion.size(); ++k)
        all[std::string("occlusion_") + coefficient_name(int(k))] = {volume.occlusion[k].data(), 1};
    if (!volume.validity.empty())
        all["validity"] = {volume.validity.data(), 1};
    return all;
}

void read_texture(const std::string& path, const std::vector<std::string>& channels,
                  glm::ivec3 dims, const Layout& layout,
                  std::map<std::string, std::pair<float*, size_t>>& wanted) {
    const int width = layout.columns * dims.x, height = layout.rows * dims.y;
    const uint64_t texels = uint64_t(width) * uint64_t(height);
    const std::string bytes = read_file(path, (uint64_t(1) << 20) + texels * channels.size() * 8);
    const Pixels pixels = decode_exr(std::as_bytes(std::span(bytes)), path, texels);
    if (pixels.width != width || pixels.height != height
        || size_t(pixels.channels) != channels.size())
        reject(path, "has " + std::to_string(pixels.width) + " x " + std::to_string(pixels.height)
                         + " texels of " + std::to_string(pixels.channels)
                         + " channels; the sidecar says " + std::to_string(width) + " x "
                         + std::to_string(height) + " of " + std::to_string(channels.size()));
    for (size_t c = 0; c < channels.size(); ++c) {
        const auto found = wanted.find(channels[c]);
        if (found == wanted.end())
            reject(path,
                   "the sidecar's channel \"" + channels[c] + "\" is unknown, or is given twice");
        const auto [first, stride] = found->second;
        size_t cell = 0;
        for (int z = 0; z < dims.z; ++z)
            for (int y = 0; y < dims.y; ++y)
                for (int x = 0; x < dims.x; ++x, ++cell)
                    first[cell * stride] =
                        pixels.samples[layout.texel(dims, {x, y, z}) * channels.size() + c];
        wanted.erase(found);
    }
}

Volume read_sidecar(const std::string& path, const Json& json) {
    expect(json, "format", format_name);
    integer(json.at("version"), format_version, format_version);
    const Encoding encoding =
        encoding_of([&](const char* key) { return json.at(key).get<std::string>(); }, path);
    Volume volume;
    const Json& grid = json.at("grid");
    for (int a = 0; a < 3; ++a) {
        volume.grid.dims[a] = integer(grid.at("dims").at(size_t(a)), 1, INT32_MAX);
        volume.grid.origin[a] = grid.at("origin").at(size_t(a)).get<double>();
    }
    const glm::ivec3 dims = volume.grid.dims;
    volume.grid.cell = grid.at("cell").get<double>();
    volume.sh_order = integer(json.at("sh_order"), 0, sh_max_order);
    check_dims(dims, 3 * sh_count(volume.sh_order) + 5, path);
    const Layout layout{
        integer(json.at("layout").at("columns"), 1, max_side / std::min(dims.x, max_side)),
        integer(json.at("layout").at("rows"), 1, max_side / std::min(dims.y, max_side))};
    if (dims.x > max_side || dims.y > max_side || int64_t(layout.columns) * layout.rows < dims.z)
        reject(path, "the layout does not hold all slices");

    struct Entry {
        std::string file;
        std::vector<std::string> channels;
    };
    std::vector<Entry> entries;
    const auto mentions = [&](const char* channel) {
        return std::any_of(entries.begin(), entries.end(), [&](const Entry& entry) {
            return std::find(entry.channels.begin(), entry.channels.end(), channel)
                   != entry.channels.end();
        });
    };
    for (const Json& file : json.at("files")) {
        entries.push_back({file.at("file").get<std::string>(),
                           file.at("channels").get<std::vector<std::string>>()});
        const std::string& name = entries.back().file;
        if (name.empty() || name.find('/') != std::string::npos)
            reject(path, "file \"" + name + "\" is not the name of a file beside the sidecar");
        if (entries.back().channels.size() > 4 || entries.size() > 32)
            reject(path, "lists too many files or channels");
    }
    const size_t cells = volume.grid.size();
    volume.sh.assign(size_t(sh_count(volume.sh_order)), std::vector<glm::vec3>(cells));
    if (mentions("occlusion_l0"))
        volume.occlusion.assign(4, std::vector<float>(cells));
    if (mentions("validity"))
        volume.validity.assign(cells, 0.0f);
    auto wanted = destinations(volume);
    for (const Entry& entry : entries)
        read_texture((std::filesystem::path(path).parent_path() / entry.file).string(),
                     entry.channels, dims, layout, wanted);
    if (!wanted.empty())
        reject(path, "lists no file with \"" + wanted.begin()->first + "\"");
    for (const auto& [key, value] : json.at("metadata").items())
        volume.metadata[key] = value.get<std::string>();
    return encoding == Encoding{} ? volume : decoded(std::move(volume), encoding, path);
}

} // namespace

WriteReport write_exr(const std::string& path, const Volume& canonical, Precision precision,
                      Packing packing, const Encoding& encoding, int columns) {
    check_volume(canonical, path, ExitCode::failure);
    if (packing == Packing::channel && canonical.sh_order != 1 && canonical.sh_order != 2)
        throw Error(ExitCode::unsupported,
                    path + ": packing by colour channel holds SH order 1 or 2, not "
                        + std::to_string(canonical.sh_order) + "; pack by band");
    std::optional<Volume> encoded_one;
    const Volume& volume = encoding == Encoding{}
                               ? canonical
                               : encoded_one.emplace(encoded(canonical, encoding, path));
    WriteReport report;
    if (precision == Precision::half)
        if (const auto why = half_misfit(volume)) {
            precision = Precision::full;
            report.warnings.push_back(path + ": " + *why);
        }
    const glm::ivec3 dims = volume.grid.dims;
    const Layout layout = choose_layout(dims, columns, path);
    const char* precision_name = precision == Precision::half ? "half" : "float";
    const std::string stem = stem_of(path);
    const std::vector<Texture> textures = textures_of(volume, packing, encoding.convention);

    Json json = {
        {"format", format_name},
        {"version", format_version},
        {"grid",
         {{"dims", {dims.x, dims.y, dims.z}},
          {"origin", {volume.grid.origin.x, volume.grid.origin.y, volume.grid.origin.z}},
          {"cell", volume.grid.cell}}},
        {"layout",
         {{"columns", layout.columns},
          {"rows", layout.rows},
          {"tile", {dims.x, dims.y}},
          {"slices", dims.z}}},
        {"packing", packing == Packing::band ? "band" : "channel"},
        {"precision", precision_name},
        {"sh_order", volume.sh_order},
    };
    Json metadata = volume.metadata;
    if (!metadata.contains("tool"))
        metadata["tool"] = "lpvbake " LPVBAKE_VERSION;
    std::map<std::string, std::string> common;
    for (const auto& [key, value] : metadata.items())
        common["lpv:" + key] = value.get<std::string>();
    for (const auto& [key, value] : field_facts(encoding))
        json[key] = common["lpv:" + key] = value;
    common["lpv:grid_dims"] = json["grid"]["dims"].dump();
    common["lpv:grid_origin"] = json["grid"]["origin"].dump();
    common["lpv:cell_size"] = json["grid"]["cell"].dump();
    common["lpv:sh_order"] = std::to_string(volume.sh_order);
    common["lpv:columns"] = std::to_string(layout.columns);
    common["lpv:rows"] = std::to_string(layout.rows);
    json["files"] = Json::array();

    std::deque<AtomicFile> files; // they do not move
    std::vector<std::map<std::string, std::string>> headers;
    for (const Texture& texture : textures) {
        const std::string file = stem + "_" + texture.suffix + ".exr";
        const auto [quantity, units] = grid_quantity(texture.channels[0].name, encoding.convention);
        Json channels = Json::array();
        for (const Component& channel : texture.channels)
            channels.push_back(channel.name);
        headers.push_back(common);
        headers.back()["lpv:channels"] = channels.dump();
        headers.back()["lpv:quantity"] = quantity;
        headers.back()["lpv:units"] = units;
        json["files"].push_back({{"file", std::filesystem::path(file).filename().string()},
                                 {"quantity", quantity},
                                 {"units", units},
                                 {"channels", channels}});
        files.emplace_back(file);
        report.files.push_back({file, 0});
    }
    json["metadata"] = metadata;
    files.emplace_back(stem + ".json");
    report.files.push_back({stem + ".json", 0});
    // Names and metadata may come from anywhere; what is not UTF-8 is replaced.
    files.back().write(json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");

    tbb::parallel_for(size_t(0), textures.size(), [&](size_t t) {
        const auto bytes = encode_exr(picture_of(textures[t], dims, layout),
                                      precision == Precision::half, headers[t], path);
        files[t].write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    });
    tbb::parallel_for(size_t(0), files.size(),
                      [&](size_t f) { report.files[f].bytes = files[f].seal(); });
    for (AtomicFile& file : files)
        file.publish();
    return report;
}

Volume read_exr(const std::string& path) {
    const std::string sidecar = sidecar_of(path);
    const std::string text = read_file(sidecar, uint64_t(16) << 20);
    Volume volume;
    try {
        volume = read_sidecar(sidecar, Json::parse(text));
    } catch (const Json::exception& error) {
        std::string what = error.what();
        std::replace(what.begin(), what.end(), '\n', ' ');
        reject(sidecar, "is not a sidecar of lpvbake: " + what);
    } catch (const std::out_of_range& error) {
        reject(sidecar, error.what());
    }
    check_volume(volume, sidecar, ExitCode::invalid);
    return volume;
}

} // namespace lpvbake
