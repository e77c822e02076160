#include "scene/gltf/repair.h"

#include <nlohmann/json.hpp>

#include <string>

namespace lpvbake::scene::gltf {
namespace {

using nlohmann::json;

/// The value of a key, null if there is none.
json* find(json* object, const char* key) {
    if (!object || !object->is_object())
        return nullptr;
    const auto found = object->find(key);
    return found == object->end() ? nullptr : &*found;
}

size_t size_of(json& root, const char* array) {
    const json* found = find(&root, array);
    return found && found->is_array() ? found->size() : 0;
}

/// Calls f(element, place) for the objects of an array.
void for_each(json* array, const std::string& place, const auto& f) {
    if (array && array->is_array())
        for (size_t i = 0; i < array->size(); ++i)
            if ((*array)[i].is_object())
                f((*array)[i], place + "[" + std::to_string(i) + "]");
}

void add_missing_spots(json& root, Warnings& warnings) {
    constexpr const char* name = "KHR_lights_punctual";
    const std::string place = std::string("extensions.") + name + ".lights";
    for_each(find(find(find(&root, "extensions"), name), "lights"), place,
             [&](json& light, const std::string& light_place) {
                 if (const json* type = find(&light, "type");
                     !type || *type != "spot" || find(&light, "spot"))
                     return;
                 light["spot"] = json::object();
                 warnings.add("spot lights", light_place + ".spot",
                              "is missing: the extension's defaults are taken, angles of 0 and "
                              "pi/4; export it with its angles");
             });
}

/// Removes the index `key` of an object if it leads past its array.
void remove_dangling(json* object, const char* key, const char* array, size_t size,
                     const std::string& place, const char* instead, Warnings& warnings) {
    const json* index = find(object, key);
    if (!index || !index->is_number() || index->get<double>() < static_cast<double>(size))
        return;
    warnings.add(std::string(key) + " out of range", place + "." + key,
                 "index " + index->dump() + " is out of range: " + array + " has "
                     + std::to_string(size) + " elements: " + instead + "; export the file again");
    object->erase(key);
}

void remove_dangling_images(json& root, Warnings& warnings) {
    const size_t images = size_of(root, "images"), samplers = size_of(root, "samplers");
    constexpr const char* no_image = "the texture is without an image";
    for_each(find(&root, "textures"), "textures", [&](json& texture, const std::string& place) {
        remove_dangling(&texture, "source", "images", images, place, no_image, warnings);
        for (const char* name : {"EXT_texture_webp", "KHR_texture_basisu"})
            remove_dangling(find(find(&texture, "extensions"), name), "source", "images", images,
                            place + ".extensions." + name, no_image, warnings);
        remove_dangling(&texture, "sampler", "samplers", samplers, place,
                        "the texture is repeated and filtered", warnings);
    });
    const size_t views = size_of(root, "bufferViews");
    for_each(find(&root, "images"), "images", [&](json& image, const std::string& place) {
        remove_dangling(&image, "bufferView", "bufferViews", views, place,
                        "the image is without bytes", warnings);
    });
}

} // namespace

void repair(json& root, Warnings& warnings) {
    add_missing_spots(root, warnings);
    remove_dangling_images(root, warnings);
    if (size_of(root, "scenes") == 0 && size_of(root, "nodes") > 0)
        root.erase("scene");
}

} // namespace lpvbake::scene::gltf
