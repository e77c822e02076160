// lpvbake info: what a scene or a volume holds.

#include "commands.h"
#include "error.h"
#include "io/slice.h"
#include "scene_options.h"
#include "text.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

namespace lpvbake {
namespace {

const char manual[] =
#include "manual/info.txt.h"
    ;

struct InfoOptions {
    std::string file;
    LoadSettings load;
    std::optional<Slice> slice;
    std::string output;
    std::optional<float> white; ///< nits; none: the slice's own
    Format format = Format::text;
};

// ---------------------------------------------------------------- scenes

const char* alpha_name(AlphaMode mode) {
    return mode == AlphaMode::mask ? "mask" : mode == AlphaMode::blend ? "blend" : "opaque";
}

const char* type_name(LightType type) {
    return type == LightType::directional ? "directional"
           : type == LightType::point     ? "point"
                                          : "spot";
}

void print_scene(const InfoOptions& o, const Scene& scene) {
    const auto materials = [&](auto&& holds) {
        return std::count_if(scene.materials.begin(), scene.materials.end(), holds);
    };
    const auto emissive =
        materials([](const Material& m) { return m.emission != glm::vec3(0.0f); });
    const auto mask = materials([](const Material& m) { return m.alpha_mode == AlphaMode::mask; });
    const auto blend =
        materials([](const Material& m) { return m.alpha_mode == AlphaMode::blend; });
    const auto two_sided = materials([](const Material& m) { return m.double_sided; });
    const Bounds bounds = bounds_of(scene);
    const uint64_t triangles = triangle_count(scene);
    const bool emitters = has_emitters(scene);

    if (o.format == Format::json) {
        Json document{
            {"command", "info"},
            {"file", o.file},
            {"kind", "scene"},
            {"generator", scene.file.generator},
            {"extensions",
             {{"used", scene.file.extensions_used}, {"required", scene.file.extensions_required}}},
            {"scenes", scene.file.scenes},
            {"animations", Json::array()},
            {"variants", scene.file.variants},
            {"triangles", triangles},
            {"meshes", scene.meshes.size()},
            {"instances", scene.instances.size()},
            {"bounds", nullptr},
            {"materials",
             {{"count", scene.materials.size()},
              {"emissive", emissive},
              {"mask", mask},
              {"blend", blend},
              {"double_sided", two_sided},
              {"list", Json::array()}}},
            {"textures", scene.textures.size()},
            {"images", Json::array()},
            {"emitters", emitters},
            {"lights", Json::array()},
            {"cameras", Json::array()},
            {"warnings", scene.warnings}};
        if (!bounds.empty())
            document["bounds"] = {{"lo", vector_json(bounds.lo)}, {"hi", vector_json(bounds.hi)}};
        for (const SceneFile::Animation& animation : scene.file.animations)
            document["animations"].push_back(
                {{"name", animation.name}, {"duration", animation.duration}});
        for (const Material& m : scene.materials)
            document["materials"]["list"].push_back(
                {{"name", m.name},
                 {"base_color", {m.base_color.r, m.base_color.g, m.base_color.b, m.base_color.a}},
                 {"base_color_texture",
                  m.base_color_texture < 0 ? Json(nullptr) : Json(m.base_color_texture)},
                 {"emission", vector_json(m.emission)},
                 {"alpha", alpha_name(m.alpha_mode)},
                 {"double_sided", m.double_sided}});
        for (const Image& image : scene.images)
            document["images"].push_back(
                {{"name", image.name}, {"width", image.width}, {"height", image.height}});
        for (const Light& light : scene.lights) {
            Json entry{{"type", type_name(light.type)},
                       {"name", light.name},
                       {"color", vector_json(light.color)},
                       {"intensity", light.intensity},
                       {"unit", light.type == LightType::directional ? "lux" : "candela"}};
            if (light.type != LightType::directional) {
                entry["position"] = vector_json(light.position);
                entry["range"] = light.range > 0 ? Json(light.range) : Json(nullptr);
            }
            if (light.type != LightType::point)
                entry["direction"] = vector_json(light.direction);
            if (light.type == LightType::spot) {
                entry["inner_cone"] = light.inner_cone;
                entry["outer_cone"] = light.outer_cone;
            }
            document["lights"].push_back(entry);
        }
        for (const Camera& camera : scene.cameras)
            document["cameras"].push_back(
                {{"name", camera.name},
                 {"yfov", camera.yfov},
                 {"aspect", camera.aspect},
                 {"position", vector_json(glm::dvec3(camera.to_world[3]))}});
        print_json(document);
        return;
    }

    std::printf("scene      %s\n", o.file.c_str());
    if (!scene.file.generator.empty())
        std::printf("generator  %s\n", scene.file.generator.c_str());
    const auto print_names = [](const char* title, const std::vector<std::string>& names) {
        for (std::size_t i = 0; i < names.size(); ++i)
            std::printf("%-9s  %zu \"%s\"\n", i == 0 ? title : "", i, names[i].c_str());
    };
    for (const std::string& name : scene.file.extensions_used) {
        const auto& required = scene.file.extensions_required;
        const bool is_required =
            std::find(required.begin(), required.end(), name) != required.end();
        std::printf("extension  %s%s\n", name.c_str(), is_required ? " (required)" : "");
    }
    if (scene.file.scenes.size() > 1)
        print_names("scenes", scene.file.scenes);
    print_names("variants", scene.file.variants);
    for (std::size_t i = 0; i < scene.file.animations.size(); ++i)
        std::printf("animation  %zu \"%s\", %.4g s\n", i, scene.file.animations[i].name.c_str(),
                    scene.file.animations[i].duration);
    std::printf("triangles  %llu in %s (%zu different)\n",
                static_cast<unsigned long long>(triangles),
                counted(scene.instances.size(), "placed mesh", "placed meshes").c_str(),
                scene.meshes.size());
    if (bounds.empty()) {
        std::printf("bounds     none\n");
    } else {
        const glm::dvec3 size = bounds.hi - bounds.lo;
        std::printf("bounds     (%.6g, %.6g, %.6g) to (%.6g, %.6g, %.6g), %.4g x %.4g x %.4g m\n",
                    bounds.lo.x, bounds.lo.y, bounds.lo.z, bounds.hi.x, bounds.hi.y, bounds.hi.z,
                    size.x, size.y, size.z);
    }
    std::printf("materials  %zu: %td emissive, %td mask, %td blend, %td double-sided\n",
                scene.materials.size(), emissive, mask, blend, two_sided);
    std::printf("emitters   %s\n", emitters ? "yes" : "none");
    std::printf("textures   %zu of %s\n", scene.textures.size(),
                counted(scene.images.size(), "image").c_str());
    for (const Image& image : scene.images)
        std::printf("  %d x %d  %s\n", image.width, image.height, image.name.c_str());
    std::printf("lights     %zu\n", scene.lights.size());
    for (const Light& light : scene.lights) {
        std::printf("  %-11s  %.6g %s", type_name(light.type), light.intensity,
                    light.type == LightType::directional ? "lx" : "cd");
        std::printf("  colour %.3g:%.3g:%.3g", light.color.x, light.color.y, light.color.z);
        if (light.type != LightType::directional)
            std::printf("  at (%.4g, %.4g, %.4g)", light.position.x, light.position.y,
                        light.position.z);
        if (light.type != LightType::point)
            std::printf("  towards (%.4g, %.4g, %.4g)", light.direction.x, light.direction.y,
                        light.direction.z);
        if (light.type == LightType::spot)
            std::printf("  cone %.3g to %.3g rad", light.inner_cone, light.outer_cone);
        if (light.range > 0)
            std::printf("  range %.4g m", light.range);
        std::printf("  %s\n", light.name.c_str());
    }
    std::printf("cameras    %zu\n", scene.cameras.size());
    for (const Camera& camera : scene.cameras)
        std::printf("  yfov %.3g rad  at (%.4g, %.4g, %.4g)  %s\n", camera.yfov,
                    camera.to_world[3].x, camera.to_world[3].y, camera.to_world[3].z,
                    camera.name.c_str());
}

// ---------------------------------------------------------------- volumes

struct NamedRange {
    std::string name;
    GridRange range;
};

std::vector<NamedRange> ranges_of(const Volume& volume) {
    std::vector<NamedRange> ranges;
    for (const ConstGridView& grid : grids_of(volume))
        ranges.push_back({grid.name(), range_of(grid)});
    return ranges;
}

std::string channels_text(const std::vector<double>& values) {
    std::string text;
    for (double value : values) {
        char number[32];
        std::snprintf(number, sizeof number, "%11.4g", value);
        text += number;
    }
    return text;
}

void print_volume(const InfoOptions& o, const Volume& volume) {
    const Grid& grid = volume.grid;
    const std::vector<NamedRange> ranges = ranges_of(volume);
    const double energy = total_energy(volume);
    if (o.format == Format::json) {
        Json document{{"command", "info"},
                      {"file", o.file},
                      {"kind", "volume"},
                      {"grid", grid_json(grid)},
                      {"sh_order", volume.sh_order},
                      {"grids", Json::array()},
                      {"energy", energy},
                      {"metadata", volume.metadata},
                      {"slice", o.output.empty() ? Json(nullptr) : Json(o.output)}};
        for (const auto& [name, range] : ranges)
            document["grids"].push_back({{"name", name},
                                         {"channels", range.min.size()},
                                         {"min", range.min},
                                         {"max", range.max},
                                         {"mean", range.mean},
                                         {"nonzero", range.nonzero}});
        print_json(document);
        return;
    }
    std::printf("volume     %s\n", o.file.c_str());
    std::printf("grid       %d x %d x %d cells of %.6g m\n", grid.dims.x, grid.dims.y, grid.dims.z,
                grid.cell);
    std::printf("transform  index (i, j, k) at (%.6g, %.6g, %.6g) + %.6g (i, j, k) m\n",
                grid.center({0, 0, 0}).x, grid.center({0, 0, 0}).y, grid.center({0, 0, 0}).z,
                grid.cell);
    std::printf("energy     %.6g nit sr over all cells (luminance)\n", energy);
    for (const auto& [name, range] : ranges) {
        std::printf("%-14s  %5.1f %% of cells not zero\n", name.c_str(),
                    100.0 * double(range.nonzero) / double(grid.size()));
        std::printf("  min  %s\n", channels_text(range.min).c_str());
        std::printf("  max  %s\n", channels_text(range.max).c_str());
        std::printf("  mean %s\n", channels_text(range.mean).c_str());
    }
    for (const auto& [key, value] : volume.metadata)
        std::printf("lpv:%s = %s\n", key.c_str(), value.c_str());
    if (!o.output.empty())
        std::printf("wrote      %s\n", o.output.c_str());
}

// ---------------------------------------------------------------- running

void draw_slice(const InfoOptions& o, const Volume& volume) {
    check_slice(*o.slice, volume.grid);
    write_png(o.output, slice_picture(volume, o.slice->axis, o.slice->index, o.white));
}

void run(const InfoOptions& o) {
    if (o.slice.has_value() == o.output.empty())
        throw Error(ErrorKind::argument,
                    "--slice and -o belong together: --slice z=16 -o slice.png");
    if (!o.output.empty() && !has_extension(o.output, ".png"))
        throw Error(ErrorKind::argument, o.output + ": the name of a picture ends in .png");
    if (has_extension(o.file, ".gltf") || has_extension(o.file, ".glb")) {
        if (o.slice)
            throw Error(ErrorKind::argument, "--slice: " + o.file + " is a scene, not a volume");
        ImageModulePreload preload;
        SceneOptions scene_options;
        scene_options.scene = o.file;
        if (mentions_images(scene_options))
            preload = preload_image_module();
        LoadSettings settings = o.load;
        settings.skip_colors = !o.load.strict; // which looks for every fault
        const Scene scene = load_gltf(o.file, settings);
        for (const std::string& warning : scene.warnings)
            std::fprintf(stderr, "lpvbake: warning: %s\n", warning.c_str());
        print_scene(o, scene);
    } else if (readable_format(o.file)) {
        const Volume volume = read_volume(o.file);
        if (o.slice)
            draw_slice(o, volume);
        print_volume(o, volume);
    } else {
        throw Error(ErrorKind::argument, o.file + ": neither a scene (.gltf, .glb) nor a volume ("
                                             + format_list(", ", true) + ")");
    }
}

Action declare(Options& options) {
    const auto fields = std::make_shared<InfoOptions>();
    InfoOptions& o = *fields;
    options.text("file", o.file, "FILE", "Scene or volume").require();
    options.value("--slice", o.slice, "AXIS=INDEX", parse_slice,
                  "Layer of cells to draw, such as z=16; needs -o");
    options.number(
        "--white", o.white, 1e-12, 1e12,
        "Mean luminance drawn white, nits; default: the slice's 99th percentile, at most "
        "ten times its median");
    options.text("-o,--output", o.output, "FILE", "PNG to write");
    add_format_option(options, o.format);
    add_load_options(options, o.load);
    return [fields] { run(*fields); };
}

} // namespace

Command info_command() {
    return {"info", "Tells what a scene or a volume file holds.", manual, declare};
}

} // namespace lpvbake
