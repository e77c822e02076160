#include "scene/gltf/materials.h"

#include "quoted.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::scene::gltf {
namespace {

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

/// KHR_materials_volume: how thick it is, and what that leaves. A distance of 0 stands for none.
void read_volume(SourceMaterial& result, const tinygltf::Value& extension, const auto& factor) {
    const auto value = [&](const char* key, double otherwise) {
        return double(factor(number(extension, key, otherwise),
                             (std::string(".extensions.KHR_materials_volume.") + key).c_str()));
    };
    const double thickness = value("thicknessFactor", 0.0);
    const double distance = value("attenuationDistance", 0.0);
    if (extension.Has("attenuationColor"))
        for (int i = 0; i < 3; ++i)
            result.attenuation_color[i] =
                std::min(1.0f, factor(extension.Get("attenuationColor").Get(i).GetNumberAsDouble(),
                                      ".extensions.KHR_materials_volume.attenuationColor"));
    if (!(thickness > 0.0 && distance > 0.0))
        return;
    result.thickness = thickness / distance;
    if (extension.Has("thicknessTexture"))
        result.thickness_texture = extension.Get("thicknessTexture").Get("index").GetNumberAsInt();
}

} // namespace

glm::vec2 UvSource::operator()(glm::vec2 uv) const {
    const glm::dvec2 scaled = scale * glm::dvec2(uv);
    const double c = std::cos(rotation), s = std::sin(rotation);
    return offset + glm::dvec2(c * scaled.x + s * scaled.y, c * scaled.y - s * scaled.x);
}

SourceMaterial read_material(Document& document, int index, const MaterialRules& rules) {
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
        document.warnings.add("alpha modes", result.place + ".alphaMode",
                              in_quotes(source.alphaMode)
                                  + " is not an alpha mode: the material is taken for opaque; "
                                    "write OPAQUE, MASK or BLEND");
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
    if (const auto* extension = find_extension(source.extensions, "KHR_materials_transmission")) {
        result.transmission =
            std::min(1.0f, factor(number(*extension, "transmissionFactor", 0.0),
                                  ".extensions.KHR_materials_transmission.transmissionFactor"));
        if (result.transmission > 0.0 && extension->Has("transmissionTexture"))
            result.transmission_texture =
                extension->Get("transmissionTexture").Get("index").GetNumberAsInt();
    }
    if (const auto* volume = find_extension(source.extensions, "KHR_materials_volume");
        volume && result.transmission > 0.0)
        read_volume(result, *volume, factor);
    result.unlit = find_extension(source.extensions, "KHR_materials_unlit") != nullptr;
    return result;
}

} // namespace lpvbake::scene::gltf
