#include "scene/sky.h"

#include "colour/colour.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lpvbake::scene {
namespace {

constexpr int largest_width = 1024, largest_height = 512;
/// Bright texels of a block of this size, 5.6 degrees, are one light.
constexpr int blocks_across = 64, blocks_down = 32;
constexpr size_t most_suns = 64;
/// A sun is brighter than so many times the mean of what is not.
constexpr double contrast = 8.0;
constexpr double two_pi = glm::two_pi<double>();

double brightness(glm::dvec3 c) {
    return glm::dot(c, colour::rec709_luminance);
}

/// Height (y) of the upper edge of a row.
double edge_of(int row, int height) {
    return std::cos(glm::pi<double>() * row / height);
}

/// Solid angle of a texel, by row.
std::vector<double> solid_angles_of(const SkyMap& map) {
    std::vector<double> rows;
    for (int row = 0; row < map.height; ++row)
        rows.push_back(two_pi / map.width
                       * (edge_of(row, map.height) - edge_of(row + 1, map.height)));
    return rows;
}

/// Column, not whole, at an azimuth from +Z towards +X.
double column_at(const SkyMap& map, double azimuth) {
    return map.width * (0.75 - (azimuth - map.turn) / two_pi);
}

size_t texel_at(const SkyMap& map, glm::vec3 towards) {
    const double column = column_at(map, std::atan2(double(towards.x), double(towards.z)));
    const double row =
        map.height * std::acos(std::clamp(double(towards.y), -1.0, 1.0)) / glm::pi<double>();
    const double wrapped = column - map.width * std::floor(column / map.width);
    return size_t(std::min(int(row), map.height - 1)) * size_t(map.width)
           + size_t(std::min(int(wrapped), map.width - 1));
}

glm::dvec3 direction_at(const SkyMap& map, double column, double y) {
    const double azimuth = map.turn + two_pi * (0.75 - column / map.width);
    const double radius = std::sqrt(std::max(0.0, 1.0 - y * y));
    return {radius * std::sin(azimuth), y, radius * std::cos(azimuth)};
}

/// Means over the solid angle of a picture's texels.
std::vector<glm::vec3> reduced(int from_width, int from_height, int width, int height,
                               const std::vector<glm::vec3>& texels) {
    std::vector<glm::vec3> result;
    result.reserve(size_t(width) * size_t(height));
    // In units of a texel there over the number of texels here, so that borders are whole numbers.
    for (int row = 0; row < height; ++row) {
        const int64_t top = int64_t(row) * from_height, bottom = top + from_height;
        std::vector<glm::dvec3> sums(size_t(width), glm::dvec3(0.0));
        double weights = 0.0;
        for (int r = int(top / height); int64_t(r) * height < bottom; ++r) {
            const double above = double(std::max(top, int64_t(r) * height));
            const double below = double(std::min(bottom, int64_t(r + 1) * height));
            const double scale = glm::pi<double>() / (double(from_height) * height);
            const double weight = std::cos(scale * above) - std::cos(scale * below);
            weights += weight;
            const glm::vec3* line = &texels[size_t(r) * size_t(from_width)];
            for (int column = 0; column < width; ++column) {
                const int64_t left = int64_t(column) * from_width, right = left + from_width;
                for (int c = int(left / width); int64_t(c) * width < right; ++c) {
                    const int64_t overlap = std::min(right, int64_t(c + 1) * width)
                                            - std::max(left, int64_t(c) * width);
                    sums[size_t(column)] +=
                        weight * double(overlap) / double(from_width) * glm::dvec3(line[c]);
                }
            }
        }
        for (const glm::dvec3& sum : sums)
            result.emplace_back(sum / weights);
    }
    return result;
}

/// Moves what is too bright and small from `rest` to `suns`.
void find_suns(SkyMap& map) {
    map.rest = map.texels;
    if (map.width < blocks_across || map.height < blocks_down)
        return; // its texels are large enough for rays
    const std::vector<double> solid_angles = solid_angles_of(map);
    // The mean of what is not cut off at `contrast` times that mean.
    double mean = HUGE_VAL;
    for (int pass = 0; pass < 16; ++pass) {
        const double limit = contrast * mean;
        mean = 0.0;
        for (size_t i = 0; i < map.texels.size(); ++i)
            mean +=
                std::min(brightness(map.texels[i]), limit) * solid_angles[i / size_t(map.width)];
        mean /= 2.0 * two_pi;
    }

    struct Block {
        glm::dvec3 lux{0.0}, towards{0.0};
        std::vector<uint32_t> texels;
    };
    std::vector<Block> blocks(blocks_across * blocks_down);
    for (size_t i = 0; i < map.texels.size(); ++i) {
        const double all = brightness(map.texels[i]);
        if (!(all > contrast * mean))
            continue;
        const int column = int(i % size_t(map.width)), row = int(i / size_t(map.width));
        Block& block = blocks[size_t(row * blocks_down / map.height * blocks_across
                                     + column * blocks_across / map.width)];
        const glm::dvec3 lux =
            solid_angles[size_t(row)] * (1.0 - mean / all) * glm::dvec3(map.texels[i]);
        const double y = 0.5 * (edge_of(row, map.height) + edge_of(row + 1, map.height));
        block.lux += lux;
        block.towards += brightness(lux) * direction_at(map, column + 0.5, y);
        block.texels.push_back(uint32_t(i));
    }
    std::erase_if(blocks, [](const Block& block) {
        return block.texels.empty() || !(glm::length(block.towards) > 0.0);
    });
    std::ranges::stable_sort(blocks, [](const Block& a, const Block& b) {
        return brightness(a.lux) > brightness(b.lux);
    });
    blocks.resize(std::min(blocks.size(), most_suns));
    for (const Block& block : blocks) {
        Light sun;
        sun.name = "sky";
        sun.color = glm::vec3(block.lux);
        sun.direction = -glm::normalize(block.towards);
        map.suns.push_back(sun);
        for (const uint32_t i : block.texels)
            map.rest[i] *= float(mean / brightness(map.texels[i]));
    }
}

void add_sums(SkyMap& map) {
    const auto pitch = size_t(map.width) + 1;
    const std::vector<double> solid_angles = solid_angles_of(map);
    map.integral.assign(pitch * (size_t(map.height) + 1), glm::dvec3(0.0));
    for (int row = 0; row < map.height; ++row) {
        const double solid_angle = solid_angles[size_t(row)];
        glm::dvec3 line{0.0};
        for (int column = 0; column < map.width; ++column) {
            const auto at = size_t(row) * size_t(map.width) + size_t(column);
            line += solid_angle * glm::dvec3(map.texels[at]);
            const size_t above = size_t(row) * pitch + size_t(column) + 1;
            map.integral[above + pitch] = map.integral[above] + line;
        }
    }
    if (map.integral.back() == glm::dvec3(0.0))
        return;
    double sum = 0.0;
    for (size_t i = 0; i < map.texels.size(); ++i) {
        sum += brightness(map.texels[i]) * solid_angles[i / size_t(map.width)];
        map.cumulative.push_back(sum);
    }
    for (double& share : map.cumulative)
        share /= sum;
}

/// Integral over all that is higher than y and left of `column`, which may lie beyond the picture.
glm::dvec3 integral_at(const SkyMap& map, double column, double y) {
    const double turns = std::floor(column / map.width);
    const double inside = std::clamp(column - turns * map.width, 0.0, double(map.width));
    const int left = std::min(int(inside), map.width - 1);
    const double angle = std::acos(std::clamp(y, -1.0, 1.0));
    const int row = std::min(int(map.height * angle / glm::pi<double>()), map.height - 1);
    const double top = edge_of(row, map.height), bottom = edge_of(row + 1, map.height);
    const double down = std::clamp((top - y) / (top - bottom), 0.0, 1.0);
    const auto pitch = size_t(map.width) + 1;
    const glm::dvec3* above = &map.integral[size_t(row) * pitch];
    const auto at = [&](int c) { return glm::mix(above[c], above[size_t(c) + pitch], down); };
    return glm::mix(at(left), at(left + 1), inside - left) + turns * at(map.width);
}

} // namespace

Sky make_sky(int width, int height, std::vector<glm::vec3> texels, double turn) {
    auto map = std::make_shared<SkyMap>();
    map->width = std::min(width, largest_width);
    map->height = std::min(height, largest_height);
    map->turn = turn;
    map->texels = width == map->width && height == map->height
                      ? std::move(texels)
                      : reduced(width, height, map->width, map->height, texels);
    find_suns(*map);
    add_sums(*map);
    Sky sky;
    sky.map = std::move(map);
    return sky;
}

glm::vec3 sky_luminance(const Sky& sky, glm::vec3 towards) {
    return sky.map ? sky.map->texels[texel_at(*sky.map, towards)] : sky.luminance;
}

glm::vec3 sky_rest(const Sky& sky, glm::vec3 towards) {
    return sky.map ? sky.map->rest[texel_at(*sky.map, towards)] : sky.luminance;
}

std::span<const Light> sky_suns(const Sky& sky) {
    return sky.map ? std::span<const Light>(sky.map->suns) : std::span<const Light>();
}

glm::dvec3 sky_mean(const Sky& sky, double low, double high, double from, double to) {
    if (!sky.map)
        return sky.luminance;
    const SkyMap& map = *sky.map;
    const double left = column_at(map, to), right = column_at(map, from);
    const glm::dvec3 sum = integral_at(map, right, low) - integral_at(map, left, low)
                           - integral_at(map, right, high) + integral_at(map, left, high);
    return glm::max(sum / ((high - low) * (to - from)), 0.0);
}

Sky averaged_sky(const Sky& sky, std::span<const glm::vec3> directions) {
    if (!sky.map)
        return sky;
    auto map = std::make_shared<SkyMap>();
    map->width = 256;
    map->height = 128;
    std::vector<uint32_t> nearest;
    std::vector<glm::dvec3> sums(directions.size(), glm::dvec3(0.0));
    std::vector<double> shares(directions.size(), 0.0);
    glm::dvec3 all{0.0};
    for (int row = 0; row < map->height; ++row) {
        const double high = edge_of(row, map->height), low = edge_of(row + 1, map->height);
        const double solid_angle = two_pi / map->width * (high - low);
        for (int column = 0; column < map->width; ++column) {
            const glm::vec3 towards(direction_at(*map, column + 0.5, 0.5 * (low + high)));
            uint32_t best = 0;
            for (uint32_t d = 1; d < directions.size(); ++d)
                if (glm::dot(directions[d], towards) > glm::dot(directions[best], towards))
                    best = d;
            const double azimuth = two_pi * (0.75 - (column + 1.0) / map->width);
            const glm::dvec3 light =
                solid_angle * sky_mean(sky, low, high, azimuth, azimuth + two_pi / map->width);
            nearest.push_back(best);
            sums[best] += light;
            shares[best] += solid_angle;
            all += light;
        }
    }
    glm::dvec3 seen{0.0};
    for (size_t d = 0; d < directions.size(); ++d) {
        sums[d] = shares[d] > 0.0 ? sums[d] / shares[d] : glm::dvec3(0.0);
        seen += 2.0 * two_pi / double(directions.size()) * sums[d];
    }
    const glm::dvec3 whole = glm::mix(glm::dvec3(0.0), all / glm::max(seen, 1e-300),
                                      glm::greaterThan(seen, glm::dvec3(0.0)));
    for (const uint32_t d : nearest)
        map->texels.emplace_back(whole * sums[d]);
    // A direction lies in the texel around it, which may count to a neighbour.
    for (size_t d = 0; d < directions.size(); ++d)
        map->texels[texel_at(*map, directions[d])] = glm::vec3(whole * sums[d]);
    Sky averaged;
    averaged.map = std::move(map);
    return averaged;
}

Sky turned_sky(const Sky& sky, const glm::dmat3& rotation) {
    if (!sky.map)
        return sky;
    auto map = std::make_shared<SkyMap>(*sky.map);
    for (Light& sun : map->suns)
        sun.direction = rotation * sun.direction;
    if (rotation[1] == glm::dvec3(0, 1, 0)) {
        map->turn += std::atan2(rotation[2].x, rotation[2].z);
    } else {
        constexpr int looks = 3;
        const glm::dmat3 back = glm::transpose(rotation);
        for (size_t i = 0; i < map->texels.size(); ++i) {
            const int column = int(i % size_t(map->width)), row = int(i / size_t(map->width));
            const double high = edge_of(row, map->height), low = edge_of(row + 1, map->height);
            glm::vec3 all(0.0f), rest(0.0f);
            for (int look = 0; look < looks * looks; ++look) {
                const double across = (look % looks + 0.5) / looks,
                             down = (look / looks + 0.5) / looks;
                const glm::vec3 towards(
                    back * direction_at(*map, column + across, glm::mix(high, low, down)));
                all += sky_luminance(sky, towards);
                rest += sky_rest(sky, towards);
            }
            map->texels[i] = all / float(looks * looks);
            map->rest[i] = rest / float(looks * looks);
        }
        map->cumulative.clear();
        add_sums(*map);
    }
    Sky turned;
    turned.map = std::move(map);
    return turned;
}

glm::dvec3 sample_sky(const SkyMap& map, glm::dvec2 u) {
    const auto found = std::ranges::upper_bound(map.cumulative, u.x);
    const auto at = std::min(size_t(found - map.cumulative.begin()), map.cumulative.size() - 1);
    const double before = at > 0 ? map.cumulative[at - 1] : 0.0;
    const double share = map.cumulative[at] - before;
    const double across = share > 0.0 ? std::clamp((u.x - before) / share, 0.0, 1.0) : 0.5;
    const int row = int(at / size_t(map.width));
    return direction_at(map, double(at % size_t(map.width)) + across,
                        glm::mix(edge_of(row, map.height), edge_of(row + 1, map.height), u.y));
}

double sky_density(const SkyMap& map, glm::vec3 towards) {
    if (map.cumulative.empty())
        return 0.0;
    return brightness(map.texels[texel_at(map, towards)]) / brightness(map.integral.back());
}

} // namespace lpvbake::scene
