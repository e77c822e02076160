#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>

namespace lpvbake::scenes {
namespace {

const glm::vec3 amber{0.8f, 0.4f, 0.2f};

void append_quad(Mesh& mesh, glm::vec3 corner, glm::vec3 u, glm::vec3 v) {
    const auto first = static_cast<uint32_t>(mesh.positions.size());
    const glm::vec3 normal = glm::normalize(glm::cross(u, v));
    mesh.positions.insert(mesh.positions.end(), {corner, corner + u, corner + u + v, corner + v});
    mesh.normals.insert(mesh.normals.end(), 4, normal);
    mesh.uv.insert(mesh.uv.end(), {{0, 0}, {1, 0}, {1, 1}, {0, 1}});
    mesh.uv_emission = mesh.uv;
    mesh.triangles.insert(mesh.triangles.end(),
                          {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
}

int place(Scene& scene, Mesh mesh, const glm::dmat4& to_world) {
    const int index = static_cast<int>(scene.meshes.size());
    scene.meshes.push_back(std::move(mesh));
    scene.instances.push_back({index, to_world});
    return index;
}

} // namespace

int add_material(Scene& scene, glm::vec3 albedo, glm::vec3 emission, bool double_sided) {
    Material material;
    material.base_color = glm::vec4(albedo, 1.0f);
    material.emission = emission;
    material.double_sided = double_sided;
    scene.materials.push_back(material);
    return static_cast<int>(scene.materials.size()) - 1;
}

int add_quad(Scene& scene, int material, glm::vec3 corner, glm::vec3 u, glm::vec3 v,
             const glm::dmat4& to_world) {
    Mesh mesh;
    mesh.material = material;
    append_quad(mesh, corner, u, v);
    return place(scene, std::move(mesh), to_world);
}

int add_box(Scene& scene, int material, glm::vec3 lo, glm::vec3 hi, scenes::Facing facing,
            const glm::dmat4& to_world) {
    Mesh mesh;
    mesh.material = material;
    const glm::vec3 size = hi - lo;
    for (int axis = 0; axis < 3; ++axis)
        for (const bool upper : {false, true}) {
            glm::vec3 corner = lo, u(0.0f), v(0.0f);
            const int second = (axis + 1) % 3, third = (axis + 2) % 3;
            corner[axis] = upper ? hi[axis] : lo[axis];
            u[second] = size[second]; // u x v points along +axis
            v[third] = size[third];
            if (upper == (facing == scenes::Facing::outward))
                append_quad(mesh, corner, u, v);
            else
                append_quad(mesh, corner, v, u);
        }
    return place(scene, std::move(mesh), to_world);
}

glm::dmat4 random_turn(std::mt19937& random) {
    std::normal_distribution<double> normal;
    const glm::dvec3 axis =
        glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
    return glm::rotate(glm::dmat4(1.0), std::uniform_real_distribution<double>(0, 6.28)(random),
                       axis);
}

Light sun(glm::dvec3 travel, double lux, glm::vec3 color) {
    Light light;
    light.type = LightType::directional;
    light.direction = glm::normalize(travel);
    light.intensity = lux;
    light.color = color;
    return light;
}

Light point_light(glm::dvec3 position, double candela, glm::vec3 color) {
    Light light;
    light.type = LightType::point;
    light.position = position;
    light.intensity = candela;
    light.color = color;
    return light;
}

Light spot_light(glm::dvec3 position, glm::dvec3 travel, double candela, double inner,
                 double outer) {
    Light light = scenes::point_light(position, candela);
    light.type = LightType::spot;
    light.direction = glm::normalize(travel);
    light.inner_cone = inner;
    light.outer_cone = outer;
    return light;
}

Scene floor_quad(float edge, glm::vec3 albedo) {
    Scene scene;
    const int material = scenes::add_material(scene, albedo);
    scenes::add_quad(scene, material, {-edge / 2, 0, edge / 2}, {edge, 0, 0}, {0, 0, -edge});
    return scene;
}

Scene furnace(float edge, float albedo, float emission) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(albedo), glm::vec3(emission));
    scenes::add_box(scene, material, glm::vec3(0.0f), glm::vec3(edge), scenes::Facing::inward);
    return scene;
}

Scene glass_room(bool sky) {
    Scene scene;
    if (sky)
        scene.sky.luminance = glm::vec3(1.0f);
    else
        scene = furnace(4.0f, 0.0f, 1.0f);
    const int glass = add_material(scene, amber);
    scene.materials[size_t(glass)].transmission = 0.75f;
    add_box(scene, glass, glm::vec3(1.0f), glm::vec3(3.0f), scenes::Facing::inward);
    return scene;
}

Scene clear_pane() {
    Scene scene;
    scene.sky.luminance = glm::vec3(1.0f);
    const int glass = add_material(scene, amber, glm::vec3(0.0f), true);
    scene.materials[size_t(glass)].transmission = 1.0f;
    add_quad(scene, glass, {2.1f, -999, -999}, {0, 0, 2000}, {0, 2000, 0});
    return scene;
}

glm::dvec3 luminance_beside_clear_pane() {
    return 0.5 + 0.5 * glm::dvec3(amber);
}

glm::dvec3 luminance_in_glass_room() {
    return 0.75 * glm::dvec3(amber) / (1.0 - 0.25 * glm::dvec3(amber));
}

Scene cornell_box() {
    Scene scene;
    const int white = scenes::add_material(scene, {0.73f, 0.73f, 0.73f});
    const int red = scenes::add_material(scene, {0.63f, 0.065f, 0.05f});
    const int green = scenes::add_material(scene, {0.14f, 0.45f, 0.091f});
    scenes::add_quad(scene, white, {-1, 0, 1}, {2, 0, 0}, {0, 0, -2}); // floor
    scenes::add_quad(scene, white, {-1, 2, -1}, {2, 0, 0}, {0, 0, 2}); // ceiling
    scenes::add_quad(scene, white, {-1, 0, -1}, {2, 0, 0}, {0, 2, 0}); // back
    scenes::add_quad(scene, red, {-1, 0, 1}, {0, 0, -2}, {0, 2, 0});   // left, faces +X
    scenes::add_quad(scene, green, {1, 0, -1}, {0, 0, 2}, {0, 2, 0});  // right, faces -X
    const auto turned = [](glm::dvec3 position, double degrees) {
        return glm::rotate(glm::translate(glm::dmat4(1.0), position), glm::radians(degrees),
                           glm::dvec3(0, 1, 0));
    };
    scenes::add_box(scene, white, {-0.3f, 0, -0.3f}, {0.3f, 0.6f, 0.3f}, scenes::Facing::outward,
                    glm::translate(glm::dmat4(1.0), {0.35, 0.0, 0.35}));
    scenes::add_box(scene, white, {-0.3f, 0, -0.3f}, {0.3f, 1.2f, 0.3f}, scenes::Facing::outward,
                    turned({-0.35, 0.0, -0.35}, 20.0));
    return scene;
}

Scene cornell_box_with_point(double candela) {
    Scene scene = scenes::cornell_box();
    scene.lights.push_back(scenes::point_light({0.0, 1.8, 0.0}, candela));
    return scene;
}

Scene cornell_box_with_sun(double lux) {
    Scene scene = scenes::cornell_box();
    scene.lights.push_back(scenes::sun({0.5, -0.6, -1.0}, lux));
    return scene;
}

} // namespace lpvbake::scenes
