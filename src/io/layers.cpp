#include "io/layers.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/io.h"
#include "lpvbake/error.h"
#include "quoted.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* end_of_name = ".layers.json";
constexpr const char* format_name = "lpvbake layers";
constexpr int version = 1;
constexpr uint64_t most_bytes = 1 << 20;
constexpr std::size_t most_entries = 1024;

Json json_of(const LayerEntry& layer) {
    return {{"name", layer.name},
            {"kind", layer.kind},
            {"unit", layer.unit},
            {"weight", {layer.weight.x, layer.weight.y, layer.weight.z}}};
}

std::string string_in(const std::string& path, const Json& json, const char* name) {
    const auto found = json.is_object() ? json.find(name) : json.end();
    if (!json.is_object() || found == json.end() || !found->is_string()
        || found->get<std::string>().empty())
        reject(path, std::string("has a place without a \"") + name + "\"");
    return *found;
}

/// The path of a volume that lies beside the manifest.
std::string file_in(const std::string& path, const Json& json) {
    const std::string name = string_in(path, json, "file");
    if (name.find('/') != std::string::npos || !readable_format(name))
        reject(path, "lists " + printable(name) + ", which is no volume file beside it");
    return (fs::path(path).parent_path() / name).string();
}

/// Files that the manifest of a former bake lists, if there is one, beyond those of `kept`.
std::vector<std::string> left_over(const std::string& manifest,
                                   const std::vector<std::string>& kept) {
    std::vector<std::string> over;
    LayerSet former;
    try {
        former = read_layer_manifest(manifest);
    } catch (const Error&) { // it is replaced whatever it holds
    }
    for (const LayerEntry& layer : former.layers) {
        const bool ours = layer.file == layer_path(former.file, layer.name);
        if (ours && std::ranges::count(kept, layer.file) == 0)
            add_with_textures(layer.file, over);
    }
    return over;
}

} // namespace

std::string layer_path(const std::string& path, const std::string& name) {
    return with_suffix(path, "_layer_" + name);
}

std::string layer_manifest_path(const std::string& path) {
    return fs::path(path).replace_extension().string() + end_of_name;
}

bool is_layer_manifest(const std::string& path) {
    return path.ends_with(end_of_name);
}

std::string text_of(const std::vector<LayerEntry>& layers) {
    Json list = Json::array();
    for (const LayerEntry& layer : layers)
        list.push_back(json_of(layer));
    return list.dump();
}

WriteReport::File write_layer_manifest(const std::string& path,
                                       const std::vector<LayerEntry>& layers) {
    Json list = Json::array();
    std::vector<std::string> kept;
    for (const LayerEntry& layer : layers) {
        list.push_back(json_of(layer));
        list.back().update(
            Json{{"lights", layer.lights}, {"emitters", layer.emitters}, {"sky", layer.sky}});
        kept.push_back(layer_path(path, layer.name));
        list.back()["file"] = fs::path(kept.back()).filename().string();
    }
    const Json manifest{{"format", format_name},
                        {"version", version},
                        {"file", fs::path(path).filename().string()},
                        {"layers", list}};
    const std::string name = layer_manifest_path(path);
    const std::vector<std::string> over = left_over(name, kept);
    AtomicFile file(name);
    file.write(text_of(manifest));
    const uint64_t bytes = file.seal();
    file.publish();
    remove_files(over);
    return {name, bytes};
}

LayerSet read_layer_manifest(const std::string& path) {
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    if (!json.is_object() || json.value("format", Json()) != format_name)
        reject(path, "is no manifest of layers, or damaged; bake the layers again");
    if (json.value("version", Json()) != version)
        reject(path, "has another \"version\" than " + std::to_string(version)
                         + ", which is all that this lpvbake reads");
    LayerSet set{file_in(path, json), {}};
    const auto layers = json.find("layers");
    if (layers == json.end() || !layers->is_array() || layers->empty()
        || layers->size() > most_entries)
        reject(path, "lists no layers, or more than " + std::to_string(most_entries));
    for (const Json& each : *layers) {
        LayerEntry layer{string_in(path, each, "name"),
                         string_in(path, each, "kind"),
                         string_in(path, each, "unit"),
                         {},
                         file_in(path, each)};
        const auto weight = each.find("weight");
        if (weight == each.end() || !weight->is_array() || weight->size() != 3)
            reject(path, printable(layer.name) + " has no \"weight\" of three numbers");
        for (int c = 0; c < 3; ++c) {
            const Json& number = (*weight)[std::size_t(c)];
            if (!number.is_number() || !std::isfinite(number.get<float>()))
                reject(path, printable(layer.name) + " has no \"weight\" of three numbers");
            layer.weight[c] = number.get<float>();
        }
        if (std::ranges::count(set.layers, layer.name, &LayerEntry::name) > 0)
            reject(path, "has two layers " + printable(layer.name));
        set.layers.push_back(std::move(layer));
    }
    return set;
}

} // namespace lpvbake::io
