#include "scene/gltf/roles.h"

#include "quoted.h"
#include "scene/scene.h"
#include "text.h"

#include <utility>

namespace lpvbake::scene::gltf {
namespace {

/// A value of extras as patterns see it; none where it is no text, number or truth.
std::optional<std::string> text_of(const tinygltf::Value& value) {
    if (value.IsString())
        return value.Get<std::string>();
    if (value.IsBool())
        return value.Get<bool>() ? "true" : "false";
    if (value.IsNumber())
        return format("%.9g", value.GetNumberAsDouble());
    return std::nullopt;
}

/// What the setting of a rule is called.
const char* setting_of(const RoleRule& rule) {
    if (!rule.role)
        return "`exclude`";
    switch (*rule.role) {
    case Role::receive_only:
        return "`receive_only`";
    case Role::cast_only:
        return "`cast_only`";
    case Role::lights_only:
        return "`lights_only`";
    case Role::full:
        break;
    }
    return "roles";
}

} // namespace

Roles::Roles(const Document& document, const std::vector<RoleRule>& rules)
    : document_(document),
      rules_(rules) {
    constexpr std::pair<std::string_view, Of> prefixes[] = {{"node:", Of::node},
                                                            {"mesh:", Of::mesh},
                                                            {"material:", Of::material},
                                                            {"extras:", Of::extras}};
    for (const RoleRule& rule : rules) {
        Pattern pattern{.glob = rule.pattern};
        for (const auto& [prefix, of] : prefixes)
            if (rule.pattern.starts_with(prefix)) {
                pattern.of = of;
                pattern.glob = rule.pattern.substr(prefix.size());
            }
        if (pattern.of == Of::extras) {
            const size_t equals = pattern.glob.find('=');
            pattern.key = pattern.glob.substr(0, equals);
            pattern.glob = equals == std::string::npos ? "" : pattern.glob.substr(equals + 1);
            if (equals == std::string::npos)
                pattern.of = Of::any; // of extras that are there, whatever their value
        }
        patterns_.push_back(std::move(pattern));
    }
}

RoleFit Roles::fit(Of what, const std::string& name, const tinygltf::Value& extras) {
    RoleFit result;
    for (size_t i = 0; i < patterns_.size(); ++i) {
        Pattern& pattern = patterns_[i];
        bool is_fit = false;
        if (!pattern.key.empty()) {
            if (!extras.IsObject() || !extras.Has(pattern.key))
                continue;
            const std::optional<std::string> text = text_of(extras.Get(pattern.key));
            is_fit = pattern.of == Of::any || (text && fits_pattern(*text, pattern.glob));
        } else {
            is_fit = (pattern.of == Of::any || pattern.of == what) && !name.empty()
                     && fits_pattern(name, pattern.glob);
        }
        if (!is_fit)
            continue;
        pattern.fitted = true;
        if (rules_[i].role)
            result.rule = int(i);
        else
            result.excluded = true;
    }
    return result;
}

RoleFit Roles::of_node(int index) {
    const tinygltf::Node& node = document_.model.nodes[size_t(index)];
    return fit(Of::node, node.name, node.extras);
}

RoleFit Roles::of_mesh(int index) {
    const tinygltf::Mesh& mesh = document_.model.meshes[size_t(index)];
    return fit(Of::mesh, mesh.name, mesh.extras);
}

RoleFit Roles::of_material(int index) {
    if (index < 0)
        return {};
    const tinygltf::Material& material = document_.model.materials[size_t(index)];
    return fit(Of::material, material.name, material.extras);
}

void Roles::warn(Warnings& warnings) const {
    for (size_t i = 0; i < patterns_.size(); ++i)
        if (!patterns_[i].fitted)
            warnings.add("roles " + std::to_string(i), setting_of(rules_[i]),
                         in_quotes(rules_[i].pattern)
                             + " fits no node, mesh, material or extras of the scene; give one of "
                               "their names");
}

} // namespace lpvbake::scene::gltf
