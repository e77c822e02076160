#include "selection.h"

#include "lpvbake/error.h"
#include "options/values.h"
#include "scene/scene.h"

#include <algorithm>

namespace lpvbake::cmd {
namespace {

[[noreturn]] void fail_to_find(const std::string& what, const std::string& names,
                               std::vector<std::string> known) {
    constexpr std::size_t most = 8;
    std::ranges::sort(known);
    known.erase(std::unique(known.begin(), known.end()), known.end());
    std::string text = what + " of " + (known.empty() ? "any name" : "the name '" + names + "'");
    for (std::size_t i = 0; i < std::min(known.size(), most); ++i)
        text += (i == 0 ? "; there are '" : ", '") + known[i] + "'";
    if (known.size() > most)
        text += ", and " + std::to_string(known.size() - most) + " more, which lpvbake info lists";
    throw Error(ErrorKind::argument, text);
}

} // namespace

LightScale parse_light_scale(const std::string& text) {
    const std::size_t equals = text.rfind('=');
    if (equals == std::string::npos || equals == 0)
        options::refuse(text, "is not NAMES=X, such as 'Lamp*=0.5'");
    return {text.substr(0, equals), options::number_within(text.substr(equals + 1), 0, 1e6, false)};
}

void scale_lights(const std::vector<LightScale>& scales, Scene& scene) {
    for (const auto& [names, scale] : scales) {
        std::vector<std::string> known;
        const auto is_one = [&known, &pattern = names](const std::string& name) {
            known.push_back(name);
            return scene::fits_pattern(name, pattern);
        };
        std::size_t found = 0;
        for (Light& light : scene.lights)
            if (is_one(light.name)) {
                ++found;
                light.intensity *= scale;
            }
        for (Material& material : scene.materials)
            if (material.emission != glm::vec3(0) && is_one(material.name)) {
                ++found;
                material.emission *= float(scale);
            }
        if (found == 0)
            fail_to_find(scene.path + ": no light and no emissive material", names,
                         std::move(known));
    }
    std::erase_if(scene.lights, [](const Light& light) { return light.intensity == 0; });
}

void make_static(const std::vector<std::string>& patterns, Scene& scene) {
    for (const std::string& names : patterns) {
        std::vector<std::string> known;
        bool found = false;
        for (Light& light : scene.lights) {
            known.push_back(light.name);
            const bool fits = scene::fits_pattern(light.name, names);
            light.is_static |= fits;
            found |= fits;
        }
        if (!found)
            fail_to_find(scene.path + ": --static: no light", names, std::move(known));
    }
}

medium::LampRadius parse_lamp_radius(const std::string& text) {
    medium::LampRadius radius;
    const std::size_t equals = text.rfind('=');
    if (equals == 0)
        options::refuse(text, "is neither METRES nor NAMES=METRES, such as 'Bulb*=0.03'");
    if (equals != std::string::npos)
        radius.names = text.substr(0, equals);
    radius.metres = options::number_within(
        equals == std::string::npos ? text : text.substr(equals + 1), 0, 1e9, false);
    return radius;
}

void check_lamps(const std::vector<medium::LampRadius>& radii, const Scene& scene) {
    for (const medium::LampRadius& radius : radii) {
        std::vector<std::string> known;
        bool found = radius.names == "*";
        for (const Light& light : scene.lights) {
            if (light.type == LightType::directional)
                continue;
            known.push_back(light.name);
            found |= scene::fits_pattern(light.name, radius.names);
        }
        if (!found)
            fail_to_find(scene.path + ": --lamp-radius: no point or spot light", radius.names,
                         std::move(known));
    }
}

Bounds box_of_nodes(const std::string& names, const char* option, const Scene& scene) {
    const std::vector<Bounds> boxes = scene::instance_boxes(scene);
    std::vector<Bounds> found;
    std::vector<std::string> known;
    for (const SceneFile::Node& node : scene.file.nodes) {
        known.push_back(node.name);
        if (scene::fits_pattern(node.name, names))
            found.push_back(
                scene::union_of(std::span(boxes).subspan(node.begin, node.end - node.begin)));
    }
    const Bounds all = scene::union_of(found);
    if (all.empty())
        fail_to_find(scene.path + ": " + option + ": no node with surfaces", names,
                     std::move(known));
    return all;
}

} // namespace lpvbake::cmd
