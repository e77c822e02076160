#include "hard_cases/hard_cases.h"

#include "hard_cases/gltf_writer.h"
#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <nlohmann/json.hpp>

#include <fstream>
#include <stdexcept>

namespace lpvbake::scenes {
namespace {

using json = nlohmann::ordered_json;

const double pi = glm::pi<double>();

// What classic propagation is known to get wrong whatever the grid: every empty cell sends light on
// in cosine lobes again. The measured range over rooms and streets is an error of 60 to 130 %, at
// most 2.1 times the energy, and 7 to 29 % of negative samples. Light only wanders longer than it
// should: energy below 0.9 is light lost.
json lpv_known() {
    return {{"error", 1.3}, {"energy", {0.9, 2.1}}, {"negative", 0.3}};
}
/// In empty space it knows no limit: what it sends out diffuses, and falls with the distance
/// instead of its square. A step of one cell that keeps 0.369 of its direction has a diffusion
/// coefficient D of (1 + 0.369) / (1 - 0.369) / 6, a source of power P gives P / (4 pi D r) a cell,
/// that over 1.5 h^2 is light, which should be P / (4 pi r^2): their sums over the cells bound the
/// energy, since light that leaves the grid is lost. `sources` in cells from the grid's corner.
json lpv_in_empty_space(int cells, const std::vector<glm::dvec3>& sources) {
    double diffused = 0.0, straight = 0.0;
    for (int i = 0; i < cells * cells * cells; ++i)
        for (const glm::dvec3& source : sources) {
            const glm::dvec3 centre(i % cells, i / cells % cells, i / (cells * cells));
            const double r = std::max(0.5, glm::distance(centre + 0.5, source));
            diffused += 1.0 / (1.5 * (1.369 / 0.631 / 6.0) * r);
            straight += 1.0 / (r * r);
        }
    return {{"energy", {0.9, diffused / straight}}, {"negative", 0.3}};
}
/// In a furnace it reads 1.2 to 1.5 instead of 1 by its nature; walls at an angle to the grid are
/// stairs of more area, which take more light away.
json lpv_furnace(double stairs) {
    return {{"error", 0.6}, {"energy", {1.2 / stairs, 1.5}}, {"negative", 0.3}};
}

/// Of solvers that keep directions: what is exact but for the grid. Invariances and leaks are as
/// for lpv, where it is bound to them.
json exact(const json& lpv) {
    json limits{{"negative", 0.3}};
    if (lpv.contains("error") || lpv.contains("energy"))
        limits.update({{"error", 0.1}, {"energy", {0.97, 1.02}}});
    if (lpv.contains("leak"))
        limits["leak"] = lpv["leak"][1] == 0 ? lpv["leak"] : json{0.95, 1.05};
    if (lpv.contains("same"))
        limits["same"] = std::min(lpv["same"].get<double>(), 0.02);
    return limits;
}

/// What a solver is held to, from what classic propagation is held to in the same case.
struct Held {
    const char* solver;
    json (*limits)(const json& lpv);
};
constexpr Held held[] = {
    {"lpv", [](const json& lpv) { return lpv; }},
    {"sn", exact},
    {"gather", exact},
};

/// The cases of one file, written as they are added.
struct Writer {
    std::string folder;
    json cases = json::array();

    /// `extra` has what the case says beyond name, reason, scene and limits of lpv.
    void add(const std::string& name, const std::string& reason, const Scene& scene, json extra,
             json lpv, bool cheap) {
        scenes::write_gltf(scene, folder + "/" + name + ".gltf");
        json c{{"name", name}, {"reason", reason}, {"scene", name + ".gltf"}};
        c.update(extra);
        for (const Held& each : held)
            c["limits"][each.solver] = each.limits(lpv);
        c["cheap"] = cheap;
        cases.push_back(std::move(c));
    }
};

glm::dmat4 odd_turn() {
    return glm::rotate(glm::dmat4(1.0), 0.7, glm::normalize(glm::dvec3(0.3, 1.0, 0.5)));
}

/// Moves all that a scene has.
Scene moved(Scene scene, const glm::dmat4& move) {
    for (Instance& instance : scene.instances)
        instance.to_world = move * instance.to_world;
    for (Light& light : scene.lights)
        light.position = glm::dvec3(move * glm::dvec4(light.position, 1.0));
    return scene;
}

Scene scaled(const Scene& scene, double factor) {
    return moved(scene, glm::scale(glm::dmat4(1.0), glm::dvec3(factor)));
}

Scene shifted(const Scene& scene, glm::dvec3 by) {
    return moved(scene, glm::translate(glm::dmat4(1.0), by));
}

// ---------------------------------------------------------------- scenes

/// A square of 1 m in the plane y = 0 that faces up.
Scene patch(float albedo, float emission) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(albedo), glm::vec3(emission)),
                     {-0.5f, 0, 0.5f}, {1, 0, 0}, {0, 0, -1});
    return scene;
}

Scene sunlit_patch(double elevation) {
    Scene scene = patch(0.8f, 0.0f);
    scene.lights.push_back(scenes::sun({std::cos(elevation), -std::sin(elevation), 0.0}, 1000.0));
    return scene;
}

/// Luminance of a floor of albedo 0.8 in a sun of 1000 lux.
double sunlit_luminance(double elevation) {
    return double(0.8f) * 1000.0 * std::sin(elevation) / pi;
}

json polygon_truth(const std::vector<glm::dvec3>& corners, double luminance) {
    json polygon{{"corners", json::array()}, {"luminance", luminance}};
    for (const glm::dvec3& corner : corners)
        polygon["corners"].push_back({corner.x, corner.y, corner.z});
    return {{"polygon", polygon}};
}

/// A square about the origin that faces up.
json square_truth(double half, double luminance) {
    return polygon_truth({{-half, 0, half}, {half, 0, half}, {half, 0, -half}, {-half, 0, -half}},
                         luminance);
}

/// The Cornell box closed, with a hole of 0.6 m in its ceiling, and a sun above it.
Scene sun_through_opening() {
    Scene scene = scenes::cornell_box();
    scene.instances.erase(scene.instances.begin() + 1); // the ceiling
    constexpr int white = 0;
    scenes::add_quad(scene, white, {1, 0, 1}, {-2, 0, 0}, {0, 2, 0}); // front, faces -Z
    for (const auto& [x0, x1, z0, z1] :
         {std::array{-1.0f, 1.0f, -1.0f, -0.3f}, std::array{-1.0f, 1.0f, 0.3f, 1.0f},
          std::array{-1.0f, -0.3f, -0.3f, 0.3f}, std::array{0.3f, 1.0f, -0.3f, 0.3f}})
        scenes::add_quad(scene, white, {x0, 2, z0}, {x1 - x0, 0, 0}, {0, 0, z1 - z0});
    scene.lights.push_back(scenes::sun({0.3, -1.0, 0.25}, 10000.0));
    return scene;
}

/// A room of 4 x 2 x 2 m with a light left of x = 0.
Scene long_room() {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.7f), glm::vec3(0.0f)),
                    {-2, 0, -1}, {2, 2, 1}, scenes::Facing::inward);
    scene.lights.push_back(scenes::point_light({-1.1, 1.6, 0.3}, 100.0));
    return scene;
}

/// Two rooms with a wall of 5 cm between them, which a door of 0.8 x 1.6 m opens.
Scene two_rooms(bool door) {
    Scene scene = long_room();
    const glm::vec3 lo(-0.025f, 0, -1), hi(0.025f, 2, 1);
    if (!door) {
        scenes::add_box(scene, 0, lo, hi, scenes::Facing::outward);
        return scene;
    }
    scenes::add_box(scene, 0, lo, {hi.x, hi.y, -0.4f}, scenes::Facing::outward);
    scenes::add_box(scene, 0, {lo.x, lo.y, 0.4f}, hi, scenes::Facing::outward);
    scenes::add_box(scene, 0, {lo.x, 1.6f, -0.4f}, {hi.x, hi.y, 0.4f}, scenes::Facing::outward);
    return scene;
}

/// A sheet without thickness, a third of a cell off the middle.
Scene thin_wall() {
    Scene scene = long_room();
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.7f), glm::vec3(0.0f), true),
                     {0.09f, 0, 1}, {0, 0, -2}, {0, 2, 0});
    return scene;
}

/// A closed hollow box, turned, in a lit room.
Scene sealed_box() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_box(scene, grey, glm::vec3(-1), glm::vec3(1), scenes::Facing::inward);
    scenes::add_box(scene, grey, glm::vec3(-0.5f), glm::vec3(0.5f), scenes::Facing::outward,
                    odd_turn());
    scenes::add_box(scene, grey, glm::vec3(-0.47f), glm::vec3(0.47f), scenes::Facing::inward,
                    odd_turn());
    scene.lights.push_back(scenes::point_light({-0.8, 0.8, 0.7}, 100.0));
    return scene;
}

Scene canyon() {
    Scene scene;
    const int asphalt = scenes::add_material(scene, glm::vec3(0.2f));
    const int brick = scenes::add_material(scene, {0.6f, 0.35f, 0.25f});
    scenes::add_quad(scene, asphalt, {-5, 0, 8}, {10, 0, 0}, {0, 0, -16});
    scenes::add_box(scene, brick, {-5, 0, -8}, {-2, 6, 8}, scenes::Facing::outward);
    scenes::add_box(scene, brick, {2, 0, -8}, {5, 6, 8}, scenes::Facing::outward);
    scene.lights.push_back(scenes::sun({0.6, -1.0, 0.3}, 50000.0));
    return scene;
}

/// A glowing triangle of a fifth of a cell with its centroid where cells meet, off by x metres.
std::vector<glm::dvec3> dot_corners(double x) {
    return {{x - 0.01, 0, 0.01}, {x + 0.02, 0, 0.01}, {x - 0.01, 0, -0.02}};
}

Scene dot(double x) {
    Scene scene;
    Mesh mesh;
    mesh.material = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(1.0f));
    for (const glm::dvec3& corner : dot_corners(0.0))
        mesh.positions.push_back(glm::vec3(corner));
    mesh.triangles = {{0, 1, 2}};
    scene.meshes.push_back(mesh);
    scene.instances.push_back({0, glm::translate(glm::dmat4(1.0), {x, 0.0, 0.0})});
    return scene;
}

/// A closed box in the air of the Cornell box.
Scene floating_box() {
    Scene scene = scenes::cornell_box_with_point();
    scenes::add_box(scene, 0, {-0.2f, 1.3f, 0.3f}, {0.2f, 1.6f, 0.7f}, scenes::Facing::outward);
    return scene;
}

Scene with_light(Scene scene, glm::dvec3 position) {
    scene.lights.push_back(scenes::point_light(position, 1000.0));
    return scene;
}

Scene with_degenerates() {
    Scene scene = scenes::cornell_box_with_point();
    scene.instances.push_back(scene.instances[0]); // the floor twice
    Mesh mesh;
    mesh.positions = {{0, 0.5f, 0}, {0.5f, 0.5f, 0}, {1, 0.5f, 0}, {0, 1, 0.5f}};
    mesh.triangles = {{0, 1, 2}, {0, 0, 3}, {3, 3, 3}, {2, 1, 0}};
    scene.instances.push_back({int(scene.meshes.size()), glm::dmat4(1.0)});
    scene.meshes.push_back(mesh);
    return scene;
}

Scene white_cornell_box() {
    Scene scene = scenes::cornell_box_with_point();
    for (Material& material : scene.materials)
        material.base_color = glm::vec4(1.0f);
    return scene;
}

// ---------------------------------------------------------------- cases

void add_furnaces(Writer& w) {
    const auto truth = [](double albedo) -> json {
        return {{"furnace", {{"emission", 1}, {"albedo", albedo}}}};
    };
    for (const auto& [name, albedo] :
         {std::pair{"furnace-0", 0.0f}, std::pair{"furnace-50", 0.5f},
          std::pair{"furnace-80", 0.8f}, std::pair{"furnace-95", 0.95f}})
        w.add(name, "closed and glowing: 1 / (1 - albedo) everywhere, after any number of bounces",
              scenes::furnace(2.0f, albedo, 1.0f),
              {{"options", {{"resolution", 16}, {"bounces", "inf"}}},
               {"truth", truth(double(albedo))}},
              lpv_furnace(1.0), albedo == 0.0f);
    double stairs = 0.0; // area of the stairs over that of the walls
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            stairs += std::abs(odd_turn()[i][k]) / 3.0;
    w.add("furnace-turned", "the same at an odd angle to the grid: no wall lies along it",
          moved(scenes::furnace(2.0f, 0.5f, 1.0f), odd_turn()),
          {{"options", {{"resolution", 20}, {"bounces", "inf"}}}, {"truth", truth(0.5)}},
          lpv_furnace(stairs), true);
}

void add_patches(Writer& w) {
    const json options{{"resolution", 16}, {"bounds", {-1, -0.5, -1, 1, 1.5, 1}}};
    const double high = glm::radians(60.0), grazing = glm::radians(0.5);
    std::vector<glm::dvec3> middles; // of the patch's 7 x 7 cells, below which lie 4 and a half
    for (int i = 0; i < 49; ++i)
        middles.push_back({5.0 + i % 7, 4.5, 5.0 + i / 7});
    json lpv = lpv_in_empty_space(16, middles);
    w.add("patch-emissive", "one glowing patch in empty space: the form factor of a polygon",
          patch(0.0f, 1.0f), {{"options", options}, {"truth", square_truth(0.5, 1.0)}}, lpv, true);
    lpv["same"] = 0.02;
    w.add("patch-lit", "the same patch lit by a sun: light by maps and by surfaces has to agree",
          sunlit_patch(high),
          {{"options", options},
           {"truth", square_truth(0.5, sunlit_luminance(high))},
           {"same_as", {{"case", "patch-emissive"}, {"scale", sunlit_luminance(high)}}}},
          lpv, false);
    w.add("grazing-sun", "a sun half a degree high: the same light but for its strength",
          sunlit_patch(grazing),
          {{"options", options},
           {"truth", square_truth(0.5, sunlit_luminance(grazing))},
           {"same_as", {{"case", "patch-lit"}, {"scale", std::sin(grazing) / std::sin(high)}}}},
          lpv, true);
    Scene flat = scenes::floor_quad(2.0f, glm::vec3(0.8f));
    flat.lights.push_back(scenes::sun({std::cos(high), -std::sin(high), 0.0}, 1000.0));
    w.add("flat", "a scene without height: bounds of no thickness, cells that lie in the surface",
          flat,
          {{"options", {{"resolution", 16}}}, {"truth", square_truth(1.0, sunlit_luminance(high))}},
          lpv_known(), true);
    const json dot_options{{"resolution", 16}, {"bounds", {-1, -1, -1, 1, 1, 1}}};
    const double off = 0.5e-4 * 2.0 / 14.0;
    // Classic propagation puts a light into one cell whole, and is known to jump by up to 60 %.
    const json lpv_dot = lpv_in_empty_space(16, {glm::dvec3(8.0)});
    w.add("dot", "a light smaller than a cell, just left of the border of two", dot(-off),
          {{"options", dot_options}, {"truth", polygon_truth(dot_corners(-off), 1.0)}}, lpv_dot,
          true);
    w.add("dot-shifted", "the same 1e-4 cells further, across the border: nothing may jump",
          dot(off),
          {{"options", dot_options},
           {"truth", polygon_truth(dot_corners(off), 1.0)},
           {"same_as", {{"case", "dot"}}}},
          {{"same", 0.6}}, true);
}

void add_rooms(Writer& w) {
    const json options{{"resolution", 16}}, large{{"resolution", 30}};
    const json few_rays{{"resolution", 16}, {"rays", 1024}};
    w.add("cornell-sun", "a beam through an opening: all light comes from a small bright spot",
          sun_through_opening(), {{"options", {{"resolution", 16}, {"rays", 65536}}}}, lpv_known(),
          false);
    json lpv = lpv_known();
    lpv["leak"] = {0.7, 2.1}; // 0.79 is known of a finer grid
    w.add("two-rooms", "a door, and a wall of a third of a cell that may not leak past it",
          two_rooms(true),
          {{"options", large}, {"region", {{"lo", {0.05, 0, -1}}, {"hi", {2, 2, 1}}}}}, lpv, false);
    lpv["leak"] = {0, 0};
    const json right_room{{"lo", {0.05, 0, -1}}, {"hi", {2, 2, 1}}, {"dark", true}};
    w.add("sealed-room", "the same without a door: the right room is black", two_rooms(false),
          {{"options", few_rays}, {"region", right_room}}, lpv, true);
    w.add("thin-wall", "a wall without thickness between centres of cells: it blocks all the same",
          thin_wall(),
          {{"options", few_rays},
           {"region", {{"lo", {0.1, 0, -1}}, {"hi", {2, 2, 1}}, {"dark", true}}}},
          lpv, true);
    w.add("sealed-box", "a closed box at an odd angle in a lit room: black within", sealed_box(),
          {{"options", {{"resolution", 20}, {"rays", 1024}}},
           {"region", {{"lo", {-0.3, -0.3, -0.3}}, {"hi", {0.3, 0.3, 0.3}}, {"dark", true}}}},
          lpv, true);
    w.add("canyon", "a street in the sun: open above, one side lit", canyon(),
          {{"options", {{"resolution", 20}}}}, lpv_known(), true);
    w.add(
        "albedo-1", "nothing absorbs, yet the box is open: light still ends", white_cornell_box(),
        {{"options", {{"resolution", 16}, {"rays", 1024}, {"bounces", "inf"}, {"max-albedo", 1}}}},
        lpv_known(), true);
}

void add_invariances(Writer& w) {
    const json options{{"resolution", 16}};
    const Scene room = scenes::cornell_box_with_point(100.0);
    w.add("cornell-point", "a box with coloured walls: what the next cases have to agree with",
          room, {{"options", options}}, lpv_known(), true);
    const auto same = [&](const char* name, const char* reason, const Scene& scene, double scale,
                          double limit, const json& own_options, bool cheap = true) {
        w.add(name, reason, scene,
              {{"options", own_options},
               {"truth", "none"},
               {"same_as", {{"case", "cornell-point"}, {"scale", scale}}}},
              {{"same", limit}}, cheap);
    };
    same("light-in-box", "a second light in a box that stands on the floor: its light ends there",
         with_light(room, {-0.35, 0.6, -0.35}), 1.0, 0.02, options);
    w.add("floating-box", "a closed box in the air", floating_box(),
          {{"options", options}, {"truth", "none"}}, {{"negative", 0.3}}, true);
    w.add("light-inside", "the same with a light within the box: nothing changes",
          with_light(floating_box(), {0.05, 1.4, 0.5}),
          {{"options", options}, {"truth", "none"}, {"same_as", {{"case", "floating-box"}}}},
          {{"same", 1e-6}}, true);
    json box = options;
    box["bounds"] = {-1, 0, -1, 1, 2, 1};
    const double little = 1e-4 * 2.0 / 14.0;
    same("cornell-shifted", "1e-4 cells off the grid: walls and lights on borders of cells",
         shifted(room, glm::dvec3(little)), 1.0, 0.02, box);
    same("offset-1e3", "a kilometre from the origin", shifted(room, glm::dvec3(1e3)), 1.0, 1e-3,
         options);
    same("offset-1e6", "1000 km from the origin: single precision tells 6 cm apart there",
         shifted(room, glm::dvec3(1e6)), 1.0, 1e-3, options);
    same("scale-1e-4", "a room of 0.2 mm: light falls with the square", scaled(room, 1e-4), 1e8,
         1e-3, options);
    same("scale-1e4", "a room of 20 km", scaled(room, 1e4), 1e-8, 1e-3, options);
    same("light-1e-9", "a billionth of a candela", scenes::cornell_box_with_point(1e-9), 1e-11,
         1e-3, options);
    same("light-1e9", "a billion candela", scenes::cornell_box_with_point(1e9), 1e7, 1e-3, options);
    same("degenerate", "triangles without area, and a floor that is there twice",
         with_degenerates(), 1.0, 1e-3, options);
    json iterations = options;
    iterations["iterations"] = 10'000;
    same("iterations", "10,000 steps: more than enough may not blow up", room, 1.0, 0.02,
         iterations, false);
}

} // namespace

void write_hard_cases(const std::string& folder) {
    Writer w{folder};
    add_furnaces(w);
    add_patches(w);
    add_rooms(w);
    add_invariances(w);
    std::ofstream file(folder + "/suite.json", std::ios::binary);
    file << json{{"cases", w.cases}}.dump(2) << '\n';
    if (!file.flush())
        throw std::runtime_error(folder + "/suite.json cannot be written");
}

} // namespace lpvbake::scenes
