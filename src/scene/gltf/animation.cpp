#include "scene/gltf/animation.h"

#include "quoted.h"
#include "scene/gltf/attributes.h"
#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::scene::gltf {
namespace {

/// A sampler's keys: `parts` runs of `width` values each, three for CUBICSPLINE (in-tangent, value,
/// out-tangent), else one.
struct Curve {
    std::vector<float> times;
    std::vector<float> values;
    size_t width;
    size_t parts;
    bool is_step;

    /// Component `i` of part `part` of key `key`.
    double value(size_t key, size_t part, size_t i) const {
        return values[(key * parts + part) * width + i];
    }
};

/// `width` 0: as many as the keys leave room for.
Curve read_curve(Document& document, const tinygltf::Animation& animation, int sampler_index,
                 size_t width, const std::string& animation_place) {
    if (static_cast<size_t>(sampler_index) >= animation.samplers.size())
        document.fail(animation_place + ".channels",
                      "sampler " + std::to_string(sampler_index) + " is out of range: there are "
                          + std::to_string(animation.samplers.size()));
    const tinygltf::AnimationSampler& sampler = animation.samplers[sampler_index];
    const std::string place = animation_place + "." + at("samplers", sampler_index);
    Curve curve;
    curve.is_step = sampler.interpolation == "STEP";
    const bool is_cubic = sampler.interpolation == "CUBICSPLINE";
    if (!is_cubic && !curve.is_step && sampler.interpolation != "LINEAR"
        && !sampler.interpolation.empty())
        document.fail(place + ".interpolation",
                      in_quotes(sampler.interpolation) + " is not an interpolation");
    for (const int accessor : {sampler.input, sampler.output})
        document.memory.take(document.model.accessors.at(accessor).count, 8 * sizeof(float), place);
    curve.times = read_floats(document, sampler.input, 1, place + ".input");
    for (size_t i = 0; i < curve.times.size(); ++i)
        if (!std::isfinite(curve.times[i]) || (i > 0 && curve.times[i] <= curve.times[i - 1]))
            document.fail(place + ".input", "its times do not increase");
    curve.values = read_floats(document, sampler.output, width == 0 ? 1 : static_cast<int>(width),
                               place + ".output");
    for (const float value : curve.values)
        if (!std::isfinite(value))
            document.fail(place + ".output", "a value is not finite");
    curve.parts = is_cubic ? 3 : 1;
    const size_t runs = curve.times.size() * curve.parts;
    curve.width = width == 0 ? curve.values.size() / runs : width;
    if (curve.width == 0 || curve.width * runs != curve.values.size())
        document.fail(place + ".output", "has not as many values as its input has keys");
    return curve;
}

std::vector<double> interpolate(const Curve& curve, double time, bool is_rotation) {
    const size_t middle = curve.parts / 2;
    const auto key_value = [&](size_t key) {
        std::vector<double> result(curve.width);
        for (size_t i = 0; i < curve.width; ++i)
            result[i] = curve.value(key, middle, i);
        return result;
    };
    const auto after = std::upper_bound(curve.times.begin(), curve.times.end(), time);
    if (after == curve.times.begin())
        return key_value(0);
    const auto key = static_cast<size_t>(after - curve.times.begin()) - 1;
    if (curve.is_step || after == curve.times.end())
        return key_value(key);
    const double interval = double(*after) - double(curve.times[key]);
    const double t = (time - double(curve.times[key])) / interval;
    std::vector<double> result(curve.width);
    if (curve.parts == 1 && is_rotation) {
        const auto quaternion = [&](size_t k) {
            return glm::normalize(glm::dquat(curve.value(k, 0, 3), curve.value(k, 0, 0),
                                             curve.value(k, 0, 1), curve.value(k, 0, 2)));
        };
        const glm::dquat turned = glm::slerp(quaternion(key), quaternion(key + 1), t);
        return {turned.x, turned.y, turned.z, turned.w};
    }
    for (size_t i = 0; i < curve.width; ++i) {
        const double from = curve.value(key, middle, i), to = curve.value(key + 1, middle, i);
        result[i] = from + t * (to - from);
        if (curve.parts == 3) { // Hermite, tangents a second
            const double leaving = interval * curve.value(key, 2, i);
            const double arriving = interval * curve.value(key + 1, 0, i);
            const double t2 = t * t, t3 = t2 * t;
            result[i] = (2 * t3 - 3 * t2 + 1) * from + (t3 - 2 * t2 + t) * leaving
                        + (3 * t2 - 2 * t3) * to + (t3 - t2) * arriving;
        }
    }
    return result;
}

int chosen_animation(const Document& document, const LoadSettings& settings) {
    if (settings.animation.empty() && !settings.time)
        return -1;
    std::vector<std::string> names;
    for (const tinygltf::Animation& animation : document.model.animations)
        names.push_back(animation.name);
    return find_named(names, settings.animation.empty() ? "0" : settings.animation, "`animation`");
}

} // namespace

glm::dquat unit_quaternion(const Document& document, glm::dvec4 xyzw, const std::string& place) {
    const double length = glm::length(xyzw);
    if (!(length > 1e-12) || !std::isfinite(length))
        document.fail(place, "is not a quaternion: its length is 0");
    xyzw /= length;
    return {xyzw.w, xyzw.x, xyzw.y, xyzw.z};
}

Pose read_pose(Document& document, const LoadSettings& settings) {
    const int index = chosen_animation(document, settings);
    if (index < 0)
        return {};
    const tinygltf::Animation& animation = document.model.animations[index];
    const std::string place = at("animations", index);
    const double time = settings.time.value_or(0.0);
    Pose pose;
    size_t left_out = 0;
    for (size_t i = 0; i < animation.channels.size(); ++i) {
        const tinygltf::AnimationChannel& channel = animation.channels[i];
        const std::string& path = channel.target_path;
        const bool is_rotation = path == "rotation", is_weights = path == "weights";
        const bool is_vector = path == "translation" || path == "scale";
        if (channel.target_node < 0 || !(is_rotation || is_weights || is_vector)) {
            ++left_out;
            continue;
        }
        const size_t width = is_weights ? 0 : is_rotation ? 4 : 3;
        const Curve curve = read_curve(document, animation, channel.sampler, width, place);
        const std::vector<double> value = interpolate(curve, time, is_rotation);
        NodePose& node = pose[channel.target_node];
        if (is_weights)
            node.weights = value;
        else if (is_rotation)
            node.rotation = unit_quaternion(document, {value[0], value[1], value[2], value[3]},
                                            place + "." + at("channels", i));
        else
            (path == "scale" ? node.scale : node.translation) =
                glm::dvec3(value[0], value[1], value[2]);
    }
    if (left_out > 0)
        document.warnings.add("channels", place + ".channels",
                              "ignored: " + counted(left_out, "channel")
                                  + " of other things than a node's transform and weights; they "
                                    "stand as the file has them");
    return pose;
}

double duration(const Document& document, int animation) {
    double last = 0.0;
    for (const tinygltf::AnimationSampler& sampler :
         document.model.animations.at(animation).samplers)
        for (const double time : document.model.accessors.at(sampler.input).maxValues)
            last = std::max(last, time);
    return last;
}

} // namespace lpvbake::scene::gltf
