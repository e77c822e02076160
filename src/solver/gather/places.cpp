#include "solver/gather/places.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <tuple>
#include <utility>

namespace lpvbake::solver::gather {
namespace {

constexpr size_t most_zones = 256; ///< at a time: of places that lie apart each takes one

glm::vec3 zone_of(glm::vec3 place) {
    return glm::floor(place / float(zone_edge));
}

/// Places by zone, and in it by Morton's order; those of the same place beside each other.
struct Sorted {
    uint64_t zone;
    uint32_t morton, place;
};

std::vector<Sorted> sort(std::span<const glm::vec3> places) {
    std::vector<Sorted> order(places.size());
    tbb::parallel_for(size_t(0), places.size(), [&](size_t i) {
        const glm::vec3 zone = zone_of(places[i]);
        const glm::uvec3 at(glm::ivec3(zone) + (1 << 20));
        order[i] = {uint64_t(at.z) << 42 | uint64_t(at.y) << 21 | at.x,
                    morton(places[i] - float(zone_edge) * zone), uint32_t(i)};
    });
    tbb::parallel_sort(order.begin(), order.end(), [&](const Sorted& a, const Sorted& b) {
        const auto key = [&](const Sorted& each) {
            const glm::vec3 at = places[each.place];
            return std::tuple(each.zone, each.morton, at.z, at.y, at.x, each.place);
        };
        return key(a) < key(b);
    });
    return order;
}

/// A place, and one that is the same.
struct Same {
    uint32_t place, first;
};

/// Leaves the first of those that are the same, and returns the others.
std::vector<Same> take_same(std::vector<Sorted>& order, std::span<const glm::vec3> places) {
    std::vector<Same> same;
    size_t kept = 0;
    for (const Sorted& each : order)
        if (kept > 0 && places[order[kept - 1].place] == places[each.place])
            same.push_back({each.place, order[kept - 1].place});
        else
            order[kept++] = each;
    order.resize(kept);
    return same;
}

/// Places of one zone that are solved together.
struct Part {
    std::span<const Sorted> places;
    glm::vec3 lo, hi; ///< the box of all in the zone, of which this may be some
};

/// What a packet's places see.
using Bits = std::vector<uint64_t>;

class Solving {
public:
    Solving(std::span<const glm::vec3> places, const Surroundings& world, PacketSolver& solver,
            Volume& volume, std::span<Volume> layers, GatherReport& report, Laps& laps)
        : places_(places),
          world_(world),
          solver_(solver),
          volume_(volume),
          layers_(layers),
          report_(report),
          laps_(laps) {}

    void run(Progress& progress) {
        std::vector<Sorted> order = sort(places_);
        const std::vector<Same> same = take_same(order, places_);
        progress.begin("gather", order.size());
        std::span<const Sorted> left(order);
        while (!left.empty()) {
            const std::vector<Part> parts = next_parts(left);
            solve(parts, [&] { progress.advance(order.size() - left.size()); });
        }
        copy(same, volume_);
        for (Volume& layer : layers_)
            copy(same, layer);
    }

private:
    static void copy(const std::vector<Same>& same, Volume& volume) {
        for (const auto [place, first] : same)
            for (std::vector<glm::vec3>& coefficient : volume.sh)
                coefficient[place] = coefficient[first];
    }

    /// Takes zones from those that are left: as many as one chunk of packets may have, whole; or a
    /// part of one that has more.
    std::vector<Part> next_parts(std::span<const Sorted>& left) {
        std::vector<Part> parts;
        size_t room = chunk * lanes;
        while (!left.empty() && parts.size() < most_zones) {
            if (zone_left_ == 0)
                begin_zone(left);
            if (zone_left_ > room && !parts.empty())
                break;
            const size_t count = std::min(zone_left_, room);
            parts.push_back({left.first(count), lo_, hi_});
            left = left.subspan(count);
            zone_left_ -= count;
            room -= count;
        }
        return parts;
    }

    void begin_zone(std::span<const Sorted> left) {
        const auto end = std::ranges::find_if(
            left, [&](const Sorted& each) { return each.zone != left.front().zone; });
        zone_left_ = size_t(end - left.begin());
        lo_ = hi_ = places_[left.front().place];
        for (const Sorted& each : left.first(zone_left_)) {
            lo_ = glm::min(lo_, places_[each.place]);
            hi_ = glm::max(hi_, places_[each.place]);
        }
    }

    void solve(const std::vector<Part>& parts, const std::function<void()>& advance) {
        std::vector<std::unique_ptr<Zone>> zones(parts.size());
        tbb::parallel_for(size_t(0), parts.size(), [&](size_t i) {
            zones[i] = std::make_unique<Zone>(world_, parts[i].lo, parts[i].hi);
        });
        std::vector<Packet> packets;
        std::vector<std::pair<size_t, size_t>> together; // packets of a zone that look at once
        for (size_t i = 0; i < parts.size(); ++i) {
            size_t first = packets.size();
            pack(parts[i], *zones[i], packets);
            const size_t step = std::max<size_t>(zones[i]->together() / lanes, 1);
            for (; first < packets.size(); first += step)
                together.push_back({first, std::min(step, packets.size() - first)});
        }
        std::vector<Bits> bits(packets.size());
        std::atomic<uint64_t> rays = 0;
        tbb::parallel_for(size_t(0), together.size(), [&](size_t i) {
            const auto [first, count] = together[i];
            rays += look(std::span(packets).subspan(first, count), &bits[first]);
        });
        report_.rays += rays;
        laps_.add_to(report_.visibility_seconds);
        solver_.solve(packets, advance);
    }

    void pack(const Part& part, const Zone& zone, std::vector<Packet>& packets) {
        const size_t first = packets.size();
        uint32_t eighth = 0;
        for (const Sorted& each : part.places) {
            if (!(volume_.validity[each.place] > 0.0f))
                continue;
            if (packets.size() == first || packets.back().cells.size() == lanes
                || part_of(each.morton) != eighth)
                packets.push_back({&zone, {}, {}, {}});
            eighth = part_of(each.morton);
            packets.back().cells.push_back(each.place);
        }
    }

    /// Finds out what the places of packets of one zone see, and where their light is taken.
    /// Returns how many rays it took.
    uint64_t look(std::span<Packet> packets, Bits* bits) const {
        const Zone& zone = *packets.front().zone;
        const size_t words = zone.words();
        std::vector<Zone::Look> looks;
        for (Packet& packet : packets) {
            bits->assign(packet.cells.size() * words, 0);
            uint64_t* sees = (bits++)->data();
            for (const size_t cell : packet.cells) {
                packet.points.push_back(world_.visibility.capture_at(places_[cell]).point);
                packet.sees.push_back(sees);
                looks.push_back({packet.points.back(), pattern_of(places_[cell]), {}, sees});
                sees += words;
            }
        }
        return zone.look(looks);
    }

    std::span<const glm::vec3> places_;
    const Surroundings& world_;
    PacketSolver& solver_;
    Volume& volume_;
    std::span<Volume> layers_;
    GatherReport& report_;
    Laps& laps_;
    size_t zone_left_ = 0; ///< places of the first zone of those that are left
    glm::vec3 lo_{0}, hi_{0};
};

} // namespace

void solve_places(std::span<const glm::vec3> places, const Surroundings& world,
                  PacketSolver& solver, Volume& volume, std::span<Volume> layers,
                  Progress& progress, GatherReport& report, Laps& laps) {
    Solving(places, world, solver, volume, layers, report, laps).run(progress);
}

} // namespace lpvbake::solver::gather
