#include "render/flip.h"

#include "colour/colour.h"

#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace lpvbake::render {
namespace {

constexpr double pixels_a_degree = 67;

struct Plane {
    int width, height;
    std::vector<glm::dvec3> values;

    /// The rim goes on beyond itself.
    glm::dvec3 at(int x, int y) const {
        x = std::clamp(x, 0, width - 1);
        y = std::clamp(y, 0, height - 1);
        return values[std::size_t(y) * std::size_t(width) + std::size_t(x)];
    }
};

using Colour = std::function<glm::dvec3(glm::dvec3)>;

Plane converted(const Plane& plane, const Colour& colour) {
    Plane result = plane;
    for (glm::dvec3& value : result.values)
        value = colour(value);
    return result;
}

Plane linear(const image::Pixels& pixels) {
    Plane plane{pixels.width, pixels.height, {}};
    for (std::size_t i = 0; i < pixels.samples.size(); i += 3)
        plane.values.emplace_back(colour::srgb_to_linear(double(pixels.samples[i])),
                                  colour::srgb_to_linear(double(pixels.samples[i + 1])),
                                  colour::srgb_to_linear(double(pixels.samples[i + 2])));
    return plane;
}

// ---------------------------------------------------------------- colour spaces

/// Linear sRGB to XYZ over that of white, D65; columns.
const glm::dmat3 to_xyz = [] {
    glm::dmat3 m(0.4123907993, 0.2126390059, 0.0193308187, 0.3575843394, 0.7151686788, 0.1191947798,
                 0.1804807884, 0.0721923154, 0.9505321522);
    const glm::dvec3 white = m * glm::dvec3(1);
    for (int column = 0; column < 3; ++column)
        m[column] /= white;
    return m;
}();
const glm::dmat3 from_xyz = glm::inverse(to_xyz);

/// CIELAB without its cube root: Y, Cx, Cz.
glm::dvec3 to_opponents(glm::dvec3 rgb) {
    const glm::dvec3 xyz = to_xyz * rgb;
    return {116 * xyz.y - 16, 500 * (xyz.x - xyz.y), 200 * (xyz.y - xyz.z)};
}

glm::dvec3 from_opponents(glm::dvec3 c) {
    const double y = (c.x + 16) / 116;
    return from_xyz * glm::dvec3(y + c.y / 500, y, y - c.z / 200);
}

/// CIELAB, its chroma scaled by lightness: dark colours look less colourful (Hunt).
glm::dvec3 to_hunt_lab(glm::dvec3 rgb) {
    glm::dvec3 f = to_xyz * glm::clamp(rgb, 0.0, 1.0);
    for (int i = 0; i < 3; ++i) {
        constexpr double knee = 6.0 / 29;
        f[i] = f[i] > knee * knee * knee ? std::cbrt(f[i]) : f[i] / (3 * knee * knee) + 4.0 / 29;
    }
    const double lightness = 116 * f.y - 16;
    return {lightness, 0.01 * lightness * 500 * (f.x - f.y), 0.01 * lightness * 200 * (f.y - f.z)};
}

/// Distance for large differences (Abasi et al. 2020), and its power.
double colour_distance(glm::dvec3 a, glm::dvec3 b) {
    const glm::dvec3 off = glm::abs(a - b);
    return std::pow(off.x + std::sqrt(off.y * off.y + off.z * off.z), 0.7);
}

// ---------------------------------------------------------------- filters

/// Weights of the 2 r + 1 pixels around one along a row or a column, three filters at a time.
using Kernel = std::vector<glm::dvec3>;

/// Those above 0 sum to 1, those below to -1.
Kernel make_kernel(int radius, const std::function<glm::dvec3(double)>& weight) {
    Kernel kernel;
    glm::dvec3 above(0), below(0);
    for (int t = -radius; t <= radius; ++t) {
        kernel.push_back(weight(t));
        above += glm::max(kernel.back(), 0.0);
        below -= glm::min(kernel.back(), 0.0);
    }
    for (glm::dvec3& w : kernel)
        for (int i = 0; i < 3; ++i)
            w[i] /= w[i] > 0 ? above[i] : below[i] > 0 ? below[i] : 1;
    return kernel;
}

Plane filtered_along(const Plane& plane, glm::ivec2 step, const Kernel& kernel) {
    const int radius = int(kernel.size()) / 2;
    Plane result = plane;
    tbb::parallel_for(0, plane.height, [&](int y) {
        for (int x = 0; x < plane.width; ++x) {
            glm::dvec3 sum(0);
            for (int t = -radius; t <= radius; ++t)
                sum += kernel[std::size_t(t + radius)] * plane.at(x + t * step.x, y + t * step.y);
            result.values[std::size_t(y) * std::size_t(plane.width) + std::size_t(x)] = sum;
        }
    });
    return result;
}

Plane filtered(const Plane& plane, const Kernel& across, const Kernel& down) {
    return filtered_along(filtered_along(plane, {1, 0}, across), {0, 1}, down);
}

/// What the eye resolves of the opponents: Y and Cx by a Gaussian each, Cz by the sum of two; in
/// each a sqrt(pi / b) exp(-pi^2 d^2 / b), d in degrees.
Plane as_resolved(const Plane& opponents) {
    constexpr double pi = glm::pi<double>(), widest = 0.04;
    const int radius = int(std::ceil(3 * std::sqrt(widest / (2 * pi * pi)) * pixels_a_degree));
    const auto kernel = [&](glm::dvec3 b) {
        return make_kernel(radius, [b](double t) {
            const double degrees = t / pixels_a_degree;
            return glm::exp(-pi * pi * degrees * degrees / b);
        });
    };
    const Kernel first = kernel({0.0047, 0.0053, widest}), second = kernel(glm::dvec3(0.025));
    // Of the two, each summed over the square.
    const auto mass = [&](double a, double b) {
        double sum = 0;
        for (int t = -radius; t <= radius; ++t)
            sum += std::exp(-pi * pi * t * t / (b * pixels_a_degree * pixels_a_degree));
        return a * std::sqrt(pi / b) * sum * sum;
    };
    const double one = mass(34.1, widest), other = mass(13.5, 0.025);
    Plane result = filtered(opponents, first, first);
    const Plane more = filtered(opponents, second, second);
    for (std::size_t i = 0; i < result.values.size(); ++i)
        result.values[i].z = (one * result.values[i].z + other * more.values[i].z) / (one + other);
    return result;
}

/// Strength of edges and of points in the brightness (x of the result, y).
std::vector<glm::dvec2> features(const Plane& opponents) {
    const double deviation = 0.5 * 0.082 * pixels_a_degree;
    const int radius = int(std::ceil(3 * deviation));
    const Plane grey =
        converted(opponents, [](glm::dvec3 c) { return glm::dvec3((c.x + 16) / 116); });
    const auto gauss = [=](double t) { return std::exp(-t * t / (2 * deviation * deviation)); };
    const Kernel slope = make_kernel(radius, [=](double t) {
        return gauss(t) * glm::dvec3(-t, t * t / (deviation * deviation) - 1, 0);
    });
    const Kernel smooth = make_kernel(radius, [=](double t) { return glm::dvec3(gauss(t)); });
    const Plane across = filtered(grey, slope, smooth), down = filtered(grey, smooth, slope);
    std::vector<glm::dvec2> strength;
    for (std::size_t i = 0; i < across.values.size(); ++i)
        strength.emplace_back(std::hypot(across.values[i].x, down.values[i].x),
                              std::hypot(across.values[i].y, down.values[i].y));
    return strength;
}

/// Up to 0.4 of the largest distance spreads over 0 to 0.95, the rest over what is left.
double spread(double distance, double largest) {
    const double knee = 0.4 * largest;
    return distance < knee ? 0.95 * distance / knee
                           : 0.95 + 0.05 * (distance - knee) / (largest - knee);
}

} // namespace

double flip(const image::Pixels& a, const image::Pixels& b) {
    std::vector<glm::dvec3> seen[2];
    std::vector<glm::dvec2> structure[2];
    for (int i = 0; i < 2; ++i) {
        const Plane opponents = converted(linear(i == 0 ? a : b), to_opponents);
        structure[i] = features(opponents);
        seen[i] = converted(as_resolved(opponents), [](glm::dvec3 c) {
                      return to_hunt_lab(from_opponents(c));
                  }).values;
    }
    const double largest = colour_distance(to_hunt_lab({0, 1, 0}), to_hunt_lab({0, 0, 1}));
    double sum = 0;
    for (std::size_t i = 0; i < seen[0].size(); ++i) {
        const double colour = spread(colour_distance(seen[0][i], seen[1][i]), largest);
        const glm::dvec2 off = glm::abs(structure[0][i] - structure[1][i]);
        const double feature = std::sqrt(std::max(off.x, off.y) / std::sqrt(2.0));
        sum += std::pow(colour, 1 - feature);
    }
    return seen[0].empty() ? 0 : sum / double(seen[0].size());
}

} // namespace lpvbake::render
