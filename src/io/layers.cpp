#include "io/layers.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/io.h"
#include "io/levels.h"
#include "io/points.h"
#include "lpvbake/error.h"
#include "quoted.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* end_of_name = ".layers.json";
constexpr const char* format_name = "lpvbake layers";
constexpr int version = 1;
constexpr uint64_t most_bytes = 1 << 20;
constexpr std::size_t most_entries = 1024;

/// Of a layer the stem of files.
std::string named(const std::string& stem, const std::string& layer) {
    return stem + "_layer_" + layer;
}
/// The same of all light in their own cells.
std::string whole(const std::string& stem) {
    return stem + "_layers";
}

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

double number_in(const std::string& path, const Json& json, const char* name) {
    const auto found = json.is_object() ? json.find(name) : json.end();
    if (!json.is_object() || found == json.end() || !found->is_number()
        || !std::isfinite(found->get<double>()))
        reject(path, std::string("has a sun without a number \"") + name + "\"");
    return *found;
}

/// The path of a volume, or of the manifest of a set, that lies beside the manifest.
std::string file_in(const std::string& path, const Json& json) {
    const std::string name = string_in(path, json, "file");
    if (name.find('/') != std::string::npos
        || !(readable_format(name) || is_manifest(name) || is_lit_point_format(name)))
        reject(path, "lists " + printable(name) + ", which is no volume file beside it");
    return (fs::path(path).parent_path() / name).string();
}

/// Files of a layer: of a set all that its manifest lists, and that.
std::vector<std::string> files_of(const std::string& file) {
    std::vector<std::string> files, volumes{file};
    if (is_manifest(file)) {
        volumes = level_files(file);
        files.push_back(file);
    }
    for (const std::string& volume : volumes)
        add_with_textures(volume, files);
    return files;
}

/// Files of layers that the manifest of a former bake lists, if there is one, and that are not
/// written anew.
std::vector<std::string> left_over(const std::string& manifest,
                                   const std::vector<WriteReport::File>& written) {
    const std::string stem = manifest.substr(0, manifest.size() - std::string(end_of_name).size());
    std::vector<std::string> over;
    const auto add = [&](const std::string& set, const std::string& ours) {
        if (set_stem(set) == ours)
            std::ranges::copy_if(
                files_of(set), std::back_inserter(over), [&](const std::string& file) {
                    return std::ranges::count(written, file, &WriteReport::File::path) == 0;
                });
    };
    try {
        const LayerSet former = read_layer_manifest(manifest);
        add(former.file, whole(stem));
        for (const LayerEntry& layer : former.layers)
            add(layer.file, named(stem, layer.name));
    } catch (const Error&) { // it is replaced whatever it holds
    }
    return over;
}

} // namespace

std::string layer_path(const std::string& path, const std::string& name) {
    const std::string stem = set_stem(path);
    return named(stem, name) + path.substr(stem.size());
}

std::string layers_whole_path(const std::string& path) {
    const std::string stem = set_stem(path);
    return whole(stem) + path.substr(stem.size());
}

std::string layer_manifest_path(const std::string& path) {
    return set_stem(path) + end_of_name;
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

WriteReport::File write_layer_manifest(const std::string& path, const std::string& file,
                                       const std::vector<LayerEntry>& layers,
                                       const std::vector<WriteReport::File>& written) {
    const auto name_of = [](const std::string& of) { return fs::path(of).filename().string(); };
    Json list = Json::array();
    for (const LayerEntry& layer : layers) {
        list.push_back(json_of(layer));
        list.back().update(Json{{"lights", layer.lights},
                                {"emitters", layer.emitters},
                                {"sky", layer.sky},
                                {"file", name_of(layer.file)}});
        if (const auto& sun = layer.sun)
            list.back()["sun"] = {{"latitude", sun->latitude},
                                  {"longitude", sun->longitude},
                                  {"date", sun->date},
                                  {"hour", sun->hour}};
    }
    const Json manifest{
        {"format", format_name}, {"version", version}, {"file", name_of(file)}, {"layers", list}};
    const std::string name = layer_manifest_path(path);
    const std::vector<std::string> over = left_over(name, written);
    AtomicFile to(name);
    to.write(text_of(manifest));
    const uint64_t bytes = to.seal();
    to.publish();
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
        if (const auto sun = each.find("sun"); sun != each.end())
            layer.sun = {number_in(path, *sun, "latitude"), number_in(path, *sun, "longitude"),
                         string_in(path, *sun, "date"), number_in(path, *sun, "hour")};
        if (std::ranges::count(set.layers, layer.name, &LayerEntry::name) > 0)
            reject(path, "has two layers " + printable(layer.name));
        set.layers.push_back(std::move(layer));
    }
    return set;
}

} // namespace lpvbake::io
