#include "layer_files.h"

#include "bake/points.h"
#include "io/atomic_file.h"
#include "io/glb.h"
#include "io/levels.h"
#include "io/points.h"
#include "lpvbake/error.h"
#include "options/values.h"
#include "text.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>

namespace lpvbake::cmd {
namespace {

/// "suns:12@48.1,11.6,06-21".
bake::LayerWish parse_suns(const std::string& text) {
    const std::size_t at = text.find('@');
    const auto count = options::parse_number(text.substr(5, at == text.npos ? 0 : at - 5));
    const std::vector<std::string> place =
        options::split(at == text.npos ? "" : text.substr(at + 1), ',');
    if (!count || *count != int(*count) || *count < 1 || *count > bake::most_suns
        || place.size() != 3)
        options::refuse(text,
                        format("is not suns:N@LATITUDE,LONGITUDE,MONTH-DAY with 1 to %d suns, "
                               "as suns:12@48.1,11.6,06-21",
                               bake::most_suns));
    bake::LayerWish wish{bake::LayerWish::Kind::suns};
    const double none = std::numeric_limits<double>::quiet_NaN();
    wish.arc = scene::parse_arc(text, options::parse_number(place[0]).value_or(none),
                                options::parse_number(place[1]).value_or(none), place[2]);
    wish.suns = int(*count);
    scene::daylight(wish.arc);
    return wish;
}

bake::LayerWish parse_layer(const std::string& text, const std::string& whole) {
    using Kind = bake::LayerWish::Kind;
    if (text == "lights")
        return {Kind::lights};
    if (text == "emitters")
        return {Kind::emitters};
    if (text == "sky")
        return {Kind::sky};
    if (text == "transfer")
        return {Kind::transfer, {}, {}, bake::most_mode_order};
    for (const auto& [kind, word] : {std::pair{Kind::sky, "sky:"}, {Kind::transfer, "transfer:"}}) {
        if (!text.starts_with(word))
            continue;
        const auto order = options::parse_number(text.substr(std::string(word).size()));
        if (!order || *order != int(*order) || *order < 0 || *order > bake::most_mode_order)
            options::refuse(whole, std::string("has ") + word + "N, where N is a band from 0 to "
                                       + std::to_string(bake::most_mode_order));
        return {kind, {}, {}, int(*order)};
    }
    if (text.starts_with("suns:"))
        return parse_suns(text);
    const std::size_t equals = text.find('=');
    const std::string name = text.substr(0, equals);
    if (equals == std::string::npos || equals + 1 == text.size())
        options::refuse(whole, "is none of lights, emitters, sky, sky:N, transfer, transfer:N, "
                               "suns:N@LAT,LON,MM-DD and NAME=GLOB, with commas between them");
    if (!bake::is_layer_name(name) || name == "sky" || name == "rest" || name == "sun"
        || name.starts_with("sky_"))
        options::refuse(whole, "has the name " + name
                                   + "; one has letters, digits, dots, dashes and underscores, and "
                                     "sky, sun and rest have a meaning of their own");
    return {Kind::group, name, text.substr(equals + 1)};
}

} // namespace

std::vector<bake::LayerWish> parse_layers(const std::string& text) {
    std::vector<bake::LayerWish> wishes;
    const std::vector<std::string> parts = options::split(text, ',');
    for (std::size_t i = 0; i < parts.size(); ++i) {
        std::string part = parts[i];
        for (int more = 0; more < 2 && part.starts_with("suns:") && i + 1 < parts.size(); ++more)
            part += "," + parts[++i];
        wishes.push_back(parse_layer(part, text));
    }
    return wishes;
}

std::vector<io::LayerEntry> entries_of(std::span<const bake::Layer> layers, const std::string& path,
                                       std::size_t levels, bool placed) {
    std::vector<io::LayerEntry> entries;
    for (const bake::Layer& layer : layers) {
        entries.push_back({layer.name,
                           layer.kind,
                           layer.unit,
                           layer.weight,
                           io::set_path(io::layer_path(path, layer.name), levels, placed),
                           {},
                           layer.emitters,
                           layer.light.sky != glm::vec3(0.0f)});
        if (const auto& arc = layer.arc)
            entries.back().sun = {arc->latitude, arc->longitude,
                                  format("%02d-%02d", arc->month, arc->day), layer.hour};
        for (std::size_t i = 0; i < layer.light.lights.size(); ++i)
            if (layer.light.lights[i] != glm::vec3(0.0f))
                entries.back().lights.push_back(i);
    }
    return entries;
}

std::vector<volume::VolumeSet> sets_of(const volume::VolumeSet& set,
                                       std::vector<std::vector<Volume>> layers) {
    std::vector<volume::VolumeSet> sets(layers.front().size(), {{}, set.blend, set.places});
    for (std::vector<Volume>& of_level : layers)
        for (std::size_t layer = 0; layer < sets.size(); ++layer)
            sets[layer].levels.push_back(std::move(of_level[layer]));
    return sets;
}

std::optional<bake::HeldOut> held_out(std::span<const bake::Layer> layers,
                                      std::span<const volume::VolumeSet> sets,
                                      const std::vector<float>& validity) {
    std::vector<double> hours;
    std::vector<const Volume*> fields;
    std::optional<scene::SunArc> arc;
    for (std::size_t i = 0; i < layers.size(); ++i)
        if (layers[i].arc) {
            arc = layers[i].arc;
            hours.push_back(layers[i].hour);
            fields.push_back(&sets[i].levels.front());
        }
    return arc ? bake::hold_out(*arc, hours, fields, validity) : std::nullopt;
}

void check_layer_outputs(const std::vector<std::string>& paths, std::span<const bake::Layer> layers,
                         std::size_t levels, const std::vector<volume::Place>& places,
                         const std::vector<std::string>& inputs, bool own_grid) {
    std::vector<std::string> all, manifests;
    for (const std::string& path : paths) {
        if (io::volume_format(path) == &io::glb_format)
            throw Error(ErrorKind::argument, path
                                                 + ": a .glb has room for one light volume, not "
                                                   "for layers; write another kind of file");
        std::vector<std::string> sets{path};
        if (own_grid)
            sets.push_back(io::layers_whole_path(path));
        for (const bake::Layer& layer : layers)
            sets.push_back(io::layer_path(path, layer.name));
        for (const std::string& set : sets)
            for (std::size_t i = 0; i < std::max(levels, places.size()); ++i)
                all.push_back(io::member_path(set, places, i));
        const std::string manifest = io::layer_manifest_path(path);
        if (std::ranges::count(manifests, manifest) > 0)
            throw Error(ErrorKind::argument, path + ": another output has the manifest " + manifest
                                                 + ", too; give it another name");
        manifests.push_back(manifest);
    }
    check_files(inputs, {}, all);
}

std::vector<Written> write_layers(const OutputOptions& o, const std::vector<std::string>& paths,
                                  volume::VolumeSet& set, std::span<const bake::Layer> layers,
                                  LayerSets& made, TerminalProgress& progress) {
    std::vector<volume::VolumeSet>& sets = made.sets;
    const volume::VolumeSet& around = made.whole ? *made.whole : set;
    const std::size_t levels = set.levels.size();
    const bool placed = !set.places.empty();
    std::vector<Written> written;
    for (const std::string& path : paths) {
        Written& own = written.emplace_back(Written{path, {}});
        const bool last = &path == &paths.back();
        const auto write = [&](const std::string& to, volume::VolumeSet& from) {
            std::vector<Written> one = write_levels(o, {to}, from, progress);
            std::ranges::move(one.front().files, std::back_inserter(own.files));
            return one.front().packing;
        };
        io::PublishTogether together; // the old layers or the new ones, the manifest last
        volume::VolumeSet whole = set;
        own.packing = write(path, whole);
        const std::string all = made.whole ? io::layers_whole_path(path) : path;
        if (made.whole) {
            whole = *made.whole;
            write(all, whole);
        }
        for (std::size_t i = 0; i < sets.size(); ++i) {
            volume::VolumeSet layer = last ? std::move(sets[i]) : sets[i];
            for (std::size_t level = 0; level < levels; ++level)
                layer.levels[level].walls = around.levels[level].walls;
            write(io::layer_path(path, layers[i].name), layer);
        }
        own.files.push_back(io::write_layer_manifest(path, io::set_path(all, levels, placed),
                                                     entries_of(layers, path, levels, placed),
                                                     own.files));
        together.publish();
        tell("wrote " + own.files.back().path);
    }
    for (Volume& level : set.levels)
        level.sh.clear();
    return written;
}

std::vector<Written> write_layers(const std::vector<std::string>& paths, volume::LitPoints& lit,
                                  std::span<const bake::Layer> layers,
                                  std::vector<Volume>& fields) {
    std::vector<Written> written;
    for (const std::string& path : paths) {
        Written& own = written.emplace_back(Written{path, {}});
        const auto write = [&](const std::string& to) {
            std::ranges::move(io::write_points(to, lit).files, std::back_inserter(own.files));
        };
        io::PublishTogether together;
        write(path);
        for (std::size_t i = 0; i < layers.size(); ++i) {
            std::vector<glm::vec3> irradiance = lit.irradiance;
            std::swap(lit.light, fields[i]);
            bake::find_irradiance(lit);
            write(io::layer_path(path, layers[i].name));
            std::swap(lit.light, fields[i]);
            lit.irradiance = std::move(irradiance);
        }
        if (!layers.empty())
            own.files.push_back(
                io::write_layer_manifest(path, path, entries_of(layers, path), own.files));
        together.publish();
        tell("wrote " + path);
    }
    return written;
}

} // namespace lpvbake::cmd
