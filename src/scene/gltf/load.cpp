// The only file that sees tinygltf. It takes the JSON's properties and the buffers from it; types
// and references are checked before (schema.h), ranges before every read, and images are decoded
// only where a material uses them.
#include "scene/gltf/load.h"

#include "error.h"
#include "image/image.h"
#include "scene/gltf/accessor.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/schema.h"
#include "scene/lights.h"
#include "scene/material.h"

#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <exception>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string_view>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// What we read; anything else that a file requires is refused, anything else that it uses is
/// named in a warning.
constexpr const char* understood_extensions[] = {
    "EXT_mesh_gpu_instancing", "EXT_texture_webp",
    "KHR_lights_punctual",     "KHR_materials_emissive_strength",
    "KHR_materials_unlit",     "KHR_materials_pbrSpecularGlossiness",
    "KHR_mesh_quantization",   "KHR_texture_transform",
};

constexpr uint64_t max_elements = 1ull << 28;     ///< vertices and indices of a scene
constexpr uint64_t max_image_texels = 1ull << 28; ///< of one image, 16384 x 16384
constexpr uint64_t max_scene_texels = 1ull << 30; ///< of all decoded images

/// A parsed file. Every index in the model points into its array.
struct Document {
    std::string file;
    fs::path folder;
    tinygltf::Model model;
    bool quantized = false; ///< attributes may be integers (KHR_mesh_quantization)

    [[noreturn]] void fail(const std::string& place, const std::string& why,
                           ExitCode code = ExitCode::invalid) const {
        throw Error(code, file + ": " + place + ": " + why);
    }
};

std::string at(const char* array, size_t index) {
    return std::string(array) + "[" + std::to_string(index) + "]";
}

/// Runs f(0) to f(count - 1) on all threads. Of several exceptions the one of the lowest index is
/// thrown, whatever the threads did.
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

// ---------------------------------------------------------------- the file

/// The JSON and the binary chunk of a .glb, or the text of a .gltf.
struct Container {
    bool is_binary = false;
    std::string_view text;
    bool has_chunk = false;
};

uint32_t little_endian(std::span<const unsigned char> bytes, size_t offset) {
    return bytes[offset] | bytes[offset + 1] << 8 | bytes[offset + 2] << 16
           | static_cast<uint32_t>(bytes[offset + 3]) << 24;
}

Container open_container(std::span<const unsigned char> bytes, const std::string& file) {
    const auto refuse = [&](const std::string& why) {
        throw Error(ExitCode::invalid, file + ": " + why);
    };
    Container container;
    if (bytes.size() > UINT32_MAX)
        refuse("is larger than 4 GiB; keep the buffers in files of their own");
    const auto* begin = reinterpret_cast<const char*>(bytes.data());
    if (bytes.size() < 4 || std::memcmp(begin, "glTF", 4) != 0) {
        container.text = {begin, bytes.size()};
        return container;
    }
    container.is_binary = true;
    if (bytes.size() < 20)
        refuse("the binary glTF is cut off in its header");
    if (const uint32_t version = little_endian(bytes, 4); version != 2)
        throw Error(ExitCode::unsupported, file + ": binary glTF version " + std::to_string(version)
                                               + " is not supported, 2 is");
    const uint64_t length = little_endian(bytes, 8);
    const uint64_t json_length = little_endian(bytes, 12);
    if (length > bytes.size())
        refuse("the binary glTF is cut off: it should have " + std::to_string(length)
               + " bytes and has " + std::to_string(bytes.size()));
    if (little_endian(bytes, 16) != 0x4E4F534A || 20 + json_length > length)
        refuse("the binary glTF's first chunk is not whole JSON");
    container.text = {begin + 20, json_length};
    const uint64_t chunk = 20 + json_length;
    if (chunk + 8 > length)
        return container;
    const uint64_t chunk_length = little_endian(bytes, chunk);
    if (chunk + 8 + chunk_length > length)
        refuse("the binary glTF's second chunk runs past the file");
    if (little_endian(bytes, chunk + 4) == 0x004E4942 && chunk_length > 0) {
        container.has_chunk = true;
        if (chunk_length % 4 != 0 || json_length % 4 != 0)
            refuse("the binary glTF's chunks are not padded to multiples of 4 bytes");
    }
    return container;
}

void check_version(const json& root, const std::string& file) {
    const auto version = root["asset"]["version"].get<std::string>();
    if (!version.starts_with("2."))
        throw Error(ExitCode::unsupported,
                    file + ": asset.version: glTF " + version + " is not supported, 2.0 is");
    const auto least = root["asset"].find("minVersion");
    if (least != root["asset"].end() && *least != "2.0")
        throw Error(ExitCode::unsupported, file + ": asset.minVersion: glTF " + least->dump()
                                               + " is not supported, 2.0 is");
}

bool is_understood(const std::string& extension) {
    return std::find(std::begin(understood_extensions), std::end(understood_extensions), extension)
           != std::end(understood_extensions);
}

void check_extensions(const json& root, const std::string& file,
                      std::vector<std::string>& warnings) {
    std::string missing, ignored;
    const auto append = [](std::string& list, const std::string& name) {
        list += (list.empty() ? "" : ", ") + name;
    };
    for (const auto& name : root.value("extensionsRequired", json::array()))
        if (!is_understood(name))
            append(missing, name);
    if (!missing.empty())
        throw Error(ExitCode::unsupported, file + ": extensionsRequired: not supported: " + missing
                                               + "; export the scene without them");
    for (const auto& name : root.value("extensionsUsed", json::array()))
        if (!is_understood(name))
            append(ignored, name);
    if (!ignored.empty())
        warnings.push_back("extensionsUsed: not understood and ignored: " + ignored);
}

/// The files that tinygltf may read: what `buffers` names, by the name under which it will ask.
struct BufferFiles {
    struct File {
        fs::path path;
        std::string place;
        uint64_t length;
    };
    std::map<std::string, std::vector<File>> by_name; ///< in the order of the document
    std::exception_ptr error;
};

/// How tinygltf decodes a URI: as forms are, with + for a space.
std::string name_in_tinygltf(std::string uri) {
    for (size_t i = 0; i < uri.size(); ++i)
        if (uri[i] == '+')
            uri.replace(i, 1, "%20");
    return percent_decoded(uri);
}

BufferFiles find_buffers(const json& root, const fs::path& folder, const Container& container,
                         const std::string& file) {
    BufferFiles files;
    const json buffers = root.value("buffers", json::array());
    for (size_t i = 0; i < buffers.size(); ++i) {
        const std::string place = file + ": " + at("buffers", i);
        const auto length = buffers[i]["byteLength"].get<uint64_t>();
        if (length == 0)
            throw Error(ExitCode::invalid, place + ".byteLength: must be at least 1");
        const auto uri = buffers[i].value("uri", std::string());
        if (uri.empty()) {
            if (!container.has_chunk || i != 0)
                throw Error(ExitCode::invalid,
                            place + ": has neither a uri nor a chunk of a binary file");
        } else if (uri.starts_with("data:")) {
            if (decode_data_uri(uri, place + ".uri").size() != length)
                throw Error(ExitCode::invalid, place + ".uri: does not hold byteLength bytes");
            if (!tinygltf::IsDataURI(uri))
                throw Error(ExitCode::unsupported,
                            place + ".uri: only application/octet-stream is understood");
        } else {
            const fs::path path = resolve_uri(folder, uri, place + ".uri");
            files.by_name[name_in_tinygltf(uri)].push_back({path, place + ".uri", length});
        }
    }
    for (auto& [name, list] : files.by_name)
        std::reverse(list.begin(), list.end()); // taken from the back
    return files;
}

bool read_buffer(std::vector<unsigned char>* out, std::string*, const std::string& name,
                 void* user_data) {
    auto& files = *static_cast<BufferFiles*>(user_data);
    try {
        std::vector<BufferFiles::File>& list = files.by_name.at(name);
        const BufferFiles::File entry = list.back();
        if (list.size() > 1)
            list.pop_back();
        *out = read_file(entry.path, entry.place);
        if (out->size() < entry.length)
            throw Error(ExitCode::invalid,
                        entry.place + ": the file has " + std::to_string(out->size())
                            + " bytes, byteLength is " + std::to_string(entry.length));
        out->resize(entry.length);
        return true;
    } catch (...) {
        files.error = std::current_exception();
        return false;
    }
}

/// Keeps an image's bytes as they are. Those in a buffer view are read later, after checks.
bool keep_image(tinygltf::Image* image, const int, std::string*, std::string*, int, int,
                const unsigned char* bytes, int size, void*) {
    if (image->bufferView < 0)
        image->image.assign(bytes, bytes + size);
    return true;
}

std::string first_line(const std::string& text) {
    return text.substr(0, std::min<size_t>(text.find('\n'), 200));
}

Document parse(const std::string& path, std::vector<std::string>& warnings) {
    Document document;
    document.file = path;
    document.folder = fs::path(path).parent_path();
    const std::vector<unsigned char> bytes = read_file(path, path);
    const Container container = open_container(bytes, path);
    BufferFiles files;
    {
        const json root = parse_json(container.text, path);
        check_schema(root, path);
        check_version(root, path);
        check_extensions(root, path, warnings);
        const auto used = root.value("extensionsUsed", std::vector<std::string>());
        document.quantized =
            std::find(used.begin(), used.end(), "KHR_mesh_quantization") != used.end();
        files = find_buffers(root, document.folder, container, path);
    }
    tinygltf::TinyGLTF parser;
    parser.SetImageLoader(keep_image, nullptr);
    parser.SetFsCallbacks({
        [](const std::string& name, void* user_data) {
            return static_cast<BufferFiles*>(user_data)->by_name.contains(name);
        },
        [](const std::string& name, void*) { return name; },
        read_buffer,
        [](std::string*, const std::string&, const std::vector<unsigned char>&, void*) {
            return false;
        },
        &files,
    });
    std::string error, warning;
    bool ok = false;
    try {
        const auto size = static_cast<unsigned>(bytes.size());
        ok =
            container.has_chunk
                ? parser.LoadBinaryFromMemory(&document.model, &error, &warning, bytes.data(), size)
                : parser.LoadASCIIFromString(&document.model, &error, &warning,
                                             container.text.data(),
                                             static_cast<unsigned>(container.text.size()), "");
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& exception) {
        error = exception.what();
    }
    if (files.error)
        std::rethrow_exception(files.error);
    if (!ok)
        throw Error(ExitCode::invalid, path + ": is not valid glTF: " + first_line(error));
    return document;
}

// ---------------------------------------------------------------- accessors

void check_buffer_views(const Document& document) {
    for (size_t i = 0; i < document.model.bufferViews.size(); ++i) {
        const tinygltf::BufferView& view = document.model.bufferViews[i];
        const uint64_t size = document.model.buffers.at(view.buffer).data.size();
        if (view.byteOffset > size || view.byteLength > size - view.byteOffset)
            document.fail(at("bufferViews", i), "runs past " + at("buffers", view.buffer)
                                                    + ", which has " + std::to_string(size)
                                                    + " bytes");
    }
}

/// `count` elements that begin `offset` bytes into a buffer view. `stride` 0: packed.
Elements view_elements(const Document& document, int view_index, uint64_t offset, uint64_t count,
                       uint64_t stride, int component, int width, const std::string& place) {
    const tinygltf::BufferView& view = document.model.bufferViews.at(view_index);
    const std::string view_place = at("bufferViews", view_index);
    const uint64_t size = component_size(component) * width;
    if (size == 0)
        document.fail(place,
                      "componentType " + std::to_string(component) + " is not one of glTF 2.0");
    if (stride == 0)
        stride = size;
    if (stride < size)
        document.fail(view_place, "byteStride " + std::to_string(stride)
                                      + " is less than an element of " + place);
    if (offset > view.byteLength || !fits(count, stride, size, view.byteLength - offset))
        document.fail(place, "its " + std::to_string(count) + " elements run past " + view_place);
    const auto* data = document.model.buffers[view.buffer].data.data() + view.byteOffset + offset;
    return {{data, view.byteLength - offset},  stride, count,
            static_cast<Component>(component), width,  false};
}

Elements accessor_elements(const Document& document, const tinygltf::Accessor& accessor, int width,
                           const std::string& place) {
    if (accessor.count == 0)
        document.fail(place, "count must be at least 1");
    if (accessor.count > max_elements)
        document.fail(place,
                      "count " + std::to_string(accessor.count) + " is more than "
                          + std::to_string(max_elements),
                      ExitCode::memory);
    Elements elements;
    if (accessor.bufferView >= 0) {
        elements = view_elements(document, accessor.bufferView, accessor.byteOffset, accessor.count,
                                 document.model.bufferViews.at(accessor.bufferView).byteStride,
                                 accessor.componentType, width, place);
    } else {
        elements.count = accessor.count;
        elements.width = width;
        elements.component = static_cast<Component>(accessor.componentType);
    }
    elements.normalized = accessor.normalized;
    return elements;
}

/// `width` floats an element, sparse substitutions applied. `user` is who asks for the accessor.
std::vector<float> read_floats(const Document& document, int index, int width,
                               const std::string& user) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(index);
    const std::string place = user + " (" + at("accessors", index) + ")";
    if (tinygltf::GetNumComponentsInType(accessor.type) != width)
        document.fail(place, "must be of type VEC" + std::to_string(width));
    const Elements elements = accessor_elements(document, accessor, width, place);
    std::vector<float> values = accessor.bufferView >= 0
                                    ? to_floats(elements)
                                    : std::vector<float>(elements.count * width, 0.0f);
    if (!accessor.sparse.isSparse)
        return values;
    const auto& sparse = accessor.sparse;
    if (component_size(sparse.indices.componentType) == 0
        || sparse.indices.componentType == static_cast<int>(Component::float32))
        document.fail(place, "sparse.indices.componentType is not an unsigned integer");
    const std::vector<uint32_t> targets = to_indices(
        view_elements(document, sparse.indices.bufferView, sparse.indices.byteOffset, sparse.count,
                      0, sparse.indices.componentType, 1, place + ".sparse.indices"));
    Elements replacement =
        view_elements(document, sparse.values.bufferView, sparse.values.byteOffset, sparse.count, 0,
                      accessor.componentType, width, place + ".sparse.values");
    replacement.normalized = accessor.normalized;
    const std::vector<float> replacements = to_floats(replacement);
    for (size_t i = 0; i < targets.size(); ++i) {
        if (targets[i] >= accessor.count)
            document.fail(place, "sparse index " + std::to_string(targets[i]) + " is out of range");
        std::copy_n(&replacements[i * width], width, &values[size_t{targets[i]} * width]);
    }
    return values;
}

template <int N>
std::vector<glm::vec<N, float>> read_vectors(const Document& document, int index,
                                             const std::string& user) {
    const std::vector<float> values = read_floats(document, index, N, user);
    std::vector<glm::vec<N, float>> vectors(values.size() / N);
    static_assert(sizeof(glm::vec<N, float>) == N * sizeof(float));
    std::memcpy(vectors.data(), values.data(), values.size() * sizeof(float));
    return vectors;
}

std::vector<uint32_t> read_indices(const Document& document, int index, const std::string& user) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(index);
    const std::string place = user + " (" + at("accessors", index) + ")";
    const auto component = static_cast<Component>(accessor.componentType);
    if (accessor.type != TINYGLTF_TYPE_SCALAR
        || (component != Component::uint8 && component != Component::uint16
            && component != Component::uint32))
        document.fail(place, "must be a SCALAR of unsigned integers");
    if (accessor.sparse.isSparse || accessor.bufferView < 0)
        document.fail(place, "sparse indices are not supported", ExitCode::unsupported);
    return to_indices(accessor_elements(document, accessor, 1, place));
}

// ---------------------------------------------------------------- nodes

/// A glTF mesh placed in the world.
struct PlacedMesh {
    int mesh;
    glm::dmat4 to_world;
};

struct Graph {
    std::vector<PlacedMesh> meshes;
    std::vector<Light> lights;
    std::vector<Camera> cameras;
};

const tinygltf::Value* find_extension(const tinygltf::ExtensionMap& extensions, const char* name) {
    const auto found = extensions.find(name);
    return found == extensions.end() ? nullptr : &found->second;
}

glm::dmat4 compose(glm::dvec3 translation, glm::dquat rotation, glm::dvec3 scale) {
    return glm::scale(glm::translate(glm::dmat4(1.0), translation) * glm::mat4_cast(rotation),
                      scale);
}

/// A unit quaternion of x, y, z, w.
glm::dquat unit_quaternion(const Document& document, glm::dvec4 xyzw, const std::string& place) {
    const double length = glm::length(xyzw);
    if (!(length > 1e-12) || !std::isfinite(length))
        document.fail(place, "is not a quaternion: its length is 0");
    xyzw /= length;
    return {xyzw.w, xyzw.x, xyzw.y, xyzw.z};
}

glm::dmat4 local_transform(const Document& document, size_t index) {
    const tinygltf::Node& node = document.model.nodes[index];
    if (!node.matrix.empty()) {
        glm::dmat4 matrix;
        for (int i = 0; i < 16; ++i)
            matrix[i / 4][i % 4] = node.matrix.at(i);
        if (matrix[0][3] != 0 || matrix[1][3] != 0 || matrix[2][3] != 0 || matrix[3][3] != 1)
            document.fail(at("nodes", index) + ".matrix",
                          "is not affine: its last row must be 0 0 0 1");
        return matrix;
    }
    glm::dvec3 translation(0.0), scale(1.0);
    glm::dquat rotation(1.0, 0.0, 0.0, 0.0);
    if (const auto& t = node.translation; !t.empty())
        translation = {t.at(0), t.at(1), t.at(2)};
    if (const auto& s = node.scale; !s.empty())
        scale = {s.at(0), s.at(1), s.at(2)};
    if (const auto& r = node.rotation; !r.empty())
        rotation = unit_quaternion(document, {r.at(0), r.at(1), r.at(2), r.at(3)},
                                   at("nodes", index) + ".rotation");
    return compose(translation, rotation, scale);
}

bool is_finite(const glm::dmat4& matrix) {
    for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 4; ++row)
            if (!(std::abs(matrix[column][row]) < 1e100))
                return false;
    return true;
}

/// The transforms of EXT_mesh_gpu_instancing, relative to the node.
std::vector<glm::dmat4> instance_transforms(const Document& document,
                                            const tinygltf::Value& extension,
                                            const std::string& node_place) {
    const std::string place = node_place + ".extensions.EXT_mesh_gpu_instancing.attributes.";
    const tinygltf::Value& attributes = extension.Get("attributes");
    std::optional<size_t> count;
    const auto read = [&]<int N>(const char* name, std::integral_constant<int, N>) {
        std::vector<glm::vec<N, float>> values;
        if (!attributes.Has(name))
            return values;
        values = read_vectors<N>(document, attributes.Get(name).GetNumberAsInt(), place + name);
        if (count && *count != values.size())
            document.fail(place + name, "has another count than the attributes beside it");
        count = values.size();
        return values;
    };
    const auto translations = read("TRANSLATION", std::integral_constant<int, 3>());
    const auto rotations = read("ROTATION", std::integral_constant<int, 4>());
    const auto scales = read("SCALE", std::integral_constant<int, 3>());
    std::vector<glm::dmat4> transforms(count.value_or(0));
    for (size_t i = 0; i < transforms.size(); ++i)
        transforms[i] =
            compose(translations.empty() ? glm::dvec3(0.0) : glm::dvec3(translations[i]),
                    rotations.empty() ? glm::dquat(1.0, 0.0, 0.0, 0.0)
                                      : unit_quaternion(document, rotations[i], place + "ROTATION"),
                    scales.empty() ? glm::dvec3(1.0) : glm::dvec3(scales[i]));
    return transforms;
}

std::optional<Light> placed_light(const Document& document, int index, const glm::dmat4& to_world,
                                  const std::string& node_place,
                                  std::vector<std::string>& warnings) {
    const tinygltf::Light& source = document.model.lights.at(index);
    const std::string place = at("extensions.KHR_lights_punctual.lights", index);
    Light light;
    light.name = source.name;
    if (source.type == "directional")
        light.type = LightType::directional;
    else if (source.type == "point")
        light.type = LightType::point;
    else if (source.type == "spot")
        light.type = LightType::spot;
    else
        document.fail(place + ".type", "\"" + source.type + "\" is not a type of light");
    if (!source.color.empty())
        light.color = glm::dvec3(source.color.at(0), source.color.at(1), source.color.at(2));
    light.intensity = source.intensity;
    light.range = source.range;
    light.inner_cone = source.spot.innerConeAngle;
    light.outer_cone = source.spot.outerConeAngle;
    light.position = glm::dvec3(to_world[3]);
    if (light.type != LightType::point) {
        const double length = glm::length(glm::dvec3(to_world[2]));
        if (!(length > 0.0)) {
            warnings.push_back(node_place
                               + ": the scale is 0, which leaves its light without a "
                                 "direction: the light is ignored");
            return std::nullopt;
        }
        light.direction = -glm::dvec3(to_world[2]) / length;
    }
    check_light(light, document.file + ": " + place);
    return light;
}

std::optional<Camera> placed_camera(const Document& document, int index, const glm::dmat4& to_world,
                                    std::vector<std::string>& warnings) {
    const tinygltf::Camera& source = document.model.cameras.at(index);
    const std::string place = at("cameras", index);
    if (source.type != "perspective") {
        warnings.push_back(place + ": orthographic cameras are not supported: it is ignored");
        return std::nullopt;
    }
    if (!(source.perspective.yfov > 0.0 && source.perspective.yfov < 3.14159))
        document.fail(place + ".perspective.yfov", "must lie between 0 and pi");
    return Camera{source.name, to_world, source.perspective.yfov,
                  std::max(0.0, source.perspective.aspectRatio)};
}

int default_scene(const Document& document) {
    const tinygltf::Model& model = document.model;
    if (model.scenes.empty())
        document.fail("scenes", "there is no scene");
    const int index = std::max(0, model.defaultScene);
    if (model.scenes.at(index).nodes.empty())
        document.fail(at("scenes", index), "has no nodes: there is nothing to bake");
    return index;
}

/// Walks the default scene without recursion, in the document's order.
Graph walk(const Document& document, std::vector<std::string>& warnings) {
    struct Visit {
        int node;
        glm::dmat4 parent_to_world;
    };
    const tinygltf::Model& model = document.model;
    const std::vector<int>& roots = model.scenes[default_scene(document)].nodes;
    Graph graph;
    std::vector<bool> seen(model.nodes.size());
    std::vector<Visit> stack;
    for (auto root = roots.rbegin(); root != roots.rend(); ++root)
        stack.push_back({*root, glm::dmat4(1.0)});
    uint64_t skinned = 0, morphed = 0;
    while (!stack.empty()) {
        const Visit visit = stack.back();
        stack.pop_back();
        const tinygltf::Node& node = model.nodes.at(visit.node);
        const std::string place = at("nodes", visit.node);
        if (seen[visit.node])
            document.fail(place, "is placed twice: it has several parents or is its own ancestor");
        seen[visit.node] = true;
        const glm::dmat4 to_world = visit.parent_to_world * local_transform(document, visit.node);
        if (!is_finite(to_world))
            document.fail(place, "its transform is not finite");
        if (node.mesh >= 0) {
            if (const auto* instancing = find_extension(node.extensions, "EXT_mesh_gpu_instancing"))
                for (const glm::dmat4& transform :
                     instance_transforms(document, *instancing, place))
                    graph.meshes.push_back({node.mesh, to_world * transform});
            else
                graph.meshes.push_back({node.mesh, to_world});
            const tinygltf::Mesh& mesh = model.meshes[node.mesh];
            skinned += node.skin >= 0;
            morphed +=
                std::any_of(mesh.primitives.begin(), mesh.primitives.end(),
                            [](const auto& primitive) { return !primitive.targets.empty(); });
        }
        if (const auto* reference = find_extension(node.extensions, "KHR_lights_punctual"))
            if (const auto light = placed_light(document, reference->Get("light").GetNumberAsInt(),
                                                to_world, place, warnings))
                graph.lights.push_back(*light);
        if (node.camera >= 0)
            if (const auto camera = placed_camera(document, node.camera, to_world, warnings))
                graph.cameras.push_back(*camera);
        for (auto child = node.children.rbegin(); child != node.children.rend(); ++child)
            stack.push_back({*child, to_world});
    }
    if (skinned > 0)
        warnings.push_back("skins: not supported: " + std::to_string(skinned)
                           + " skinned meshes stand in their bind pose");
    if (morphed > 0)
        warnings.push_back("meshes: morph targets are not supported: " + std::to_string(morphed)
                           + " meshes have their base shape");
    if (!model.animations.empty())
        warnings.push_back("animations: not supported: the scene is baked as its nodes stand");
    return graph;
}

// ---------------------------------------------------------------- materials

/// Which coordinates a texture is looked up with: set TEXCOORD_<set>, transformed by
/// KHR_texture_transform, uv' = offset + R(rotation) * (scale * uv), R turning counter-clockwise as
/// seen in an image, whose v points down.
struct UvSource {
    int set = 0;
    glm::dvec2 offset{0.0};
    glm::dvec2 scale{1.0};
    double rotation = 0.0;

    glm::vec2 operator()(glm::vec2 uv) const {
        const glm::dvec2 scaled = scale * glm::dvec2(uv);
        const double c = std::cos(rotation), s = std::sin(rotation);
        return offset + glm::dvec2(c * scaled.x + s * scaled.y, c * scaled.y - s * scaled.x);
    }
    bool is_identity() const {
        return offset == glm::dvec2(0.0) && scale == glm::dvec2(1.0) && rotation == 0.0;
    }
};

/// A material with texture references that are still glTF's.
struct SourceMaterial {
    Material material;
    int base_texture = -1;
    int emission_texture = -1;
    int metallic_texture = -1; ///< only where metal is to be black
    double metallic = 0.0;     ///< factor; 0 unless metal is to be black
    UvSource base_uv;
    UvSource emission_uv;
    bool unlit = false;
    std::string place;
};

glm::dvec2 pair(const tinygltf::Value& object, const char* key, glm::dvec2 otherwise) {
    if (!object.Has(key))
        return otherwise;
    const tinygltf::Value& value = object.Get(key);
    return {value.Get(0).GetNumberAsDouble(), value.Get(1).GetNumberAsDouble()};
}

double number(const tinygltf::Value& object, const char* key, double otherwise) {
    return object.Has(key) ? object.Get(key).GetNumberAsDouble() : otherwise;
}

void read_transform(UvSource& uv, const tinygltf::Value& transform) {
    uv.set = static_cast<int>(number(transform, "texCoord", uv.set));
    uv.offset = pair(transform, "offset", {0.0, 0.0});
    uv.scale = pair(transform, "scale", {1.0, 1.0});
    uv.rotation = number(transform, "rotation", 0.0);
}

UvSource uv_source(const tinygltf::TextureInfo& info) {
    UvSource uv;
    uv.set = info.texCoord;
    if (const auto* transform = find_extension(info.extensions, "KHR_texture_transform"))
        read_transform(uv, *transform);
    return uv;
}

/// KHR_materials_pbrSpecularGlossiness: its diffuse part takes the place of the base colour.
void read_specular_glossiness(SourceMaterial& result, const tinygltf::Value& extension) {
    glm::vec4 color(1.0f);
    if (extension.Has("diffuseFactor"))
        for (int i = 0; i < 4; ++i)
            color[i] =
                static_cast<float>(extension.Get("diffuseFactor").Get(i).GetNumberAsDouble());
    result.material.base_color = color;
    result.base_texture = -1;
    result.base_uv = {};
    if (extension.Has("diffuseTexture")) {
        const tinygltf::Value& info = extension.Get("diffuseTexture");
        result.base_texture = info.Get("index").GetNumberAsInt();
        result.base_uv.set = static_cast<int>(number(info, "texCoord", 0));
        if (info.Has("extensions") && info.Get("extensions").Has("KHR_texture_transform"))
            read_transform(result.base_uv, info.Get("extensions").Get("KHR_texture_transform"));
    }
    result.metallic = 0.0;
    result.metallic_texture = -1;
}

SourceMaterial read_material(const Document& document, int index, const MaterialRules& rules) {
    SourceMaterial result;
    if (index < 0) {
        result.material.name = "default";
        result.place = "the default material";
        result.metallic = rules.metallic_black ? 1.0 : 0.0;
        return result;
    }
    const tinygltf::Material& source = document.model.materials.at(index);
    const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
    Material& material = result.material;
    result.place = at("materials", index);
    const auto factor = [&](double value, const char* property) {
        if (!(value >= 0.0 && value <= 3e38))
            document.fail(result.place + property, "must not be negative");
        return static_cast<float>(value);
    };
    material.name = source.name;
    material.double_sided = source.doubleSided;
    for (int i = 0; i < 4; ++i)
        material.base_color[i] =
            factor(pbr.baseColorFactor.at(i), ".pbrMetallicRoughness.baseColorFactor");
    result.base_texture = pbr.baseColorTexture.index;
    result.base_uv = uv_source(pbr.baseColorTexture);
    if (rules.metallic_black) {
        result.metallic = factor(pbr.metallicFactor, ".pbrMetallicRoughness.metallicFactor");
        result.metallic_texture = pbr.metallicRoughnessTexture.index;
    }
    if (const auto* glossy =
            find_extension(source.extensions, "KHR_materials_pbrSpecularGlossiness")) {
        read_specular_glossiness(result, *glossy);
        for (int i = 0; i < 4; ++i)
            factor(material.base_color[i],
                   ".extensions.KHR_materials_pbrSpecularGlossiness.diffuseFactor");
    }

    if (source.alphaMode == "MASK")
        material.alpha_mode = AlphaMode::mask;
    else if (source.alphaMode == "BLEND")
        material.alpha_mode = AlphaMode::blend;
    else if (source.alphaMode != "OPAQUE")
        document.fail(result.place + ".alphaMode",
                      "\"" + source.alphaMode + "\" is not an alpha mode");
    material.alpha_cutoff = factor(source.alphaCutoff, ".alphaCutoff");

    double strength = 1.0;
    if (const auto* extension =
            find_extension(source.extensions, "KHR_materials_emissive_strength"))
        strength = factor(number(*extension, "emissiveStrength", 1.0),
                          ".extensions.KHR_materials_emissive_strength.emissiveStrength");
    for (int i = 0; i < 3; ++i)
        material.emission[i] = factor(source.emissiveFactor.at(i) * strength, ".emissiveFactor");
    if (material.emission != glm::vec3(0.0f)) {
        result.emission_texture = source.emissiveTexture.index;
        result.emission_uv = uv_source(source.emissiveTexture);
    }
    result.unlit = find_extension(source.extensions, "KHR_materials_unlit") != nullptr;
    return result;
}

// ---------------------------------------------------------------- images

/// The image of a texture; -1 if it has none that is understood.
int image_of(const Document& document, int texture_index, std::vector<std::string>& warnings) {
    const tinygltf::Texture& texture = document.model.textures.at(texture_index);
    if (texture.source >= 0)
        return texture.source;
    if (const auto* webp = find_extension(texture.extensions, "EXT_texture_webp");
        webp && webp->Has("source"))
        return webp->Get("source").GetNumberAsInt();
    std::string names;
    for (const auto& [name, unused] : texture.extensions)
        names += (names.empty() ? "" : ", ") + name;
    const std::string place = at("textures", texture_index);
    if (!names.empty())
        document.fail(place, "has no source but for " + names + ", which is not supported",
                      ExitCode::unsupported);
    warnings.push_back(place + ": has no source: materials do without it");
    return -1;
}

Image load_image(const Document& document, int index) {
    const tinygltf::Image& source = document.model.images.at(index);
    const std::string place = document.file + ": " + at("images", index);
    std::span<const unsigned char> bytes;
    std::vector<unsigned char> storage;
    if (source.bufferView >= 0) {
        const size_t length = document.model.bufferViews.at(source.bufferView).byteLength;
        bytes = view_elements(document, source.bufferView, 0, length, 0,
                              static_cast<int>(Component::uint8), 1, at("images", index))
                    .bytes;
    } else if (!source.image.empty()) {
        bytes = source.image;
    } else if (source.uri.starts_with("data:")) {
        storage = decode_data_uri(source.uri, place + ".uri");
        bytes = storage;
    } else {
        storage =
            read_file(resolve_uri(document.folder, source.uri, place + ".uri"), place + ".uri");
        bytes = storage;
    }
    std::string name = place;
    if (!source.uri.empty() && !source.uri.starts_with("data:"))
        name += " (" + percent_decoded(source.uri) + ")";
    Rgba8 decoded = decode_image(std::as_bytes(bytes), name, max_image_texels);
    return {source.name.empty() ? name : source.name, decoded.width, decoded.height,
            std::move(decoded.texels)};
}

/// An image and what materials want to know of it.
struct DecodedImage {
    Image image;
    glm::vec3 brightest{0.0f}; ///< linear, a channel at a time
    double mean_blue = 0.0;    ///< of the stored value, 0 to 1
};

DecodedImage with_statistics(Image image) {
    DecodedImage result;
    std::array<uint8_t, 4> brightest{0, 0, 0, 255};
    uint64_t blue = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        for (int channel = 0; channel < 3; ++channel)
            brightest[channel] = std::max(brightest[channel], image.rgba[i + channel]);
        blue += image.rgba[i + 2];
    }
    result.mean_blue = static_cast<double>(blue) / (255.0 * (image.rgba.size() / 4));
    Scene texel;
    texel.images.push_back({"", 1, 1, {brightest.begin(), brightest.end()}});
    texel.textures.push_back({0});
    result.brightest = glm::vec3(sample_texture(texel, 0, glm::vec2(0.0f)));
    result.image = std::move(image);
    return result;
}

Texture texture_of(const Document& document, int index) {
    Texture texture;
    const int sampler_index = document.model.textures.at(index).sampler;
    if (sampler_index < 0)
        return texture;
    const tinygltf::Sampler& sampler = document.model.samplers.at(sampler_index);
    const auto wrap = [&](int mode, const char* property) {
        switch (mode) {
        case TINYGLTF_TEXTURE_WRAP_REPEAT:
            return Wrap::repeat;
        case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
            return Wrap::mirrored_repeat;
        case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
            return Wrap::clamp_to_edge;
        default:
            document.fail(at("samplers", sampler_index) + property,
                          std::to_string(mode) + " is not a wrap mode");
        }
    };
    texture.wrap_u = wrap(sampler.wrapS, ".wrapS");
    texture.wrap_v = wrap(sampler.wrapT, ".wrapT");
    texture.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    return texture;
}

/// Decodes what the materials need, puts images and textures that are sampled into the scene and
/// points the materials at them. Returns each material's brightest base colour texel.
std::vector<glm::vec3> load_textures(const Document& document,
                                     std::vector<SourceMaterial>& materials, Scene& scene) {
    std::map<int, int> image_of_texture; // by glTF texture
    std::map<int, bool> sampled;         // by glTF image: false if only its mean is wanted
    const auto need = [&](int& texture, bool is_sampled) {
        if (texture < 0)
            return;
        if (!image_of_texture.contains(texture))
            image_of_texture[texture] = image_of(document, texture, scene.warnings);
        const int image = image_of_texture[texture];
        if (image < 0)
            texture = -1;
        else
            sampled[image] |= is_sampled;
    };
    for (SourceMaterial& material : materials) {
        need(material.base_texture, true);
        need(material.emission_texture, true);
        need(material.metallic_texture, false);
    }

    const std::vector<std::pair<int, bool>> wanted(sampled.begin(), sampled.end());
    std::vector<DecodedImage> decoded(wanted.size());
    std::atomic<uint64_t> texels = 0;
    for_all(wanted.size(), [&](size_t i) {
        Image image = load_image(document, wanted[i].first);
        if ((texels += image.rgba.size() / 4) > max_scene_texels)
            document.fail("images", "are too large together; use smaller ones", ExitCode::memory);
        decoded[i] = with_statistics(std::move(image));
    });

    std::map<int, size_t> place_of_image; // in `decoded`
    std::map<int, int> scene_image;
    for (size_t i = 0; i < wanted.size(); ++i) {
        place_of_image[wanted[i].first] = i;
        if (wanted[i].second) {
            scene_image[wanted[i].first] = static_cast<int>(scene.images.size());
            scene.images.push_back(std::move(decoded[i].image));
        }
    }
    std::map<int, int> scene_texture; // by glTF texture
    const auto resolve = [&](int texture) {
        if (texture < 0)
            return -1;
        const auto [entry, is_new] =
            scene_texture.try_emplace(texture, static_cast<int>(scene.textures.size()));
        if (is_new) {
            scene.textures.push_back(texture_of(document, texture));
            scene.textures.back().image = scene_image.at(image_of_texture.at(texture));
        }
        return entry->second;
    };
    const auto statistics = [&](int texture) -> const DecodedImage& {
        return decoded[place_of_image.at(image_of_texture.at(texture))];
    };
    std::vector<glm::vec3> brightest;
    for (SourceMaterial& source : materials) {
        source.material.base_color_texture = resolve(source.base_texture);
        source.material.emission_texture = resolve(source.emission_texture);
        double metallic = source.metallic;
        if (source.metallic_texture >= 0)
            metallic *= statistics(source.metallic_texture).mean_blue;
        const auto diffuse = static_cast<float>(1.0 - std::min(metallic, 1.0));
        for (int channel = 0; channel < 3; ++channel)
            source.material.base_color[channel] *= diffuse;
        brightest.push_back(source.base_texture >= 0 ? statistics(source.base_texture).brightest
                                                     : glm::vec3(1.0f));
    }
    return brightest;
}

// ---------------------------------------------------------------- meshes

std::vector<glm::uvec3> triangles_of(const std::vector<uint32_t>& indices, int mode) {
    std::vector<glm::uvec3> triangles;
    const size_t count = indices.size();
    if (mode == TINYGLTF_MODE_TRIANGLES) {
        triangles.resize(count / 3);
        for (size_t i = 0; i < triangles.size(); ++i)
            triangles[i] = {indices[3 * i], indices[3 * i + 1], indices[3 * i + 2]};
        return triangles;
    }
    for (size_t i = 0; i + 2 < count; ++i)
        if (mode == TINYGLTF_MODE_TRIANGLE_STRIP)
            triangles.emplace_back(indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]);
        else
            triangles.emplace_back(indices[i + 1], indices[i + 2], indices[0]);
    return triangles;
}

/// One primitive of a glTF mesh, to become a Mesh.
struct Job {
    int mesh;
    size_t primitive;
    int material; ///< index into the materials in use
};

struct DecodedPrimitive {
    Mesh mesh;
    std::vector<std::string> warnings;
};

void check_attribute_type(const Document& document, int accessor_index, bool may_be_normalized,
                          const std::string& place) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(accessor_index);
    const bool is_float = accessor.componentType == static_cast<int>(Component::float32);
    if (component_size(accessor.componentType) == 0
        || accessor.componentType == static_cast<int>(Component::uint32))
        document.fail(place, "componentType " + std::to_string(accessor.componentType)
                                 + " is not allowed");
    if (!is_float && !document.quantized && !(may_be_normalized && accessor.normalized))
        document.fail(place, "must be of floats, unless KHR_mesh_quantization is used");
}

template <typename Vector>
void check_finite(const Document& document, const std::vector<Vector>& values,
                  const std::string& place) {
    for (size_t i = 0; i < values.size(); ++i)
        for (int k = 0; k < Vector::length(); ++k)
            if (!std::isfinite(values[i][k]))
                document.fail(place, "value of vertex " + std::to_string(i) + " is not finite");
}

class PrimitiveReader {
public:
    PrimitiveReader(const Document& document, const Job& job)
        : document_(document),
          source_(document.model.meshes.at(job.mesh).primitives.at(job.primitive)),
          place_(at("meshes", job.mesh) + "." + at("primitives", job.primitive)) {}

    DecodedPrimitive read(const SourceMaterial& material) {
        const std::string position_place = place_ + ".attributes.POSITION";
        const int positions = source_.attributes.at("POSITION");
        check_attribute_type(document_, positions, false, position_place);
        mesh_.positions = read_vectors<3>(document_, positions, position_place);
        check_finite(document_, mesh_.positions, position_place);
        read_triangles();
        read_normals();
        read_colors();
        if (material.material.base_color_texture >= 0)
            mesh_.uv = read_uv(material.base_uv, material);
        if (material.material.emission_texture >= 0)
            mesh_.uv_emission = read_uv(material.emission_uv, material);
        return {std::move(mesh_), std::move(warnings_)};
    }

private:
    std::optional<int> attribute(const std::string& name) const {
        const auto found = source_.attributes.find(name);
        if (found == source_.attributes.end())
            return std::nullopt;
        if (document_.model.accessors.at(found->second).count != mesh_.positions.size())
            document_.fail(place_ + ".attributes." + name, "has another count than POSITION");
        return found->second;
    }

    void read_triangles() {
        std::vector<uint32_t> indices;
        const size_t vertices = mesh_.positions.size();
        if (source_.indices >= 0) {
            indices = read_indices(document_, source_.indices, place_ + ".indices");
            for (size_t i = 0; i < indices.size(); ++i)
                if (indices[i] >= vertices)
                    document_.fail(place_ + ".indices",
                                   "index " + std::to_string(indices[i]) + " at "
                                       + std::to_string(i) + " is out of range: there are "
                                       + std::to_string(vertices) + " vertices");
        } else {
            indices.resize(vertices);
            for (size_t i = 0; i < vertices; ++i)
                indices[i] = static_cast<uint32_t>(i);
        }
        if (indices.size() < 3
            || (source_.mode == TINYGLTF_MODE_TRIANGLES && indices.size() % 3 != 0))
            warnings_.push_back(place_ + ": " + std::to_string(indices.size())
                                + " indices do not make whole triangles: the rest is ignored");
        mesh_.triangles = triangles_of(indices, source_.mode);
    }

    void read_normals() {
        const std::optional<int> index = attribute("NORMAL");
        if (!index)
            return;
        const std::string place = place_ + ".attributes.NORMAL";
        check_attribute_type(document_, *index, false, place);
        mesh_.normals = read_vectors<3>(document_, *index, place);
        if (document_.model.accessors[*index].componentType != static_cast<int>(Component::float32))
            return;
        for (size_t i = 0; i < mesh_.normals.size(); ++i)
            if (const float length = glm::length(mesh_.normals[i]);
                !(std::abs(length - 1.0f) < 0.1f))
                document_.fail(place,
                               "the normal of vertex " + std::to_string(i) + " has length "
                                   + std::to_string(length)
                                   + " and not 1; export the mesh again, or without normals");
    }

    void read_colors() {
        const std::optional<int> index = attribute("COLOR_0");
        if (!index)
            return;
        const std::string place = place_ + ".attributes.COLOR_0";
        check_attribute_type(document_, *index, true, place);
        if (document_.model.accessors[*index].type == TINYGLTF_TYPE_VEC3)
            for (const glm::vec3 color : read_vectors<3>(document_, *index, place))
                mesh_.colors.emplace_back(color, 1.0f);
        else
            mesh_.colors = read_vectors<4>(document_, *index, place);
        check_finite(document_, mesh_.colors, place);
    }

    std::vector<glm::vec2> read_uv(const UvSource& source, const SourceMaterial& material) {
        const std::string name = "TEXCOORD_" + std::to_string(source.set);
        const std::optional<int> index = attribute(name);
        if (!index) {
            warnings_.push_back(place_ + ".attributes: " + name + " is missing, which a texture of "
                                + material.place + " needs: its corner is used");
            return std::vector<glm::vec2>(mesh_.positions.size(), glm::vec2(0.0f));
        }
        const std::string place = place_ + ".attributes." + name;
        check_attribute_type(document_, *index, true, place);
        std::vector<glm::vec2> uv = read_vectors<2>(document_, *index, place);
        if (!source.is_identity())
            for (glm::vec2& coordinate : uv)
                coordinate = source(coordinate);
        size_t broken = 0;
        for (glm::vec2& coordinate : uv)
            if (!std::isfinite(coordinate.x + coordinate.y)) {
                coordinate = glm::vec2(0.0f);
                ++broken;
            }
        if (broken > 0)
            warnings_.push_back(place + ": " + std::to_string(broken)
                                + " coordinates are not finite: 0 is used");
        return uv;
    }

    const Document& document_;
    const tinygltf::Primitive& source_;
    const std::string place_;
    Mesh mesh_;
    std::vector<std::string> warnings_;
};

/// The primitives of all placed meshes that hold triangles.
struct Jobs {
    std::vector<Job> jobs;
    std::map<int, std::pair<size_t, size_t>> of_mesh; ///< [begin, end) in `jobs`
    std::vector<int> materials;                       ///< glTF materials in use, -1: the default
};

Jobs collect_jobs(const Document& document, const Graph& graph,
                  std::vector<std::string>& warnings) {
    Jobs result;
    std::map<int, int> material_index;
    uint64_t not_triangles = 0, without_positions = 0, elements = 0;
    std::set<int> placed;
    for (const PlacedMesh& mesh : graph.meshes)
        placed.insert(mesh.mesh);
    for (const int mesh : placed) {
        const std::vector<tinygltf::Primitive>& primitives = document.model.meshes[mesh].primitives;
        const size_t begin = result.jobs.size();
        for (size_t i = 0; i < primitives.size(); ++i) {
            const tinygltf::Primitive& primitive = primitives[i];
            if (primitive.mode > TINYGLTF_MODE_TRIANGLE_FAN)
                document.fail(at("meshes", mesh) + "." + at("primitives", i) + ".mode",
                              std::to_string(primitive.mode) + " is not a mode");
            if (primitive.mode < TINYGLTF_MODE_TRIANGLES) {
                ++not_triangles;
                continue;
            }
            const auto positions = primitive.attributes.find("POSITION");
            if (positions == primitive.attributes.end()) {
                ++without_positions;
                continue;
            }
            for (const int accessor : {positions->second, primitive.indices})
                if (accessor >= 0)
                    elements += std::min<uint64_t>(document.model.accessors.at(accessor).count,
                                                   max_elements + 1); // cannot overflow
            if (elements > max_elements)
                document.fail("meshes",
                              "hold more than " + std::to_string(max_elements)
                                  + " vertices and indices",
                              ExitCode::memory);
            const auto [entry, is_new] = material_index.try_emplace(
                primitive.material, static_cast<int>(result.materials.size()));
            if (is_new)
                result.materials.push_back(primitive.material);
            result.jobs.push_back({mesh, i, entry->second});
        }
        result.of_mesh[mesh] = {begin, result.jobs.size()};
    }
    if (not_triangles > 0)
        warnings.push_back("meshes: " + std::to_string(not_triangles)
                           + " primitives of points or lines are ignored");
    if (without_positions > 0)
        warnings.push_back("meshes: " + std::to_string(without_positions)
                           + " primitives without POSITION are ignored");
    return result;
}

void warn_of_bright_materials(const Scene& scene, const std::vector<glm::vec3>& brightest_texel,
                              std::vector<std::string>& warnings) {
    std::vector<glm::vec3> brightest_vertex(scene.materials.size(), glm::vec3(0.0f));
    for (const Mesh& mesh : scene.meshes) {
        glm::vec3& brightest = brightest_vertex[mesh.material];
        if (mesh.colors.empty())
            brightest = glm::max(brightest, glm::vec3(1.0f));
        for (const glm::vec4& color : mesh.colors)
            brightest = glm::max(brightest, glm::vec3(color));
    }
    size_t count = 0;
    for (size_t i = 0; i < scene.materials.size(); ++i) {
        const glm::vec3 albedo =
            glm::vec3(scene.materials[i].base_color) * brightest_texel[i] * brightest_vertex[i];
        count += glm::any(glm::greaterThan(albedo, glm::vec3(scene.rules.max_albedo + 1e-6f)));
    }
    if (count > 0) {
        std::string limit = std::to_string(scene.rules.max_albedo);
        limit.erase(std::min(limit.size(), limit.find_last_not_of('0') + 1));
        warnings.push_back("materials: " + std::to_string(count) + " can reflect more than " + limit
                           + " of the light and are clamped to it (--max-albedo)");
    }
}

} // namespace

Scene load_gltf(const std::string& path, const MaterialRules& rules) {
    try {
        Scene scene;
        scene.path = path;
        scene.rules = rules;
        const Document document = parse(path, scene.warnings);
        check_buffer_views(document);
        Graph graph = walk(document, scene.warnings);
        scene.lights = std::move(graph.lights);
        scene.cameras = std::move(graph.cameras);

        const Jobs jobs = collect_jobs(document, graph, scene.warnings);
        std::vector<SourceMaterial> materials;
        uint64_t unlit = 0;
        for (const int index : jobs.materials) {
            materials.push_back(read_material(document, index, rules));
            unlit += materials.back().unlit;
        }
        if (unlit > 0)
            scene.warnings.push_back(
                "materials: " + std::to_string(unlit)
                + " are unlit (KHR_materials_unlit): they are lit all the same");
        const std::vector<glm::vec3> brightest = load_textures(document, materials, scene);

        std::vector<DecodedPrimitive> decoded(jobs.jobs.size());
        for_all(jobs.jobs.size(), [&](size_t i) {
            const Job& job = jobs.jobs[i];
            decoded[i] = PrimitiveReader(document, job).read(materials[job.material]);
        });
        for (size_t i = 0; i < decoded.size(); ++i) {
            Mesh& mesh = decoded[i].mesh;
            mesh.name = document.model.meshes[jobs.jobs[i].mesh].name;
            mesh.material = jobs.jobs[i].material;
            scene.meshes.push_back(std::move(mesh));
            scene.warnings.insert(scene.warnings.end(), decoded[i].warnings.begin(),
                                  decoded[i].warnings.end());
        }
        for (SourceMaterial& material : materials)
            scene.materials.push_back(std::move(material.material));
        for (const PlacedMesh& placed : graph.meshes) {
            const auto [begin, end] = jobs.of_mesh.at(placed.mesh);
            for (size_t mesh = begin; mesh < end; ++mesh)
                scene.instances.push_back({static_cast<int>(mesh), placed.to_world});
        }
        warn_of_bright_materials(scene, brightest, scene.warnings);
        return scene;
    } catch (const Error&) {
        throw;
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::memory, path + ": is too large for the memory of this machine");
    } catch (const std::exception& error) {
        throw Error(ExitCode::invalid, path + ": is not valid glTF: " + error.what());
    }
}

} // namespace lpvbake
