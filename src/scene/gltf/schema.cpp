#include "scene/gltf/schema.h"

#include "lpvbake/error.h"
#include "quoted.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>

namespace lpvbake::scene::gltf {
namespace {

using nlohmann::json;

enum class Kind {
    object,
    array,
    integer, ///< at least 0 and below 2^31
    size,    ///< integer of 64 bits
    number,
    boolean,
    string,
    index,   ///< into the array that the rule names
    indices, ///< an array of such
    numbers, ///< an array of any length
    vec2,
    vec3,
    vec4,
    mat4,
};

/// A property of the document: "[]" stands for every element of an array, "{}" for every value of
/// an object, a final "!" for required.
struct Rule {
    const char* path;
    Kind kind;
    const char* array = nullptr; ///< path of the array that an index points into
};

constexpr const char* lights_array = "extensions.KHR_lights_punctual.lights";
constexpr const char* variants_array = "extensions.KHR_materials_variants.variants";

constexpr Rule rules[] = {
    {"asset!", Kind::object},
    {"asset.version!", Kind::string},
    {"extensionsUsed", Kind::array},
    {"extensionsUsed[]", Kind::string},
    {"extensionsRequired", Kind::array},
    {"extensionsRequired[]", Kind::string},
    {"extensions", Kind::object},

    {"buffers", Kind::array},
    {"buffers[]", Kind::object},
    {"buffers[].byteLength!", Kind::size},
    {"buffers[].uri", Kind::string},
    {"buffers[].extensions", Kind::object},
    {"buffers[].extensions.EXT_meshopt_compression", Kind::object},
    {"buffers[].extensions.EXT_meshopt_compression.fallback", Kind::boolean},
    {"buffers[].extensions.KHR_meshopt_compression", Kind::object},
    {"buffers[].extensions.KHR_meshopt_compression.fallback", Kind::boolean},
    {"bufferViews", Kind::array},
    {"bufferViews[]", Kind::object},
    {"bufferViews[].buffer!", Kind::index, "buffers"},
    {"bufferViews[].byteOffset", Kind::size},
    {"bufferViews[].byteLength!", Kind::size},
    {"bufferViews[].byteStride", Kind::integer},
    {"bufferViews[].extensions", Kind::object},
    {"accessors", Kind::array},
    {"accessors[]", Kind::object},
    {"accessors[].bufferView", Kind::index, "bufferViews"},
    {"accessors[].byteOffset", Kind::size},
    {"accessors[].componentType!", Kind::integer},
    {"accessors[].count!", Kind::size},
    {"accessors[].type!", Kind::string},
    {"accessors[].normalized", Kind::boolean},
    {"accessors[].sparse", Kind::object},
    {"accessors[].sparse.count!", Kind::integer},
    {"accessors[].sparse.indices!", Kind::object},
    {"accessors[].sparse.indices.bufferView!", Kind::index, "bufferViews"},
    {"accessors[].sparse.indices.byteOffset", Kind::integer},
    {"accessors[].sparse.indices.componentType!", Kind::integer},
    {"accessors[].sparse.values!", Kind::object},
    {"accessors[].sparse.values.bufferView!", Kind::index, "bufferViews"},
    {"accessors[].sparse.values.byteOffset", Kind::integer},

    {"meshes", Kind::array},
    {"meshes[]", Kind::object},
    {"meshes[].name", Kind::string},
    {"meshes[].primitives!", Kind::array},
    {"meshes[].primitives[]", Kind::object},
    {"meshes[].primitives[].attributes!", Kind::object},
    {"meshes[].primitives[].attributes{}", Kind::index, "accessors"},
    {"meshes[].primitives[].indices", Kind::index, "accessors"},
    {"meshes[].primitives[].material", Kind::index, "materials"},
    {"meshes[].primitives[].mode", Kind::integer},
    {"meshes[].primitives[].targets", Kind::array},
    {"meshes[].primitives[].targets[]", Kind::object},
    {"meshes[].primitives[].targets[]{}", Kind::index, "accessors"},
    {"meshes[].primitives[].extensions", Kind::object},
    {"meshes[].primitives[].extensions.KHR_draco_mesh_compression", Kind::object},
    {"meshes[].primitives[].extensions.KHR_draco_mesh_compression.bufferView!", Kind::index,
     "bufferViews"},
    {"meshes[].primitives[].extensions.KHR_draco_mesh_compression.attributes!", Kind::object},
    {"meshes[].primitives[].extensions.KHR_draco_mesh_compression.attributes{}", Kind::integer},
    {"meshes[].primitives[].extensions.KHR_materials_variants", Kind::object},
    {"meshes[].primitives[].extensions.KHR_materials_variants.mappings!", Kind::array},
    {"meshes[].primitives[].extensions.KHR_materials_variants.mappings[]", Kind::object},
    {"meshes[].primitives[].extensions.KHR_materials_variants.mappings[].material!", Kind::index,
     "materials"},
    {"meshes[].primitives[].extensions.KHR_materials_variants.mappings[].variants!", Kind::indices,
     variants_array},
    {"meshes[].weights", Kind::numbers},

    {"images", Kind::array},
    {"images[]", Kind::object},
    {"images[].name", Kind::string},
    {"images[].uri", Kind::string},
    {"images[].bufferView", Kind::index, "bufferViews"},
    {"textures", Kind::array},
    {"textures[]", Kind::object},
    {"textures[].source", Kind::index, "images"},
    {"textures[].sampler", Kind::index, "samplers"},
    {"textures[].extensions", Kind::object},
    {"textures[].extensions.EXT_texture_webp", Kind::object},
    {"textures[].extensions.EXT_texture_webp.source", Kind::index, "images"},
    {"textures[].extensions.KHR_texture_basisu", Kind::object},
    {"textures[].extensions.KHR_texture_basisu.source", Kind::index, "images"},
    {"samplers", Kind::array},
    {"samplers[]", Kind::object},
    {"samplers[].magFilter", Kind::integer},
    {"samplers[].wrapS", Kind::integer},
    {"samplers[].wrapT", Kind::integer},

    {"materials", Kind::array},
    {"materials[]", Kind::object},
    {"materials[].name", Kind::string},
    {"materials[].pbrMetallicRoughness", Kind::object},
    {"materials[].pbrMetallicRoughness.baseColorFactor", Kind::vec4},
    {"materials[].pbrMetallicRoughness.metallicFactor", Kind::number},
    {"materials[].emissiveFactor", Kind::vec3},
    {"materials[].alphaMode", Kind::string},
    {"materials[].alphaCutoff", Kind::number},
    {"materials[].doubleSided", Kind::boolean},
    {"materials[].extensions", Kind::object},
    {"materials[].extensions.KHR_materials_emissive_strength", Kind::object},
    {"materials[].extensions.KHR_materials_emissive_strength.emissiveStrength", Kind::number},
    {"materials[].extensions.KHR_materials_pbrSpecularGlossiness", Kind::object},
    {"materials[].extensions.KHR_materials_pbrSpecularGlossiness.diffuseFactor", Kind::vec4},
    {"materials[].extensions.KHR_materials_transmission", Kind::object},
    {"materials[].extensions.KHR_materials_transmission.transmissionFactor", Kind::number},
    {"materials[].extensions.KHR_materials_volume", Kind::object},
    {"materials[].extensions.KHR_materials_volume.thicknessFactor", Kind::number},
    {"materials[].extensions.KHR_materials_volume.attenuationDistance", Kind::number},
    {"materials[].extensions.KHR_materials_volume.attenuationColor", Kind::vec3},
    {"extensions.KHR_materials_variants", Kind::object},
    {"extensions.KHR_materials_variants.variants", Kind::array},
    {"extensions.KHR_materials_variants.variants[]", Kind::object},
    {"extensions.KHR_materials_variants.variants[].name", Kind::string},

    {"cameras", Kind::array},
    {"cameras[]", Kind::object},
    {"cameras[].name", Kind::string},

    {"extensions.KHR_lights_punctual", Kind::object},
    {"extensions.KHR_lights_punctual.lights", Kind::array},
    {"extensions.KHR_lights_punctual.lights[]", Kind::object},
    {"extensions.KHR_lights_punctual.lights[].name", Kind::string},
    {"extensions.KHR_lights_punctual.lights[].type!", Kind::string},
    {"extensions.KHR_lights_punctual.lights[].color", Kind::vec3},
    {"extensions.KHR_lights_punctual.lights[].intensity", Kind::number},
    {"extensions.KHR_lights_punctual.lights[].range", Kind::number},
    {"extensions.KHR_lights_punctual.lights[].spot", Kind::object},
    {"extensions.KHR_lights_punctual.lights[].spot.innerConeAngle", Kind::number},
    {"extensions.KHR_lights_punctual.lights[].spot.outerConeAngle", Kind::number},

    {"nodes", Kind::array},
    {"nodes[]", Kind::object},
    {"nodes[].name", Kind::string},
    {"nodes[].children", Kind::indices, "nodes"},
    {"nodes[].mesh", Kind::index, "meshes"},
    {"nodes[].camera", Kind::index, "cameras"},
    {"nodes[].skin", Kind::index, "skins"},
    {"nodes[].matrix", Kind::mat4},
    {"nodes[].translation", Kind::vec3},
    {"nodes[].rotation", Kind::vec4},
    {"nodes[].scale", Kind::vec3},
    {"nodes[].weights", Kind::numbers},
    {"nodes[].extensions", Kind::object},
    {"nodes[].extensions.KHR_lights_punctual", Kind::object},
    {"nodes[].extensions.KHR_lights_punctual.light!", Kind::index, lights_array},
    {"nodes[].extensions.EXT_mesh_gpu_instancing", Kind::object},
    {"nodes[].extensions.EXT_mesh_gpu_instancing.attributes!", Kind::object},
    {"nodes[].extensions.EXT_mesh_gpu_instancing.attributes{}", Kind::index, "accessors"},
    {"nodes[].extensions.KHR_node_visibility", Kind::object},
    {"nodes[].extensions.KHR_node_visibility.visible", Kind::boolean},
    {"skins", Kind::array},
    {"skins[]", Kind::object},
    {"skins[].joints!", Kind::indices, "nodes"},
    {"skins[].inverseBindMatrices", Kind::index, "accessors"},
    {"skins[].skeleton", Kind::index, "nodes"},
    {"animations", Kind::array},
    {"animations[]", Kind::object},
    {"animations[].name", Kind::string},
    {"animations[].channels!", Kind::array},
    {"animations[].channels[]", Kind::object},
    {"animations[].channels[].sampler!", Kind::integer},
    {"animations[].channels[].target!", Kind::object},
    {"animations[].channels[].target.node", Kind::index, "nodes"},
    {"animations[].channels[].target.path!", Kind::string},
    {"animations[].samplers!", Kind::array},
    {"animations[].samplers[]", Kind::object},
    {"animations[].samplers[].input!", Kind::index, "accessors"},
    {"animations[].samplers[].output!", Kind::index, "accessors"},
    {"animations[].samplers[].interpolation", Kind::string},
    {"scenes", Kind::array},
    {"scenes[]", Kind::object},
    {"scenes[].name", Kind::string},
    {"scenes[].nodes", Kind::indices, "nodes"},
    {"scene", Kind::index, "scenes"},
};

/// Where texture references stand, and what is checked in each.
constexpr const char* texture_places[] = {
    "materials[].pbrMetallicRoughness.baseColorTexture",
    "materials[].pbrMetallicRoughness.metallicRoughnessTexture",
    "materials[].emissiveTexture",
    "materials[].extensions.KHR_materials_pbrSpecularGlossiness.diffuseTexture",
    "materials[].extensions.KHR_materials_transmission.transmissionTexture",
    "materials[].extensions.KHR_materials_volume.thicknessTexture",
};
constexpr Rule texture_rules[] = {
    {"", Kind::object},
    {".index!", Kind::index, "textures"},
    {".texCoord", Kind::integer},
    {".extensions", Kind::object},
    {".extensions.KHR_texture_transform", Kind::object},
    {".extensions.KHR_texture_transform.offset", Kind::vec2},
    {".extensions.KHR_texture_transform.scale", Kind::vec2},
    {".extensions.KHR_texture_transform.rotation", Kind::number},
    {".extensions.KHR_texture_transform.texCoord", Kind::integer},
};

/// Either name of meshoptimizer's extension, and what is checked in it.
constexpr const char* meshopt_places[] = {
    "bufferViews[].extensions.EXT_meshopt_compression",
    "bufferViews[].extensions.KHR_meshopt_compression",
};
constexpr Rule meshopt_rules[] = {
    {"", Kind::object},
    {".buffer!", Kind::index, "buffers"},
    {".byteOffset", Kind::size},
    {".byteLength!", Kind::size},
    {".byteStride!", Kind::integer},
    {".count!", Kind::size},
    {".mode!", Kind::string},
    {".filter", Kind::string},
};

class Checker {
public:
    Checker(json& root, const std::string& file) : root_(root), file_(file) {}

    void check(std::string_view path, Kind kind, const char* array) {
        required_ = path.ends_with('!');
        if (required_)
            path.remove_suffix(1);
        kind_ = kind;
        array_ = array;
        limit_ = array ? size_of(array) : 0;
        descend(root_, path, "");
    }

private:
    [[noreturn]] void fail(const std::string& place, const std::string& why) const {
        throw Error(ErrorKind::invalid,
                    file_ + ": " + place + ": " + why + "; repair the file or export it again");
    }

    size_t size_of(std::string_view path) const {
        const json* value = &root_;
        while (!path.empty()) {
            const size_t dot = path.find('.');
            const auto found = value->find(path.substr(0, dot));
            if (found == value->end())
                return 0;
            value = &*found;
            path.remove_prefix(dot == std::string_view::npos ? path.size() : dot + 1);
        }
        return value->is_array() ? value->size() : 0;
    }

    /// `rest` is what of the rule's path lies below `value`, which stands at `place`. A value of
    /// another type than the path expects has its own rule, which speaks first.
    void descend(json& value, std::string_view rest, const std::string& place) {
        if (rest.empty()) {
            test(value, place);
        } else if (rest.starts_with("[]")) {
            if (value.is_array())
                for (size_t i = 0; i < value.size(); ++i)
                    descend(value[i], rest.substr(2), place + "[" + std::to_string(i) + "]");
        } else if (rest.starts_with("{}")) {
            if (value.is_object())
                for (auto& [key, child] : value.items())
                    descend(child, rest.substr(2), place + "." + printable(key));
        } else if (value.is_object()) {
            if (rest.front() == '.')
                rest.remove_prefix(1);
            const std::string_view key = rest.substr(0, rest.find_first_of(".[{"));
            const auto child = value.find(key);
            const std::string child_place = (place.empty() ? "" : place + ".") + std::string(key);
            if (child != value.end())
                descend(*child, rest.substr(key.size()), child_place);
            else if (required_ && key.size() == rest.size())
                fail(child_place, "is missing");
        }
    }

    void test(json& value, const std::string& place) const {
        switch (kind_) {
        case Kind::object:
            return require(value.is_object(), place, "must be an object");
        case Kind::array:
            return require(value.is_array(), place, "must be an array");
        case Kind::integer:
            return require(make_whole(value)
                               && value.get<uint64_t>() <= std::numeric_limits<int32_t>::max(),
                           place, "must be an integer from 0 to 2147483647");
        case Kind::size:
            return require(make_whole(value), place, "must be an integer that is not negative");
        case Kind::number:
            return require(value.is_number(), place, "must be a number");
        case Kind::boolean:
            return require(value.is_boolean(), place, "must be true or false");
        case Kind::string:
            return require(value.is_string(), place, "must be a string");
        case Kind::index:
            return test_index(value, place);
        case Kind::indices:
            require(value.is_array(), place, "must be an array");
            for (size_t i = 0; i < value.size(); ++i)
                test_index(value[i], place + "[" + std::to_string(i) + "]");
            return;
        case Kind::numbers:
            require(value.is_array(), place, "must be an array");
            return test_numbers(value, place, value.size());
        case Kind::vec2:
            return test_numbers(value, place, 2);
        case Kind::vec3:
            return test_numbers(value, place, 3);
        case Kind::vec4:
            return test_numbers(value, place, 4);
        case Kind::mat4:
            return test_numbers(value, place, 16);
        }
    }

    void require(bool ok, const std::string& place, const char* what) const {
        if (!ok)
            fail(place, what);
    }

    /// True if the value is an integer of 64 bits without sign, as it is from then on.
    static bool make_whole(json& value) {
        if (value.is_number_integer() && !value.is_number_unsigned() && value.get<int64_t>() == 0)
            value = uint64_t{0}; // -0
        if (value.is_number_float()) {
            const double number = value.get<double>();
            if (number >= 0.0 && number < 0x1p64 && number == std::floor(number))
                value = static_cast<uint64_t>(number);
        }
        return value.is_number_unsigned();
    }

    void test_index(json& value, const std::string& place) const {
        require(make_whole(value), place, "must be an index");
        if (const auto index = value.get<uint64_t>(); index >= limit_)
            fail(place, "index " + std::to_string(index) + " is out of range: " + array_ + " has "
                            + std::to_string(limit_) + " elements");
    }

    void test_numbers(const json& value, const std::string& place, size_t count) const {
        bool ok = value.is_array() && value.size() == count;
        for (size_t i = 0; ok && i < count; ++i)
            ok = value[i].is_number();
        if (!ok)
            fail(place, "must be an array of " + std::to_string(count) + " numbers");
    }

    json& root_;
    const std::string& file_;
    bool required_ = false;
    Kind kind_ = Kind::object;
    const char* array_ = nullptr;
    size_t limit_ = 0;
};

} // namespace

void check_schema(json& root, const std::string& file) {
    if (!root.is_object())
        throw Error(ErrorKind::invalid,
                    file + ": is not a glTF document: its root is not an object");
    Checker checker(root, file);
    for (const Rule& rule : rules)
        checker.check(rule.path, rule.kind, rule.array);
    for (const std::string place : texture_places)
        for (const Rule& rule : texture_rules)
            checker.check(place + rule.path, rule.kind, rule.array);
    for (const std::string place : meshopt_places)
        for (const Rule& rule : meshopt_rules)
            checker.check(place + rule.path, rule.kind, rule.array);
}

} // namespace lpvbake::scene::gltf
