#include "scene/gltf/nodes.h"

#include "quoted.h"
#include "scene/gltf/attributes.h"
#include "scene/lights.h"

#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <tuple>

namespace lpvbake::scene::gltf {
namespace {

// ---------------------------------------------------------------- transforms

glm::dmat4 compose(glm::dvec3 translation, glm::dquat rotation, glm::dvec3 scale) {
    return glm::scale(glm::translate(glm::dmat4(1.0), translation) * glm::mat4_cast(rotation),
                      scale);
}

glm::dmat4 local_transform(Document& document, int index, const Pose& pose) {
    const tinygltf::Node& node = document.model.nodes[index];
    const auto posed = pose.find(index);
    const NodePose animated = posed == pose.end() ? NodePose() : posed->second;
    const bool moves = animated.translation || animated.rotation || animated.scale;
    if (!node.matrix.empty()) {
        if (moves)
            document.warnings.add("matrix", at("nodes", index) + ".matrix",
                                  "an animated node has to have none: its animation is ignored; "
                                  "export the file again with separate transforms");
        glm::dmat4 matrix;
        for (int i = 0; i < 16; ++i)
            matrix[i / 4][i % 4] = node.matrix.at(i);
        for (int column = 0; column < 4; ++column) {
            constexpr double rounding = 1e-5; // of programs that multiply in single precision
            const double exact = column == 3 ? 1.0 : 0.0;
            if (!(std::abs(matrix[column][3] - exact) <= rounding))
                document.fail(at("nodes", index) + ".matrix",
                              "is not affine: its last row must be 0 0 0 1");
            matrix[column][3] = exact;
        }
        return matrix;
    }
    glm::dvec3 translation(0.0), scale(1.0);
    glm::dquat rotation(1.0, 0.0, 0.0, 0.0);
    if (const auto& t = node.translation; !t.empty())
        translation = {t.at(0), t.at(1), t.at(2)};
    if (const auto& s = node.scale; !s.empty())
        scale = {s.at(0), s.at(1), s.at(2)};
    if (const auto& r = node.rotation; !r.empty())
        rotation = unit_quaternion(document, {r.at(0), r.at(1), r.at(2), r.at(3)},
                                   at("nodes", index) + ".rotation");
    return compose(animated.translation.value_or(translation), animated.rotation.value_or(rotation),
                   animated.scale.value_or(scale));
}

bool is_finite(const glm::dmat4& matrix) {
    for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 4; ++row)
            if (!(std::abs(matrix[column][row]) < 1e100))
                return false;
    return true;
}

/// False if the transform presses everything onto a line or a point.
bool leaves_area(const glm::dmat4& matrix) {
    const glm::dvec3 x(matrix[0]), y(matrix[1]), z(matrix[2]);
    const double longest = std::max({glm::length(x), glm::length(y), glm::length(z)});
    const double area = std::max({glm::length(glm::cross(x, y)), glm::length(glm::cross(y, z)),
                                  glm::length(glm::cross(z, x))});
    return longest > 0.0 && area > 1e-12 * longest * longest;
}

/// The parent of each node, -1 for none. Throws Error unless nodes form trees.
std::vector<int> parents_of(const Document& document) {
    const std::vector<tinygltf::Node>& nodes = document.model.nodes;
    std::vector<int> parent(nodes.size(), -1);
    for (size_t i = 0; i < nodes.size(); ++i)
        for (size_t k = 0; k < nodes[i].children.size(); ++k) {
            const int child = nodes[i].children[k];
            const std::string place = at("nodes", i) + "." + at("children", k);
            if (parent[child] >= 0)
                document.fail(place, at("nodes", child) + " is a child of "
                                         + at("nodes", parent[child]) + " already");
            parent[child] = static_cast<int>(i);
        }
    std::vector<bool> seen(nodes.size());
    std::vector<int> open;
    for (size_t i = 0; i < nodes.size(); ++i)
        if (parent[i] < 0)
            open.push_back(static_cast<int>(i));
    while (!open.empty()) {
        const int node = open.back();
        open.pop_back();
        seen[node] = true;
        open.insert(open.end(), nodes[node].children.begin(), nodes[node].children.end());
    }
    if (const auto lost = std::find(seen.begin(), seen.end(), false); lost != seen.end())
        document.fail(at("nodes", static_cast<size_t>(lost - seen.begin())) + ".children",
                      "the node is its own ancestor: nodes must form trees");
    return parent;
}

/// World transforms of all nodes, in whichever scene they stand.
std::vector<glm::dmat4> world_transforms(Document& document, const std::vector<int>& parent,
                                         const Pose& pose) {
    const std::vector<tinygltf::Node>& nodes = document.model.nodes;
    std::vector<glm::dmat4> worlds(nodes.size());
    std::vector<int> open;
    for (size_t i = nodes.size(); i-- > 0;)
        if (parent[i] < 0)
            open.push_back(static_cast<int>(i));
    while (!open.empty()) {
        const int node = open.back();
        open.pop_back();
        const glm::dmat4 local = local_transform(document, node, pose);
        worlds[node] = parent[node] < 0 ? local : worlds[parent[node]] * local;
        if (!is_finite(worlds[node]))
            document.fail(at("nodes", node), "its transform is not finite");
        const std::vector<int>& children = nodes[node].children;
        for (auto child = children.rbegin(); child != children.rend(); ++child)
            if (parent[*child] == node)
                open.push_back(*child);
    }
    return worlds;
}

// ---------------------------------------------------------------- what nodes hold

/// The transforms of EXT_mesh_gpu_instancing, relative to the node.
std::vector<glm::dmat4> instance_transforms(Document& document, const tinygltf::Value& extension,
                                            const std::string& node_place) {
    const std::string place = node_place + ".extensions.EXT_mesh_gpu_instancing.attributes.";
    const tinygltf::Value& attributes = extension.Get("attributes");
    std::optional<size_t> count;
    const auto read = [&]<int N>(const char* name, std::integral_constant<int, N>) {
        std::vector<glm::vec<N, float>> values;
        if (!attributes.Has(name))
            return values;
        const int accessor = attributes.Get(name).GetNumberAsInt();
        document.memory.take(document.model.accessors.at(accessor).count,
                             2 * N * sizeof(float) + sizeof(glm::dmat4) + sizeof(Instance),
                             place + name);
        values = read_vectors<N>(document, accessor, place + name);
        for (const glm::vec<N, float>& value : values)
            for (int k = 0; k < N; ++k)
                if (!std::isfinite(value[k]))
                    document.fail(place + name, "a value is not finite");
        if (count && *count != values.size())
            document.fail(place + name, "has another count than the attributes beside it");
        count = values.size();
        return values;
    };
    const auto translations = read("TRANSLATION", std::integral_constant<int, 3>());
    const auto rotations = read("ROTATION", std::integral_constant<int, 4>());
    const auto scales = read("SCALE", std::integral_constant<int, 3>());
    std::vector<glm::dmat4> transforms(count.value_or(0));
    for (size_t i = 0; i < transforms.size(); ++i)
        transforms[i] =
            compose(translations.empty() ? glm::dvec3(0.0) : glm::dvec3(translations[i]),
                    rotations.empty() ? glm::dquat(1.0, 0.0, 0.0, 0.0)
                                      : unit_quaternion(document, rotations[i], place + "ROTATION"),
                    scales.empty() ? glm::dvec3(1.0) : glm::dvec3(scales[i]));
    return transforms;
}

/// A light without a name has that of its node.
std::optional<Light> placed_light(Document& document, int index, const glm::dmat4& to_world,
                                  const std::string& name, const std::string& node_place) {
    const tinygltf::Light& source = document.model.lights.at(index);
    const std::string place = at("extensions.KHR_lights_punctual.lights", index);
    Light light;
    light.name = source.name.empty() ? name : source.name;
    if (source.type == "directional")
        light.type = LightType::directional;
    else if (source.type == "point")
        light.type = LightType::point;
    else if (source.type == "spot")
        light.type = LightType::spot;
    else
        document.fail(place + ".type", in_quotes(source.type) + " is not a type of light");
    if (!source.color.empty())
        light.color = glm::dvec3(source.color.at(0), source.color.at(1), source.color.at(2));
    light.intensity = source.intensity;
    light.range = source.range;
    light.inner_cone = source.spot.innerConeAngle;
    light.outer_cone = source.spot.outerConeAngle;
    light.position = glm::dvec3(to_world[3]);
    if (light.type != LightType::point) {
        const double length = glm::length(glm::dvec3(to_world[2]));
        if (!(length > 0.0)) {
            document.warnings.add("lights of scale 0", node_place,
                                  "the scale is 0, which leaves its light without a direction: "
                                  "the light is ignored; scale the node to 1");
            return std::nullopt;
        }
        light.direction = -glm::dvec3(to_world[2]) / length;
    }
    if (make_hard_edge(light, std::numbers::pi))
        document.warnings.add("hard-edged spots", place + ".spot.innerConeAngle",
                              "is not below outerConeAngle: the spot has a hard edge there; export "
                              "it with a smaller one");
    check_light(light, document.file + ": " + place);
    return light;
}

std::optional<Camera> placed_camera(Document& document, int index, const glm::dmat4& to_world) {
    const CameraSource& source = document.cameras.at(index);
    if (source.is_orthographic)
        document.warnings.add("orthographic cameras", at("cameras", index),
                              "orthographic cameras are not supported: it is ignored; a bake "
                              "needs no camera");
    if (source.yfov == 0.0)
        return std::nullopt;
    return Camera{source.name, to_world, source.yfov, source.aspect};
}

bool is_hidden(const tinygltf::Node& node) {
    const auto* extension = find_extension(node.extensions, "KHR_node_visibility");
    return extension && extension->Has("visible") && !extension->Get("visible").Get<bool>();
}

// ---------------------------------------------------------------- shapes

/// Makes shapes, each once.
class Shapes {
public:
    Shapes(Document& document, const Pose& pose, const std::vector<glm::dmat4>& worlds)
        : document_(document),
          pose_(pose),
          worlds_(worlds) {}

    /// Places the mesh of a node.
    PlacedShape place(int index) {
        const tinygltf::Node& node = document_.model.nodes[index];
        Shape shape{node.mesh, weights_of(index), node.skin, {}};
        const auto [entry, is_new] = known_.try_emplace({shape.mesh, shape.weights, shape.skin},
                                                        static_cast<int>(shapes.size()));
        const glm::dmat4 to_world =
            shape.skin < 0 ? worlds_[index] : glm::translate(glm::dmat4(1.0), anchor(shape.skin));
        if (is_new) {
            if (shape.skin >= 0)
                shape.joints = joints_of(shape.skin);
            shapes.push_back(std::move(shape));
        }
        return {entry->second, to_world};
    }

    std::vector<Shape> shapes;

private:
    /// Weights of a node's morph targets; empty where they change nothing.
    std::vector<double> weights_of(int index) const {
        const tinygltf::Node& node = document_.model.nodes[index];
        const tinygltf::Mesh& mesh = document_.model.meshes[node.mesh];
        std::vector<double> weights = node.weights.empty() ? mesh.weights : node.weights;
        if (const auto posed = pose_.find(index);
            posed != pose_.end() && !posed->second.weights.empty())
            weights = posed->second.weights;
        size_t targets = 0;
        for (const tinygltf::Primitive& primitive : mesh.primitives)
            targets = std::max(targets, primitive.targets.size());
        weights.resize(targets);
        for (const double weight : weights)
            if (!(std::abs(weight) < 1e30))
                document_.fail(at("nodes", index) + ".weights", "a weight is not finite");
        const auto is_zero = [](double weight) { return weight == 0.0; };
        if (std::all_of(weights.begin(), weights.end(), is_zero))
            weights.clear();
        return weights;
    }

    /// A point of the skeleton: vertices are kept relative to it, so that single precision does
    /// for a figure far from the origin.
    glm::dvec3 anchor(int skin) const {
        const std::vector<int>& joints = document_.model.skins[skin].joints;
        if (joints.empty())
            document_.fail(at("skins", skin) + ".joints", "is empty");
        return glm::dvec3(worlds_[joints.front()][3]);
    }

    std::vector<glm::dmat4> joints_of(int index) const {
        const tinygltf::Skin& skin = document_.model.skins[index];
        const std::string place = at("skins", index);
        document_.memory.take(skin.joints.size(), sizeof(glm::dmat4) + 2 * sizeof(glm::mat4),
                              place);
        std::vector<float> inverse_bind;
        if (skin.inverseBindMatrices >= 0) {
            document_.memory.take(document_.model.accessors.at(skin.inverseBindMatrices).count,
                                  sizeof(glm::mat4), place);
            inverse_bind = read_floats(document_, skin.inverseBindMatrices, 16,
                                       place + ".inverseBindMatrices");
            if (inverse_bind.size() < 16 * skin.joints.size())
                document_.fail(place + ".inverseBindMatrices", "has fewer matrices than joints");
        }
        const glm::dmat4 from_world = glm::translate(glm::dmat4(1.0), -anchor(index));
        std::vector<glm::dmat4> joints;
        for (size_t i = 0; i < skin.joints.size(); ++i) {
            glm::dmat4 bind(1.0);
            for (int k = 0; k < 16 && !inverse_bind.empty(); ++k)
                bind[k / 4][k % 4] = inverse_bind[16 * i + k];
            joints.push_back(from_world * worlds_[skin.joints[i]] * bind);
            if (!is_finite(joints.back()))
                document_.fail(place + "." + at("joints", i), "its matrix is not finite");
        }
        return joints;
    }

    Document& document_;
    const Pose& pose_;
    const std::vector<glm::dmat4>& worlds_;
    std::map<std::tuple<int, std::vector<double>, int>, int> known_;
};

// ---------------------------------------------------------------- the scene

/// Whether each node is a root of the scene, or stands below one.
std::vector<bool> held_by(const std::vector<int>& roots, const std::vector<tinygltf::Node>& nodes) {
    std::vector<bool> held(nodes.size());
    std::vector<int> open = roots;
    while (!open.empty()) {
        const int node = open.back();
        open.pop_back();
        if (held[node])
            continue;
        held[node] = true;
        open.insert(open.end(), nodes[node].children.begin(), nodes[node].children.end());
    }
    return held;
}

/// All nodes that have no parent, for a file without scenes.
std::vector<int> all_roots(Document& document, const std::vector<int>& parent) {
    std::vector<int> roots;
    for (size_t i = 0; i < parent.size(); ++i)
        if (parent[i] < 0)
            roots.push_back(static_cast<int>(i));
    if (roots.empty())
        document.fail("scenes", "there is no scene; export the file with one");
    document.warnings.add("no scene", "scenes",
                          "there is no scene: all nodes are taken; export the file with one");
    return roots;
}

/// The roots of the settings' scene. A root that is another node's child as well is placed once:
/// by its parent if the scene holds that, else on its own, cut off from the parent.
std::vector<int> scene_roots(Document& document, const LoadSettings& settings,
                             std::vector<int>& parent) {
    const tinygltf::Model& model = document.model;
    int index = std::max(0, model.defaultScene);
    if (!settings.scene.empty()) {
        std::vector<std::string> names;
        for (const tinygltf::Scene& scene : model.scenes)
            names.push_back(scene.name);
        index = find_named(names, settings.scene, "`scene`");
    }
    if (model.scenes.empty())
        return all_roots(document, parent);
    const std::vector<int>& listed = model.scenes.at(index).nodes;
    const std::string place = at("scenes", index);
    if (listed.empty())
        document.fail(place, model.scenes.size() > 1
                                 ? "has no nodes: there is nothing to bake; name another `scene`"
                                 : "has no nodes: there is nothing to bake; export it with some");
    const std::vector<bool> held = held_by(listed, model.nodes);
    std::vector<bool> is_listed(model.nodes.size());
    std::vector<int> roots;
    for (size_t i = 0; i < listed.size(); ++i) {
        const int node = listed[i];
        const std::string root_place = place + "." + at("nodes", i);
        if (is_listed[node])
            document.fail(root_place, at("nodes", node) + " is listed twice");
        is_listed[node] = true;
        const bool is_child = parent[node] >= 0, is_below = is_child && held[parent[node]];
        if (is_child)
            document.warnings.add("roots that are children", root_place,
                                  at("nodes", node) + " is a child of " + at("nodes", parent[node])
                                      + (is_below ? " as well: it is placed once, there"
                                                  : ", which is not in the scene: it is placed "
                                                    "without it")
                                      + "; list roots alone");
        if (!is_below)
            roots.push_back(node);
        if (is_child && !is_below)
            parent[node] = -1;
    }
    return roots;
}

/// Of a mesh's positions, which may be compressed: then by what their accessors say.
void bound_mesh(Document& document, int mesh, const std::string& node_place, glm::dvec3& lo,
                glm::dvec3& hi) {
    const tinygltf::Model& model = document.model;
    lo = glm::dvec3(1e300);
    hi = -lo;
    for (const tinygltf::Primitive& primitive : model.meshes[size_t(mesh)].primitives) {
        const auto position = primitive.attributes.find("POSITION");
        if (position == primitive.attributes.end())
            continue;
        const tinygltf::Accessor& accessor = model.accessors.at(size_t(position->second));
        if (accessor.minValues.size() == 3 && accessor.maxValues.size() == 3
            && accessor.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT) {
            const auto &least = accessor.minValues, &most = accessor.maxValues;
            lo = glm::min(lo, glm::dvec3(least[0], least[1], least[2]));
            hi = glm::max(hi, glm::dvec3(most[0], most[1], most[2]));
            continue;
        }
        for (const glm::vec3& at :
             read_vectors<3>(document, position->second, node_place + ".mesh")) {
            lo = glm::min(lo, glm::dvec3(at));
            hi = glm::max(hi, glm::dvec3(at));
        }
    }
    if (lo.x > hi.x)
        document.fail(node_place, "is to bound a volume, and its mesh has no positions");
}

SceneFile::Box box_of(Document& document, int index, const glm::dmat4& to_world) {
    const tinygltf::Node& node = document.model.nodes[size_t(index)];
    SceneFile::Box box;
    box.name = node.name;
    box.to_world = to_world;
    if (node.mesh >= 0)
        bound_mesh(document, node.mesh, at("nodes", index), box.lo, box.hi);
    const auto number = [&](const char* key, std::optional<double>& to) {
        if (node.extras.IsObject() && node.extras.Has(key) && node.extras.Get(key).IsNumber())
            to = node.extras.Get(key).GetNumberAsDouble();
    };
    number("cell", box.cell);
    number("priority", box.priority);
    number("falloff", box.falloff);
    return box;
}

} // namespace

Graph walk(Document& document, const LoadSettings& settings, const Pose& pose, Roles& roles) {
    struct Visit {
        int node;
        bool hidden = false;
        int rule = -1;            ///< of those above
        std::ptrdiff_t left = -1; ///< in Graph::nodes: all below it is placed
    };
    const tinygltf::Model& model = document.model;
    std::vector<int> parent = parents_of(document);
    const std::vector<int> roots = scene_roots(document, settings, parent);
    const std::vector<glm::dmat4> worlds = world_transforms(document, parent, pose);
    const std::vector<RoleRule> bounding(settings.boxes.empty() ? 0 : 1, {settings.boxes, {}});
    Roles boxes(document, bounding);
    Graph graph;
    Shapes shapes(document, pose, worlds);
    const auto place = [&](const PlacedShape& placed, const std::string& node_place) {
        if (leaves_area(placed.to_world))
            graph.placed.push_back(placed);
        else
            document.warnings.add("meshes without area", node_place,
                                  "its transform is singular and leaves its mesh no area: the "
                                  "mesh is left out; scale the node to more than 0");
    };
    std::vector<Visit> open;
    for (auto root = roots.rbegin(); root != roots.rend(); ++root)
        open.push_back({*root});
    while (!open.empty()) {
        const auto [index, above_hidden, above_rule, left] = open.back();
        open.pop_back();
        if (left >= 0) {
            graph.nodes[size_t(left)].end = graph.placed.size();
            continue;
        }
        const tinygltf::Node& node = model.nodes[index];
        RoleFit fit = roles.of_node(index);
        fit.rule = std::max(fit.rule, above_rule);
        const bool hidden = above_hidden || is_hidden(node) || fit.excluded;
        const int rule = fit.rule; // of what stands below
        if (!node.name.empty()) {
            open.push_back({index, hidden, rule, std::ssize(graph.nodes)});
            graph.nodes.push_back({node.name, graph.placed.size(), 0});
        }
        const std::string node_place = at("nodes", index);
        const glm::dmat4& to_world = worlds[index];
        if (!bounding.empty()
            && (boxes.of_node(index).excluded
                || (node.mesh >= 0 && boxes.of_mesh(node.mesh).excluded)))
            graph.boxes.push_back(box_of(document, index, to_world));
        if (node.mesh >= 0)
            fit.add(roles.of_mesh(node.mesh));
        if (node.mesh >= 0 && !hidden && !fit.excluded) {
            PlacedShape placed = shapes.place(index);
            placed.rule = fit.rule;
            const auto* instancing = find_extension(node.extensions, "EXT_mesh_gpu_instancing");
            if (instancing && node.skin < 0)
                for (const glm::dmat4& transform :
                     instance_transforms(document, *instancing, node_place)) {
                    if (!is_finite(to_world * transform))
                        document.fail(node_place, "the transform of an instance is not finite");
                    place({placed.shape, to_world * transform, placed.rule}, node_place);
                }
            else
                place(placed, node_place);
        }
        if (const auto* reference = find_extension(node.extensions, "KHR_lights_punctual");
            reference && !hidden)
            if (const auto light = placed_light(document, reference->Get("light").GetNumberAsInt(),
                                                to_world, node.name, node_place))
                graph.lights.push_back(*light);
        if (node.camera >= 0)
            if (const auto camera = placed_camera(document, node.camera, to_world))
                graph.cameras.push_back(*camera);
        for (auto child = node.children.rbegin(); child != node.children.rend(); ++child)
            open.push_back({*child, hidden, rule});
    }
    graph.shapes = std::move(shapes.shapes);
    return graph;
}

} // namespace lpvbake::scene::gltf
