#include "io/exr.h"

#include "image/image.h"
#include "io/atomic_file.h"
#include "io/layout.h"
#include "quoted.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <deque>
#include <filesystem>
#include <map>
#include <numbers>

namespace lpvbake::io {
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

constexpr const char* names_of_packings[] = {"band", "channel", "vrc", "cube", "atlas"};

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
        throw Error(ErrorKind::unsupported,
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
    const GridKind* kind = &volume::light_kind();
};

/// The scalars of a grid.
std::vector<Component> components(const volume::ConstGridView& grid) {
    std::vector<Component> all;
    all.reserve(size_t(grid.kind->width()));
    for (int c = 0; c < grid.kind->width(); ++c)
        all.push_back({grid.channel_name(c), grid.data + c, size_t(grid.kind->width())});
    return all;
}

/// Irradiance over pi of each cell towards a side of a cube, +x, -x, +y, ...; `volume` is
/// canonical.
std::vector<glm::vec3> cube_side(const Volume& volume, size_t side) {
    std::vector<glm::vec3> values(volume.grid.size());
    glm::vec3 normal(0.0f);
    normal[int(side / 2)] = side % 2 == 0 ? 1.0f : -1.0f;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, values.size()), [&](const auto& range) {
        std::vector<float> coefficients(volume.sh.size());
        for (size_t cell = range.begin(); cell < range.end(); ++cell)
            for (int c = 0; c < 3; ++c) {
                for (size_t k = 0; k < coefficients.size(); ++k)
                    coefficients[k] = volume.sh[k][cell][c];
                values[cell][c] = std::max(0.0f, volume::sh_irradiance(coefficients, normal))
                                  / std::numbers::pi_v<float>;
            }
    });
    return values;
}

/// Names alone: see cube_picture.
Texture cube_texture() {
    Texture cube{"cube", {}};
    for (const char* side : {"px", "nx", "py", "ny", "pz", "nz"}) {
        cube.blocks.emplace_back();
        for (const char colour : {'r', 'g', 'b'})
            cube.blocks.back().push_back({std::string("cube_") + side + "." + colour});
    }
    return cube;
}

/// How many of these share a picture, of one, three or four channels: those of one kind.
size_t grids_in_picture(std::span<const volume::ConstGridView> grids) {
    size_t left = 1;
    while (left < grids.size() && grids[left].kind == grids[0].kind)
        ++left;
    return grids[0].kind->width() == 3 || left < 3 ? 1 : std::min<size_t>(left, 4);
}

std::vector<Texture> textures_of(const Volume& volume, Packing packing,
                                 volume::ShConvention convention) {
    if (packing == Packing::cube)
        return {cube_texture()};
    const std::vector<volume::ConstGridView> light = volume::grids_of(volume, volume::light_kind());
    const auto colours = [&](size_t k) { return components(light[k]); };
    std::vector<Texture> textures;
    const auto add_band = [&](size_t k) { textures.push_back({light[k].name(), {colours(k)}}); };
    const auto add_channels = [&](const char* suffix, std::array<size_t, 4> order) {
        for (int c = 0; c < 3; ++c) {
            textures.push_back({"rgb"[c] + std::string(suffix), {{}}});
            for (const size_t k : order)
                textures.back().blocks[0].push_back(colours(k)[size_t(c)]);
        }
    };
    if (packing == Packing::vrc) {
        constexpr size_t z = 2, bands[] = {0, 3, 1}; // the coefficients 1, x and y
        for (int file = 0; file < 3; ++file) {
            add_band(bands[file]);
            textures.back().suffix = std::to_string(file);
            textures.back().blocks[0].push_back(colours(z)[size_t(file)]);
        }
        return textures;
    }
    if (packing == Packing::atlas) {
        textures.push_back({"atlas", {}});
        for (size_t i = 0; i < 28; ++i) {
            if (i % 4 == 0)
                textures[0].blocks.emplace_back();
            const size_t k = i / 3;
            textures[0].blocks.back().push_back(k < volume.sh.size() ? colours(k)[i % 3]
                                                                     : Component{});
        }
        return textures;
    }
    if (packing == Packing::band) {
        for (size_t k = 0; k < volume.sh.size(); ++k)
            add_band(k);
    } else {
        add_channels("", convention == volume::ShConvention::unity
                             ? std::array<size_t, 4>{3, 1, 2, 0}
                             : std::array<size_t, 4>{0, 1, 2, 3});
        if (volume.sh_order == 2) {
            add_channels("2", {4, 5, 6, 7});
            add_band(8);
        }
    }
    const std::vector<volume::ConstGridView> grids = volume::grids_of(volume);
    for (size_t g = light.size(), count; g < grids.size(); g += count) {
        const volume::ConstGridView& first = grids[g];
        count = grids_in_picture(std::span(grids).subspan(g));
        const bool whole = first.k == 0 && count > 1;
        Texture& texture = textures.emplace_back(
            Texture{whole ? first.kind->name : first.name(), {{}}, first.kind});
        for (size_t i = 0; i < count; ++i)
            for (const Component& component : components(grids[g + i]))
                texture.blocks[0].push_back(component);
    }
    return textures;
}

/// Of the pictures, then of the sidecar.
std::vector<std::string> names_of(const std::string& path, const std::vector<Texture>& textures) {
    std::vector<std::string> names;
    for (const Texture& texture : textures)
        names.push_back(stem_of(path) + "_" + texture.suffix + ".exr");
    names.push_back(stem_of(path) + ".json");
    return names;
}

image::Pixels picture_of(const Texture& texture, glm::ivec3 cells, const Stack& stack,
                         const Layout& layout) {
    const size_t n = texture.blocks[0].size();
    const glm::ivec3 dims = stack.dims(cells);
    image::Pixels pixels{layout.columns * dims.x, layout.rows * dims.y, int(n), {}};
    pixels.samples.resize(size_t(pixels.width) * size_t(pixels.height) * n);
    stack.for_each_texel(cells, layout, [&](size_t texel, int block, size_t cell, bool) {
        for (size_t c = 0; c < n; ++c)
            if (const Component& from = texture.blocks[size_t(block)][c]; from.first)
                pixels.samples[texel * n + c] = from.first[cell * from.stride];
    });
    return pixels;
}

image::Pixels cube_picture(const Volume& volume, const Stack& stack, const Layout& layout) {
    const glm::ivec3 dims = stack.dims(volume.grid.dims);
    image::Pixels pixels{layout.columns * dims.x, layout.rows * dims.y, 3, {}};
    pixels.samples.resize(size_t(pixels.width) * size_t(pixels.height) * 3);
    for (int side = 0; side < stack.blocks; ++side) {
        const std::vector<glm::vec3> values = cube_side(volume, size_t(side));
        stack.for_each_texel(volume.grid.dims, layout,
                             [&](size_t texel, int block, size_t cell, bool) {
                                 if (block == side)
                                     std::copy_n(&values[cell].x, 3, &pixels.samples[texel * 3]);
                             });
    }
    return pixels;
}

/// Throws Error (unsupported) for what a packing has no form for.
void check_packing(const Volume& volume, Packing packing, volume::ShConvention convention,
                   const std::string& path) {
    const auto unless = [&](bool fits, const std::string& what) {
        if (!fits)
            throw Error(ErrorKind::unsupported, path + ": packing by " + what + ", not order "
                                                    + std::to_string(volume.sh_order) + " of "
                                                    + volume::name_of(convention)
                                                    + "; pack by band");
    };
    const int order = volume.sh_order;
    const bool canonical = convention == volume::ShConvention::radiance;
    switch (packing) {
    case Packing::band:
        break;
    case Packing::channel:
        unless(order == 1 || order == 2, "colour channel holds SH order 1 or 2");
        break;
    case Packing::vrc:
        unless(order == 1 && convention == volume::ShConvention::unity,
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

// ---- what is said of the pictures ----

using Header = std::map<std::string, std::string>;

Json metadata_of(const Volume& volume) {
    Json metadata = volume.metadata;
    if (!metadata.contains("tool"))
        metadata["tool"] = "lpvbake " LPVBAKE_VERSION;
    return metadata;
}

/// The sidecar up to the list of files, which is empty.
Json sidecar(const Stored& stored, Packing packing, const Stack& stack, const Layout& layout,
             Precision precision) {
    const Grid& grid = stored.volume().grid;
    const glm::ivec3 dims = grid.dims, texture_dims = stack.dims(dims);
    Json json = {
        {"format", format_name},
        {"version", format_version},
        {"grid",
         {{"dims", {dims.x, dims.y, dims.z}},
          {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
          {"cell", grid.cell}}},
        {"layout",
         {{"columns", layout.columns},
          {"rows", layout.rows},
          {"tile", {texture_dims.x, texture_dims.y}},
          {"slices", texture_dims.z}}},
        {"packing", name_of(packing)},
        {"precision", precision == Precision::half ? "half" : "float"},
        {"sh_order", stored.volume().sh_order},
    };
    if (stack.padding > 0)
        json["layout"]["padding"] = stack.padding;
    for (const auto& [key, value] : field_facts(stored.encoding()))
        json[key] = value;
    if (packing == Packing::cube)
        json["convention"] = "ambient cube";
    json["files"] = Json::array();
    return json;
}

/// What the headers of all pictures repeat of the metadata and the sidecar.
Header common_header(const Stored& stored, const Json& json) {
    Header header;
    const Json metadata = metadata_of(stored.volume());
    for (const auto& [key, value] : metadata.items())
        header["lpv:" + key] = value.get<std::string>();
    for (const auto& fact : field_facts(stored.encoding()))
        header["lpv:" + fact.first] = json[fact.first].get<std::string>();
    header["lpv:grid_dims"] = json["grid"]["dims"].dump();
    header["lpv:grid_origin"] = json["grid"]["origin"].dump();
    header["lpv:cell_size"] = json["grid"]["cell"].dump();
    header["lpv:sh_order"] = json["sh_order"].dump();
    header["lpv:columns"] = json["layout"]["columns"].dump();
    header["lpv:rows"] = json["layout"]["rows"].dump();
    return header;
}

volume::Quantity quantity_in(const Texture& texture, Packing packing, const Stored& stored) {
    if (packing == Packing::cube)
        return {"irradiance / pi", "lx"};
    return volume::quantity_of(*texture.kind, stored.encoding().convention);
}

/// Adds to a picture's header, and fills its entry of the sidecar.
void describe(const Texture& texture, const volume::Quantity& quantity, const std::string& path,
              Header& header, Json& entry) {
    Json blocks = Json::array();
    for (const std::vector<Component>& block : texture.blocks) {
        blocks.push_back(Json::array());
        for (const Component& channel : block)
            blocks.back().push_back(channel.name);
    }
    const bool single = blocks.size() == 1;
    const Json& channels = single ? blocks[0] : blocks;
    header[single ? "lpv:channels" : "lpv:blocks"] = channels.dump();
    header["lpv:quantity"] = quantity.name;
    header["lpv:units"] = quantity.units;
    entry = {{"file", std::filesystem::path(path).filename().string()},
             {"quantity", quantity.name},
             {"units", quantity.units},
             {single ? "channels" : "blocks", channels}};
}

// ---- reading ----

[[noreturn]] void reject(const std::string& path, const std::string& why) {
    throw Error(ErrorKind::invalid, path + ": " + why);
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
        throw std::out_of_range(std::string(key) + " is " + printable(found.dump())
                                + ", expected \"" + value + "\"");
}

/// Where a channel's values go: name -> component, of a volume whose grids have been sized.
std::map<std::string, std::pair<float*, size_t>> destinations(Volume& volume) {
    std::map<std::string, std::pair<float*, size_t>> all;
    for (const volume::GridView& grid : volume::grids_of(volume))
        for (int c = 0; c < grid.kind->width(); ++c)
            all[grid.channel_name(c)] = {grid.data + c, size_t(grid.kind->width())};
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
    const image::Pixels pixels = image::decode_exr(std::as_bytes(std::span(bytes)), path, texels);
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

/// A picture that a sidecar lists.
struct Entry {
    std::string file;
    Names blocks;
    Stack stack;
};

Layout layout_of(const Json& json, glm::ivec3 dims) {
    return {integer(json.at("columns"), 1, max_side / std::min(dims.x, max_side)),
            integer(json.at("rows"), 1, max_side / std::min(dims.y, max_side))};
}

std::vector<Entry> entries_of(const std::string& path, const Json& json, glm::ivec3 dims,
                              const Layout& layout) {
    const int padding =
        json.at("layout").contains("padding") ? integer(json["layout"]["padding"], 0, 1) : 0;
    std::vector<Entry> entries;
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
        if (entry.blocks.empty() || entry.blocks.size() > 16 || entries.size() >= 64)
            reject(path, "lists too many files or blocks, or none");
        entry.stack = {int(entry.blocks.size()), 1, padding};
        if (dims.x > max_side || dims.y > max_side
            || int64_t(layout.columns) * layout.rows < entry.stack.dims(dims).z)
            reject(path, "the layout does not hold all slices");
        entries.push_back(entry);
    }
    return entries;
}

bool mentions(const std::vector<Entry>& entries, const GridKind& kind, int k) {
    const std::string channel = volume::ConstGridView{&kind, k, nullptr, 0}.channel_name(0);
    for (const Entry& entry : entries)
        for (const std::vector<std::string>& block : entry.blocks)
            if (std::ranges::find(block, channel) != block.end())
                return true;
    return false;
}

/// Whether a channel is of one of these kinds, by its name.
bool holds_any(const Entry& entry, volume::GridKinds kinds) {
    const auto is_of = [](const std::string& channel, const std::string& kind) {
        return channel.starts_with(kind)
               && (channel.size() == kind.size() || channel[kind.size()] == '_'
                   || channel[kind.size()] == '.');
    };
    for (const std::vector<std::string>& block : entry.blocks)
        for (const std::string& channel : block)
            if (std::ranges::any_of(kinds, [&](auto* kind) { return is_of(channel, kind->name); }))
                return true;
    return false;
}

Volume read_sidecar(const std::string& path, const Json& json, volume::GridKinds kinds) {
    if (!json.is_object() || !json.contains("format"))
        reject(path, std::string("is not a sidecar of lpvbake: it does not say \"format\": \"")
                         + format_name + '"');
    expect(json, "format", format_name);
    integer(json.at("version"), format_version, format_version);
    if (json.at("packing") == name_of(Packing::cube))
        throw Error(ErrorKind::unsupported,
                    path + ": holds ambient cubes, which cannot be turned back into coefficients");
    const volume::Encoding encoding =
        encoding_of([&](const char* key) { return json.at(key).get<std::string>(); }, path);
    Volume volume;
    const Json& grid = json.at("grid");
    for (int a = 0; a < 3; ++a) {
        volume.grid.dims[a] = integer(grid.at("dims").at(size_t(a)), 1, INT32_MAX);
        volume.grid.origin[a] = grid.at("origin").at(size_t(a)).get<double>();
    }
    const glm::ivec3 dims = volume.grid.dims;
    volume.grid.cell = grid.at("cell").get<double>();
    volume.sh_order = integer(json.at("sh_order"), 0, volume::sh_max_order);
    check_dims(dims, volume.sh_order, kinds, path);
    const Layout layout = layout_of(json.at("layout"), dims);
    const std::vector<Entry> entries = entries_of(path, json, dims, layout);
    for (const GridKind* kind : kinds) {
        int count = kind == &volume::light_kind() ? volume::sh_count(volume.sh_order) : 0;
        if (count == 0 && mentions(entries, *kind, 0))
            for (count = kind->fewest; count < kind->most && mentions(entries, *kind, count);)
                ++count;
        volume::set_grids(volume, *kind, count);
    }
    auto wanted = destinations(volume);
    for (const Entry& entry : entries)
        if (holds_any(entry, kinds))
            read_texture((std::filesystem::path(path).parent_path() / entry.file).string(),
                         entry.blocks, dims, entry.stack, layout, wanted);
    if (!wanted.empty())
        reject(path, "lists no file with \"" + wanted.begin()->first + "\"");
    for (const auto& [key, value] : json.at("metadata").items())
        volume.metadata[key] = value.get<std::string>();
    decode(encoding, path, volume);
    return volume;
}

} // namespace

const char* name_of(Packing packing) {
    return names_of_packings[size_t(packing)];
}

std::optional<Packing> packing_named(std::string_view name) {
    const auto found = std::ranges::find(names_of_packings, name);
    if (found == std::end(names_of_packings))
        return std::nullopt;
    return Packing(found - std::begin(names_of_packings));
}

std::vector<const char*> packing_names() {
    return {std::begin(names_of_packings), std::end(names_of_packings)};
}

namespace {

std::vector<std::string> files_of(const std::string& path, const Volume& volume,
                                  const Pictures& pictures, volume::ShConvention convention) {
    check_packing(volume, pictures.packing, convention, path);
    return names_of(path, textures_of(volume, pictures.packing, convention));
}

} // namespace

constexpr VolumeFormat exr_format{.extension = ".exr",
                                  .sidecar = ".json",
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
    check_packing(volume, packing, stored.encoding().convention, path);
    WriteReport report;
    const bool half = stored.precision(wanted, path, report) == Precision::half;
    const Stack stack = stack_of(packing);
    const Layout layout = choose_layout(stack.dims(volume.grid.dims), pictures, path);
    report.columns = layout.columns;
    report.rows = layout.rows;
    const std::vector<Texture> textures =
        textures_of(volume, packing, stored.encoding().convention);

    Json json = sidecar(stored, packing, stack, layout, report.precision);
    const Header common = common_header(stored, json);
    std::deque<AtomicFile> files; // they do not move
    for (const std::string& name : names_of(path, textures)) {
        files.emplace_back(name);
        report.files.push_back({name, 0});
    }
    std::vector<Header> headers(textures.size(), common);
    for (size_t t = 0; t < textures.size(); ++t)
        describe(textures[t], quantity_in(textures[t], packing, stored), report.files[t].path,
                 headers[t], json["files"].emplace_back());
    json["metadata"] = metadata_of(volume);
    // Names and metadata may come from anywhere; what is not UTF-8 is replaced.
    files.back().write(json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");

    tbb::parallel_for(size_t(0), textures.size(), [&](size_t t) {
        const auto bytes = image::encode_exr(
            packing == Packing::cube ? cube_picture(volume, stack, layout)
                                     : picture_of(textures[t], volume.grid.dims, stack, layout),
            half, headers[t], path);
        files[t].write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    });
    tbb::parallel_for(size_t(0), files.size(),
                      [&](size_t f) { report.files[f].bytes = files[f].seal(); });
    for (AtomicFile& file : files)
        file.publish();
    return report;
}

Volume read_exr(const std::string& path, volume::GridKinds kinds) {
    const std::string sidecar = sidecar_of(path);
    const std::string text = read_file(sidecar, uint64_t(16) << 20);
    Volume volume;
    try {
        const Json json = Json::parse(text);
        volume = read_sidecar(sidecar, json, kinds);
        // A picture stands for its volume only while the sidecar is still that of its volume.
        const std::string name = std::filesystem::path(path).filename().string();
        if (stem_of(path) != stem_of(sidecar)
            && std::ranges::none_of(json["files"],
                                    [&](const Json& file) { return file["file"] == name; }))
            reject(path, "is not of the volume that " + sidecar + " describes");
    } catch (const Json::exception& error) {
        reject(sidecar, "is not a sidecar of lpvbake: " + without_label(error.what()));
    } catch (const std::out_of_range& error) {
        reject(sidecar, error.what());
    }
    check_volume(volume, sidecar, ErrorKind::invalid);
    return volume;
}

} // namespace lpvbake::io
