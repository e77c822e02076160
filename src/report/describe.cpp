#include "report/describe.h"

#include "report/json.h"
#include "scene/roles.h"
#include "text.h"
#include "volume/compare.h"

#include <algorithm>
#include <span>

namespace lpvbake::report {
namespace {

const char* alpha_name(AlphaMode mode) {
    return mode == AlphaMode::mask ? "mask" : mode == AlphaMode::blend ? "blend" : "opaque";
}

const char* type_name(LightType type) {
    return type == LightType::directional ? "directional"
           : type == LightType::point     ? "point"
                                          : "spot";
}

/// How many materials are of a kind.
struct MaterialCounts {
    std::ptrdiff_t emissive, mask, blend, transmitting, double_sided;
};

MaterialCounts count_materials(const Scene& scene) {
    const auto materials = [&](auto&& holds) {
        return std::ranges::count_if(scene.materials, holds);
    };
    return {materials([](const Material& m) { return m.emission != glm::vec3(0.0f); }),
            materials([](const Material& m) { return m.alpha_mode == AlphaMode::mask; }),
            materials([](const Material& m) { return m.alpha_mode == AlphaMode::blend; }),
            materials([](const Material& m) { return m.transmission > 0.0f; }),
            materials([](const Material& m) { return m.double_sided; })};
}

Json materials_json(const Scene& scene) {
    Json list = Json::array();
    for (const Material& m : scene.materials)
        list.push_back(
            {{"name", m.name},
             {"base_color", {m.base_color.r, m.base_color.g, m.base_color.b, m.base_color.a}},
             {"base_color_texture",
              m.base_color_texture < 0 ? Json(nullptr) : Json(m.base_color_texture)},
             {"emission", vector_json(m.emission)},
             {"alpha", alpha_name(m.alpha_mode)},
             {"transmission", m.transmission},
             {"attenuation", vector_json(m.attenuation)},
             {"double_sided", m.double_sided}});
    const MaterialCounts count = count_materials(scene);
    return {{"count", scene.materials.size()},
            {"emissive", count.emissive},
            {"mask", count.mask},
            {"blend", count.blend},
            {"transmitting", count.transmitting},
            {"double_sided", count.double_sided},
            {"clamped", scene.clamped_materials},
            {"list", list}};
}

} // namespace

Json lights_json(const Scene& scene) {
    Json list = Json::array();
    for (const Light& light : scene.lights) {
        Json entry{{"type", type_name(light.type)},
                   {"name", light.name},
                   {"color", vector_json(light.color)},
                   {"intensity", light.intensity},
                   {"unit", light.type == LightType::directional ? "lux" : "candela"}};
        if (light.type != LightType::directional) {
            entry["position"] = vector_json(light.position);
            if (light.range > 0)
                entry["range"] = light.range;
        }
        if (light.type != LightType::point)
            entry["direction"] = vector_json(light.direction);
        if (light.type == LightType::spot)
            entry["spot"] = {{"innerConeAngle", light.inner_cone},
                             {"outerConeAngle", light.outer_cone}};
        if (light.is_static)
            entry["static"] = true;
        list.push_back(entry);
    }
    return list;
}

namespace {

std::string lights_text(const Scene& scene) {
    std::string text;
    text += format("lights     %zu\n", scene.lights.size());
    for (const Light& light : scene.lights) {
        text += format("  %-11s  %.6g %s", type_name(light.type), light.intensity,
                       light.type == LightType::directional ? "lx" : "cd");
        text += format("  colour %.3g:%.3g:%.3g", light.color.x, light.color.y, light.color.z);
        if (light.type != LightType::directional)
            text += format("  at (%.4g, %.4g, %.4g)", light.position.x, light.position.y,
                           light.position.z);
        if (light.type != LightType::point)
            text += format("  towards (%.4g, %.4g, %.4g)", light.direction.x, light.direction.y,
                           light.direction.z);
        if (light.type == LightType::spot)
            text += format("  cone %.3g to %.3g rad", light.inner_cone, light.outer_cone);
        if (light.range > 0)
            text += format("  range %.4g m", light.range);
        text += format("  %s\n", light.name.c_str());
    }
    return text;
}

Json box_json(const Bounds& box) {
    return {{"lo", vector_json(box.lo)}, {"hi", vector_json(box.hi)}};
}

std::string box_text(const Bounds& box) {
    return format("(%.6g, %.6g, %.6g) to (%.6g, %.6g, %.6g)", box.lo.x, box.lo.y, box.lo.z,
                  box.hi.x, box.hi.y, box.hi.z);
}

/// What stands there in a role other than the full one.
struct RoleCount {
    const char* role;
    std::size_t placed = 0; ///< meshes
    uint64_t triangles = 0;
    std::vector<std::string> meshes = {}; ///< names, each once
};

std::vector<RoleCount> count_roles(const Scene& scene) {
    std::vector<RoleCount> counts;
    for (const Role role : {Role::receive_only, Role::cast_only, Role::lights_only}) {
        RoleCount count{scene::name_of(role)};
        for (const Instance& instance : scene.instances) {
            if (instance.role != role)
                continue;
            const Mesh& mesh = scene.meshes[std::size_t(instance.mesh)];
            ++count.placed;
            count.triangles += mesh.triangles.size();
            if (!mesh.name.empty()
                && std::ranges::find(count.meshes, mesh.name) == count.meshes.end())
                count.meshes.push_back(mesh.name);
        }
        if (count.placed > 0)
            counts.push_back(std::move(count));
    }
    return counts;
}

Json roles_json(const Scene& scene) {
    Json list = Json::array();
    for (const RoleCount& count : count_roles(scene))
        list.push_back({{"role", count.role},
                        {"placed", count.placed},
                        {"triangles", count.triangles},
                        {"meshes", count.meshes}});
    return list;
}

std::string roles_text(const Scene& scene) {
    std::string text;
    for (const RoleCount& count : count_roles(scene)) {
        text += format("%-9s  %s: %s, %s", text.empty() ? "roles" : "", count.role,
                       counted(count.placed, "placed mesh", "placed meshes").c_str(),
                       counted(count.triangles, "triangle").c_str());
        for (std::size_t i = 0; i < count.meshes.size(); ++i)
            text += format("%s\"%s\"", i == 0 ? "  " : ", ", count.meshes[i].c_str());
        text += '\n';
    }
    return text;
}

struct NamedBox {
    std::string name;
    Bounds box;
};

/// Nodes that hold triangles.
std::vector<NamedBox> boxes_of_nodes(const Scene& scene) {
    const std::vector<Bounds> instances = scene::instance_boxes(scene);
    std::vector<NamedBox> nodes;
    for (const SceneFile::Node& node : scene.file.nodes)
        if (const Bounds box =
                scene::union_of(std::span(instances).subspan(node.begin, node.end - node.begin));
            !box.empty())
            nodes.push_back({node.name, box});
    return nodes;
}

Json nodes_json(const Scene& scene) {
    Json list = Json::array();
    for (const NamedBox& node : boxes_of_nodes(scene))
        list.push_back({{"name", node.name}, {"bounds", box_json(node.box)}});
    return list;
}

/// The first lines of a list, for people.
std::string first_of(const std::vector<std::string>& lines) {
    constexpr std::size_t most = 40;
    std::string text;
    for (std::size_t i = 0; i < std::min(lines.size(), most); ++i)
        text += "  " + lines[i] + "\n";
    if (lines.size() > most)
        text += format("  and %zu more, which the JSON has\n", lines.size() - most);
    return text;
}

std::string nodes_text(const Scene& scene) {
    std::vector<std::string> lines;
    for (const NamedBox& node : boxes_of_nodes(scene))
        lines.push_back(box_text(node.box) + "  " + node.name);
    return format("nodes      %zu with a name and surfaces\n", lines.size()) + first_of(lines);
}

std::string material_names_text(const Scene& scene) {
    std::vector<std::string> lines;
    for (const Material& m : scene.materials) {
        std::string line =
            format("colour %.3g:%.3g:%.3g", m.base_color.r, m.base_color.g, m.base_color.b);
        if (m.base_color_texture >= 0)
            line += " times a texture";
        if (m.emission != glm::vec3(0))
            line +=
                format("  emission %.4g:%.4g:%.4g nits", m.emission.r, m.emission.g, m.emission.b);
        lines.push_back(line + "  " + m.name);
    }
    return first_of(lines);
}

struct NamedRange {
    std::string name;
    volume::GridRange range;
};

std::vector<NamedRange> ranges_of(const Volume& volume) {
    std::vector<NamedRange> ranges;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        ranges.push_back({grid.name(), volume::range_of(grid)});
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

} // namespace

Json scene_json(const std::string& path, const Scene& scene, const std::string& hash) {
    const Bounds bounds = bounds_of(scene);
    Json document{
        {"command", "info"},
        {"file", path},
        {"kind", "scene"},
        {"scene_hash", hash.empty() ? Json(nullptr) : Json(hash)},
        {"generator", scene.file.generator},
        {"extensions",
         {{"used", scene.file.extensions_used}, {"required", scene.file.extensions_required}}},
        {"scenes", scene.file.scenes},
        {"animations", Json::array()},
        {"variants", scene.file.variants},
        {"triangles", scene::triangle_count(scene)},
        {"meshes", scene.meshes.size()},
        {"instances", scene.instances.size()},
        {"bounds", bounds.empty() ? Json(nullptr) : box_json(bounds)},
        {"nodes", nodes_json(scene)},
        {"roles", roles_json(scene)},
        {"materials", materials_json(scene)},
        {"textures", scene.textures.size()},
        {"images", Json::array()},
        {"emitters", scene::has_emitters(scene)},
        {"lights", lights_json(scene)},
        {"cameras", Json::array()},
        {"warnings", scene.warnings}};
    for (const SceneFile::Animation& animation : scene.file.animations)
        document["animations"].push_back(
            {{"name", animation.name}, {"duration", animation.duration}});
    for (const Image& image : scene.images)
        document["images"].push_back(
            {{"name", image.name}, {"width", image.width}, {"height", image.height}});
    for (const Camera& camera : scene.cameras)
        document["cameras"].push_back({{"name", camera.name},
                                       {"yfov", camera.yfov},
                                       {"aspect", camera.aspect},
                                       {"position", vector_json(glm::dvec3(camera.to_world[3]))}});
    return document;
}

std::string scene_text(const std::string& path, const Scene& scene, const std::string& hash) {
    const Bounds bounds = bounds_of(scene);
    const MaterialCounts count = count_materials(scene);
    std::string text;
    text += format("scene      %s\n", path.c_str());
    if (!hash.empty())
        text += format("hash       %s\n", hash.c_str());
    if (!scene.file.generator.empty())
        text += format("generator  %s\n", scene.file.generator.c_str());
    const auto print_names = [&](const char* title, const std::vector<std::string>& names) {
        for (std::size_t i = 0; i < names.size(); ++i)
            text += format("%-9s  %zu \"%s\"\n", i == 0 ? title : "", i, names[i].c_str());
    };
    for (const std::string& name : scene.file.extensions_used) {
        const auto& required = scene.file.extensions_required;
        const bool is_required =
            std::find(required.begin(), required.end(), name) != required.end();
        text += format("extension  %s%s\n", name.c_str(), is_required ? " (required)" : "");
    }
    if (scene.file.scenes.size() > 1)
        print_names("scenes", scene.file.scenes);
    print_names("variants", scene.file.variants);
    for (std::size_t i = 0; i < scene.file.animations.size(); ++i)
        text += format("animation  %zu \"%s\", %.4g s\n", i, scene.file.animations[i].name.c_str(),
                       scene.file.animations[i].duration);
    text += format("triangles  %llu in %s (%zu different)\n",
                   static_cast<unsigned long long>(scene::triangle_count(scene)),
                   counted(scene.instances.size(), "placed mesh", "placed meshes").c_str(),
                   scene.meshes.size());
    if (bounds.empty()) {
        text += format("bounds     none\n");
    } else {
        const glm::dvec3 size = bounds.hi - bounds.lo;
        text += format("bounds     %s, %.4g x %.4g x %.4g m\n", box_text(bounds).c_str(), size.x,
                       size.y, size.z);
    }
    text += nodes_text(scene);
    text += roles_text(scene);
    text +=
        format("materials  %zu: %td emissive, %td mask, %td blend, %td double-sided",
               scene.materials.size(), count.emissive, count.mask, count.blend, count.double_sided);
    if (count.transmitting > 0)
        text += format(", %td transmitting", count.transmitting);
    if (scene.clamped_materials > 0)
        text += format(", %zu clamped to a reflectance of %g", scene.clamped_materials,
                       double(scene.rules.max_albedo));
    text += '\n';
    text += material_names_text(scene);
    text += format("emitters   %s\n", scene::has_emitters(scene) ? "yes" : "none");
    text += format("textures   %zu of %s\n", scene.textures.size(),
                   counted(scene.images.size(), "image").c_str());
    for (const Image& image : scene.images)
        text += format("  %d x %d  %s\n", image.width, image.height, image.name.c_str());
    text += lights_text(scene);
    text += format("cameras    %zu\n", scene.cameras.size());
    for (const Camera& camera : scene.cameras)
        text += format("  yfov %.3g rad  at (%.4g, %.4g, %.4g)  %s\n", camera.yfov,
                       camera.to_world[3].x, camera.to_world[3].y, camera.to_world[3].z,
                       camera.name.c_str());
    return text;
}

Json volume_json(const std::string& path, const Volume& volume) {
    Json document{{"command", "info"},
                  {"file", path},
                  {"kind", "volume"},
                  {"grid", grid_json(volume.grid)},
                  {"sh_order", volume.sh_order},
                  {"grids", Json::array()},
                  {"energy", volume::total_energy(volume)},
                  {"metadata", volume.metadata}};
    for (const auto& [name, range] : ranges_of(volume))
        document["grids"].push_back({{"name", name},
                                     {"channels", range.min.size()},
                                     {"min", range.min},
                                     {"max", range.max},
                                     {"mean", range.mean},
                                     {"nonzero", range.nonzero}});
    if (const auto layers = volume.metadata.find("layers"); layers != volume.metadata.end())
        if (Json list = Json::parse(layers->second, nullptr, false); list.is_array())
            document["layers"] = std::move(list);
    return document;
}

std::string volume_text(const std::string& path, const Volume& volume) {
    const Grid& grid = volume.grid;
    std::string text;
    text += format("volume     %s\n", path.c_str());
    text += format("grid       %d x %d x %d cells of %.6g m\n", grid.dims.x, grid.dims.y,
                   grid.dims.z, grid.cell);
    text += format("transform  index (i, j, k) at (%.6g, %.6g, %.6g) + %.6g (i, j, k) m\n",
                   grid.center({0, 0, 0}).x, grid.center({0, 0, 0}).y, grid.center({0, 0, 0}).z,
                   grid.cell);
    if (const glm::dquat& turn = grid.turn; grid.is_turned())
        text += format("turn       (i, j, k) by the quaternion (%.6g, %.6g, %.6g, %.6g), %.4g "
                       "degrees\n",
                       turn.x, turn.y, turn.z, turn.w, glm::degrees(glm::angle(turn)));
    text += format("energy     %.6g nit sr over valid cells (luminance)\n",
                   volume::total_energy(volume));
    for (const auto& [name, range] : ranges_of(volume)) {
        text += format("%-14s  %5.1f %% of cells not zero\n", name.c_str(),
                       100.0 * double(range.nonzero) / double(grid.size()));
        text += format("  min  %s\n", channels_text(range.min).c_str());
        text += format("  max  %s\n", channels_text(range.max).c_str());
        text += format("  mean %s\n", channels_text(range.mean).c_str());
    }
    for (const auto& [key, value] : volume.metadata)
        text += "lpv:" + key + " = " + value + "\n";
    return text;
}

} // namespace lpvbake::report
