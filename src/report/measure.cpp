#include "report/measure.h"

#include "colour/colour.h"
#include "reference/sampler.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <chrono>
#include <cmath>
#include <limits>

namespace lpvbake::report {
namespace {

double relative(double x, double whole) {
    return whole > 0 ? x / whole : x > 0 ? std::numeric_limits<double>::infinity() : 0;
}

} // namespace

reference::PathRules field_rules(const bake::BakeSettings& settings) {
    return {settings.bounces, settings.emitters};
}

Truth trace_truth(const Scene& scene, const visibility::Visibility& visibility,
                  const scene::Frame& frame, std::span<const glm::vec3> points,
                  std::span<const glm::dvec3> own, const reference::PathRules& rules,
                  const TruthSettings& settings, Progress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const std::size_t normals = own.empty() ? volume::neighbour_normals().size() : 1;
    std::vector<uint64_t> keys(points.size());
    for (std::size_t i = 0; i < keys.size(); ++i)
        keys[i] = i;

    reference::ReferenceSettings reference;
    reference.sh_order = truth_order;
    reference.noise = settings.noise;
    reference.rays = settings.most_rays;
    reference.paths = rules;
    reference.seed = settings.seed;
    reference::ProbeNormals wanted;
    if (own.empty())
        wanted.common = volume::neighbour_normals();
    else
        wanted.own = own;
    reference::ProbeField field = reference::trace_probes(scene, visibility, frame, points, keys,
                                                          reference, progress, wanted);
    Truth truth;
    truth.irradiance.resize(points.size() * normals);
    truth.error.resize(truth.irradiance.size());
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t n = 0; n < normals; ++n) {
            const std::size_t at = i * normals + n;
            truth.irradiance[at] =
                glm::dvec3(own.empty() ? field.irradiance[n][i] : field.own_irradiance[i]);
            truth.error[at] = glm::dvec3(own.empty() ? field.irradiance_error[n][i]
                                                     : field.own_irradiance_error[i]);
        }
    truth.sh = std::move(field.sh);
    truth.noise = field.noise;
    truth.rays = field.rays;
    truth.traced = field.traced;
    truth.converged = field.converged;
    truth.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return truth;
}

std::vector<glm::dvec3> irradiance_of(const std::vector<std::vector<glm::vec3>>& sh, int order,
                                      uint64_t* negative) {
    const auto& normals = volume::neighbour_normals();
    const std::size_t coefficients = std::size_t(volume::sh_count(order));
    const std::size_t points = sh[0].size();
    std::vector<double> weights(coefficients * normals.size());
    std::vector<float> one(coefficients);
    for (std::size_t k = 0; k < coefficients; ++k) {
        one[k] = 1;
        for (std::size_t n = 0; n < normals.size(); ++n)
            weights[k * normals.size() + n] =
                double(volume::sh_irradiance(one, glm::vec3(normals[n])));
        one[k] = 0;
    }
    std::vector<glm::dvec3> irradiance(points * normals.size(), glm::dvec3(0.0));
    for (std::size_t i = 0; i < points; ++i)
        for (std::size_t n = 0; n < normals.size(); ++n) {
            glm::dvec3& e = irradiance[i * normals.size() + n];
            for (std::size_t k = 0; k < coefficients; ++k)
                e += weights[k * normals.size() + n] * glm::dvec3(sh[k][i]);
            for (int c = 0; c < 3; ++c)
                if (e[c] < 0) {
                    e[c] = 0;
                    if (negative)
                        ++*negative;
                }
        }
    return irradiance;
}

FieldError error_of(std::span<const glm::dvec3> estimate, std::span<const glm::dvec3> truth) {
    double distance = 0, squares = 0, whole = 0;
    glm::dvec3 estimated{0.0}, true_{0.0};
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const glm::dvec3 d = estimate[i] - truth[i];
        distance += std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
        squares += glm::dot(d, d);
        whole += truth[i].x + truth[i].y + truth[i].z;
        estimated += estimate[i];
        true_ += truth[i];
    }
    const double count = std::max(1.0, 3.0 * double(truth.size()));
    const double energy = glm::dot(estimated, colour::rec709_luminance);
    const double true_energy = glm::dot(true_, colour::rec709_luminance);
    return {relative(distance, whole), relative(std::sqrt(squares / count), whole / count),
            energy == true_energy ? 1.0 : relative(energy, true_energy), 0};
}

} // namespace lpvbake::report
