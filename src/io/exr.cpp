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
#include <numbers>

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

constexpr const char* packing_names[] = {"band", "channel", "vrc", "cube", "atlas"};

// ---- layout ----

struct Layout {
    int columns = 0;
    int rows = 0;

    /// Row-major index of a texel of a texture of `dims` in the picture of dims.x * columns texels
    /// a row.
    size_t texel(glm::ivec3 dims, glm::ivec3 at) const {
        const size_t x = size_t(at.z % columns) * size_t(dims.x) + size_t(at.x);
        const size_t y = size_t(at.z / columns) * size_t(dims.y) + size_t(at.y);
        return y * size_t(columns) * size_t(dims.x) + x;
    }
};

/// How blocks of cells make a texture: `rows` of them along y, and what is more behind along z,
/// each between `padding` copies of its outermost slices.
struct Stack {
    int blocks = 1;
    int rows = 1;
    int padding = 0;

    glm::ivec3 dims(glm::ivec3 cells) const {
        return {cells.x, cells.y * rows, (cells.z + 2 * padding) * (blocks / rows)};
    }
    /// Calls visit(texel, block, cell, whether it is padding) for all texels of a texture.
    template <class Visit>
    void for_each_texel(glm::ivec3 cells, const Layout& layout, const Visit& visit) const {
        const glm::ivec3 texture = dims(cells);
        for (int block = 0; block < blocks; ++block) {
            const glm::ivec3 first(0, block % rows * cells.y,
                                   block / rows * (cells.z + 2 * padding) + padding);
            for (int z = -padding; z < cells.z + padding; ++z) {
                const int slice = std::clamp(z, 0, cells.z - 1);
                size_t cell = size_t(slice) * size_t(cells.x) * size_t(cells.y);
                for (int y = 0; y < cells.y; ++y)
                    for (int x = 0; x < cells.x; ++x, ++cell)
                        visit(layout.texel(texture, first + glm::ivec3(x, y, z)), block, cell,
                              z != slice);
            }
        }
    }
};

Stack stack_of(Packing packing) {
    if (packing == Packing::cube)
        return {6, 2, 0};
    if (packing == Packing::atlas)
        return {7, 1, 1};
    return {};
}

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
        throw Error(ExitCode::unsupported,
                    path + ": "
                        + (wanted > 0 ? std::to_string(wanted) + " columns of a texture of "
                                      : std::string("a texture of "))
                        + std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x "
                        + std::to_string(dims.z) + " texels does not fit a picture of 16384 a side"
                        + (pictures.no_empty_tiles ? " without empty tiles" : "") + "; write .vdb");
    return best;
}

// ---- which channel of which file holds what ----

/// A scalar of the volume: the floats of one grid, or of one colour of an RGB grid; or, without a
/// name, zeros.
struct Component {
    std::string name; ///< e.g. sh_l1_y.g
    const float* first = nullptr;
    size_t stride = 0; ///< floats from cell to cell
};

struct Texture {
    std::string suffix; ///< of the file's name: STEM_suffix.exr
    /// What the channels hold, block by block, all of as many channels.
    std::vector<std::vector<Component>> blocks;
};

/// The three scalars of a grid.
std::vector<Component> components(const std::string& name, const std::vector<glm::vec3>& grid,
                                  const char* letters = "rgb") {
    std::vector<Component> all;
    for (int c = 0; c < 3; ++c)
        all.push_back({name + "." + letters[c], &grid[0].x + c, 3});
    return all;
}

std::vector<Component> colours(const Volume& volume, size_t k) {
    return components(std::string("sh_") + coefficient_name(int(k)), volume.sh[k]);
}

std::vector<Component> wall_axes(const Volume& volume, size_t k) {
    return components(wall_name(int(k)), volume.walls[k], "xyz");
}

/// Irradiance over pi of each cell towards +x, -x, +y, ...; `volume` is canonical.
std::vector<std::vector<glm::vec3>> ambient_cube(const Volume& volume) {
    std::vector<std::vector<glm::vec3>> sides(6, std::vector<glm::vec3>(volume.grid.size()));
    tbb::parallel_for(size_t(0), sides.size(), [&](size_t side) {
        glm::vec3 normal(0.0f);
        normal[int(side / 2)] = side % 2 == 0 ? 1.0f : -1.0f;
        std::vector<float> coefficients(volume.sh.size());
        for (size_t cell = 0; cell < volume.grid.size(); ++cell)
            for (int c = 0; c < 3; ++c) {
                for (size_t k = 0; k < coefficients.size(); ++k)
                    coefficients[k] = volume.sh[k][cell][c];
                sides[side][cell][c] =
                    std::max(0.0f, sh_irradiance(coefficients, normal)) / std::numbers::pi_v<float>;
            }
    });
    return sides;
}

std::vector<Texture> cube_textures(const std::vector<std::vector<glm::vec3>>& sides) {
    constexpr const char* names[] = {"cube_px", "cube_nx", "cube_py",
                                     "cube_ny", "cube_pz", "cube_nz"};
    Texture cube{"cube", {}};
    for (size_t side = 0; side < 6; ++side)
        cube.blocks.push_back(components(names[side], sides[side]));
    return {cube};
}

std::vector<Texture> textures_of(const Volume& volume, Packing packing, ShConvention convention) {
    std::vector<Texture> textures;
    const auto add_band = [&](size_t k) {
        textures.push_back({std::string("sh_") + coefficient_name(int(k)), {colours(volume, k)}});
    };
    const auto add_channels = [&](const char* suffix, std::array<size_t, 4> order) {
        for (int c = 0; c < 3; ++c) {
            textures.push_back({"rgb"[c] + std::string(suffix), {{}}});
            for (const size_t k : order)
                textures.back().blocks[0].push_back(colours(volume, k)[size_t(c)]);
        }
    };
    if (packing == Packing::vrc) {
        constexpr size_t z = 2, bands[] = {0, 3, 1}; // the coefficients 1, x and y
        for (int file = 0; file < 3; ++file) {
            add_band(bands[file]);
            textures.back().suffix = std::to_string(file);
            textures.back().blocks[0].push_back(colours(volume, z)[size_t(file)]);
        }
        return textures;
    }
    if (packing == Packing::atlas) {
        textures.push_back({"atlas", {}});
        for (size_t i = 0; i < 28; ++i) {
            if (i % 4 == 0)
                textures[0].blocks.emplace_back();
            const size_t k = i / 3;
            textures[0].blocks.back().push_back(k < volume.sh.size() ? colours(volume, k)[i % 3]
                                                                     : Component{});
        }
        return textures;
    }
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
        Texture texture{"occlusion", {{}}};
        for (size_t k = 0; k < 4; ++k)
            texture.blocks[0].push_back({std::string("occlusion_") + coefficient_name(int(k)),
                                         volume.occlusion[k].data(), 1});
        textures.push_back(texture);
    }
    if (!volume.validity.empty())
        textures.push_back({"validity", {{{"validity", volume.validity.data(), 1}}}});
    for (size_t k = 0; k < volume.walls.size(); ++k)
        textures.push_back({wall_name(int(k)), {wall_axes(volume, k)}});
    return textures;
}

Pixels picture_of(const Texture& texture, glm::ivec3 cells, const Stack& stack,
                  const Layout& layout) {
    const size_t n = texture.blocks[0].size();
    const glm::ivec3 dims = stack.dims(cells);
    Pixels pixels{layout.columns * dims.x, layout.rows * dims.y, int(n), {}};
    pixels.samples.resize(size_t(pixels.width) * size_t(pixels.height) * n);
    stack.for_each_texel(cells, layout, [&](size_t texel, int block, size_t cell, bool) {
        for (size_t c = 0; c < n; ++c)
            if (const Component& from = texture.blocks[size_t(block)][c]; from.first)
                pixels.samples[texel * n + c] = from.first[cell * from.stride];
    });
    return pixels;
}

/// Throws Error (unsupported) for what a packing has no form for.
void check_packing(const Volume& volume, Packing packing, ShConvention convention,
                   const std::string& path) {
    const auto unless = [&](bool fits, const std::string& what) {
        if (!fits)
            throw Error(ExitCode::unsupported, path + ": packing by " + what + ", not order "
                                                   + std::to_string(volume.sh_order) + " of "
                                                   + name_of(convention) + "; pack by band");
    };
    const int order = volume.sh_order;
    const bool canonical = convention == ShConvention::radiance;
    switch (packing) {
    case Packing::band:
        break;
    case Packing::channel:
        unless(order == 1 || order == 2, "colour channel holds SH order 1 or 2");
        break;
    case Packing::vrc:
        unless(order == 1 && convention == ShConvention::unity,
               "vrc holds SH order 1 of the convention unity");
        break;
    case Packing::cube:
        unless(canonical, "cube is made of the convention radiance");
        break;
    case Packing::atlas:
        unless(canonical && order <= 2, "atlas holds SH orders 0 to 2 of the convention radiance");
        break;
    }
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
            all[colours(volume, k)[size_t(c)].name] = {&volume.sh[k][0].x + c, 3};
    for (size_t k = 0; k < volume.occlusion.size(); ++k)
        all[std::string("occlusion_") + coefficient_name(int(k))] = {volume.occlusion[k].data(), 1};
    if (!volume.validity.empty())
        all["validity"] = {volume.validity.data(), 1};
    for (size_t k = 0; k < volume.walls.size(); ++k)
        for (int axis = 0; axis < 3; ++axis)
            all[wall_axes(volume, k)[size_t(axis)].name] = {&volume.walls[k][0].x + axis, 3};
    return all;
}

/// Blocks of names of channels, each of as many.
using Names = std::vector<std::vector<std::string>>;

void read_texture(const std::string& path, const Names& blocks, glm::ivec3 cells,
                  const Stack& stack, const Layout& layout,
                  std::map<std::string, std::pair<float*, size_t>>& wanted) {
    const size_t channels = blocks[0].size();
    const glm::ivec3 dims = stack.dims(cells);
    const int width = layout.columns * dims.x, height = layout.rows * dims.y;
    const uint64_t texels = uint64_t(width) * uint64_t(height);
    const std::string bytes = read_file(path, (uint64_t(1) << 20) + texels * channels * 8);
    const Pixels pixels = decode_exr(std::as_bytes(std::span(bytes)), path, texels);
    if (pixels.width != width || pixels.height != height || size_t(pixels.channels) != channels)
        reject(path, "has " + std::to_string(pixels.width) + " x " + std::to_string(pixels.height)
                         + " texels of " + std::to_string(pixels.channels)
                         + " channels; the sidecar says " + std::to_string(width) + " x "
                         + std::to_string(height) + " of " + std::to_string(channels));
    std::vector<std::pair<float*, size_t>> to;
    for (const std::vector<std::string>& block : blocks)
        for (const std::string& name : block) {
            to.push_back({nullptr, 0});
            if (name.empty())
                continue;
            const auto found = wanted.find(name);
            if (found == wanted.end())
                reject(path,
                       "the sidecar's channel \"" + name + "\" is unknown, or is given twice");
            to.back() = found->second;
            wanted.erase(found);
        }
    stack.for_each_texel(cells, layout, [&](size_t texel, int block, size_t cell, bool padding) {
        for (size_t c = 0; c < channels; ++c)
            if (const auto [first, stride] = to[size_t(block) * channels + c]; first && !padding)
                first[cell * stride] = pixels.samples[texel * channels + c];
    });
}

Volume read_sidecar(const std::string& path, const Json& json) {
    expect(json, "format", format_name);
    integer(json.at("version"), format_version, format_version);
    if (json.at("packing") == name_of(Packing::cube))
        throw Error(ExitCode::unsupported,
                    path + ": holds ambient cubes, which cannot be turned back into coefficients");
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
    check_dims(dims, 3 * sh_count(volume.sh_order) + 5 + 3 * most_walls, path);
    const Layout layout{
        integer(json.at("layout").at("columns"), 1, max_side / std::min(dims.x, max_side)),
        integer(json.at("layout").at("rows"), 1, max_side / std::min(dims.y, max_side))};
    const int padding =
        json.at("layout").contains("padding") ? integer(json["layout"]["padding"], 0, 1) : 0;

    struct Entry {
        std::string file;
        Names blocks;
        Stack stack;
    };
    std::vector<Entry> entries;
    const auto mentions = [&](const std::string& channel) {
        for (const Entry& entry : entries)
            for (const std::vector<std::string>& block : entry.blocks)
                if (std::ranges::find(block, channel) != block.end())
                    return true;
        return false;
    };
    for (const Json& file : json.at("files")) {
        Entry entry{file.at("file").get<std::string>(), {}, {}};
        if (entry.file.empty() || entry.file.find('/') != std::string::npos)
            reject(path,
                   "file \"" + entry.file + "\" is not the name of a file beside the sidecar");
        if (file.contains("blocks"))
            entry.blocks = file["blocks"].get<Names>();
        else
            entry.blocks = {file.at("channels").get<std::vector<std::string>>()};
        for (const std::vector<std::string>& block : entry.blocks)
            if (block.size() > 4 || block.size() != entry.blocks[0].size())
                reject(path, "lists too many channels, or blocks of different ones");
        if (entry.blocks.empty() || entry.blocks.size() > 16 || entries.size() >= 32)
            reject(path, "lists too many files or blocks, or none");
        entry.stack = {int(entry.blocks.size()), 1, padding};
        if (dims.x > max_side || dims.y > max_side
            || int64_t(layout.columns) * layout.rows < entry.stack.dims(dims).z)
            reject(path, "the layout does not hold all slices");
        entries.push_back(entry);
    }
    const size_t cells = volume.grid.size();
    volume.sh.assign(size_t(sh_count(volume.sh_order)), std::vector<glm::vec3>(cells));
    if (mentions("occlusion_l0"))
        volume.occlusion.assign(4, std::vector<float>(cells));
    if (mentions("validity"))
        volume.validity.assign(cells, 0.0f);
    while (volume.walls.size() < size_t(most_walls)
           && mentions(wall_name(int(volume.walls.size())) + ".x"))
        volume.walls.emplace_back(cells, glm::vec3(0.0f));
    auto wanted = destinations(volume);
    for (const Entry& entry : entries)
        read_texture((std::filesystem::path(path).parent_path() / entry.file).string(),
                     entry.blocks, dims, entry.stack, layout, wanted);
    if (!wanted.empty())
        reject(path, "lists no file with \"" + wanted.begin()->first + "\"");
    for (const auto& [key, value] : json.at("metadata").items())
        volume.metadata[key] = value.get<std::string>();
    return encoding == Encoding{} ? volume : decoded(std::move(volume), encoding, path);
}

} // namespace

const char* name_of(Packing packing) {
    return packing_names[size_t(packing)];
}

std::optional<Packing> packing_named(std::string_view name) {
    const auto found = std::ranges::find(packing_names, name);
    if (found == std::end(packing_names))
        return std::nullopt;
    return Packing(found - std::begin(packing_names));
}

WriteReport write_exr(const std::string& path, const Volume& canonical, Precision precision,
                      const Pictures& pictures, const Encoding& encoding) {
    check_volume(canonical, path, ExitCode::failure);
    const Packing packing = pictures.packing;
    check_packing(canonical, packing, encoding.convention, path);
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
    report.precision = precision;
    const glm::ivec3 dims = volume.grid.dims;
    const Stack stack = stack_of(packing);
    const glm::ivec3 texture_dims = stack.dims(dims);
    const Layout layout = choose_layout(texture_dims, pictures, path);
    report.columns = layout.columns;
    report.rows = layout.rows;
    const char* precision_name = precision == Precision::half ? "half" : "float";
    const std::string stem = stem_of(path);
    std::vector<std::vector<glm::vec3>> cube;
    if (packing == Packing::cube)
        cube = ambient_cube(volume);
    const std::vector<Texture> textures = packing == Packing::cube
                                              ? cube_textures(cube)
                                              : textures_of(volume, packing, encoding.convention);

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
          {"tile", {texture_dims.x, texture_dims.y}},
          {"slices", texture_dims.z}}},
        {"packing", name_of(packing)},
        {"precision", precision_name},
        {"sh_order", volume.sh_order},
    };
    if (stack.padding > 0)
        json["layout"]["padding"] = stack.padding;
    Json metadata = volume.metadata;
    if (!metadata.contains("tool"))
        metadata["tool"] = "lpvbake " LPVBAKE_VERSION;
    std::map<std::string, std::string> common;
    for (const auto& [key, value] : metadata.items())
        common["lpv:" + key] = value.get<std::string>();
    for (const auto& [key, value] : field_facts(encoding))
        json[key] = common["lpv:" + key] = value;
    if (packing == Packing::cube)
        json["convention"] = common["lpv:convention"] = "ambient cube";
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
        const auto [quantity, units] =
            packing == Packing::cube
                ? std::pair<std::string, std::string>("irradiance / pi", "lx")
                : grid_quantity(texture.blocks[0][0].name, encoding.convention);
        Json blocks = Json::array();
        for (const std::vector<Component>& block : texture.blocks) {
            blocks.push_back(Json::array());
            for (const Component& channel : block)
                blocks.back().push_back(channel.name);
        }
        const bool single = blocks.size() == 1;
        const Json& channels = single ? blocks[0] : blocks;
        headers.push_back(common);
        headers.back()[single ? "lpv:channels" : "lpv:blocks"] = channels.dump();
        headers.back()["lpv:quantity"] = quantity;
        headers.back()["lpv:units"] = units;
        json["files"].push_back({{"file", std::filesystem::path(file).filename().string()},
                                 {"quantity", quantity},
                                 {"units", units},
                                 {single ? "channels" : "blocks", channels}});
        files.emplace_back(file);
        report.files.push_back({file, 0});
    }
    json["metadata"] = metadata;
    files.emplace_back(stem + ".json");
    report.files.push_back({stem + ".json", 0});
    // Names and metadata may come from anywhere; what is not UTF-8 is replaced.
    files.back().write(json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");

    tbb::parallel_for(size_t(0), textures.size(), [&](size_t t) {
        const auto bytes = encode_exr(picture_of(textures[t], dims, stack, layout),
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
        const Json json = Json::parse(text);
        volume = read_sidecar(sidecar, json);
        // A picture stands for its volume only while the sidecar is still that of its volume.
        const std::string name = std::filesystem::path(path).filename().string();
        if (stem_of(path) != stem_of(sidecar)
            && std::ranges::none_of(json["files"],
                                    [&](const Json& file) { return file["file"] == name; }))
            reject(path, "is not of the volume that " + sidecar + " describes");
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
