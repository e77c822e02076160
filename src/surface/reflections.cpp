#include "surface/reflections.h"

#include "surface/emitter_sampling.h"
#include "surface/layered_elements.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

constexpr int longest_sum = 20'000; ///< reflections, where their number is not bounded

/// How fast the orders of a series fall off.
class Orders {
public:
    /// Power of one more; none may be 0.
    void add(double power) {
        last_.insert(last_.begin(), power);
        last_.resize(std::min<size_t>(last_.size(), several + 1));
    }
    /// Of an order to the one before it: of the last two, or on the mean of several if that is
    /// more.
    double ratio() const {
        if (last_.size() < 2)
            return 1.0;
        const double orders = double(last_.size() - 1);
        return std::min(
            1.0, std::max(last_[0] / last_[1], std::pow(last_[0] / last_.back(), 1.0 / orders)));
    }

private:
    static constexpr size_t several = 16;
    std::vector<double> last_; ///< the latest first
};

/// What elements send before light goes from one to another.
struct Sent {
    std::vector<glm::vec3> albedo; ///< mean of the covered part
    std::vector<glm::vec3> direct; ///< luminance without light of other elements
    std::vector<double> area;      ///< covered

    explicit Sent(size_t elements) : albedo(elements), direct(elements), area(elements) {}
};

/// Adds what the rays have found to the luminance of sides.
Sent send(const std::vector<glm::vec3>& lux, const Elements& elements, LitSurfaces& lit) {
    Sent sent(elements.size());
    tbb::parallel_for(size_t(0), elements.size(), [&](size_t i) {
        glm::dvec3 albedo{0.0}, sum{0.0};
        double area = 0.0;
        for (const uint32_t side : elements.members_of(i)) {
            const Patch& patch = lit.patches[side / 2];
            lit.luminance[side] += patch.albedo / glm::pi<float>() * lux[i];
            const double weight = covered_area(patch);
            albedo += weight * glm::dvec3(patch.albedo);
            sum += weight * glm::dvec3(lit.luminance[side]);
            area += weight;
        }
        if (area > 0.0) {
            sent.albedo[i] = glm::vec3(albedo / area);
            sent.direct[i] = glm::vec3(sum / area);
        }
        sent.area[i] = area;
    });
    return sent;
}

/// Sum of what leaves the sides that an element's rays meet, by the tints that they passed, if any.
/// The hits become elements, or the place after all of them where nothing is reflected.
glm::dvec3 sum_of_sides(const std::vector<glm::vec3>& spots, const LitSurfaces& lit,
                        const Elements& elements, std::span<uint32_t> hits,
                        std::span<const glm::vec3> tints) {
    glm::dvec3 sum{0.0};
    for (size_t ray = 0; ray < hits.size(); ++ray) {
        uint32_t& hit = hits[ray];
        if (hit == ElementRays::black) {
            hit = uint32_t(elements.size());
            continue;
        }
        glm::vec3 sent = lit.luminance[hit];
        if (!spots.empty())
            sent -= spots[hit];
        sum += glm::dvec3(tints.empty() ? sent : tints[ray] * sent);
        hit = elements.of_side[hit];
    }
    return sum;
}

/// The same of elements; that after the last one is black, so that no branch is guessed, and four
/// numbers of each are one load.
glm::dvec3 sum_of_elements(const std::vector<glm::vec4>& sent, std::span<const uint32_t> hits,
                           std::span<const glm::vec3> tints) {
    glm::dvec4 sum{0.0};
    if (tints.empty())
        for (const uint32_t hit : hits)
            sum += glm::dvec4(sent[hit]);
    else
        for (size_t ray = 0; ray < hits.size(); ++ray)
            sum += glm::dvec4(glm::vec4(tints[ray], 0.0f) * sent[hits[ray]]);
    return glm::dvec3(sum);
}

/// R = D + rho K R by its series, D + rho K D + ...: each order is added to the others, not taken
/// as a difference of sums, so that it falls off to any number of digits. No row of K sums to more
/// than 1: where the largest albedo is below 1 the series ends. D leaves its own side of a patch,
/// LitSurfaces::luminance; what follows, all of an element, which the hits become. Returns K R.
std::vector<glm::vec3> reflect_between(const Sent& of, ElementRays& found, const Elements& elements,
                                       const std::vector<glm::vec3>& spots,
                                       const Reflections& reflections, LayeredElements* layered,
                                       LitSurfaces& lit, Progress& progress) {
    const size_t count = elements.size(), rays = found.hits.size() / std::max<size_t>(count, 1);
    std::vector<glm::dvec3> met(count, glm::dvec3(0.0));
    std::vector<glm::vec4> order, next(count + 1, glm::vec4(0.0f)); // the last: of what is black
    const auto power_of = [&](size_t i, glm::dvec3 luminance) {
        return of.area[i] * std::max({luminance.x, luminance.y, luminance.z});
    };
    // What an element sends of an order, and which share that is of all that it sends, if any.
    struct Power {
        double sent = 0.0, share = 0.0;
        bool any = false;
    };
    std::vector<Power> powers(count);
    // Who has the largest albedo, and sends most of those that have it.
    const auto keeps = [&](size_t i) { return greatest(of.albedo[i]) >= 1.0f; };
    bool ends = true;
    for (size_t i = 0; i < count; ++i)
        ends = ends && !keeps(i);
    Orders orders;
    const int most = reflections.most.value_or(longest_sum);
    if (layered)
        layered->begin_orders();
    progress.begin("bounces", 0);
    while (lit.bounces < most) {
        progress.advance(0);
        const bool first = order.empty();
        tbb::parallel_for(size_t(0), count, [&](size_t i) {
            const std::span<uint32_t> hits = std::span(found.hits).subspan(i * rays, rays);
            const std::span<const glm::vec3> tints =
                found.tints.empty() ? std::span<const glm::vec3>{}
                                    : std::span(found.tints).subspan(i * rays, rays);
            if (layered)
                layered->reflect(i, of.albedo[i], hits,
                                 first ? ElementRays::black : uint32_t(count), tints);
            glm::dvec3 sum = (first ? sum_of_sides(spots, lit, elements, hits, tints)
                                    : sum_of_elements(order, hits, tints))
                             / double(rays);
            if (first)
                sum += glm::dvec3(found.spots[i]);
            next[i] = glm::vec4(glm::dvec3(of.albedo[i]) * sum, 0.0f);
            met[i] += sum;
        });
        // By themselves, or what is summed above would wait for it.
        tbb::parallel_for(size_t(0), count, [&](size_t i) {
            const double all =
                power_of(i, glm::dvec3(of.direct[i]) + glm::dvec3(of.albedo[i]) * met[i]);
            const double sent = power_of(i, glm::dvec3(next[i]));
            powers[i] = all > 0.0 ? Power{sent, sent / all, true} : Power{};
        });
        std::swap(order, next);
        next.resize(count + 1, glm::vec4(0.0f));
        if (layered)
            layered->next_order();
        ++lit.bounces;
        double last = 0.0, shares = 0.0;
        size_t light = 0;                   // elements that have any
        for (const Power& power : powers) { // in their order, for any number of threads
            last += power.sent;
            shares += power.share;
            light += power.any;
        }
        if (!(last > 0.0)) {
            lit.residual = 0.0;
            break;
        }
        orders.add(last);
        const double ratio = orders.ratio();
        if (!reflections.most && !ends && lit.bounces > 100 && ratio > 0.9999) {
            size_t worst = 0;
            for (size_t i = 0; i < count; ++i)
                if (!keeps(worst)
                    || (keeps(i)
                        && power_of(i, glm::dvec3(order[i]))
                               > power_of(worst, glm::dvec3(order[worst]))))
                    worst = i;
            throw reflections.endless(lit.patches[elements.members[elements.first[worst]] / 2]);
        }
        lit.residual = ratio < 1.0 ? ratio / (1.0 - ratio) * shares / double(light) : 1.0;
        if (!reflections.most && lit.residual <= double(reflections.tolerance))
            break;
    }
    if (reflections.most)
        lit.residual = 0.0;
    return {met.begin(), met.end()};
}

} // namespace

std::vector<glm::vec3> emission_of(const std::vector<Patch>& patches) {
    std::vector<glm::vec3> of_sides(2 * patches.size(), glm::vec3(0.0f));
    for (size_t i = 0; i < patches.size(); ++i) {
        of_sides[2 * i] = patches[i].sent();
        if (patches[i].double_sided)
            of_sides[2 * i + 1] = of_sides[2 * i];
    }
    return of_sides;
}

void add_emission(const std::vector<glm::vec3>& emission, LitSurfaces& lit) {
    for (size_t side = 0; side < emission.size(); ++side)
        lit.luminance[side] += emission[side];
}

void reflect_found(ElementRays rays, const Elements& elements, const std::vector<glm::vec3>& spots,
                   const Reflections& reflections, LayeredElements* layered, LitSurfaces& lit,
                   Progress& progress) {
    const Sent sent = send(rays.lux, elements, lit);
    if (reflections.most == 1)
        return;
    const std::vector<glm::vec3> met =
        reflect_between(sent, rays, elements, spots, reflections, layered, lit, progress);
    tbb::parallel_for(size_t(0), elements.size(), [&](size_t i) {
        for (const uint32_t side : elements.members_of(i))
            lit.luminance[side] += lit.patches[side / 2].albedo * met[i];
    });
    if (layered)
        layered->add_reflected();
}

} // namespace lpvbake::surface
