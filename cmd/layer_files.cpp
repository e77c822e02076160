#include "layer_files.h"

#include "io/atomic_file.h"
#include "io/glb.h"
#include "lpvbake/error.h"
#include "options/values.h"

#include <algorithm>
#include <iterator>
#include <optional>

namespace lpvbake::cmd {
namespace {

bake::LayerWish parse_layer(const std::string& text, const std::string& whole) {
    using Kind = bake::LayerWish::Kind;
    if (text == "lights")
        return {Kind::lights};
    if (text == "emitters")
        return {Kind::emitters};
    if (text == "sky")
        return {Kind::sky};
    if (text.starts_with("sky:")) {
        const auto order = options::parse_number(text.substr(4));
        if (!order || *order != int(*order) || *order < 0 || *order > bake::most_mode_order)
            options::refuse(whole, "has sky:N, where N is a band from 0 to "
                                       + std::to_string(bake::most_mode_order));
        return {Kind::sky, {}, {}, int(*order)};
    }
    const std::size_t equals = text.find('=');
    const std::string name = text.substr(0, equals);
    if (equals == std::string::npos || equals + 1 == text.size())
        options::refuse(whole, "is none of lights, emitters, sky, sky:N and NAME=GLOB, with commas "
                               "between them");
    if (!bake::is_layer_name(name) || name == "sky" || name == "rest" || name.starts_with("sky_"))
        options::refuse(whole, "has the name " + name
                                   + "; one has letters, digits, dots, dashes and underscores, and "
                                     "sky and rest have a meaning of their own");
    return {Kind::group, name, text.substr(equals + 1)};
}

} // namespace

std::vector<bake::LayerWish> parse_layers(const std::string& text) {
    std::vector<bake::LayerWish> wishes;
    for (const std::string& part : options::split(text, ','))
        wishes.push_back(parse_layer(part, text));
    return wishes;
}

std::vector<io::LayerEntry> entries_of(std::span<const bake::Layer> layers,
                                       const std::string& path) {
    std::vector<io::LayerEntry> entries;
    for (const bake::Layer& layer : layers) {
        entries.push_back({layer.name,
                           layer.kind,
                           layer.unit,
                           layer.weight,
                           io::layer_path(path, layer.name),
                           {},
                           layer.emitters,
                           layer.light.sky != glm::vec3(0.0f)});
        for (std::size_t i = 0; i < layer.light.lights.size(); ++i)
            if (layer.light.lights[i] != glm::vec3(0.0f))
                entries.back().lights.push_back(i);
    }
    return entries;
}

void check_layer_outputs(const std::vector<std::string>& paths, std::span<const bake::Layer> layers,
                         const std::vector<std::string>& inputs) {
    std::vector<std::string> all = paths, manifests;
    for (const std::string& path : paths) {
        if (io::volume_format(path) == &io::glb_format)
            throw Error(ErrorKind::argument, path
                                                 + ": a .glb has room for one light volume, not "
                                                   "for layers; write another kind of file");
        for (const io::LayerEntry& layer : entries_of(layers, path))
            all.push_back(layer.file);
        const std::string manifest = io::layer_manifest_path(path);
        if (std::ranges::count(manifests, manifest) > 0)
            throw Error(ErrorKind::argument, path + ": another output has the manifest " + manifest
                                                 + ", too; give it another name");
        manifests.push_back(manifest);
    }
    check_files(inputs, {}, all);
}

std::vector<Written> write_layers(const OutputOptions& o, const std::vector<std::string>& paths,
                                  Volume& volume, std::span<const bake::Layer> layers,
                                  std::vector<Volume>& volumes, TerminalProgress& progress) {
    std::vector<Written> written;
    for (const std::string& path : paths) {
        Written& own = written.emplace_back(Written{path, {}});
        const bool last = &path == &paths.back();
        const std::vector<io::LayerEntry> entries = entries_of(layers, path);
        const auto write = [&](const std::string& to, Volume& from) {
            std::vector<Written> one = write_outputs(o, {to}, from, progress);
            std::ranges::move(one.front().files, std::back_inserter(own.files));
            return one.front().packing;
        };
        io::PublishTogether together; // the old layers or the new ones, the manifest last
        Volume whole = volume;
        own.packing = write(path, whole);
        for (std::size_t i = 0; i < entries.size(); ++i) {
            Volume layer = last ? std::move(volumes[i]) : volumes[i];
            layer.walls = volume.walls;
            write(entries[i].file, layer);
        }
        own.files.push_back(io::write_layer_manifest(path, entries));
        together.publish();
        tell("wrote " + own.files.back().path);
    }
    volume.sh.clear();
    return written;
}

} // namespace lpvbake::cmd
