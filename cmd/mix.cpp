// lpvbake mix: one volume of the layers of a bake, by weights, colours and a sky.

#include "bake/layers.h"
#include "commands.h"
#include "io/layers.h"
#include "io/levels.h"
#include "layer_files.h"
#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "options/lights.h"
#include "read_light.h"
#include "render/display.h"
#include "report/describe.h"
#include "scene/sky.h"
#include "scene_options.h"
#include "text.h"
#include "volume/sh.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/mix.txt.h"
    ;

/// "NAME=VALUE".
struct Weight {
    std::string name;
    std::string value;
};

struct MixOptions {
    std::string file;
    std::vector<Weight> weights;
    OutputOptions outputs;
    Format format = Format::text;
};

Weight parse_weight(const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == text.size())
        options::refuse(text, "is not NAME=WEIGHT, NAME=R,G,B, NAME=#RRGGBB or sky=FILE");
    return {text.substr(0, equals), text.substr(equals + 1)};
}

std::optional<glm::vec3> colour_of(const std::string& text) {
    if (const auto colour = options::parse_hex_colour(text))
        return colour;
    const auto numbers = options::parse_numbers(text);
    if (!numbers || (numbers->size() != 1 && numbers->size() != 3))
        return {};
    const auto& n = *numbers;
    return n.size() == 1 ? glm::vec3(n[0]) : glm::vec3(n[0], n[1], n[2]);
}

/// Gives the modes of a sky the weights of a picture.
void set_sky(const MixOptions& o, const std::string& file, TerminalProgress& progress,
             io::LayerSet& set) {
    const auto is_mode = [](const io::LayerEntry& layer) { return layer.kind == "mode"; };
    const auto modes = std::size_t(std::ranges::count_if(set.layers, is_mode));
    const int order = volume::sh_order_of(modes);
    if (order < 0)
        throw Error(ErrorKind::argument, "sky=" + file + ": " + o.file
                                             + " has no modes of a sky; bake it with --layers "
                                               "sky:2");
    std::vector<std::string> warnings;
    const Sky sky = load_sky(file, warnings);
    for (const std::string& warning : warnings)
        progress.warn(warning);
    if (!scene::sky_suns(sky).empty())
        progress.warn(
            format("%s: its sun is spread over the sky, as all that is smaller than bands "
                   "up to %d show",
                   file.c_str(), order));
    const std::vector<glm::vec3> weights = bake::project_sky(sky, order);
    std::size_t k = 0;
    for (io::LayerEntry& layer : set.layers)
        if (is_mode(layer))
            layer.weight = weights[k++];
        else if (layer.kind == "sky")
            layer.weight = glm::vec3(0.0f);
}

void set_weights(const MixOptions& o, TerminalProgress& progress, io::LayerSet& set) {
    for (const Weight& weight : o.weights) {
        const auto layer = std::ranges::find(set.layers, weight.name, &io::LayerEntry::name);
        const std::optional<glm::vec3> colour = colour_of(weight.value);
        if (weight.name == "sky" && !colour) {
            set_sky(o, weight.value, progress, set);
            continue;
        }
        if (layer == set.layers.end()) {
            std::string names;
            for (const io::LayerEntry& each : set.layers)
                names += (names.empty() ? "" : ", ") + each.name;
            throw Error(ErrorKind::argument, weight.name + "=" + weight.value + ": " + o.file
                                                 + " has no layer of that name; it has " + names);
        }
        if (!colour)
            throw Error(ErrorKind::argument, weight.name + "=" + weight.value
                                                 + ": is neither a number nor R,G,B nor #RRGGBB");
        layer->weight = *colour;
    }
}

/// What of the metadata is true of any light of the same layers.
void describe(const MixOptions& o, Volume& volume) {
    for (const char* fact : {"layers", "lights", "sky", "scene_hash", "settings", "output_settings",
                             "bake_hash", "default_light", "verified_cells", "verified_surfaces"})
        volume.metadata.erase(fact);
    std::string mix;
    for (const Weight& weight : o.weights)
        mix += (mix.empty() ? "" : " ") + weight.name + "=" + weight.value;
    volume.metadata["mix"] = mix.empty() ? "as baked" : mix;
    volume.metadata["exposure"] = format("%.1f", render::automatic_exposure(volume));
}

/// Throws Error (invalid) unless the layer is of the same bake.
void check_alike(const std::string& manifest, const std::string& file, const Volume& whole,
                 const Volume& layer) {
    const auto fact = [](const Volume& of, const char* name) {
        const auto found = of.metadata.find(name);
        return found == of.metadata.end() ? std::string() : found->second;
    };
    if (whole.grid.dims != layer.grid.dims || whole.sh_order != layer.sh_order
        || fact(whole, "scene_hash") != fact(layer, "scene_hash")
        || fact(whole, "settings") != fact(layer, "settings"))
        throw Error(ErrorKind::invalid,
                    manifest + ": " + file
                        + " is of another bake than the volume; bake all layers together");
}

volume::VolumeSet mix(const std::string& manifest, const io::LayerSet& set) {
    volume::VolumeSet sum = read_levels(set.file);
    for (Volume& level : sum.levels)
        for (std::vector<glm::vec3>& values : level.sh)
            std::ranges::fill(values, glm::vec3(0.0f));
    for (const io::LayerEntry& layer : set.layers) {
        if (layer.weight == glm::vec3(0.0f))
            continue;
        const volume::VolumeSet part = read_levels(layer.file);
        if (part.levels.size() != sum.levels.size())
            throw Error(ErrorKind::invalid, manifest + ": " + layer.file
                                                + " has other volumes than " + set.file
                                                + "; bake all layers together");
        for (std::size_t i = 0; i < sum.levels.size(); ++i) {
            Volume& level = sum.levels[i];
            check_alike(manifest, layer.file, level, part.levels[i]);
            for (std::size_t k = 0; k < level.sh.size(); ++k)
                for (std::size_t cell = 0; cell < level.sh[k].size(); ++cell)
                    level.sh[k][cell] += layer.weight * part.levels[i].sh[k][cell];
        }
    }
    return sum;
}

/// Whatever a program may be given: the manifest of layers, of a set, or a volume.
std::string manifest_of(const std::string& file) {
    return io::is_layer_manifest(file) ? file : io::layer_manifest_path(file);
}

/// Throws Error (argument) where an output would replace an input.
void check_outputs(const MixOptions& o, const std::string& manifest, const io::LayerSet& set) {
    std::vector<std::string> inputs{manifest}, files{set.file};
    for (const io::LayerEntry& layer : set.layers)
        files.push_back(layer.file);
    for (const std::string& file : files) {
        inputs.push_back(file);
        if (io::is_manifest(file))
            std::ranges::move(io::level_files(file), std::back_inserter(inputs));
    }
    check_files({}, inputs, o.outputs.paths);
    if (io::is_manifest(set.file))
        check_level_outputs(o.outputs.paths, inputs);
}

void run(const MixOptions& o) {
    if (o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "no output: add -o FILE" + io::format_list(" or -o FILE"));
    for (const std::string& path : o.outputs.paths)
        if (!io::volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": unknown kind of volume file; use " + io::format_list());
    const std::string manifest = manifest_of(o.file);
    io::LayerSet set;
    try {
        set = io::read_layer_manifest(manifest);
    } catch (const Error& error) {
        if (error.kind == ErrorKind::file && manifest != o.file)
            throw Error(ErrorKind::file, o.file + ": has no layers beside it (" + error.what()
                                             + "); bake it with --layers");
        throw;
    }
    check_outputs(o, manifest, set);
    TerminalProgress progress(ProgressStyle::none);
    set_weights(o, progress, set);
    volume::VolumeSet mixed = mix(manifest, set);
    for (Volume& level : mixed.levels)
        describe(o, level);
    const std::vector<Grid> grids = mixed.grids();
    const int order = mixed.levels.front().sh_order;
    const std::vector<Written> written = write_levels(o.outputs, o.outputs.paths, mixed, progress);
    if (o.format == Format::json) {
        print_json({{"command", "mix"},
                    {"file", o.file},
                    {"layers", report::Json::parse(io::text_of(set.layers))},
                    {"grid", report::grid_json(grids.front())},
                    {"sh_order", order},
                    {"outputs", outputs_json(written)},
                    {"warnings", progress.warnings()}});
        return;
    }
    std::ranges::for_each(grids, print_grid);
    for (const io::LayerEntry& layer : set.layers)
        std::printf("layer         %-20s %.4g, %.4g, %.4g\n", layer.name.c_str(),
                    double(layer.weight.x), double(layer.weight.y), double(layer.weight.z));
    print_outputs(written);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<MixOptions>();
    MixOptions& o = *fields;
    options
        .text("file", o.file, "IN",
              "Volume, or set of volumes, of bake --layers with its layers beside it, or the "
              ".layers.json")
        .require();
    options.values(
        "weights", o.weights, "NAME=VALUE", parse_weight,
        "Weight of a layer: a number, R,G,B, or #RRGGBB (sRGB); or sky=FILE, a picture as "
        "--sky takes it, where there are modes of a sky. All others keep the weight of "
        "the scene");
    options.texts("-o,--output", o.outputs.paths, "FILE", outputs_help()).keep_to_one_run();
    add_output_options(options, o.outputs);
    add_format_option(options, o.format);
    return [fields] { run(*fields); };
}

} // namespace

options::Command mix_command() {
    return {"mix", "Mixes the layers of a bake into a volume of other light.", manual, declare};
}

} // namespace lpvbake::cmd
