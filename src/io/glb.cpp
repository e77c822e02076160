#include "io/glb.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/ktx2.h"
#include "io/layout.h"
#include "io/texture_files.h"
#include "lpvbake/error.h"
#include "lpvbake/pack.h"
#include "quoted.h"
#include "text.h"

#include <glm/gtc/quaternion.hpp>
#include <tbb/parallel_for.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <ostream>

namespace lpvbake::io {
namespace {

constexpr const char* extension = "EXT_light_volume";
// Binary glTF, chapter 4 of the specification of glTF 2.0.
constexpr uint32_t version = 2, json_type = 0x4e4f534a, chunk_type = 0x004e4942;
constexpr size_t head_size = 12, chunk_head_size = 8;
constexpr size_t alignment = 16; ///< of payloads, in the chunk
/// What a box may be off being one of cubes, along the axes.
constexpr double tolerance = 1e-5;

size_t padded(size_t size, size_t to) {
    return (size + to - 1) / to * to;
}

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
    throw Error(ErrorKind::unsupported, path + ": " + why);
}

bool is_used(const Json& object) {
    return object.contains("extensions") && object["extensions"].contains(extension);
}

// ---- writing ----

void check_form(const std::string& path, const volume::Encoding& encoding, Packing packing) {
    using volume::ShConvention;
    const bool is_known = encoding.convention == ShConvention::radiance
                          || encoding.convention == ShConvention::irradiance;
    if (!is_known || encoding.axes != volume::Axes::gltf)
        refuse(path, std::string("holds radiance or irradiance in glTF's axes, not ")
                         + volume::name_of(encoding.convention) + " in those of "
                         + volume::name_of(encoding.axes) + ": write it for generic or threejs");
    if (packing != Packing::band && packing != Packing::channel && packing != Packing::atlas)
        refuse(path, std::string("packing by ") + name_of(packing)
                         + " has no form in it; pack by band, channel or atlas");
}

void refuse_volume(const Json& root, const std::string& place) {
    if (root.is_object() && is_used(root))
        refuse(place, "has a light volume already; for a .glb take the file from before it had");
}

/// A number that reading has made metadata.
void add_number(const char* key, Json& metadata, Json& volume) {
    const auto found = metadata.find(key);
    if (found == metadata.end())
        return;
    volume[key] = std::strtod(found->get_ref<const std::string&>().c_str(), nullptr);
    metadata.erase(found);
}

/// The volume as the extension has it, whose textures are the buffer views from `first_view` on.
Json volume_json(const Stored& stored, Precision precision, Packing packing,
                 const std::vector<Texture>& textures, size_t first_view) {
    const Json facts = describe(extension, stored, precision, packing, textures,
                                std::vector<std::string>(textures.size()));
    Json volume = {{"cells", facts["grid"]["dims"]},
                   {"order", facts["sh_order"]},
                   {"convention", facts["convention"]},
                   {"units", facts["files"][0]["units"]}};
    if (facts["layout"].contains("padding"))
        volume["padding"] = facts["layout"]["padding"];
    for (size_t t = 0; t < textures.size(); ++t) {
        const Json& file = facts["files"][t];
        const char* key = file.contains("blocks") ? "blocks" : "channels";
        volume["textures"].push_back({{"bufferView", first_view + t}, {key, file[key]}});
    }
    Json metadata = metadata_of(stored.volume());
    add_number("priority", metadata, volume);
    add_number("falloff", metadata, volume);
    volume["extras"] = {{"metadata", metadata}};
    return volume;
}

/// Its harmonics would be in the node's axes.
void refuse_turned(const Grid& grid, const std::string& path) {
    if (grid.is_turned())
        refuse(path, "a .glb holds no volume that is turned against its scene; write another kind "
                     "of file");
}

/// Where the volume stands: a node whose unit cube is its box.
void add_node(const Grid& grid, int scene, Json& root) {
    const glm::dvec3 size = grid.cell * glm::dvec3(grid.dims), middle = grid.origin + 0.5 * size;
    root["nodes"].push_back({{"name", "light volume"},
                             {"translation", {middle.x, middle.y, middle.z}},
                             {"scale", {size.x, size.y, size.z}},
                             {"extensions", {{extension, {{"volume", 0}}}}}});
    if (root.contains("scenes"))
        root["scenes"].at(size_t(scene))["nodes"].push_back(root["nodes"].size() - 1);
}

/// The textures as whole KTX2 files.
std::vector<std::string> payloads_of(const std::vector<Texture>& textures, const Volume& volume,
                                     Packing packing, Precision precision, glm::ivec3 dims) {
    std::vector<std::string> payloads(textures.size());
    tbb::parallel_for(size_t(0), textures.size(), [&](size_t t) {
        const TexelForm& form = form_of(textures[t], precision);
        payloads[t] = encode_ktx2(
            form, dims, pack(texels_of(textures[t], packing, volume, {1, dims.z}), form, dims), {});
    });
    return payloads;
}

/// Adds them behind `bytes` bytes of the first buffer. Returns the bytes that it has then.
size_t add_views(const std::vector<std::string>& payloads, size_t bytes, Json& root) {
    for (const std::string& payload : payloads) {
        bytes = padded(bytes, alignment);
        root["bufferViews"].push_back(
            {{"buffer", 0}, {"byteOffset", bytes}, {"byteLength", payload.size()}});
        bytes += payload.size();
    }
    if (!root.contains("buffers"))
        root["buffers"] = Json::array({Json::object()});
    root["buffers"].at(0)["byteLength"] = bytes;
    return bytes;
}

void write_file(const std::string& path, std::string json, std::string_view bytes,
                const std::vector<std::string>& payloads, size_t chunk_size, WriteReport& report) {
    json.resize(padded(json.size(), 4), ' ');
    const size_t chunk = padded(chunk_size, 4);
    const uint64_t size = head_size + 2 * chunk_head_size + json.size() + chunk;
    if (size > UINT32_MAX)
        refuse(path, "would have " + std::to_string(size)
                         + " bytes, and a .glb has at most 4294967295; write the volume as .ktx2");
    AtomicFile file(path);
    file.write([&](std::ostream& out) {
        size_t in_chunk = 0;
        const auto put = [&](std::string_view part) {
            out.write(part.data(), std::streamsize(part.size()));
            in_chunk += part.size();
        };
        const auto pad = [&](size_t to) {
            put(std::string(padded(in_chunk, to) - in_chunk, '\0'));
        };
        std::string head = "glTF";
        for (const uint32_t word : {version, uint32_t(size), uint32_t(json.size()), json_type})
            append_number(head, word);
        put(head + json);
        head.clear();
        append_number(head, uint32_t(chunk));
        append_number(head, chunk_type);
        put(head);
        in_chunk = 0;
        put(bytes);
        for (const std::string& payload : payloads) {
            pad(alignment);
            put(payload);
        }
        pad(4);
    });
    report.files = {{path, file.seal()}};
    file.publish();
}

// ---- reading ----

/// The parts of a binary glTF file.
struct Glb {
    std::string_view json, chunk;
};

Glb parse(std::string_view bytes, const std::string& path) {
    if (bytes.size() < head_size + chunk_head_size || !bytes.starts_with("glTF")
        || number_at<uint32_t>(bytes, 4) != version || number_at<uint32_t>(bytes, 16) != json_type)
        reject(path, "is not a binary glTF 2.0 file");
    const size_t length = number_at<uint32_t>(bytes, 8);
    const auto chunk = [&](size_t at) {
        const size_t begin = at + chunk_head_size, size = number_at<uint32_t>(bytes, at);
        if (length > bytes.size() || begin > length || size > length - begin)
            reject(path, cut_off);
        return bytes.substr(begin, size);
    };
    Glb glb{chunk(head_size), {}};
    if (const size_t next = head_size + chunk_head_size + glb.json.size();
        length - next >= chunk_head_size && number_at<uint32_t>(bytes, next + 4) == chunk_type)
        glb.chunk = chunk(next);
    return glb;
}

size_t whole(const Json& json) {
    if (!json.is_number_unsigned())
        throw std::out_of_range(json.dump() + " is not a whole number");
    return json.get<size_t>();
}

std::string_view view(const Json& root, size_t index, const Glb& glb, const std::string& place) {
    const Json& range = root.at("bufferViews").at(index);
    if (whole(range.at("buffer")) != 0 || root.at("buffers").at(0).contains("uri"))
        reject(place, "is not in the file's binary chunk");
    const size_t offset = range.contains("byteOffset") ? whole(range["byteOffset"]) : 0;
    const size_t size = whole(range.at("byteLength"));
    if (offset > glb.chunk.size() || size > glb.chunk.size() - offset)
        reject(place, "runs past the file's binary chunk");
    return glb.chunk.substr(offset, size);
}

glm::dvec3 three(const Json& node, const char* key, double usual) {
    glm::dvec3 v(usual);
    if (node.contains(key))
        for (int a = 0; a < 3; ++a)
            v[a] = node[key].at(size_t(a)).get<double>();
    return v;
}

glm::dmat4 local_matrix(const Json& node) {
    glm::dmat4 matrix(1);
    if (node.contains("matrix")) {
        for (int i = 0; i < 16; ++i)
            matrix[i / 4][i % 4] = node["matrix"].at(size_t(i)).get<double>();
        return matrix;
    }
    if (node.contains("rotation")) {
        const auto q = [&](size_t i) { return node["rotation"].at(i).get<double>(); };
        matrix = glm::mat4_cast(glm::normalize(glm::dquat(q(3), q(0), q(1), q(2))));
    }
    const glm::dvec3 scale = three(node, "scale", 1);
    for (int a = 0; a < 3; ++a)
        matrix[a] *= scale[a];
    matrix[3] = glm::dvec4(three(node, "translation", 0), 1);
    return matrix;
}

glm::dmat4 world_matrix(const Json& nodes, size_t index, const std::string& path) {
    std::vector<size_t> parents(nodes.size(), nodes.size());
    for (size_t i = 0; i < nodes.size(); ++i)
        if (nodes[i].contains("children"))
            for (const Json& child : nodes[i]["children"])
                parents.at(whole(child)) = i;
    glm::dmat4 matrix(1);
    for (size_t steps = 0; index < nodes.size(); index = parents[index]) {
        if (++steps > nodes.size())
            reject(path, "its nodes are children of themselves");
        matrix = local_matrix(nodes[index]) * matrix;
    }
    return matrix;
}

/// A lattice in axes that `turn`, a signed permutation, takes to those of the scene.
struct Box {
    Grid grid;
    glm::dmat3 turn;
};

/// Of a unit cube of so many cells.
Box box_of(const glm::dmat4& matrix, glm::ivec3 dims, const std::string& path) {
    Box box{{{}, 0, dims}, {}};
    glm::dvec3 cell;
    glm::dmat3 turn;
    for (int a = 0; a < 3; ++a) {
        const double length = glm::length(glm::dvec3(matrix[a]));
        if (!std::isnormal(length))
            reject(path, "its light volume is in a box without an extent");
        turn[a] = glm::dvec3(matrix[a]) / length;
        cell[a] = length / dims[a];
        box.turn[a] = glm::round(turn[a]);
    }
    for (int a = 0; a < 3; ++a)
        if (std::abs(glm::dot(turn[a], turn[(a + 1) % 3])) > tolerance)
            reject(path, "its light volume is in a box that is sheared");
    box.grid.cell = cell.x;
    if (glm::length(cell - cell.x) > tolerance * cell.x)
        refuse(path, format("its light volume has cells of %.6g x %.6g x %.6g m, and cubes alone "
                            "are read",
                            cell.x, cell.y, cell.z));
    for (int a = 0; a < 3; ++a)
        if (glm::length(turn[a] - box.turn[a]) > tolerance)
            refuse(path, "its light volume is turned by other than quarter turns about the axes, "
                         "and these alone are read; turn node and scene together");
    box.grid.origin =
        glm::transpose(box.turn) * glm::dvec3(matrix[3]) - 0.5 * box.grid.cell * glm::dvec3(dims);
    return box;
}

/// The node that has the volume.
size_t node_in(const Json& nodes, const std::string& path) {
    size_t found = nodes.size();
    for (size_t i = 0; i < nodes.size(); ++i)
        if (is_used(nodes[i])) {
            if (found < nodes.size())
                refuse(path, "has several light volumes, and files of one are read");
            found = i;
        }
    if (found == nodes.size())
        reject(path, "has a light volume that stands nowhere: no node names it");
    return found;
}

/// The description (described.h) that says the same.
Json description_of(const Json& volume, const Grid& grid, const std::string& path) {
    Json metadata = Json::object();
    const Json extras = volume.value("extras", Json());
    if (extras.is_object() && extras.contains("metadata"))
        metadata = extras["metadata"];
    for (const char* key : {"priority", "falloff"})
        if (const double number = volume.value(key, 0.0); number != 0)
            metadata[key] = format("%.9g", number);
    Json json = {{"format", extension},
                 {"version", 1},
                 {"grid",
                  {{"dims", volume.at("cells")},
                   {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
                   {"cell", grid.cell}}},
                 {"sh_order", volume.at("order")},
                 {"packing", name_of(Packing::band)},
                 {"layout", {{"padding", volume.value("padding", Json(0))}}},
                 {"metadata", metadata}};
    const auto convention = volume::convention_named(volume.at("convention").get<std::string>());
    if (convention != volume::ShConvention::radiance
        && convention != volume::ShConvention::irradiance)
        reject(path, "the convention of its light volume is " + volume["convention"].dump()
                         + ", neither radiance nor irradiance");
    for (const auto& [key, value] : field_facts({.convention = *convention}))
        json[key] = value;
    const std::string name = std::filesystem::path(path).filename().string();
    for (const Json& texture : volume.at("textures")) {
        const char* key = texture.contains("blocks") ? "blocks" : "channels";
        json["files"].push_back(
            {{"file", name + ": textures[" + std::to_string(json["files"].size()) + "]"},
             {key, texture.at(key)}});
    }
    return json;
}

Volume read_root(const Json& root, const Glb& glb, const std::string& path,
                 volume::GridKinds kinds) {
    if (!root.is_object() || !is_used(root))
        reject(path, "holds no light volume (EXT_light_volume)");
    const Json& nodes = root.at("nodes");
    const size_t node = node_in(nodes, path);
    const Json& volume = root["extensions"][extension].at("volumes").at(
        whole(nodes[node]["extensions"][extension].at("volume")));
    glm::ivec3 dims;
    for (int a = 0; a < 3; ++a) {
        const size_t cells = whole(volume.at("cells").at(size_t(a)));
        if (cells < 1 || cells > max_texture_side)
            reject(path, "its light volume has not 1 to 2048 cells a side");
        dims[a] = int(cells);
    }
    const Box box = box_of(world_matrix(nodes, node, path), dims, path);
    const Json description = description_of(volume, box.grid, path);
    std::map<std::string, size_t> views;
    const std::filesystem::path folder = std::filesystem::path(path).parent_path();
    for (size_t t = 0; t < volume["textures"].size(); ++t)
        views[(folder / description["files"][t]["file"].get<std::string>()).string()] =
            whole(volume["textures"][t].at("bufferView"));
    Volume read = read_textures(
        path, description, extension, kinds,
        [&](const std::string& place, glm::ivec3 texture, const Layout&, size_t channels) {
            return decode_ktx2(view(root, views.at(place), glb, place), place, texture, channels);
        });
    volume::turn_axes(box.turn, read);
    return read;
}

} // namespace

constexpr VolumeFormat glb_format{.extension = ".glb",
                                  .help = "NAME.glb, the scene with the volume in it",
                                  .has_pictures = true,
                                  .has_rgb9e5 = true,
                                  .write = write_glb,
                                  .read = read_glb};

WriteReport write_glb(const std::string& path, const Stored& stored, Precision wanted,
                      const Pictures& pictures) {
    const Volume& volume = stored.volume();
    const Packing packing = pictures.packing;
    check_form(path, stored.encoding(), packing);
    refuse_turned(volume.grid, path);
    const PackedScene empty{
        R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]})", {}, 0, {}};
    const PackedScene& scene = pictures.scene ? *pictures.scene : empty;
    Json root = Json::parse(scene.json);
    refuse_volume(root, path);
    const std::vector<Texture> textures =
        textures_of(volume, packing, stored.encoding().convention, path);
    const glm::ivec3 dims = texture_dims(path, volume.grid.dims, packing);
    WriteReport report;
    report.warnings = scene.warnings;
    const Precision precision = stored.precision(wanted, path, report);
    const std::vector<std::string> payloads =
        payloads_of(textures, volume, packing, precision, dims);

    size_t bytes = 0;
    try {
        const size_t first_view = root.contains("bufferViews") ? root["bufferViews"].size() : 0;
        root["extensionsUsed"].push_back(extension);
        root["extensions"][extension]["volumes"] =
            Json::array({volume_json(stored, precision, packing, textures, first_view)});
        add_node(volume.grid, scene.scene, root);
        bytes = add_views(payloads, scene.bytes.size(), root);
    } catch (const Json::exception& error) {
        reject(path, "the scene is not valid glTF: " + without_label(error.what()));
    }
    write_file(path, root.dump(-1, ' ', false, Json::error_handler_t::replace), scene.bytes,
               payloads, bytes, report);
    return report;
}

Volume read_glb(const std::string& path, volume::GridKinds kinds) {
    const std::string bytes = read_texture_file(path);
    const Glb glb = parse(bytes, path);
    Volume volume = read_description(path, std::string(glb.json), [&](const Json& root) {
        return read_root(root, glb, path, kinds);
    });
    check_volume(volume, path, ErrorKind::invalid);
    return volume;
}

bool has_light_volume(const std::string& path) {
    const std::string bytes = read_texture_file(path);
    if (!bytes.starts_with("glTF")) // JSON under that name
        return false;
    const Json root = Json::parse(parse(bytes, path).json, nullptr, false);
    return root.is_object() && is_used(root);
}

void check_has_no_volume(const PackedScene& scene, const std::string& place) {
    refuse_volume(Json::parse(scene.json), place);
}

} // namespace lpvbake::io
