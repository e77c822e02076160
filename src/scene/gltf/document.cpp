#include "scene/gltf/document.h"

#include "quoted.h"
#include "scene/gltf/accessor.h"
#include "scene/gltf/compression.h"
#include "scene/gltf/container.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/json_text.h"
#include "scene/gltf/repair.h"
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
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
};

/// What a diffuse bake has no use for, so that nothing is lost where it is left out.
constexpr const char* irrelevant_extensions[] = {
    "EXT_light_volume",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
};

constexpr const char* meshopt_extensions[] = {"EXT_meshopt_compression", "KHR_meshopt_compression"};

// ---------------------------------------------------------------- the JSON

/// True for a document of glTF 1.0 that does not say so: its arrays were objects.
bool looks_like_version_1(const json& root) {
    for (const char* key : {"buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes"})
        if (const auto found = root.find(key); found != root.end() && found->is_object())
            return true;
    return false;
}

/// Comes before all other checks: they are of glTF 2.0.
void check_version(const json& root, const std::string& file) {
    const auto refuse = [&](const std::string& key, const std::string& version) {
        throw Error(ErrorKind::unsupported, file + ": asset." + key + ": glTF " + printable(version)
                                                + " is not supported, 2.0 is; convert the file");
    };
    if (!root.is_object())
        return;
    const json asset = root.value("asset", json(nullptr));
    const json version = asset.is_object() ? asset.value("version", json(nullptr)) : json(nullptr);
    if (version.is_string() && !version.get_ref<const std::string&>().starts_with("2."))
        refuse("version", version.get<std::string>());
    if (version.is_number() && version.get<double>() < 2.0)
        refuse("version", version.dump());
    if (version.is_null() && looks_like_version_1(root))
        refuse("version", "1.0");
    if (!asset.is_object())
        return;
    const auto least = asset.find("minVersion");
    if (least != asset.end() && *least != "2.0")
        refuse("minVersion", least->dump());
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
            names += (names.empty() ? "" : ", ") + printable(name);
    return printable(names, 400);
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

/// A buffer without bytes stands in for what its views hold compressed (meshopt's fallback), or has
/// a fault.
struct Buffer {
    Bytes bytes;
    bool has_bytes = false;
    std::optional<Error> fault = {};
};

/// What is left out as long as nobody wants it. Throws the error again if it is not the file's.
std::optional<Error> left_out(const Error& error, Document& document) {
    if (error.kind == ErrorKind::memory)
        throw error;
    document.warnings.add("buffers", error, "left out");
    return error;
}

/// The bytes that a URI stands for, at least `length`.
Bytes read_uri(const std::string& uri, uint64_t length, const std::string& place,
               Document& document) {
    const std::string uri_place = document.file + ": " + place + ".uri";
    std::vector<unsigned char> bytes;
    if (is_data_uri(uri)) {
        document.memory.take(uri.size(), 1, place + ".uri");
        bytes = decode_data_uri(uri, uri_place);
        if (bytes.size() < length)
            document.fail(place + ".uri", "does not hold byteLength bytes");
    } else {
        document.memory.take(length, 1, place);
        bytes = document.file_beside(uri, uri_place, length);
        if (bytes.size() < length)
            document.fail(place + ".uri", "the file has " + std::to_string(bytes.size())
                                              + " bytes, byteLength is " + std::to_string(length));
    }
    document.storage.push_back(std::move(bytes));
    return document.storage.back();
}

Buffer read_buffer(const json& buffer, size_t index, Bytes chunk, Document& document) {
    const std::string place = at("buffers", index);
    const auto length = buffer["byteLength"].get<uint64_t>();
    if (length == 0)
        document.fail(place + ".byteLength", "must be at least 1");
    if (is_marked_as_fallback(buffer))
        return {};
    const auto& uri =
        buffer.contains("uri") ? buffer["uri"].get_ref<const std::string&>() : std::string();
    if (!uri.empty())
        return {read_uri(uri, length, place, document).first(length), true};
    if (index != 0 || chunk.empty())
        return {};
    if (chunk.size() < length)
        document.fail(place, "byteLength is " + std::to_string(length)
                                 + ", the file's binary chunk has " + std::to_string(chunk.size())
                                 + " bytes");
    return {chunk.first(length), true};
}

std::vector<Buffer> read_buffers(const json& list, Bytes chunk, Document& document) {
    std::vector<Buffer> buffers(list.size());
    for (size_t i = 0; i < list.size(); ++i)
        try {
            buffers[i] = read_buffer(list[i], i, chunk, document);
        } catch (const Error& error) {
            buffers[i].fault = left_out(error, document);
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

View read_view(const json& source, const std::vector<Buffer>& buffers, const std::string& place,
               Document& document) {
    View view;
    view.stride = source.value("byteStride", uint64_t{0});
    view.has_valid_stride = view.stride % 4 == 0 && view.stride <= 252;
    if (!view.has_valid_stride)
        document.warnings.add("strides", place + ".byteStride",
                              std::to_string(view.stride)
                                  + " is not a multiple of 4 up to 252: taken as it is, or, where "
                                    "elements are larger, as if they were packed; export the file "
                                    "again");
    view.fault = buffers[source["buffer"].get<size_t>()].fault;
    if (!view.fault)
        view.bytes = slice_of(document, buffers, source, place);
    return view;
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
        const json extensions = list[i].value("extensions", json::object());
        const auto extension =
            std::find_if(std::begin(meshopt_extensions), std::end(meshopt_extensions),
                         [&](const char* name) { return extensions.contains(name); });
        if (extension == std::end(meshopt_extensions)) {
            document.views[i] = read_view(list[i], buffers, place, document);
            continue;
        }
        const json& packed = extensions[*extension];
        const std::string packed_place = place + ".extensions." + *extension;
        document.views[i].stride = list[i].value("byteStride", uint64_t{0});
        document.views[i].fault = buffers[packed["buffer"].get<size_t>()].fault;
        if (document.views[i].fault)
            continue;
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

/// Cameras that make no sense are of no use, and no fault of what is baked.
std::vector<CameraSource> camera_sources(const json& list, Warnings& warnings) {
    std::vector<CameraSource> cameras;
    for (size_t i = 0; i < list.size(); ++i) {
        CameraSource source;
        source.name = list[i].value("name", std::string());
        const std::string place = at("cameras", i);
        const auto leave_out = [&](const std::string& property, const std::string& why) {
            warnings.add("cameras", place + property,
                         why + ": the camera is left out; a bake needs none");
        };
        const json type = list[i].value("type", json(nullptr));
        const json perspective = list[i].value("perspective", json(nullptr));
        const json none = nullptr;
        const json& yfov = perspective.contains("yfov") ? perspective["yfov"] : none;
        if (type == "orthographic")
            source.is_orthographic = true;
        else if (type != "perspective")
            leave_out(".type", (type.is_string() ? in_quotes(type.get_ref<const std::string&>())
                                                 : std::string("the type"))
                                   + " is not a type of camera");
        else if (!yfov.is_number())
            leave_out(".perspective.yfov", "is no number");
        else if (!(yfov.get<double>() > 0.0 && yfov.get<double>() < 3.14159))
            leave_out(".perspective.yfov", yfov.dump() + " does not lie between 0 and pi radians");
        else
            source.yfov = yfov.get<double>();
        if (perspective.contains("aspectRatio") && perspective["aspectRatio"].is_number())
            source.aspect = std::max(0.0, perspective["aspectRatio"].get<double>());
        cameras.push_back(source);
    }
    return cameras;
}

// ---------------------------------------------------------------- tinygltf

std::string first_line(const std::string& text) {
    return printable(std::string_view(text).substr(0, text.find('\n')), 200);
}

/// Gives every accessor a buffer view: tinygltf 2.7.0 refuses indices without one, which Draco's
/// are. Returns those that had none. What views are is known already, and nothing in them may be
/// refused for its sake.
std::vector<size_t> simplify_views(json& root) {
    std::vector<size_t> without;
    if (root.contains("bufferViews"))
        for (json& view : root["bufferViews"])
            view = {{"buffer", 0}, {"byteLength", 1}};
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
    const std::vector<size_t> without_view = simplify_views(root);
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

std::vector<unsigned char> Document::file_beside(const std::string& uri, const std::string& place,
                                                 uint64_t most) const {
    if (!folder)
        throw Error(ErrorKind::invalid,
                    place + ": " + in_quotes(uri)
                        + " is a file beside the scene, and standard input has none; embed it, as "
                          "a .glb does");
    const std::filesystem::path path = resolve_uri(*folder, uri, place, allow_external);
    std::vector<unsigned char> bytes = read_file(path, place, most);
    beside.push_back(path.string());
    return bytes;
}

const View& Document::view(int index) const {
    const View& view = views.at(index);
    if (view.fault)
        throw Error(*view.fault);
    return view;
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
        known += (i ? ", " : "") + std::to_string(i)
                 + (names[i].empty() ? "" : " " + in_quotes(names[i]));
    throw Error(ErrorKind::argument,
                std::string(setting) + " " + text + ": the file has no such; it has "
                    + (names.empty() ? "none" : known) + (names.size() > 20 ? ", ..." : ""));
}

std::string name_of(const std::string& path) {
    return path == standard_input ? "standard input" : path;
}

Document parse_document(const std::string& path, const LoadSettings& settings) {
    const std::string name = name_of(path);
    Document document{.file = name,
                      .folder = std::nullopt,
                      .allow_external = settings.allow_external,
                      .model = {},
                      .images = {},
                      .cameras = {},
                      .views = {},
                      .warnings = Warnings(name),
                      .memory = MemoryLimit(name, settings.max_memory),
                      .storage = {}};
    if (path == standard_input) {
        document.storage.push_back(read_standard_input(document.memory));
    } else {
        document.folder = std::filesystem::path(path).parent_path();
        document.memory.take(file_size(path, path), 1, "the file");
        document.storage.push_back(read_file(path, path));
    }
    const Container container = open_container(document.storage.front(), name);
    document.memory.take(json_elements(container.text, name), json_element_bytes, "its JSON");
    json root = parse_json(container.text, name, document.warnings);
    check_version(root, name);
    repair(root, document.warnings);
    check_schema(root, name);
    check_extensions(root, document);
    const std::vector<std::string> used = strings(root, "extensionsUsed");
    document.quantized = std::find(used.begin(), used.end(), "KHR_mesh_quantization") != used.end();
    read_views(root.value("bufferViews", json::array()),
               read_buffers(taken(root, "buffers"), container.chunk, document), document);
    json images = taken(root, "images");
    document.images = image_sources(images);
    document.cameras = camera_sources(taken(root, "cameras"), document.warnings);
    document.model = parse_model(std::move(root), document);
    return document;
}

} // namespace lpvbake::scene::gltf
