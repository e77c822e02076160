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
#include "scene/sun_arc.h"
#include "scene_options.h"
#include "text.h"
#include "volume/dilate.h"
#include "volume/sh.h"
#include "volume/sky_occlusion.h"

#include <algorithm>
#include <array>
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
    bool sky_occlusion = false;
    OutputOptions outputs;
    Format format = Format::text;
};

Weight parse_weight(const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == text.size())
        options::refuse(text, "is not NAME=WEIGHT, NAME=R,G,B, NAME=#RRGGBB, sky=SKY or sun=HH:MM");
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

/// Layers with the weights that they have in a mixture.
struct Mixture {
    io::LayerSet set;
    /// Coefficients of a sky, of which the layer of visibility gives what is seen instead of what
    /// its weight says; empty: none.
    std::vector<glm::vec3> seen_sky = {};
};

bool is_visibility(const io::LayerEntry& layer) {
    return layer.kind == "visibility";
}

/// Kind of the layers that are a sky's modes, reflected alone beside one of visibility.
const char* mode_kind(const io::LayerSet& set) {
    return std::ranges::any_of(set.layers, is_visibility) ? "bounce" : "mode";
}

/// The highest band of a sky that mixtures show; throws Error (argument) where there is none.
int sky_order(const std::string& file, const std::string& word, const io::LayerSet& set) {
    const auto modes = std::ranges::count(set.layers, mode_kind(set), &io::LayerEntry::kind);
    const int order = volume::sh_order_of(std::size_t(modes));
    if (order < 0)
        throw Error(ErrorKind::argument, word + ": " + file
                                             + " has no modes of a sky; bake it with --layers "
                                               "transfer or sky:2");
    return std::ranges::any_of(set.layers, is_visibility) ? volume::sh_max_order : order;
}

/// Puts a sky, of which so much is shown, in the place of the scene's.
void set_sky(const Sky& sky, int order, Mixture& mixture) {
    const std::string kind = mode_kind(mixture.set);
    const std::vector<glm::vec3> coefficients = bake::project_sky(sky, order);
    mixture.seen_sky.clear();
    std::size_t k = 0;
    for (io::LayerEntry& layer : mixture.set.layers)
        if (layer.kind == kind) {
            layer.weight = coefficients[k++];
        } else if (is_visibility(layer)) {
            layer.weight = volume::sh_y0 * coefficients[0];
            mixture.seen_sky = coefficients;
        } else if (layer.kind == "sky") {
            layer.weight = glm::vec3(0.0f);
        }
}

Sky sky_of(const std::string& text, TerminalProgress& progress) {
    const SkyOption option = parse_sky_option(text);
    const auto* picture = std::get_if<SkyPicture>(&option);
    if (!picture)
        return std::get<Sky>(option);
    std::vector<std::string> warnings;
    const Sky sky = load_sky(picture->path, warnings, picture->scale);
    for (const std::string& warning : warnings)
        progress.warn(warning);
    return sky;
}

/// Hours of "19:30" or "19.5".
std::optional<double> hour_of(const std::string& text) {
    const std::size_t colon = text.find(':');
    const auto hours = options::parse_number(text.substr(0, colon));
    const auto minutes =
        colon == text.npos ? std::optional(0.0) : options::parse_number(text.substr(colon + 1));
    if (!hours || !minutes || *hours < 0 || *minutes < 0 || *minutes >= 60
        || *hours + *minutes / 60 > 24)
        return {};
    return *hours + *minutes / 60;
}

/// Gives suns the weights of a time of the day.
void set_sun(const MixOptions& o, const std::string& time, io::LayerSet& set) {
    std::vector<io::LayerEntry*> suns;
    std::vector<double> hours;
    for (io::LayerEntry& layer : set.layers)
        if (layer.sun) {
            suns.push_back(&layer);
            hours.push_back(layer.sun->hour);
        }
    if (suns.empty())
        throw Error(ErrorKind::argument, "sun=" + time + ": " + o.file
                                             + " has no suns of a day; bake it with --layers "
                                               "suns:12@48.1,11.6,06-21");
    const io::SunPlace& sun = *suns.front()->sun;
    const auto damaged = [&] {
        return Error(ErrorKind::invalid,
                     o.file
                         + ": its suns do not follow each other over a day of a "
                           "place; bake the layers again");
    };
    for (const io::LayerEntry* layer : suns)
        if (layer->sun->latitude != sun.latitude || layer->sun->longitude != sun.longitude
            || layer->sun->date != sun.date)
            throw damaged();
    scene::SunArc arc;
    try {
        arc = scene::parse_arc(o.file, sun.latitude, sun.longitude, sun.date);
    } catch (const Error&) {
        throw damaged();
    }
    const auto hour = time == "off" ? std::optional(0.0) : hour_of(time);
    if (!hour)
        throw Error(ErrorKind::argument,
                    "sun=" + time + ": is no time of the day, as 19:30, and not off");
    for (std::size_t i = 0; i < hours.size(); ++i)
        if (!(scene::sun_illuminance(scene::towards_sun(arc, hours[i]).y) > 0)
            || (i > 0 && hours[i] <= hours[i - 1]))
            throw damaged();
    const std::vector<double> weights = scene::key_weights(arc, hours, *hour);
    for (std::size_t i = 0; i < suns.size(); ++i)
        suns[i]->weight = glm::vec3(time == "off" ? 0.0 : weights[i]);
}

void set_weights(const MixOptions& o, TerminalProgress& progress, Mixture& mixture) {
    std::vector<io::LayerEntry>& layers = mixture.set.layers;
    for (const Weight& weight : o.weights) {
        if (std::ranges::count(o.weights, weight.name, &Weight::name) > 1)
            throw Error(ErrorKind::argument, weight.name + ": has two weights; give it one");
        const std::string word = weight.name + "=" + weight.value;
        const auto layer = std::ranges::find(layers, weight.name, &io::LayerEntry::name);
        const std::optional<glm::vec3> colour = colour_of(weight.value);
        if (weight.name == "sky" && !colour) {
            const int order = sky_order(o.file, word, mixture.set);
            const Sky sky = sky_of(weight.value, progress);
            set_sky(sky, order, mixture);
            if (!scene::sky_suns(sky).empty())
                progress.warn(
                    format("%s: its sun is spread over the sky, as all that is smaller than bands "
                           "up to %d show",
                           weight.value.c_str(), order));
            continue;
        }
        if (weight.name == "sun") {
            set_sun(o, weight.value, mixture.set);
            continue;
        }
        if (layer == layers.end()) {
            std::string names;
            for (const io::LayerEntry& each : layers)
                names += (names.empty() ? "" : ", ") + each.name;
            throw Error(ErrorKind::argument,
                        word + ": " + o.file + " has no layer of that name; it has " + names);
        }
        if (!colour)
            throw Error(ErrorKind::argument, word + ": is neither a number nor R,G,B nor #RRGGBB");
        layer->weight = *colour;
        if (is_visibility(*layer))
            mixture.seen_sky.clear();
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
void check_alike(const std::string& manifest, const io::LayerEntry& layer, const Volume& whole,
                 const Volume& part) {
    const auto fact = [](const Volume& of, const char* name) {
        const auto found = of.metadata.find(name);
        return found == of.metadata.end() ? std::string() : found->second;
    };
    const int order = is_visibility(layer) ? volume::sh_max_order : whole.sh_order;
    if (whole.grid.dims != part.grid.dims || part.sh_order != order
        || fact(whole, "scene_hash") != fact(part, "scene_hash")
        || fact(whole, "settings") != fact(part, "settings") || fact(part, "layer") != layer.name)
        throw Error(ErrorKind::invalid,
                    manifest + ": " + layer.file
                        + " is of another bake than the volume; bake all layers together");
}

void add(glm::vec3 weight, const std::vector<glm::vec3>& values, std::vector<glm::vec3>& sum) {
    for (std::size_t cell = 0; cell < sum.size(); ++cell)
        sum[cell] += weight * values[cell];
}

/// Adds what is seen of a sky: the product of visibility and its luminance.
void add_seen(std::span<const glm::vec3> sky, const Volume& visibility, Volume& sum) {
    std::array<std::vector<double>, 3> product;
    for (int c = 0; c < 3; ++c) {
        std::vector<float> of(sky.size());
        std::ranges::transform(sky, of.begin(), [c](glm::vec3 k) { return k[c]; });
        product[std::size_t(c)] = volume::sh_product(sum.sh_order, of);
    }
    const std::size_t terms = visibility.sh.size();
    for (std::size_t i = 0; i < sum.sh.size(); ++i)
        for (std::size_t k = 0; k < terms; ++k) {
            const std::size_t at = terms * i + k;
            const glm::vec3 weight(product[0][at], product[1][at], product[2][at]);
            if (weight != glm::vec3(0.0f))
                add(weight, visibility.sh[k], sum.sh[i]);
        }
}

/// Adds to levels what they have of a layer.
void add_layer(const std::string& manifest, const io::LayerEntry& layer,
               std::span<const glm::vec3> seen_sky, volume::VolumeSet& sum) {
    const volume::VolumeSet part = read_levels(layer.file);
    if (part.levels.size() != sum.levels.size())
        throw Error(ErrorKind::invalid, manifest + ": " + layer.file
                                            + " has other volumes than the volume; bake all layers "
                                              "together");
    for (std::size_t i = 0; i < sum.levels.size(); ++i) {
        Volume& level = sum.levels[i];
        check_alike(manifest, layer, level, part.levels[i]);
        if (!seen_sky.empty())
            add_seen(seen_sky, part.levels[i], level);
        else
            for (std::size_t k = 0; k < level.sh.size(); ++k)
                add(layer.weight, part.levels[i].sh[k], level.sh[k]);
    }
}

volume::VolumeSet mix(const std::string& manifest, const Mixture& mixture) {
    volume::VolumeSet sum = read_levels(mixture.set.file);
    for (Volume& level : sum.levels)
        for (std::vector<glm::vec3>& values : level.sh)
            std::ranges::fill(values, glm::vec3(0.0f));
    for (const io::LayerEntry& layer : mixture.set.layers) {
        const bool seen = is_visibility(layer) && !mixture.seen_sky.empty();
        if (layer.weight != glm::vec3(0.0f) || seen)
            add_layer(manifest, layer,
                      seen ? std::span<const glm::vec3>(mixture.seen_sky)
                           : std::span<const glm::vec3>(),
                      sum);
    }
    return sum;
}

/// Gives volumes what Unity's APV keep of a sky; of cells inside geometry, too, as the target fills
/// them.
void add_sky_occlusion(const MixOptions& o, const std::string& manifest, Mixture white,
                       volume::VolumeSet& mixed) {
    for (io::LayerEntry& layer : white.set.layers)
        layer.weight = glm::vec3(0.0f);
    set_sky({glm::vec3(1.0f), nullptr}, sky_order(o.file, "--sky-occlusion", white.set), white);
    volume::VolumeSet light = mix(manifest, white);
    if (light.levels.front().sh_order < 1)
        throw Error(ErrorKind::argument, "--sky-occlusion: " + o.file + " has no band 1");
    for (std::size_t i = 0; i < mixed.levels.size(); ++i) {
        volume::dilate(light.levels[i], o.outputs.storage().dilate);
        volume::add_sky_occlusion(light.levels[i], mixed.levels[i]);
    }
}

/// Whatever a program may be given: the manifest of layers, of a set, or a volume.
std::string manifest_of(const std::string& file) {
    return io::is_layer_manifest(file) ? file : io::layer_manifest_path(file);
}

/// All files that are read, and the manifests that list them.
std::vector<std::string> inputs_of(const std::string& manifest, const io::LayerSet& set) {
    std::vector<std::string> inputs{manifest}, files{set.file};
    for (const io::LayerEntry& layer : set.layers)
        files.push_back(layer.file);
    for (const std::string& file : files) {
        inputs.push_back(file);
        if (io::is_manifest(file))
            std::ranges::move(io::level_files(file), std::back_inserter(inputs));
    }
    return inputs;
}

void run(const MixOptions& o) {
    if (o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "no output: add -o FILE" + io::format_list(" or -o FILE"));
    for (const std::string& path : o.outputs.paths)
        if (!io::volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": unknown kind of volume file; use " + io::format_list());
    const std::string manifest = manifest_of(o.file);
    Mixture mixture;
    io::LayerSet& set = mixture.set;
    try {
        set = io::read_layer_manifest(manifest);
    } catch (const Error& error) {
        if (error.kind == ErrorKind::file && manifest != o.file)
            throw Error(ErrorKind::file, o.file + ": has no layers beside it (" + error.what()
                                             + "); bake it with --layers");
        throw;
    }
    const std::vector<std::string> inputs = inputs_of(manifest, set);
    check_files({}, inputs, o.outputs.paths);
    TerminalProgress progress(ProgressStyle::none);
    set_weights(o, progress, mixture);
    volume::VolumeSet mixed = mix(manifest, mixture);
    if (io::is_manifest(set.file))
        check_level_outputs(o.outputs.paths, inputs, mixed.places);
    if (o.sky_occlusion)
        add_sky_occlusion(o, manifest, mixture, mixed);
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
        "Weight of a layer: a number, R,G,B, or #RRGGBB (sRGB); or sky=SKY, a picture or "
        "COLOUR,NITS as --sky of bake takes it, where layers transfer or modes are; or sun=HH:MM, "
        "where there are suns of a day (off: none). All others keep the weight of the scene");
    options.flag(
        "--sky-occlusion", o.sky_occlusion,
        "Adds grids of how much of a white sky's light comes to a cell, as Unity's Adaptive "
        "Probe Volumes keep it, and from where; see below");
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
