#include "io/described.h"

#include "io/atomic_file.h"
#include "io/io.h"
#include "io/layout.h"
#include "io/ratios.h"
#include "io/texel.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "volume/sh.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>

namespace lpvbake::io {
namespace {

constexpr int version = 1;
constexpr int max_side = 16384; ///< of a flipbook, and more than any 3D texture has

/// A whole number within [lo, hi]. (nlohmann's own conversion from reals has no defined range.)
int integer(const Json& json, int lo, int hi) {
    if (!json.is_number_integer() || json < lo || json > hi)
        throw std::out_of_range(json.dump() + " is not a whole number from " + std::to_string(lo)
                                + " to " + std::to_string(hi));
    return json.get<int>();
}

volume::Quantity quantity_in(const Texture& texture, Packing packing, const Stored& stored) {
    if (packing == Packing::cube)
        return {"irradiance / pi", "lx"};
    return volume::quantity_of(*texture.kind, stored.encoding().convention);
}

// ---- reading ----

/// Where a channel's values go: name -> component, of a volume whose grids have been sized.
using Destinations = std::map<std::string, std::pair<float*, size_t>>;

Destinations destinations(Volume& volume) {
    Destinations all;
    for (const volume::GridView& grid : volume::grids_of(volume))
        for (int c = 0; c < grid.kind->width(); ++c)
            all[grid.channel_name(c)] = {grid.data + c, size_t(grid.kind->width())};
    return all;
}

/// A file that a description lists.
struct Entry {
    std::string file;
    std::vector<std::vector<std::string>> blocks; ///< of names of channels, each of as many
    std::vector<Range> ranges;                    ///< of the channels, or none
    Stack stack;

    size_t channels() const { return blocks[0].size(); }
};

void copy_texels(const std::string& path, const Entry& entry, const image::Pixels& pixels,
                 glm::ivec3 cells, const Layout& layout, Destinations& wanted) {
    std::vector<std::pair<float*, size_t>> to;
    for (const std::vector<std::string>& block : entry.blocks)
        for (const std::string& name : block) {
            to.push_back({nullptr, 0});
            if (name.empty())
                continue;
            const auto found = wanted.find(name);
            if (found == wanted.end())
                reject(path, "the channel \"" + printable(name)
                                 + "\" that it should hold is unknown, or is given twice");
            to.back() = found->second;
            wanted.erase(found);
        }
    const size_t channels = entry.channels();
    entry.stack.for_each_texel(
        cells, layout, [&](size_t texel, int block, size_t cell, bool padding) {
            for (size_t c = 0; c < channels; ++c)
                if (const auto [first, stride] = to[size_t(block) * channels + c];
                    first && !padding)
                    first[cell * stride] = pixels.samples[texel * channels + c];
        });
}

/// Of a flipbook as it says, of 3D textures a column of slices (none, where blocks are theirs).
std::optional<Layout> flipbook_of(const Json& json, glm::ivec3 dims) {
    if (!json.contains("columns"))
        return {};
    return Layout{integer(json.at("columns"), 1, max_side / std::min(dims.x, max_side)),
                  integer(json.at("rows"), 1, max_side / std::min(dims.y, max_side))};
}

/// Of a texture of light.
std::vector<Range> ranges_in(const std::string& path, const Json& file, const Entry& entry) {
    const auto low = file["low"].get<std::vector<float>>(),
               high = file.at("high").get<std::vector<float>>();
    if (entry.blocks.size() != 1 || low.size() != entry.channels() || high.size() != low.size())
        reject(path, "\"low\" and \"high\" are not numbers for each channel");
    std::vector<Range> ranges;
    for (size_t c = 0; c < low.size(); ++c)
        ranges.push_back({low[c], high[c]});
    return ranges;
}

std::vector<Entry> entries_of(const std::string& path, const Json& json, glm::ivec3 dims,
                              const std::optional<Layout>& flipbook) {
    const Json& layout = json.at("layout");
    const int padding = layout.contains("padding") ? integer(layout["padding"], 0, 1) : 0;
    std::vector<Entry> entries;
    for (const Json& file : json.at("files")) {
        Entry entry;
        entry.file = file.at("file").get<std::string>();
        if (entry.file.empty() || entry.file.find('/') != std::string::npos)
            reject(path,
                   "file \"" + printable(entry.file) + "\" is not the name of a file beside it");
        if (file.contains("blocks"))
            entry.blocks = file["blocks"].get<std::vector<std::vector<std::string>>>();
        else
            entry.blocks = {file.at("channels").get<std::vector<std::string>>()};
        for (const std::vector<std::string>& block : entry.blocks)
            if (block.empty() || block.size() > 4 || block.size() != entry.blocks[0].size())
                reject(path, "lists no channels, too many, or blocks of different ones");
        if (entry.blocks.empty() || entry.blocks.size() > 16 || entries.size() >= 64)
            reject(path, "lists too many files or blocks, or none");
        if (file.contains("low"))
            entry.ranges = ranges_in(path, file, entry);
        entry.stack = {int(entry.blocks.size()), 1, padding};
        if (dims.x > max_side || dims.y > max_side || dims.z > max_side
            || (flipbook && int64_t(flipbook->columns) * flipbook->rows < entry.stack.dims(dims).z))
            reject(path, "the layout does not hold all slices");
        entries.push_back(entry);
    }
    return entries;
}

/// Puts an entry's into those of the volume's light.
void add_ranges(const std::string& path, const Entry& entry, const Volume& volume, Ranges& ranges) {
    for (size_t i = 0; i < entry.ranges.size(); ++i) {
        const std::string& name = entry.blocks[0][i];
        bool is_light = false;
        ranges.resize(volume.sh.size());
        for (size_t k = 0; k < volume.sh.size(); ++k)
            for (size_t c = 0; c < 3; ++c)
                if (name == volume::grid_name(volume::light_kind(), int(k)) + "." + "rgb"[c]) {
                    ranges[k][c] = entry.ranges[i];
                    is_light = true;
                }
        if (!is_light)
            reject(path, "\"low\" and \"high\" are for light, not for \"" + printable(name) + '"');
    }
}

bool mentions(const std::vector<Entry>& entries, const std::string& channel) {
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

} // namespace

Json describe(const char* format, const Stored& stored, Precision precision) {
    const Grid& grid = stored.volume().grid;
    Json json = {
        {"format", format},
        {"version", version},
        {"grid",
         {{"dims", {grid.dims.x, grid.dims.y, grid.dims.z}},
          {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
          {"cell", grid.cell}}},
        {"precision", name_of(precision)},
        {"sh_order", stored.volume().sh_order},
    };
    if (const glm::dquat& turn = grid.turn; grid.is_turned())
        json["grid"]["turn"] = {turn.x, turn.y, turn.z, turn.w};
    for (const auto& [key, value] : field_facts(stored.encoding()))
        json[key] = value;
    return json;
}

Json describe(const char* format, const Stored& stored, Precision precision, Packing packing,
              const std::vector<Texture>& textures, const std::vector<std::string>& files,
              const std::optional<Layout>& flipbook) {
    Json json = describe(format, stored, precision);
    const Stack stack = stack_of(packing);
    const glm::ivec3 dims = stack.dims(stored.volume().grid.dims);
    Json& layout = json["layout"];
    if (flipbook)
        layout = {{"columns", flipbook->columns}, {"rows", flipbook->rows}};
    layout["tile"] = {dims.x, dims.y};
    layout["slices"] = dims.z;
    if (stack.padding > 0)
        layout["padding"] = stack.padding;
    json["packing"] = name_of(packing);
    if (packing == Packing::cube)
        json["convention"] = "ambient cube";
    for (size_t t = 0; t < textures.size(); ++t) {
        Json blocks = Json::array();
        for (const std::vector<Component>& block : textures[t].blocks) {
            blocks.push_back(Json::array());
            for (const Component& channel : block)
                blocks.back().push_back(channel.name);
        }
        const bool single = blocks.size() == 1;
        const volume::Quantity quantity = quantity_in(textures[t], packing, stored);
        Json& file = json["files"].emplace_back(
            Json{{"file", std::filesystem::path(files[t]).filename().string()},
                 {"quantity", quantity.name},
                 {"units", quantity.units},
                 {single ? "channels" : "blocks", single ? blocks[0] : blocks}});
        const glm::ivec3 texels = form_of(textures[t], precision).whole(dims);
        if (texels != dims)
            file["texels"] = {texels.x, texels.y, texels.z};
        for (const Component& channel : textures[t].blocks[0])
            if (channel.range) {
                file["low"].push_back(channel.range->low);
                file["high"].push_back(channel.range->high);
            }
    }
    return json;
}

Json metadata_of(const Volume& volume) {
    Json metadata = volume.metadata;
    if (!metadata.contains("tool"))
        metadata["tool"] = "lpvbake " LPVBAKE_VERSION;
    return metadata;
}

std::string text_of(const Json& description) {
    return description.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Volume read_description(const std::string& path, const std::string& text,
                        const std::function<Volume(const Json&)>& read) {
    try {
        return read(Json::parse(text));
    } catch (const Json::exception& error) {
        reject(path, "does not describe a volume of lpvbake: " + without_label(error.what()));
    } catch (const std::out_of_range& error) {
        reject(path, error.what());
    }
}

Volume empty_volume(const std::string& path, const Json& json, const char* format,
                    volume::GridKinds kinds) {
    if (!json.is_object() || !json.contains("format"))
        reject(path,
               std::string("does not describe a volume of lpvbake: it does not say \"format\": \"")
                   + format + '"');
    if (const Json& found = json["format"]; found != format)
        reject(path, "format is " + printable(found.dump()) + ", expected \"" + format + "\"");
    integer(json.at("version"), version, version);
    Volume volume;
    const Json& grid = json.at("grid");
    for (int a = 0; a < 3; ++a) {
        volume.grid.dims[a] = integer(grid.at("dims").at(size_t(a)), 1, INT32_MAX);
        volume.grid.origin[a] = grid.at("origin").at(size_t(a)).get<double>();
    }
    volume.grid.cell = grid.at("cell").get<double>();
    if (grid.contains("turn"))
        for (int a = 0; a < 4; ++a)
            volume.grid.turn[a] = grid["turn"].at(size_t(a)).get<double>();
    volume.sh_order = integer(json.at("sh_order"), 0, volume::sh_max_order);
    check_dims(volume.grid.dims, volume.sh_order, kinds, path);
    for (const auto& [key, value] : json.at("metadata").items())
        volume.metadata[key] = value.get<std::string>();
    return volume;
}

volume::Encoding encoding_in(const std::string& path, const Json& json) {
    return encoding_of([&](const char* key) { return json.at(key).get<std::string>(); }, path);
}

int count_grids(const Volume& volume, const GridKind& kind,
                const std::function<bool(const std::string&)>& has) {
    if (&kind == &volume::light_kind())
        return volume::sh_count(volume.sh_order);
    if (!has(volume::grid_name(kind, 0)))
        return 0;
    int count = kind.fewest;
    while (count < kind.most && has(volume::grid_name(kind, count)))
        ++count;
    return count;
}

namespace {

std::string stem_beside(const std::string& path, const std::string& sidecar) {
    return path.ends_with(sidecar) ? path.substr(0, path.size() - sidecar.size()) : stem_of(path);
}

} // namespace

std::string sidecar_of(const std::string& path, const std::string& sidecar) {
    const std::filesystem::path stem = stem_beside(path, sidecar);
    std::string name = stem.filename().string();
    const auto beside = [&] { return stem.parent_path() / (name + sidecar); };
    std::error_code ignored;
    while (!std::filesystem::exists(beside(), ignored)) {
        const size_t end = name.rfind('_');
        if (end == std::string::npos || end == 0)
            return stem.string() + sidecar;
        name.resize(end);
    }
    return beside().string();
}

std::vector<std::string> left_behind(const std::string& sidecar,
                                     const std::vector<std::string>& files) {
    namespace fs = std::filesystem;
    std::vector<std::string> left;
    std::ifstream in(sidecar);
    const Json json = Json::parse(in, nullptr, false);
    if (!json.is_object() || !json.contains("files") || !json["files"].is_array())
        return left;
    const std::string name = fs::path(sidecar).filename(),
                      stem = name.substr(0, name.find('.')) + "_";
    for (const Json& file : json["files"]) {
        if (!file.is_object() || !file.contains("file") || !file["file"].is_string())
            return {};
        const std::string own = file["file"];
        const std::string path = fs::path(sidecar).replace_filename(own);
        if (own.starts_with(stem) && own.find('/') == own.npos
            && std::ranges::find(files, path) == files.end())
            left.push_back(path);
    }
    return left;
}

void add_with_textures(const std::string& path, std::vector<std::string>& files) {
    files.push_back(path);
    const VolumeFormat* format = volume_format(path);
    if (!format || format->sidecar[0] == '\0')
        return;
    const std::string sidecar = sidecar_of(path, format->sidecar);
    std::ranges::move(left_behind(sidecar, {}), std::back_inserter(files));
    files.push_back(sidecar);
}

std::string with_suffix(const std::string& path, const std::string& suffix) {
    const std::filesystem::path whole(path);
    return (whole.parent_path() / (whole.stem().string() + suffix + whole.extension().string()))
        .string();
}

void check_listed(const std::string& path, const std::string& described, const std::string& sidecar,
                  const Json& json) {
    // A texture stands for its volume only while the description is still that of its volume.
    const std::string name = std::filesystem::path(path).filename().string();
    if (stem_beside(path, sidecar) != stem_beside(described, sidecar)
        && std::ranges::none_of(json.at("files"),
                                [&](const Json& file) { return file.at("file") == name; }))
        reject(path, "is not of the volume that " + described + " describes");
}

Volume read_texels(const std::string& path, const Json& json, const char* format,
                   volume::GridKinds wanted_kinds, const Decode& decode, Ranges& ranges) {
    std::vector<const GridKind*> kinds(wanted_kinds.begin(), wanted_kinds.end());
    if (std::ranges::find(kinds, &volume::light_kind()) != kinds.end())
        kinds.push_back(&base_kind);
    Volume volume = empty_volume(path, json, format, kinds);
    if (json.at("packing") == name_of(Packing::cube))
        throw Error(ErrorKind::unsupported,
                    path + ": holds ambient cubes, which cannot be turned back into coefficients");
    const glm::ivec3 dims = volume.grid.dims;
    const std::optional<Layout> flipbook = flipbook_of(json.at("layout"), dims);
    const std::vector<Entry> entries = entries_of(path, json, dims, flipbook);
    for (const GridKind* kind : kinds)
        make_grids(volume, *kind,
                   count_grids(volume, *kind,
                               [&](const std::string& name) {
                                   return mentions(entries, kind->width() == 1
                                                                ? name
                                                                : name + "." + kind->channels[0]);
                               }),
                   path);
    Destinations wanted = destinations(volume);
    const std::filesystem::path folder = std::filesystem::path(path).parent_path();
    for (const Entry& entry : entries) {
        if (!holds_any(entry, kinds))
            continue;
        add_ranges(path, entry, volume, ranges);
        const std::string file = (folder / entry.file).string();
        const glm::ivec3 texture = entry.stack.dims(dims);
        const Layout layout = flipbook.value_or(Layout{1, texture.z});
        copy_texels(file, entry, decode(file, texture, layout, entry.channels()), dims, layout,
                    wanted);
    }
    if (!wanted.empty())
        reject(path, "lists no file with \"" + wanted.begin()->first + "\"");
    return volume;
}

Volume read_textures(const std::string& path, const Json& json, const char* format,
                     volume::GridKinds kinds, const Decode& decode) {
    Ranges ranges;
    Volume volume = read_texels(path, json, format, kinds, decode, ranges);
    if (!ranges.empty())
        from_ratios(ranges, volume);
    io::decode(encoding_in(path, json), path, volume);
    return volume;
}

} // namespace lpvbake::io
