#include "bake/layers.h"

#include "lpvbake/error.h"
#include "quoted.h"
#include "scene/scene.h"
#include "scene/sky.h"
#include "text.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::bake {
namespace {

/// Materials whose emission lights others.
std::vector<bool> emissive(const Scene& scene, bool emitters) {
    return emitters ? scene::emissive_materials(scene)
                    : std::vector<bool>(scene.materials.size(), false);
}

/// What of a scene's light no layer has yet.
class Left {
public:
    Left(const Scene& scene, bool emitters)
        : scene_(scene),
          lights_(scene.lights.size(), true),
          emissions_(emissive(scene, emitters)),
          sky_(scene::has_sky(scene)) {}

    /// A new layer, of no light.
    Layer& add(const std::string& wanted, const char* kind) {
        std::string name = wanted;
        std::ranges::replace_if(
            name, [](char c) { return !is_of_file_names(c); }, '_');
        if (!is_layer_name(name))
            name = kind + std::string("_") + name;
        const auto taken = [&](const std::string& other) {
            return std::ranges::count(layers, other, &Layer::name) > 0;
        };
        std::string unique = name;
        for (int i = 2; taken(unique); ++i)
            unique = name + "_" + std::to_string(i);
        Layer& layer = layers.emplace_back();
        layer.name = unique;
        layer.kind = kind;
        layer.unit = "scene";
        layer.light.lights.resize(lights_.size(), glm::vec3(0.0f));
        layer.light.emissions.resize(emissions_.size(), glm::vec3(0.0f));
        return layer;
    }
    bool has_light(std::size_t i) const { return lights_[i]; }
    bool has_emission(std::size_t i) const { return emissions_[i]; }
    bool has_sky() const { return sky_; }
    void give_light(std::size_t i, Layer& to) {
        lights_[i] = false;
        to.light.lights[i] = glm::vec3(1.0f);
    }
    void give_emission(std::size_t i, Layer& to) {
        emissions_[i] = false;
        to.light.emissions[i] = glm::vec3(1.0f);
        to.emitters.push_back(scene_.materials[i].name);
    }
    void give_sky(Layer& to) {
        sky_ = false;
        to.light.sky = glm::vec3(1.0f);
    }
    /// All that is left, unless that is nothing.
    void add_rest() {
        const auto any = [](const std::vector<bool>& of) {
            return std::ranges::find(of, true) != of.end();
        };
        if (!any(lights_) && !any(emissions_) && !sky_)
            return;
        Layer& rest = add("rest", "rest");
        for (std::size_t i = 0; i < lights_.size(); ++i)
            if (lights_[i])
                give_light(i, rest);
        for (std::size_t i = 0; i < emissions_.size(); ++i)
            if (emissions_[i])
                give_emission(i, rest);
        if (sky_)
            give_sky(rest);
    }

    std::vector<Layer> layers;

private:
    const Scene& scene_;
    std::vector<bool> lights_, emissions_;
    bool sky_;
};

std::string names_in(const Scene& scene, const std::vector<bool>& emissions) {
    std::string names;
    const auto add = [&](const std::string& name) {
        names += std::string(names.empty() ? "'" : ", '") + printable(name) + "'";
    };
    for (const Light& light : scene.lights)
        add(light.name);
    for (std::size_t i = 0; i < emissions.size(); ++i)
        if (emissions[i])
            add(scene.materials[i].name);
    return names.empty() ? "there is none" : "there are " + names;
}

void add_group(const Scene& scene, const LayerWish& wish, bool emitters, Left& left) {
    Layer group = left.add(wish.name, "group");
    left.layers.pop_back();
    bool any = false;
    for (std::size_t i = 0; i < scene.lights.size(); ++i)
        if (left.has_light(i) && scene::fits_pattern(scene.lights[i].name, wish.pattern)) {
            left.give_light(i, group);
            any = true;
        }
    for (std::size_t i = 0; i < scene.materials.size(); ++i)
        if (left.has_emission(i) && scene::fits_pattern(scene.materials[i].name, wish.pattern)) {
            left.give_emission(i, group);
            any = true;
        }
    if (!any)
        throw Error(ErrorKind::argument,
                    format("`layers` %s=%s: no light or emissive material of such a name is left; ",
                           wish.name.c_str(), wish.pattern.c_str())
                        + names_in(scene, emissive(scene, emitters)));
    left.layers.push_back(std::move(group));
}

void add_sky(const LayerWish& wish, Left& left) {
    if (!left.has_sky())
        throw Error(ErrorKind::argument,
                    std::string("`layers` ")
                        + (wish.kind == LayerWish::Kind::transfer ? "transfer" : "sky")
                        + ": there is no sky that no layer has; add one with `sky`, by whose light "
                          "settings are chosen");
    left.give_sky(left.add("sky", "sky"));
    const auto add = [&](const std::string& name, const char* kind) -> scene::LightLayer& {
        Layer& layer = left.add(name, kind);
        layer.unit = "nits";
        layer.weight = glm::vec3(0.0f);
        return layer.light;
    };
    const bool transfer = wish.kind == LayerWish::Kind::transfer;
    if (transfer) {
        scene::LightLayer& seen = add("sky_visibility", "visibility");
        seen.beyond = [](glm::vec3) { return glm::vec3(1.0f); };
        seen.part = scene::LightLayer::Part::direct;
        seen.order = volume::sh_max_order;
    }
    for (int k = 0; wish.order >= 0 && k < volume::sh_count(wish.order); ++k) {
        scene::LightLayer& mode = add((transfer ? "sky_bounce_" : "sky_") + std::to_string(k),
                                      transfer ? "bounce" : "mode");
        mode.beyond = [k, order = wish.order](glm::vec3 towards) {
            return glm::vec3(volume::sh_basis(order, towards)[std::size_t(k)]);
        };
        if (transfer)
            mode.part = scene::LightLayer::Part::reflected;
    }
}

} // namespace

bool is_layer_name(const std::string& name) {
    return !name.empty() && name.size() <= 64 && std::ranges::all_of(name, is_of_file_names)
           && name[0] != '.' && name[0] != '-';
}

std::vector<Layer> make_layers(const Scene& scene, std::span<const LayerWish> wishes,
                               bool emitters) {
    Left left(scene, emitters);
    using Kind = LayerWish::Kind;
    for (const LayerWish& wish : wishes)
        if (wish.kind == Kind::group)
            add_group(scene, wish, emitters, left);
    for (const LayerWish& wish : wishes) {
        const std::size_t before = left.layers.size();
        if (wish.kind == Kind::lights)
            for (std::size_t i = 0; i < scene.lights.size(); ++i)
                if (left.has_light(i))
                    left.give_light(i, left.add(scene.lights[i].name, "light"));
        if (wish.kind == Kind::emitters)
            for (std::size_t i = 0; i < scene.materials.size(); ++i)
                if (left.has_emission(i))
                    left.give_emission(i, left.add(scene.materials[i].name, "emitter"));
        if (wish.kind == Kind::sky || wish.kind == Kind::transfer)
            add_sky(wish, left);
        if (wish.kind != Kind::group && left.layers.size() == before)
            throw Error(ErrorKind::argument,
                        wish.kind == Kind::lights
                            ? "`layers` lights: no punctual light is left"
                            : "`layers` emitters: no emissive material that gives light is left");
    }
    if (!wishes.empty())
        left.add_rest();
    if (left.layers.size() > most_layers)
        throw Error(ErrorKind::argument,
                    format("`layers`: these are %zu, and %zu at most; put lights together by "
                           "NAME=GLOB",
                           left.layers.size(), most_layers));
    return std::move(left.layers);
}

std::vector<glm::vec3> project_sky(const Sky& sky, int order) {
    constexpr int rows = 256, columns = 512;
    const auto count = std::size_t(volume::sh_count(order));
    std::vector<glm::dvec3> sums(count, glm::dvec3(0.0));
    const double turn = 2.0 * glm::pi<double>();
    for (int row = 0; row < rows; ++row) // of one solid angle each
        for (int column = 0; column < columns; ++column) {
            const double low = 1.0 - 2.0 * (row + 1) / rows, high = 1.0 - 2.0 * row / rows;
            const double from = turn * column / columns, to = turn * (column + 1) / columns;
            const glm::dvec3 luminance = scene::sky_mean(sky, low, high, from, to);
            // Gauss and Legendre's two points in height: midpoints are off by 1e-5.
            for (const double at : {0.5 - std::sqrt(1.0 / 12), 0.5 + std::sqrt(1.0 / 12)}) {
                const double y = glm::mix(low, high, at), angle = 0.5 * (from + to);
                const double radius = std::sqrt(1.0 - y * y);
                const volume::ShValues basis = volume::sh_basis(
                    order, glm::vec3(radius * std::sin(angle), y, radius * std::cos(angle)));
                for (std::size_t k = 0; k < count; ++k)
                    sums[k] += 0.5 * luminance * double(basis[k]);
            }
        }
    std::vector<glm::vec3> coefficients;
    for (const glm::dvec3& sum : sums)
        coefficients.emplace_back(sum * (2.0 * turn / (rows * columns)));
    return coefficients;
}

} // namespace lpvbake::bake
