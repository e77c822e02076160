#include "hard_cases/gltf_writer.h"

#include <glm/gtc/quaternion.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <nlohmann/json.hpp>

#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>

namespace lpvbake::scenes {
namespace {

using json = nlohmann::ordered_json;

std::string base64(const std::string& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t bits = 0;
        for (size_t k = 0; k < 3; ++k)
            bits = bits << 8 | (i + k < bytes.size() ? uint8_t(bytes[i + k]) : 0u);
        for (size_t k = 0; k < 4; ++k)
            text += i + k <= bytes.size() ? digits[bits >> (18 - 6 * k) & 63u] : '=';
    }
    return text;
}

/// Of a vector or a matrix, column by column.
template <typename Value>
json numbers(const Value& value) {
    constexpr size_t count = sizeof(Value) / sizeof(typename Value::value_type);
    return std::vector<double>(glm::value_ptr(value), glm::value_ptr(value) + count);
}

json material_json(const Material& material) {
    json j{{"name", material.name},
           {"doubleSided", material.double_sided},
           {"pbrMetallicRoughness",
            {{"baseColorFactor", numbers(material.base_color)}, {"metallicFactor", 0}}}};
    const float strongest =
        std::max({material.emission.x, material.emission.y, material.emission.z});
    if (strongest > 0.0f) {
        j["emissiveFactor"] = numbers(glm::dvec3(material.emission) / double(strongest));
        j["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = strongest;
    }
    return j;
}

json light_json(const Light& light) {
    json j{{"type", light.type == LightType::directional ? "directional"
                    : light.type == LightType::point     ? "point"
                                                         : "spot"},
           {"color", numbers(light.color)},
           {"intensity", light.intensity}};
    if (light.range > 0.0)
        j["range"] = light.range;
    if (light.type == LightType::spot)
        j["spot"] = {{"innerConeAngle", light.inner_cone}, {"outerConeAngle", light.outer_cone}};
    return j;
}

/// Turns -Z to `direction`.
glm::dquat turn_to(glm::dvec3 direction) {
    const glm::dvec3 from(0, 0, -1);
    if (glm::dot(from, direction) < -1.0 + 1e-12)
        return glm::dquat(0, 0, 1, 0);
    return glm::normalize(glm::dquat(1.0 + glm::dot(from, direction), glm::cross(from, direction)));
}

/// Appends values to the buffer and an accessor for them; returns its index.
template <typename Element>
size_t append(json& root, std::string& buffer, const std::vector<Element>& values,
              const json& accessor) {
    const size_t bytes = values.size() * sizeof(Element);
    root["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes}});
    buffer.append(reinterpret_cast<const char*>(values.data()), bytes);
    root["accessors"].push_back(accessor);
    root["accessors"].back()["bufferView"] = root["bufferViews"].size() - 1;
    return root["accessors"].size() - 1;
}

} // namespace

void write_gltf(const Scene& scene, const std::string& path) {
    json root{{"asset", {{"version", "2.0"}}}, {"scene", 0}};
    std::string buffer;
    for (const Material& material : scene.materials)
        root["materials"].push_back(material_json(material));
    for (const Mesh& mesh : scene.meshes) {
        glm::vec3 lo(std::numeric_limits<float>::max()), hi(-lo);
        for (const glm::vec3& p : mesh.positions) {
            lo = glm::min(lo, p);
            hi = glm::max(hi, p);
        }
        const size_t positions = append(root, buffer, mesh.positions,
                                        {{"componentType", 5126},
                                         {"count", mesh.positions.size()},
                                         {"type", "VEC3"},
                                         {"min", numbers(lo)},
                                         {"max", numbers(hi)}});
        const size_t indices = append(
            root, buffer, mesh.triangles,
            {{"componentType", 5125}, {"count", 3 * mesh.triangles.size()}, {"type", "SCALAR"}});
        root["meshes"].push_back({{"primitives",
                                   {{{"attributes", {{"POSITION", positions}}},
                                     {"indices", indices},
                                     {"material", mesh.material}}}}});
    }
    for (const Instance& instance : scene.instances)
        root["nodes"].push_back({{"mesh", instance.mesh}, {"matrix", numbers(instance.to_world)}});
    for (size_t i = 0; i < scene.lights.size(); ++i) {
        const Light& light = scene.lights[i];
        const glm::dquat q = turn_to(light.direction);
        root["extensions"]["KHR_lights_punctual"]["lights"].push_back(light_json(light));
        root["nodes"].push_back({{"translation", numbers(light.position)},
                                 {"rotation", {q.x, q.y, q.z, q.w}},
                                 {"extensions", {{"KHR_lights_punctual", {{"light", i}}}}}});
    }
    root["extensionsUsed"] = {"KHR_lights_punctual", "KHR_materials_emissive_strength"};
    std::vector<size_t> nodes(root["nodes"].size());
    for (size_t i = 0; i < nodes.size(); ++i)
        nodes[i] = i;
    root["scenes"].push_back({{"nodes", nodes}});
    root["buffers"].push_back({{"byteLength", buffer.size()},
                               {"uri", "data:application/octet-stream;base64," + base64(buffer)}});
    std::ofstream file(path, std::ios::binary);
    file << root.dump(1) << '\n';
    if (!file.flush())
        throw std::runtime_error(path + " cannot be written");
}

} // namespace lpvbake::scenes
