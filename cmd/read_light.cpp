#include "read_light.h"

#include "io/glb.h"
#include "io/levels.h"
#include "io/target.h"
#include "io/world.h"
#include "lpvbake/error.h"
#include "lpvbake/file.h"
#include "options/file.h"
#include "quoted.h"
#include "scene/scene_hash.h"
#include "scene/surroundings.h"
#include "volume/dilate.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace lpvbake::cmd {
namespace {

const readers::Reader* const facing = readers::reader_named("lpvbake");
const readers::Reader trilinear{
    .name = "trilinear", .highest_order = volume::sh_max_order, .clamped = true};

/// Null where there is none.
const std::string* fact_in(const Volume& volume, const char* name) {
    const auto fact = volume.metadata.find(name);
    return fact == volume.metadata.end() ? nullptr : &fact->second;
}

/// The volume, unless it holds something else than light.
Volume checked(const std::string& path, Volume volume) {
    const bool is_difference = fact_in(volume, "minuend") != nullptr;
    if (is_difference || fact_in(volume, "quantity"))
        throw Error(ErrorKind::invalid,
                    path + ": holds " + (is_difference ? "the difference of two volumes" : "errors")
                        + ", not light; give a volume of bake or reference");
    return volume;
}

} // namespace

Volume read_light(const std::string& path) {
    return checked(path, read_volume(path));
}

volume::VolumeSet read_levels(const std::string& path) {
    volume::VolumeSet set;
    if (io::is_manifest(path))
        set = io::read_levels(path);
    else
        set.levels.push_back(read_volume(path));
    for (Volume& level : set.levels)
        level = checked(path, std::move(level));
    return set;
}

void check_order(const std::string& scene, const std::string& volume, const char* usage) {
    const auto is_volume = [](const std::string& path) {
        return io::is_manifest(path) || io::is_world(path)
               || (io::readable_format(path) && io::readable_format(path) != &io::glb_format);
    };
    if (is_volume(scene))
        throw Error(ErrorKind::argument,
                    scene
                        + (is_volume(volume) || volume.empty()
                               ? ": is a volume, where the scene belongs: "
                               : ": scene and volume are the other way round: ")
                        + usage);
}

bool holds(const Volume& volume, std::optional<volume::Reflections> volume::LightContent::*source) {
    const std::optional<volume::LightContent> content = volume::content_in(volume.metadata);
    return !content || (*content).*source;
}

reference::PathRules rules_of(const Volume& volume) {
    const std::string* bounces = fact_in(volume, "bounces");
    return {bounces ? options::parse_bounces(*bounces).most : std::nullopt,
            holds(volume, &volume::LightContent::emitters)};
}

bool is_in_air(const Volume& volume) {
    return fact_in(volume, "scattering") != nullptr;
}

void make_static(const std::string& path, const Volume& volume, Scene& scene) {
    const std::string* list = fact_in(volume, "static_lights");
    if (!list)
        return;
    const nlohmann::json names = nlohmann::json::parse(*list, nullptr, false);
    if (!names.is_array()
        || !std::ranges::all_of(names, [](auto& name) { return name.is_string(); }))
        throw Error(ErrorKind::invalid,
                    path + ": its static_lights are no JSON list of names: " + printable(*list));
    for (Light& light : scene.lights)
        light.is_static |= std::ranges::count(names, nlohmann::json(light.name)) > 0;
}

std::optional<std::string> mismatch(const std::string& path, const Volume& volume,
                                    const Scene& scene) {
    if (const std::string* mix = fact_in(volume, "mix"); mix && *mix != "as baked")
        return path + ": is mixed of layers (" + printable(*mix)
               + "); give the scene's lights the same weights, as by --light-scale";
    const std::string* hash = fact_in(volume, "scene_hash");
    const std::string* near = fact_in(volume, "surroundings");
    const auto around = near ? scene::parse_surroundings(*near) : std::nullopt;
    if (!hash
        || *hash
               == (around ? scene::scene_hash(scene::parts_of(scene), scene::Around(scene)(*around))
                          : scene::scene_hash(scene)))
        return {};
    return path
           + ": is of another scene or other lights; give those of its bake, which lpvbake info "
             "lists";
}

std::optional<std::string> other_surfaces(const std::string& path, const Volume& volume,
                                          const Scene& scene) {
    const std::string* hash = fact_in(volume, "local_surfaces");
    if (!hash || *hash == scene::surfaces_hash(scene))
        return {};
    return path + ": its operators are those of other surfaces than this scene's; bake them anew";
}

void take_light(const std::string& path, const Volume& volume, options::Options& options) {
    if (const std::string* settings = fact_in(volume, "settings"))
        options::read_recorded(*settings, path + ": its settings", {"Scene", "Light"}, options);
}

void add_sampler_option(options::Options& options, const readers::Reader*& sampler) {
    options::Choices<const readers::Reader*> choices{
        {"auto", nullptr}, {"facing", facing}, {"trilinear", &trilinear}};
    for (const readers::Reader& reader : readers::all_readers())
        if (&reader != facing)
            choices.emplace_back(reader.name, &reader);
    options.choice("--sampler", sampler, choices,
                   "How the volume is read, or by which program; auto: by the one that it is "
                   "fitted to or was written for, else facing");
}

readers::Reader sampler_for(const readers::Reader* asked, const Volume& volume) {
    if (asked)
        return *asked;
    const std::string* of = fact_in(volume, "fit");
    if (!of)
        of = fact_in(volume, "target");
    const readers::Reader* own_reader = of ? readers::reader_named(*of) : nullptr;
    const readers::Reader& reader = own_reader ? *own_reader : *facing;
    const std::string* own = fact_in(volume, "fit_evaluation");
    const readers::Evaluation* evaluation = own ? readers::evaluation_named(*own) : nullptr;
    return evaluation && reader.gives_coefficients ? readers::with_evaluation(reader, *evaluation)
                                                   : reader;
}

std::string sampler_name(const readers::Reader& sampler) {
    return std::string(sampler.name) == facing->name ? "facing" : sampler.name;
}

std::optional<Volume> filled_for(const readers::Reader& sampler, const Volume& volume) {
    const io::Target* target = io::target_named(sampler.name);
    if (!target || target->dilate == 0 || fact_in(volume, "fit"))
        return {};
    std::optional<Volume> filled = volume;
    volume::dilate(*filled, target->dilate);
    return filled;
}

std::optional<volume::VolumeSet> filled_for(const readers::Reader& sampler,
                                            const volume::VolumeSet& levels) {
    volume::VolumeSet filled{{}, levels.blend, levels.places, levels.bricks};
    for (const Volume& level : levels.levels) {
        std::optional<Volume> own = filled_for(sampler, level);
        if (!own)
            return {};
        filled.levels.push_back(std::move(*own));
    }
    return filled;
}

} // namespace lpvbake::cmd
