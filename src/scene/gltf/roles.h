// Which nodes, meshes and materials of a file have a role.
#pragma once

#include "scene/gltf/document.h"

namespace lpvbake::scene::gltf {

/// What the rules say of one thing.
struct RoleFit {
    bool excluded = false;
    int rule = -1; ///< the last of those with a role that fit; -1: none

    void add(const RoleFit& other) {
        excluded = excluded || other.excluded;
        rule = std::max(rule, other.rule);
    }
};

/// Asks rules of what a scene holds, and remembers which fitted something.
class Roles {
public:
    /// Both outlive it.
    Roles(const Document& document, const std::vector<RoleRule>& rules);

    RoleFit of_node(int index);
    RoleFit of_mesh(int index);
    RoleFit of_material(int index); ///< -1: the default
    Role role_of(int rule) const { return rule < 0 ? Role::full : *rules_[size_t(rule)].role; }
    /// Of rules that nothing fitted.
    void warn(Warnings& warnings) const;

private:
    enum class Of { any, node, mesh, material, extras };
    struct Pattern {
        Of of = Of::any;
        std::string glob = {};
        std::string key = {}; ///< of extras
        bool fitted = false;
    };
    RoleFit fit(Of what, const std::string& name, const tinygltf::Value& extras);

    const Document& document_;
    const std::vector<RoleRule>& rules_;
    std::vector<Pattern> patterns_;
};

} // namespace lpvbake::scene::gltf
