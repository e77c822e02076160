#include "solver/gather/zone.h"

#include "mix_word.h"
#include "solver/gather/look.rgen.h"
#include "visibility/capture.h"
#include "visibility/caster.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <queue>

namespace lpvbake::solver::gather {
namespace {

constexpr float smallest = 0.25f;     ///< clusters of this share of a patch's size are not opened
constexpr float near_triangle = 1.0f; ///< sizes of a triangle within which it is not a point
constexpr float divided_weight = 8.0f;

float unit(uint32_t bits) {
    return float(bits >> 8) * 0x1p-24f;
}

/// 1 in one channel.
glm::vec3 channel_of(int channel) {
    glm::vec3 unit(0.0f);
    unit[channel] = 1.0f;
    return unit;
}

} // namespace

std::span<const uint32_t> look_program() {
    return shaders::look_rgen;
}

void Sources::clear() {
    points.clear();
    triangles.clear();
    bins.clear();
}

/// The additive sequence of the plastic number's relative in three dimensions, a step a cell, and
/// another one inside it, which is 0 at its centre.
uint32_t pattern_of(glm::vec3 place) {
    const glm::vec3 low = glm::floor(place);
    const glm::ivec3 cell(low), inside(glm::round(1024.0f * (place - low - 0.5f)));
    return 0xd1b54a33u * uint32_t(cell.x) + 0xabc98389u * uint32_t(cell.y)
           + 0x8cb92ba7u * uint32_t(cell.z) + 0x9e3779b1u * uint32_t(inside.x)
           + 0x85ebca6bu * uint32_t(inside.y) + 0xc2b2ae35u * uint32_t(inside.z);
}

Zone::Zone(const Surroundings& world, glm::vec3 lo, glm::vec3 hi, float step) : world_(world) {
    const glm::vec3 half = 0.5f * (hi - lo);
    choose_clusters(lo + half, half, step);
    targets_.reserve(clusters_.size());
    for (const uint32_t index : clusters_) {
        const Cluster& cluster = world_.clusters.nodes[index];
        Targets& targets = targets_.emplace_back();
        for (uint32_t s = 0; s < strata; ++s) {
            const uint32_t key = mix_word(mix_word(index) + s);
            const double share = (double(s) + double(unit(key))) / strata;
            const Emitter& emitter =
                world_.clusters.emitters[world_.clusters.emitter_at(cluster, share)];
            const glm::vec3 point =
                emitter.point({unit(mix_word(key + 1)), unit(mix_word(key + 2))});
            for (int i = 0; i < 3; ++i) {
                targets.point[size_t(i)][s] = point[i];
                targets.normal[size_t(i)][s] = emitter.normal[i];
            }
        }
    }
    channels_ = world.visibility.is_tinted() ? 3 : 1;
    planes_ = channels_ + (world.visibility.is_veiled() ? 1 : 0);
    words_ = (clusters_.size() + world_.sky.size() + 63) / 64;
}

void Zone::choose_clusters(glm::vec3 centre, glm::vec3 half, float step) {
    const std::vector<Cluster>& nodes = world_.clusters.nodes;
    if (nodes.empty())
        return;
    const float radius = 0.5f * zone_edge * step;
    struct Open {
        float weight;
        uint32_t node;
        bool operator<(const Open& other) const {
            return weight != other.weight ? weight < other.weight : node > other.node;
        }
    };
    std::priority_queue<Open> open;
    const auto offer = [&](uint32_t index) {
        const Cluster& cluster = nodes[index];
        if (faces_away(cluster, centre, half + visibility::farthest_capture))
            return;
        const glm::vec3 to = glm::clamp(centre, cluster.lo, cluster.hi) - centre;
        const float square = std::max(glm::dot(to, to), radius * radius);
        float weight = cluster.power / square;
        weight *= 1.0f + 8.0f * (1.0f - glm::length(cluster.normal));
        if (cluster.divided)
            weight *= divided_weight;
        if (cluster.count == 1)
            clusters_.push_back(index);
        else
            open.push({weight, index});
    };
    offer(0);
    while (!open.empty() && clusters_.size() + open.size() < size_t(world_.vpls)) {
        const uint32_t index = open.top().node;
        open.pop();
        offer(index + 1);
        offer(nodes[index].second);
    }
    for (; !open.empty(); open.pop())
        clusters_.push_back(open.top().node);
    std::sort(clusters_.begin(), clusters_.end());
}

/// The ray by which a place looks at a source. False: the cluster has its back to it.
bool Zone::aim(glm::vec3 from, uint32_t source, uint32_t pattern, visibility::Ray& ray,
               float& threshold) const {
    const uint32_t shift = mix_word(source + 1), key = mix_word(pattern ^ shift);
    threshold = unit(key);
    if (source >= clusters_.size()) {
        const SkyBin& bin = world_.sky[source - clusters_.size()];
        ray = {from, bin.direction({unit(pattern + shift), unit(mix_word(key))}), 0.0f, HUGE_VALF};
        return true;
    }
    const Targets& targets = targets_[source];
    // One point speaks for all: the more light one would send here, the more often it is that one.
    // Near parts of a cluster, which send most, are seen more often than the others.
    std::array<float, strata> sent;
    for (uint32_t i = 0; i < strata; ++i) {
        const float x = targets.point[0][i] - from.x, y = targets.point[1][i] - from.y,
                    z = targets.point[2][i] - from.z;
        const float square = std::max(x * x + y * y + z * z, 1e-6f);
        const float facing =
            x * targets.normal[0][i] + y * targets.normal[1][i] + z * targets.normal[2][i];
        sent[i] = std::max(0.0f, -facing) / (square * std::sqrt(square));
    }
    std::array<float, strata> up_to;
    float sum = 0.0f;
    for (uint32_t i = 0; i < strata; ++i)
        up_to[i] = sum += sent[i];
    if (!(sum > 0.0f))
        return false;
    const float wanted = unit(pattern + shift) * sum;
    uint32_t pick = 0; // they rise
    for (uint32_t i = 0; i + 1 < strata; ++i)
        pick += !(up_to[i] > wanted);
    ray = {from, glm::vec3(targets.point[0][pick], targets.point[1][pick], targets.point[2][pick])
                     - from};
    return true;
}

/// Places that look at one cluster: aim() for all of them, a lane each, to the bit.
struct Zone::Lanes {
    static constexpr size_t most = 8;
    std::array<float, most> x{}, y{}, z{}; ///< of the places
    std::array<float, most> share{}; ///< of what all points send, up to the one that is wanted
    std::array<float, most> sum;     ///< what all points send
    std::array<uint32_t, most> pick;
};

void Zone::aim(uint32_t source, Lanes& eight) const {
    const Targets& targets = targets_[source];
    std::array<std::array<float, Lanes::most>, strata> up_to;
    eight.sum.fill(0.0f);
    for (uint32_t i = 0; i < strata; ++i)
        for (size_t k = 0; k < Lanes::most; ++k) {
            const float x = targets.point[0][i] - eight.x[k], y = targets.point[1][i] - eight.y[k],
                        z = targets.point[2][i] - eight.z[k];
            const float square = std::max(x * x + y * y + z * z, 1e-6f);
            const float facing =
                x * targets.normal[0][i] + y * targets.normal[1][i] + z * targets.normal[2][i];
            up_to[i][k] = eight.sum[k] += std::max(0.0f, -facing) / (square * std::sqrt(square));
        }
    std::array<float, Lanes::most> wanted;
    for (size_t k = 0; k < Lanes::most; ++k)
        wanted[k] = eight.share[k] * eight.sum[k];
    eight.pick.fill(0);
    for (uint32_t i = 0; i + 1 < strata; ++i)
        for (size_t k = 0; k < Lanes::most; ++k)
            eight.pick[k] += !(up_to[i][k] > wanted[k]);
}

/// What a place tests.
struct Zone::Tests {
    struct Test {
        uint32_t source;
        float threshold; ///< what has to pass for it to be seen
    };
    std::vector<Test> tests;
    std::vector<visibility::Ray> ways;

    void clear() {
        tests.clear();
        ways.clear();
    }
    void add(uint32_t source, float threshold, const visibility::Ray& way) {
        tests.push_back({source, threshold});
        ways.push_back(way);
    }
};

void Zone::find_tests(std::span<const Look> places, std::span<Tests> tests) const {
    constexpr size_t fewest = 3; // for which lanes pay
    for (uint32_t source = 0; source < sources(); ++source) {
        std::array<size_t, most_looks + 1> own;
        size_t count = 0;
        for (size_t p = 0; p < places.size(); ++p) {
            own[count] = p;
            count += places[p].opens(source);
        }
        if (count < fewest || source >= clusters_.size()) {
            visibility::Ray ray;
            float threshold;
            for (size_t k = 0; k < count; ++k)
                if (const Look& place = places[own[k]];
                    aim(place.from, source, place.pattern, ray, threshold))
                    tests[own[k]].add(source, threshold, ray);
            continue;
        }
        const uint32_t shift = mix_word(source + 1);
        for (size_t first = 0; first < count; first += Lanes::most) {
            const size_t end = std::min(count, first + Lanes::most);
            Lanes eight;
            for (size_t k = first; k < end; ++k) {
                const Look& place = places[own[k]];
                eight.x[k - first] = place.from.x;
                eight.y[k - first] = place.from.y;
                eight.z[k - first] = place.from.z;
                eight.share[k - first] = unit(place.pattern + shift);
            }
            aim(source, eight);
            for (size_t k = first; k < end; ++k) {
                const Look& place = places[own[k]];
                const uint32_t pick = eight.pick[k - first];
                const auto& point = targets_[source].point;
                if (eight.sum[k - first] > 0.0f)
                    tests[own[k]].add(
                        source, unit(mix_word(place.pattern ^ shift)),
                        {place.from,
                         glm::vec3(point[0][pick], point[1][pick], point[2][pick]) - place.from});
            }
        }
    }
}

void Zone::set_seen(const Look& place, const Tests& tests,
                    std::span<const glm::vec3> passed) const {
    for (size_t i = 0; i < tests.tests.size(); ++i) {
        const auto [source, threshold] = tests.tests[i];
        const glm::vec3 passes = passed[i];
        for (size_t channel = 0; channel < channels_; ++channel)
            if (passes[int(channel)] > threshold)
                set(place, channel, source);
        if (planes_ > channels_ && glm::any(glm::greaterThan(passes, glm::vec3(0.0f)))
            && glm::any(glm::lessThan(passes, glm::vec3(1.0f))))
            set(place, channels_, source);
    }
}

size_t Zone::together() const {
    const visibility::Visibility& visibility = world_.visibility;
    if (!visibility.caster() || visibility.air())
        return 0;
    const size_t room = visibility.batch() * sizeof(visibility::Ray) / sizeof(glm::uvec4);
    const size_t shared = head_words + target_words * clusters_.size() + world_.sky.size() + 1;
    if (sources() == 0 || room < shared)
        return 0;
    return std::min(visibility.batch() / sources(), (room - shared) / (1 + sources() / 4 + 1));
}

uint64_t Zone::look(std::span<const Look> places) const {
    thread_local std::vector<Tests> all;
    const size_t at_once = together(), step = at_once > 0 ? at_once : most_looks;
    uint64_t rays = 0;
    for (size_t first = 0; first < places.size(); first += step) {
        const std::span<const Look> some =
            places.subspan(first, std::min(step, places.size() - first));
        if (all.size() < some.size())
            all.resize(some.size());
        const std::span<Tests> tests = std::span(all).first(some.size());
        for (Tests& own : tests)
            own.clear();
        if (at_once > 0)
            rays += look_on_device(some, tests);
        else
            find_tests(some, tests);
        rays += ask(some, tests);
    }
    return rays;
}

uint64_t Zone::ask(std::span<const Look> places, std::span<const Tests> tests) const {
    thread_local std::vector<glm::vec3> passed;
    uint64_t rays = 0;
    for (size_t p = 0; p < places.size(); ++p) {
        passed.resize(tests[p].ways.size());
        world_.visibility.filter_of_eights(tests[p].ways, visibility::Bundle::loose, passed);
        set_seen(places[p], tests[p], passed);
        rays += passed.size();
    }
    return rays;
}

std::vector<glm::uvec4> Zone::given_to_look(std::span<const Look> places,
                                            std::span<const uint32_t> asked) const {
    const visibility::Visibility& visibility = world_.visibility;
    const auto word = [](glm::vec4 of) { return std::bit_cast<glm::uvec4>(of); };
    std::vector<glm::uvec4> given;
    given.push_back({clusters_.size(), sources(), places.size(), 0});
    given.push_back(word({visibility.to_structure(glm::vec3(0.0f)), visibility.scale()}));
    for (const Look& place : places) {
        given.push_back(word({place.from, 0.0f}));
        given.back().w = place.pattern;
    }
    const auto append = [&](std::span<const std::byte> bytes) {
        const size_t first = given.size();
        given.resize(first + (bytes.size() + sizeof(glm::uvec4) - 1) / sizeof(glm::uvec4));
        std::ranges::copy(bytes, reinterpret_cast<std::byte*>(given.data() + first));
    };
    static_assert(sizeof(Targets) == target_words * sizeof(glm::uvec4));
    append(std::as_bytes(std::span(targets_)));
    for (const SkyBin& bin : world_.sky)
        given.push_back(word({bin.low, bin.high, bin.from, bin.to}));
    append(std::as_bytes(asked));
    return given;
}

/// Leaves those tests of which the device is not sure.
uint64_t Zone::look_on_device(std::span<const Look> places, std::span<Tests> tests) const {
    thread_local std::vector<uint32_t> asked, answers;
    asked.clear();
    for (uint32_t source = 0; source < sources(); ++source)
        for (size_t p = 0; p < places.size(); ++p)
            if (places[p].opens(source))
                asked.push_back(uint32_t(p) * sources() + source);
    answers.resize(asked.size());
    if (asked.empty())
        return 0;
    const std::vector<glm::uvec4> given = given_to_look(places, asked);
    world_.visibility.caster()->look(std::as_bytes(std::span(given)), answers);
    uint64_t rays = 0;
    for (size_t i = 0; i < asked.size(); ++i) {
        const uint32_t place = asked[i] / sources(), source = asked[i] % sources();
        const Look& look = places[place];
        rays += answers[i] == answer_seen || answers[i] == answer_hidden;
        for (size_t channel = 0; answers[i] == answer_seen && channel < channels_; ++channel)
            set(look, channel, source);
        visibility::Ray ray;
        float threshold;
        if (answers[i] == answer_unsure && aim(look.from, source, look.pattern, ray, threshold))
            tests[place].add(source, threshold, ray);
    }
    return rays;
}

Zone::Masks Zone::masks_of(std::span<const uint64_t* const> sees, size_t source) const {
    std::array<uint32_t, 3> seen{};
    for (size_t i = 0; i < sees.size(); ++i)
        for (size_t channel = 0; channel < channels_; ++channel)
            seen[channel] |= uint32_t(sees[i][channel * words_ + source / 64] >> (source % 64) & 1)
                             << i;
    if (channels_ == 1)
        return {seen[0]};
    const uint32_t all = seen[0] & seen[1] & seen[2];
    return {all, {seen[0] & ~all, seen[1] & ~all, seen[2] & ~all}};
}

template <class Take>
void Zone::each_seen(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                     const Take& take) const {
    glm::vec3 lo = points[0], hi = points[0];
    for (const glm::vec3 point : points) {
        lo = glm::min(lo, point);
        hi = glm::max(hi, point);
    }
    const glm::vec3 half = 0.5f * (hi - lo), centre = lo + half;
    for (size_t i = 0; i < clusters_.size(); ++i) {
        const Masks masks = masks_of(sees, i);
        if (masks.all)
            descend(clusters_[i], masks.all, glm::vec3(1.0f), centre, half, take);
        for (int channel = 0; channel < 3; ++channel)
            if (const uint32_t mask = masks.one[size_t(channel)])
                descend(clusters_[i], mask, channel_of(channel), centre, half, take);
    }
}

template <class Take>
void Zone::descend(uint32_t cluster, uint32_t mask, glm::vec3 channels, glm::vec3 centre,
                   glm::vec3 half, const Take& take) const {
    const std::vector<Cluster>& nodes = world_.clusters.nodes;
    // Surfaces may be lit more finely than this frame's cells need.
    const float closed = smallest / world_.visibility.scale();
    uint32_t stack[512]; // deeper than a tree whose halves hold a sixteenth at least
    size_t depth = 0;
    stack[depth++] = cluster;
    while (depth > 0) {
        const uint32_t index = stack[--depth];
        const Cluster& c = nodes[index];
        if (faces_away(c, centre, half))
            continue;
        const glm::vec3 apart = glm::max(glm::abs(c.position - centre) - half, glm::vec3(0.0f));
        const float square = glm::dot(apart, apart);
        const float wanted = c.size * (c.count == 1 ? near_triangle : world_.kappa);
        if (square >= wanted * wanted || c.size <= closed) {
            take(index, true, mask, channels);
        } else if (c.count == 1) {
            take(index, false, mask, channels);
        } else {
            stack[depth++] = c.second;
            stack[depth++] = index + 1;
        }
    }
}

void Zone::gather_surfaces(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                           Sources& sources) const {
    each_seen(sees, points, [&](uint32_t index, bool point, uint32_t mask, glm::vec3 channels) {
        const Cluster& c = world_.clusters.nodes[index];
        if (point) {
            const float guard = 0.25f * c.size * c.size;
            sources.points.push_back(glm::vec4(c.position, mask));
            sources.points.push_back(glm::vec4(c.normal, guard));
            sources.points.push_back(glm::vec4(channels * c.intensity, 0.5f * c.spread));
        } else {
            const Emitter& e = world_.clusters.emitters[c.first];
            sources.triangles.push_back(glm::vec4(e.a, 0));
            sources.triangles.push_back(glm::vec4(e.b, 0));
            sources.triangles.push_back(glm::vec4(e.c, 0));
            sources.triangles.push_back(glm::vec4(channels * e.luminance, mask));
        }
    });
}

void Zone::gather_layers(std::span<const uint64_t* const> sees, std::span<const glm::vec3> points,
                         size_t first, Sources& sources) const {
    const Clusters& clusters = world_.clusters;
    const size_t count = std::min<size_t>(pass_layers, clusters.layer_count - first);
    each_seen(sees, points, [&](uint32_t index, bool point, uint32_t mask, glm::vec3 channels) {
        const Cluster& c = clusters.nodes[index];
        std::vector<glm::vec4>& list = point ? sources.points : sources.triangles;
        if (point) {
            list.push_back(glm::vec4(c.position, mask));
            list.push_back(glm::vec4(c.normal, 0.25f * c.size * c.size));
            list.push_back(glm::vec4(0.5f * c.spread, 0, 0, 0));
        } else {
            const Emitter& e = clusters.emitters[c.first];
            list.push_back(glm::vec4(e.a, mask));
            list.push_back(glm::vec4(e.b, 0));
            list.push_back(glm::vec4(e.c, 0));
            channels /= 0.5f * glm::length(glm::cross(e.b - e.a, e.c - e.a));
        }
        std::array<glm::vec3, pass_layers> light{};
        const glm::vec3* of = clusters.layers.data() + clusters.layer_count * index + first;
        for (size_t layer = 0; layer < count; ++layer)
            light[layer] = channels * of[layer];
        list.resize(list.size() + pass_words);
        std::memcpy(list.data() + list.size() - pass_words, light.data(), sizeof light);
    });
}

void Zone::gather_sky(std::span<const uint64_t* const> sees, int order, Sources& sources,
                      std::optional<size_t> layer) const {
    const auto coefficients = [&](size_t bin) -> const std::vector<float>& {
        return layer ? world_.sky[bin].layers[*layer] : world_.sky[bin].coefficients;
    };
    std::vector<float> sum, part;
    const auto add_bin = [&](const std::vector<float>& c, uint32_t mask) {
        const size_t first = sources.bins.size();
        sources.bins.resize(first + bin_words(order), glm::vec4(0.0f));
        std::memcpy(&sources.bins[first], c.data(), c.size() * sizeof(float));
        sources.bins.back().w = float(mask);
    };
    const auto add = [&](const std::vector<float>& c, const Masks& masks) {
        if (masks.all)
            add_bin(c, masks.all);
        for (size_t channel = 0; channel < 3; ++channel)
            if (masks.one[channel]) {
                part.assign(c.size(), 0.0f);
                for (size_t t = channel; t < c.size(); t += 3)
                    part[t] = c[t];
                add_bin(part, masks.one[channel]);
            }
    };
    for (size_t i = 0; i < world_.sky.size(); i += sky_group) {
        std::array<Masks, sky_group> masks;
        for (size_t k = 0; k < sky_group; ++k)
            masks[k] = masks_of(sees, clusters_.size() + i + k);
        if (std::all_of(masks.begin(), masks.end(),
                        [&](const Masks& mask) { return mask == masks[0]; })) {
            if (masks[0] == Masks{})
                continue;
            sum.assign(coefficients(i).size(), 0.0f);
            for (size_t k = 0; k < sky_group; ++k)
                for (size_t t = 0; t < sum.size(); ++t)
                    sum[t] += coefficients(i + k)[t];
            add(sum, masks[0]);
        } else {
            for (size_t k = 0; k < sky_group; ++k)
                add(coefficients(i + k), masks[k]);
        }
    }
}

} // namespace lpvbake::solver::gather
