#include "scene/gltf/document.h"

#include "scene/gltf/accessor.h"
#include "scene/gltf/compression.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/schema.h"

#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <exception>

namespace lpvbake::scene::gltf {
namespace {

using nlohmann::json;

/// What is read. Anything else that a file requires is refused, anything else that it uses is named
/// in a warning.
constexpr const char* understood_extensions[] = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
};

/// What a diffuse bake has no use for, so that nothing is lost where it is left out.
constexpr const char* irrelevant_extensions[] = {
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_volume",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
};

constexpr const char* meshopt_extensions[] = {"EXT_meshopt_compression", "KHR_meshopt_compression"};

// ---------------------------------------------------------------- the container

/// The JSON and the binary chunk of a .glb, or the text of a .gltf.
struct Container {
    std::string_view text;
    Bytes chunk;
};

uint32_t little_endian(Bytes bytes, size_t offset) {
    return bytes[offset] | bytes[offset + 1] << 8 | bytes[offset + 2] << 16
           | static_cast<uint32_t>(bytes[offset + 3]) << 24;
}

Container open_container(Bytes bytes, const std::string& file) {
    const auto refuse = [&](const std::string& why) {
        throw Error(ErrorKind::invalid, file + ": " + why + "; copy or export it again");
    };
    const auto* begin = reinterpret_cast<const char*>(bytes.data());
    if (bytes.size() < 4 || std::memcmp(begin, "glTF", 4) != 0)
        return {{begin, bytes.size()}, {}};
    if (bytes.size() < 20)
        refuse("the binary glTF is cut off in its header");
    if (const uint32_t version = little_endian(bytes, 4); version != 2)
        throw Error(ErrorKind::unsupported, file + ": binary glTF version "
                                                + std::to_string(version)
                                                + " is not supported, 2 is; convert the file");
    const uint64_t length = little_endian(bytes, 8);
    const uint64_t json_length = little_endian(bytes, 12);
    if (length > bytes.size())
        refuse("the binary glTF is cut off: it should have " + std::to_string(length)
               + " bytes and has " + std::to_string(bytes.size()));
    if (little_endian(bytes, 16) != 0x4E4F534A || 20 + json_length > length)
        refuse("the binary glTF's first chunk is not whole JSON");
    Container container{{begin + 20, json_length}, {}};
    const uint64_t chunk = 20 + json_length;
    if (chunk + 8 > length)
        return container;
    const uint64_t chunk_length = little_endian(bytes, chunk);
    if (chunk + 8 + chunk_length > length)
        refuse("the binary glTF's second chunk runs past the file");
    if (little_endian(bytes, chunk + 4) == 0x004E4942)
        container.chunk = bytes.subspan(chunk + 8, chunk_length);
    return container;
}

// ---------------------------------------------------------------- the JSON

void check_version(const json& root, const std::string& file) {
    const auto version = root["asset"]["version"].get<std::string>();
    if (!version.starts_with("2."))
        throw Error(ErrorKind::unsupported, file + ": asset.version: glTF " + version
                                                + " is not supported, 2.0 is; convert the file");
    const auto least = root["asset"].find("minVersion");
    if (least != root["asset"].end() && *least != "2.0")
        throw Error(ErrorKind::unsupported, file + ": asset.minVersion: glTF " + least->dump()
                                                + " is not supported, 2.0 is; convert the file");
}

template <size_t N>
bool is_among(const char* const (&names)[N], const std::string& name) {
    return std::find(std::begin(names), std::end(names), name) != std::end(names);
}

std::vector<std::string> strings(const json& root, const char* key) {
    return root.value(key, std::vector<std::string>());
}

/// Those of a list that are not understood, separated by commas.
std::string not_understood(const std::vector<std::string>& extensions) {
    std::string names;
    for (const std::string& name : extensions)
        if (!is_among(understood_extensions, name) && !is_among(irrelevant_extensions, name))
            names += (names.empty() ? "" : ", ") + name;
    return names;
}

void check_extensions(const json& root, Document& document) {
    if (const std::string missing = not_understood(strings(root, "extensionsRequired"));
        !missing.empty())
        document.fail("extensionsRequired",
                      "not supported: " + missing + "; export the scene without them",
                      ErrorKind::unsupported);
    if (const std::string ignored = not_understood(strings(root, "extensionsUsed"));
        !ignored.empty())
        document.warnings.add("extensionsUsed", "extensionsUsed",
                              "not understood and ignored: " + ignored
                                  + "; export the scene without them if they matter");
}

/// Takes an array out of the document.
json taken(json& root, const char* key) {
    json array = json::array();
    if (const auto found = root.find(key); found != root.end()) {
        array.swap(*found);
        root.erase(found);
    }
    return array;
}

// ---------------------------------------------------------------- buffers

bool is_marked_as_fallback(const json& buffer) {
    const json extensions = buffer.value("extensions", json::object());
    for (const char* name : meshopt_extensions)
        if (extensions.contains(name) && extensions[name].value("fallback", false))
            return true;
    return false;
}

/// A buffer without bytes stands in for what its views hold compressed (meshopt's fallback).
struct Buffer {
    Bytes bytes;
    bool has_bytes = false;
};

std::vector<Buffer> read_buffers(const json& list, Bytes chunk, Document& document) {
    std::vector<Buffer> buffers(list.size());
    for (size_t i = 0; i < list.size(); ++i) {
        const std::string place = at("buffers", i);
        const auto length = list[i]["byteLength"].get<uint64_t>();
        if (length == 0)
            document.fail(place + ".byteLength", "must be at least 1");
        if (is_marked_as_fallback(list[i]))
            continue;
        const auto& uri =
            list[i].contains("uri") ? list[i]["uri"].get_ref<const std::string&>() : std::string();
        if (uri.empty()) {
            if (i != 0 || chunk.empty())
                continue;
            if (chunk.size() < length)
                document.fail(place, "byteLength is " + std::to_string(length)
                                         + ", the file's binary chunk has "
                                         + std::to_string(chunk.size()) + " bytes");
            buffers[i] = {chunk.first(length), true};
            continue;
        }
        const std::string uri_place = document.file + ": " + place + ".uri";
        if (uri.starts_with("data:")) {
            document.memory.take(uri.size(), 1, place + ".uri");
            document.storage.push_back(decode_data_uri(uri, uri_place));
            if (document.storage.back().size() < length)
                document.fail(place + ".uri", "does not hold byteLength bytes");
        } else {
            document.memory.take(length, 1, place);
            document.storage.push_back(
                read_file(resolve_uri(document.folder, uri, uri_place, document.allow_external),
                          uri_place, length));
            if (document.storage.back().size() < length)
                document.fail(place + ".uri",
                              "the file has " + std::to_string(document.storage.back().size())
                                  + " bytes, byteLength is " + std::to_string(length));
        }
        buffers[i] = {Bytes(document.storage.back()).first(length), true};
    }
    return buffers;
}

Bytes slice_of(const Document& document, const std::vector<Buffer>& buffers, const json& range,
               const std::string& place) {
    const auto index = range["buffer"].get<size_t>();
    const auto offset = range.value("byteOffset", uint64_t{0});
    const auto length = range["byteLength"].get<uint64_t>();
    const std::string buffer = at("buffers", index);
    if (!buffers[index].has_bytes)
        document.fail(buffer,
                      "has neither a uri nor a chunk of a binary file, and " + place + " reads it");
    const Bytes bytes = buffers[index].bytes;
    if (offset > bytes.size() || length > bytes.size() - offset)
        document.fail(place, "runs past " + buffer + ", which has " + std::to_string(bytes.size())
                                 + " bytes");
    return bytes.subspan(offset, length);
}

/// Slices the buffers, and decompresses what is compressed.
void read_views(const json& list, const std::vector<Buffer>& buffers, Document& document) {
    struct Compressed {
        size_t view;
        MeshoptView data;
        std::string place;
        std::vector<unsigned char> result;
    };
    std::vector<Compressed> compressed;
    document.views.resize(list.size());
    for (size_t i = 0; i < list.size(); ++i) {
        const std::string place = at("bufferViews", i);
        View& view = document.views[i];
        view.stride = list[i].value("byteStride", uint64_t{0});
        const json extensions = list[i].value("extensions", json::object());
        const auto extension =
            std::find_if(std::begin(meshopt_extensions), std::end(meshopt_extensions),
                         [&](const char* name) { return extensions.contains(name); });
        if (extension == std::end(meshopt_extensions)) {
            view.bytes = slice_of(document, buffers, list[i], place);
            continue;
        }
        const json& packed = extensions[*extension];
        const std::string packed_place = place + ".extensions." + *extension;
        const MeshoptView data{
            slice_of(document, buffers, packed, packed_place), packed["count"].get<uint64_t>(),
            packed["byteStride"].get<uint64_t>(), packed["mode"].get<std::string>(),
            packed.value("filter", std::string("NONE"))};
        const auto length = list[i]["byteLength"].get<uint64_t>();
        check_meshopt(data, length, document.file + ": " + packed_place);
        document.memory.take(length, 1, place);
        compressed.push_back({i, data, document.file + ": " + packed_place, {}});
    }
    for_all(compressed.size(), [&](size_t i) {
        compressed[i].result = decode_meshopt(compressed[i].data, compressed[i].place);
    });
    for (Compressed& entry : compressed) {
        document.storage.push_back(std::move(entry.result));
        document.views[entry.view].bytes = document.storage.back();
    }
}

std::vector<ImageSource> image_sources(json& list) {
    std::vector<ImageSource> images;
    for (json& image : list) {
        ImageSource source;
        source.name = image.value("name", std::string());
        if (const auto view = image.find("bufferView"); view != image.end())
            source.view = view->get<int>();
        else if (const auto uri = image.find("uri"); uri != image.end())
            source.uri = std::move(uri->get_ref<std::string&>());
        images.push_back(std::move(source));
    }
    return images;
}

// ---------------------------------------------------------------- tinygltf

std::string first_line(const std::string& text) {
    return text.substr(0, std::min<size_t>(text.find('\n'), 200));
}

/// Gives every accessor a buffer view: tinygltf 2.7.0 refuses indices without one, which Draco's
/// are. Returns those that had none.
std::vector<size_t> add_missing_views(json& root) {
    std::vector<size_t> without;
    if (!root.contains("accessors"))
        return without;
    json& accessors = root["accessors"];
    for (size_t i = 0; i < accessors.size(); ++i)
        if (!accessors[i].contains("bufferView")) {
            accessors[i]["bufferView"] = 0;
            without.push_back(i);
        }
    if (!without.empty() && (!root.contains("bufferViews") || root["bufferViews"].empty()))
        root["bufferViews"] = {{{"buffer", 0}, {"byteLength", 1}}};
    return without;
}

tinygltf::Model parse_model(json root, const Document& document) {
    const std::vector<size_t> without_view = add_missing_views(root);
    tinygltf::TinyGLTF parser;
    tinygltf::Model model;
    std::string error, warning;
    bool ok = false;
    try {
        const std::string text = root.dump();
        ok = parser.LoadASCIIFromString(&model, &error, &warning, text.data(),
                                        static_cast<unsigned>(text.size()), "");
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& exception) {
        error = exception.what();
    }
    if (!ok)
        throw Error(ErrorKind::invalid, document.file + ": is not valid glTF: " + first_line(error)
                                            + "; repair the file or export it again");
    for (const size_t accessor : without_view)
        model.accessors.at(accessor).bufferView = -1;
    return model;
}

} // namespace

void Document::fail(const std::string& place, const std::string& why, ErrorKind kind) const {
    const bool has_remedy = why.find(';') != std::string::npos;
    throw Error(kind, file + ": " + place + ": " + why
                          + (has_remedy || kind != ErrorKind::invalid
                                 ? ""
                                 : "; repair the file or export it again"));
}

std::string at(const char* array, size_t index) {
    return std::string(array) + "[" + std::to_string(index) + "]";
}

void for_all(size_t count, const std::function<void(size_t)>& f) {
    std::vector<std::exception_ptr> errors(count);
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
        try {
            f(i);
        } catch (...) {
            errors[i] = std::current_exception();
        }
    });
    for (const std::exception_ptr& error : errors)
        if (error)
            std::rethrow_exception(error);
}

const tinygltf::Value* find_extension(const tinygltf::ExtensionMap& extensions, const char* name) {
    const auto found = extensions.find(name);
    return found == extensions.end() ? nullptr : &found->second;
}

std::vector<std::string> variant_names(const Document& document) {
    std::vector<std::string> names;
    if (const auto* extension = find_extension(document.model.extensions, "KHR_materials_variants");
        extension && extension->Has("variants")) {
        const tinygltf::Value& variants = extension->Get("variants");
        for (size_t i = 0; i < variants.ArrayLen(); ++i) {
            const tinygltf::Value& variant = variants.Get(static_cast<int>(i));
            names.push_back(variant.Has("name") ? variant.Get("name").Get<std::string>() : "");
        }
    }
    return names;
}

int find_named(const std::vector<std::string>& names, const std::string& text,
               const char* setting) {
    if (const auto found = std::find(names.begin(), names.end(), text); found != names.end())
        return static_cast<int>(found - names.begin());
    size_t index = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
    if (error == std::errc() && end == text.data() + text.size() && index < names.size())
        return static_cast<int>(index);
    std::string known;
    for (size_t i = 0; i < std::min<size_t>(names.size(), 20); ++i)
        known +=
            (i ? ", " : "") + std::to_string(i) + (names[i].empty() ? "" : " \"" + names[i] + "\"");
    throw Error(ErrorKind::argument,
                std::string(setting) + " " + text + ": the file has no such; it has "
                    + (names.empty() ? "none" : known) + (names.size() > 20 ? ", ..." : ""));
}

Document parse_document(const std::string& path, const LoadSettings& settings) {
    Document document{.file = path,
                      .folder = std::filesystem::path(path).parent_path(),
                      .allow_external = settings.allow_external,
                      .model = {},
                      .images = {},
                      .views = {},
                      .warnings = Warnings(path),
                      .memory = MemoryLimit(path, settings.max_memory),
                      .storage = {}};
    document.memory.take(file_size(path, path), 1, "the file");
    document.storage.push_back(read_file(path, path));
    const Container container = open_container(document.storage.front(), path);
    document.memory.take(json_elements(container.text, path), json_element_bytes, "its JSON");
    json root = parse_json(container.text, path);
    check_schema(root, path);
    check_version(root, path);
    check_extensions(root, document);
    const std::vector<std::string> used = strings(root, "extensionsUsed");
    document.quantized = std::find(used.begin(), used.end(), "KHR_mesh_quantization") != used.end();
    read_views(root.value("bufferViews", json::array()),
               read_buffers(taken(root, "buffers"), container.chunk, document), document);
    json images = taken(root, "images");
    document.images = image_sources(images);
    document.model = parse_model(std::move(root), document);
    return document;
}

} // namespace lpvbake::scene::gltf
