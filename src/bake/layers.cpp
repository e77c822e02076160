#include "bake/layers.h"

#include "lpvbake/error.h"
#include "quoted.h"
#include "scene/scene.h"
#include "scene/sky.h"
#include "text.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <array>
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
        name.resize(std::min<std::size_t>(name.size(), 48)); // with what makes it another's
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

void add_suns(const Scene& scene, const LayerWish& wish, Left& left) {
    const std::vector<double> hours = scene::key_hours(wish.arc, wish.suns);
    const std::vector<Light> suns = suns_along(wish.arc, wish.suns);
    for (std::size_t sun = 0; sun < suns.size(); ++sun)
        for (std::size_t i = 0; i < scene.lights.size(); ++i)
            if (left.has_light(i) && scene.lights[i].name == suns[sun].name
                && scene.lights[i].direction == suns[sun].direction) {
                Layer& layer = left.add(suns[sun].name, "sun");
                layer.arc = wish.arc;
                layer.hour = hours[sun];
                left.give_light(i, layer);
            }
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
        if (wish.kind == Kind::suns)
            add_suns(scene, wish, left);
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
        if ((wish.kind == Kind::lights || wish.kind == Kind::emitters)
            && left.layers.size() == before)
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

std::vector<Light> suns_along(const scene::SunArc& arc, int count) {
    std::vector<Light> suns;
    for (const double hour : scene::key_hours(arc, count)) {
        const glm::dvec3 towards = scene::towards_sun(arc, hour);
        Light& sun = suns.emplace_back();
        sun.name = "sun_" + scene::clock_text(hour).erase(2, 1);
        sun.intensity = scene::sun_illuminance(towards.y) / count;
        sun.direction = -towards;
    }
    return suns;
}

namespace {

/// Irradiance in all valid cells on faces along the axes, summed, of a sum of fields.
double irradiance_of(std::span<const Volume* const> fields, std::span<const double> weights,
                     const std::vector<float>& validity) {
    double sum = 0.0;
    std::array<float, volume::sh_count(volume::sh_max_order)> one;
    const auto coefficients = std::span(one).first(fields.front()->sh.size());
    for (std::size_t cell = 0; cell < fields.front()->sh.front().size(); ++cell) {
        if (!validity.empty() && validity[cell] == 0.0f)
            continue;
        for (int channel = 0; channel < 3; ++channel) {
            for (std::size_t k = 0; k < coefficients.size(); ++k) {
                double value = 0.0;
                for (std::size_t i = 0; i < fields.size(); ++i)
                    value += weights[i] * double(fields[i]->sh[k][cell][channel]);
                coefficients[k] = float(value);
            }
            for (int face = 0; face < 6; ++face) {
                glm::vec3 normal(0.0f);
                normal[face / 2] = face % 2 ? -1.0f : 1.0f;
                sum += std::abs(double(volume::sh_irradiance(coefficients, normal)));
            }
        }
    }
    return sum;
}

} // namespace

std::optional<HeldOut> hold_out(const scene::SunArc& arc, std::span<const double> hours,
                                std::span<const Volume* const> fields,
                                const std::vector<float>& validity) {
    HeldOut found;
    double off = 0.0, light = 0.0;
    int count = 0;
    for (std::size_t i = 1; i + 1 < fields.size(); i += 2, ++count) {
        const double around[] = {hours[i - 1], hours[i + 1]}; // each as of a day of two suns
        const std::vector<double> weights = scene::key_weights(arc, around, hours[i]);
        const double error = irradiance_of(
            fields.subspan(i - 1, 3), std::array{weights[0] / 2, -1.0, weights[1] / 2}, validity);
        off += error;
        light += irradiance_of(fields.subspan(i, 1), std::array{1.0}, validity);
        if (error >= found.worst) {
            found.worst = error;
            found.hour = hours[i];
        }
    }
    if (light == 0.0)
        return {};
    found.mean = off / light;
    found.worst *= count / light;
    return found;
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
