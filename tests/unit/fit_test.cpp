#include "readers/fit.h"

#include "unit/volumes.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <numbers>

namespace lpvbake::readers {
namespace {

using std::numbers::pi;

class Places {
public:
    explicit Places(unsigned seed) : random_(seed) {}
    double share() { return share_(random_); }
    glm::dvec3 normal() {
        return glm::normalize(glm::dvec3(bell_(random_), bell_(random_), bell_(random_)));
    }

private:
    std::mt19937 random_;
    std::uniform_real_distribution<double> share_;
    std::normal_distribution<double> bell_;
};

/// A lit room in the dark, in cells of half a metre: its walls are without thickness, off the
/// lattice, and seen from both sides. Inside the luminance is 1 nit from everywhere. Cells are
/// valid, as no centre lies in anything.
struct Room {
    double scale = 1; ///< of the room, against the cells
    glm::dvec3 lo = scale * glm::dvec3(1.7, 1.6, 1.8), hi = scale * glm::dvec3(8.3, 7.3, 8.4);
    static constexpr double cell = 0.5; ///< metres
    static constexpr glm::dvec3 colour{1.0, 0.5, 0.25};

    bool inside(glm::dvec3 p) const {
        return glm::all(glm::lessThan(lo, p)) && glm::all(glm::lessThan(p, hi));
    }

    /// What a solver would give the cells' centres.
    Volume field(int order) const {
        Volume volume;
        volume.grid = {{0, 0, 0}, cell, glm::ivec3(glm::ceil(hi + 1.5 * scale))};
        volume.sh_order = order;
        volume.sh.assign(std::size_t(volume::sh_count(order)),
                         std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
        volume.validity.assign(volume.grid.size(), 1.0f);
        glm::ivec3 c;
        for (c.z = 0; c.z < volume.grid.dims.z; ++c.z)
            for (c.y = 0; c.y < volume.grid.dims.y; ++c.y)
                for (c.x = 0; c.x < volume.grid.dims.x; ++c.x)
                    if (inside(glm::dvec3(c) + 0.5))
                        volume.sh[0][volume.grid.index(c)] = glm::vec3(colour) / volume::sh_y0;
        return volume;
    }

    /// Points on both sides of the walls, `density` a face and side.
    std::vector<readers::FitPoint> points(double density, unsigned seed) const {
        std::vector<readers::FitPoint> result;
        Places places(seed);
        const glm::dvec3 size = hi - lo;
        for (int axis = 0; axis < 3; ++axis)
            for (const bool upper : {false, true}) {
                const double area = size[(axis + 1) % 3] * size[(axis + 2) % 3];
                for (int i = 0; i < int(density * area); ++i) {
                    glm::dvec3 p =
                        lo + size * glm::dvec3(places.share(), places.share(), places.share());
                    p[axis] = upper ? hi[axis] : lo[axis];
                    for (const double way : {1.0, -1.0}) {
                        glm::dvec3 n(0.0);
                        n[axis] = way;
                        const bool inwards = upper == (way < 0);
                        result.push_back({cell * p, n, 1 / density, (inwards ? pi : 0.0) * colour});
                    }
                }
            }
        return result;
    }
};

const readers::Reader& reader(const char* name) {
    return *readers::reader_named(name);
}

void expect_same_bits(const Volume& a, const Volume& b) {
    for (std::size_t k = 0; k < a.sh.size(); ++k)
        ASSERT_EQ(std::memcmp(a.sh[k].data(), b.sh[k].data(), a.sh[k].size() * sizeof(glm::vec3)),
                  0);
}

TEST(Fit, FindsTheFieldThatTheTargetsWereReadFrom) {
    Volume truth = random_volume({5, 4, 6}, 2, false, 17, 10);
    for (glm::vec3& l0 : truth.sh[0])
        l0 += 20.0f;
    for (const char* name : {"unity", "threejs", "lpvbake"}) {
        Places places(3);
        std::vector<readers::FitPoint> points;
        readers::Reader plain = reader(name);
        plain.clamped = false; // targets of a clamped one do not tell what is below 0
        for (int i = 0; i < 20000; ++i) {
            const glm::dvec3 p = truth.grid.origin
                                 + truth.grid.cell * (glm::dvec3(truth.grid.dims) - 1.0)
                                       * glm::dvec3(places.share(), places.share(), places.share())
                                 + 0.5 * truth.grid.cell;
            const glm::dvec3 n = places.normal();
            points.push_back({p, n, 1, readers::irradiance(plain, truth, p, n)});
        }
        Volume volume = truth;
        for (auto& cells : volume.sh)
            cells.assign(cells.size(), glm::vec3(0.0f));
        readers::FitSettings settings;
        settings.steps = 500;
        settings.hold_valid = settings.hold_other = 1e-9;
        settings.tolerance = 1e-9;
        const readers::FitReport report = readers::fit(plain, points, settings, volume);
        EXPECT_LT(readers::error_of(plain, volume, points).relative, 1e-4) << name;
        EXPECT_EQ(report.points, points.size());
        if (name == std::string_view("lpvbake")) // which reads no cell that is not valid
            continue;
        for (std::size_t k = 0; k < volume.sh.size(); ++k)
            for (std::size_t i = 0; i < volume.grid.size(); ++i)
                ASSERT_LT(glm::length(volume.sh[k][i] - truth.sh[k][i]), 0.05f) << name << k;
    }
}

TEST(Fit, LeavesAFieldThatIsShownRight) {
    const Volume truth = random_volume({5, 4, 6}, 2, false, 17, 10);
    Places places(3);
    std::vector<readers::FitPoint> points;
    for (int i = 0; i < 300; ++i) {
        const glm::dvec3 p =
            truth.grid.center(truth.grid.dims / 2) + truth.grid.cell * (places.share() - 0.5);
        const glm::dvec3 n = places.normal();
        points.push_back({p, n, 1, readers::irradiance(reader("unity"), truth, p, n)});
    }
    Volume volume = truth;
    const readers::FitReport report = readers::fit(reader("unity"), points, {}, volume);
    EXPECT_LT(report.moved, 1e-6);
    EXPECT_LT(report.cells, 60u); // and no cell that is not read
    EXPECT_NEAR(readers::error_of(reader("unity"), truth, points).energy, 1, 1e-6);
}

/// What is asked of a reader's picture of a room.
bool is_right(const readers::SurfaceError& error) {
    return error.relative < 0.025 && std::abs(error.energy - 1) < 0.02
           && std::abs(error.leak) < 0.02;
}

TEST(Fit, ShowsBothSidesOfThinWalls) {
    const Room room{2};
    const std::vector<readers::FitPoint> points = room.points(6, 1), others = room.points(10, 2);
    for (const char* name : {"unity", "unreal", "godot", "threejs", "vrc", "bevy"}) {
        Volume volume = room.field(reader(name).highest_order);
        EXPECT_GT(readers::error_of(reader(name), volume, others).relative, 0.3) << name;
        const readers::FitReport report = readers::fit(reader(name), points, {}, volume);
        const readers::SurfaceError error = readers::error_of(reader(name), volume, others);
        EXPECT_TRUE(is_right(error))
            << name << ' ' << error.relative << ' ' << error.energy << ' ' << error.leak;
        // Of a room whose cells are half beside walls; Bevy's sides cannot go below 0 behind them.
        EXPECT_LT(report.moved, name == std::string_view("bevy") ? 0.12 : 0.06) << name;
        EXPECT_LT(report.residual, 1e-2) << name;
        EXPECT_LT(readers::error_of(reader(name), volume, points).relative, error.relative) << name;
    }
}

TEST(Fit, IsSeenToFailWhenItIsMadeWrongly) {
    const Room room{2};
    const readers::Reader& threejs = reader("threejs");
    const std::vector<readers::FitPoint> points = room.points(6, 1), others = room.points(10, 2);
    const auto error_after = [&](const readers::Reader& fitted,
                                 std::span<const readers::FitPoint> to) {
        Volume volume = room.field(2);
        readers::fit(fitted, to, {}, volume);
        return readers::error_of(threejs, volume, others);
    };
    EXPECT_TRUE(is_right(error_after(threejs, points)));

    readers::Reader unmoved = threejs;
    unmoved.offset = 0;
    EXPECT_FALSE(is_right(error_after(unmoved, points))) << "the reader's offset is ignored";

    std::vector<readers::FitPoint> wrong = points;
    const Volume grid = room.field(2);
    for (readers::FitPoint& point : wrong)
        point.irradiance = readers::irradiance(threejs, grid, point.position, point.normal);
    EXPECT_FALSE(is_right(error_after(threejs, wrong))) << "the grid's own values are the targets";

    wrong.clear();
    for (const readers::FitPoint& point : points)
        if (point.irradiance.x > 0)
            wrong.push_back(point);
    EXPECT_FALSE(is_right(error_after(threejs, wrong))) << "points of one side";

    wrong = points;
    for (readers::FitPoint& point : wrong)
        point.normal = -point.normal;
    EXPECT_FALSE(is_right(error_after(threejs, wrong))) << "swapped normals";
}

TEST(Fit, SidesOfACubeAreNotNegative) {
    const Room room{1};
    Volume volume = room.field(2);
    const Volume given = volume;
    readers::fit(reader("bevy"), room.points(6, 1), {}, volume);
    const readers::Reader plain{.name = "", .highest_order = 2};
    int bound = 0;
    glm::ivec3 c;
    for (c.z = 0; c.z < volume.grid.dims.z; ++c.z)
        for (c.y = 0; c.y < volume.grid.dims.y; ++c.y)
            for (c.x = 0; c.x < volume.grid.dims.x; ++c.x)
                for (int side = 0; side < 6; ++side) {
                    glm::dvec3 n(0.0);
                    n[side / 2] = side % 2 ? -1 : 1;
                    const double e = readers::irradiance(plain, volume, volume.grid.center(c), n).x;
                    ASSERT_GT(e, -1e-4);
                    bound += e < 1e-4 && volume.sh[0][volume.grid.index(c)].x > 0.1f;
                }
    EXPECT_GT(bound, 100); // and many would be
    // Bands that sides do not know stay.
    for (const std::size_t k : {4, 5, 7})
        EXPECT_EQ(volume.sh[k], given.sh[k]);
}

TEST(Fit, BitsDoNotDependOnThreads) {
    const Room room{1};
    const std::vector<readers::FitPoint> points = room.points(6, 1);
    for (const char* name : {"unity", "bevy"}) {
        Volume first;
        for (const std::size_t threads : {1, 2, 4}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            Volume volume = room.field(2);
            const readers::FitReport report = readers::fit(reader(name), points, {}, volume);
            EXPECT_GT(report.cells, 100u);
            if (threads == 1)
                first = volume;
            else
                expect_same_bits(first, volume);
        }
    }
}

TEST(Fit, KeepsWhatItHasNoSayIn) {
    const Room room{1};
    const Volume given = room.field(2);
    Volume volume = given;
    volume.sh_order = 3;
    volume.sh.resize(16, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(7.0f)));
    const std::vector<readers::FitPoint> points = room.points(6, 1);
    readers::fit(reader("vrc"), points, {}, volume);
    for (std::size_t k = 4; k < volume.sh.size(); ++k) // bands that it does not read
        for (std::size_t i = 0; i < volume.grid.size(); ++i)
            ASSERT_EQ(volume.sh[k][i], k < 9 ? given.sh[k][i] : glm::vec3(7.0f));
    // No points, none with weight, none that finds cells.
    volume = given;
    std::vector<readers::FitPoint> none = points;
    for (readers::FitPoint& point : none)
        point.weight = 0;
    EXPECT_EQ(readers::fit(reader("unity"), {}, {}, volume).cells, 0u);
    EXPECT_EQ(readers::fit(reader("unity"), none, {}, volume).points, 0u);
    for (readers::FitPoint& point : none) {
        point.weight = 1;
        point.position.x += 1000;
    }
    EXPECT_EQ(readers::fit(reader("vrc"), none, {}, volume).points, 0u);
    expect_same_bits(given, volume);
}

TEST(Fit, CellsThatAreNotValidGiveWay) {
    // A wall with cells in it: they take what the valid ones would have to.
    const Room room{2};
    const std::vector<readers::FitPoint> points = room.points(6, 1);
    Volume free = room.field(2), held = free;
    for (std::size_t i = 0; i < free.grid.size(); ++i)
        free.validity[i] = free.sh[0][i].x > 0;
    readers::FitSettings settings;
    settings.hold_valid = 0.1;
    settings.hold_other = 1e-3;
    settings.hold_dark = 1;
    const readers::FitReport with_free = readers::fit(reader("unity"), points, settings, free);
    const readers::FitReport all_held = readers::fit(reader("unity"), points, settings, held);
    EXPECT_LT(readers::error_of(reader("unity"), free, points).relative,
              0.5 * readers::error_of(reader("unity"), held, points).relative);
    EXPECT_EQ(with_free.moved_dark, 0.0); // none of the valid ones was dark
    EXPECT_GT(all_held.moved_dark, 0.01);
}

TEST(Fit, TheDarkSideGivesWayToTheAirOfTheLitOne) {
    const Room room{2};
    const std::vector<readers::FitPoint> points = room.points(6, 1);
    Volume yielding = room.field(2), alike = yielding;
    readers::FitSettings settings;
    const readers::FitReport report = readers::fit(reader("unity"), points, settings, yielding);
    settings.hold_dark = 1;
    const readers::FitReport held_alike = readers::fit(reader("unity"), points, settings, alike);
    EXPECT_LT(report.moved, 0.5 * held_alike.moved);
    EXPECT_LT(readers::error_of(reader("unity"), yielding, points).relative,
              readers::error_of(reader("unity"), alike, points).relative);
}

TEST(Fit, IsNotTakenWhereOtherPointsSeeNoGain) {
    // Points of a wall in the middle of an even field ask for twice its light; others know better.
    const Volume field = Room().field(2);
    const glm::dvec3 middle = field.grid.center(field.grid.dims / 2), up(0, 0, 1);
    const auto asking = [&](double factor, double apart) {
        std::vector<readers::FitPoint> points;
        for (int i = 0; i < 25; ++i)
            points.push_back({middle + apart * glm::dvec3(i % 5 - 2, i / 5 - 2, 0), up, 1,
                              factor * pi * Room::colour});
        return points;
    };
    const auto fitted = [&](const std::vector<readers::FitPoint>& judges, bool& taken) {
        Volume volume = field;
        const auto report =
            readers::fit(reader("unity"), asking(2, 0.2), {.bright = 0}, volume, judges);
        taken = report.share > 0;
        EXPECT_EQ(report.moved > 0, taken);
        return volume;
    };
    bool taken = true;
    expect_same_bits(fitted(asking(1, 0.17), taken), field);
    EXPECT_FALSE(taken);
    const Volume moved = fitted(asking(2, 0.17), taken);
    EXPECT_TRUE(taken);
    EXPECT_GT(readers::error_of(reader("unity"), moved, asking(1, 0.1)).energy, 1.9);
    // Where all of the way is too far, half of it is gone.
    const Volume half = fitted(asking(1.4, 0.17), taken);
    EXPECT_TRUE(taken);
    EXPECT_NEAR(readers::error_of(reader("unity"), half, asking(1, 0.17)).energy, 1.5, 0.05);
    // One judge of many for it, more than all others are against it: that is chance.
    auto judges = asking(1, 0.17);
    judges[12].irradiance *= 100;
    judges[12].weight = 100;
    fitted(judges, taken);
    EXPECT_FALSE(taken);
}

TEST(Fit, BesideALampIsNotBentToIt) {
    // A wall of even light, but for a spot of a few hundredths of a cell, of 80 times that.
    const Volume field = Room().field(2);
    const glm::dvec3 middle = field.grid.center(field.grid.dims / 2), up(0, 0, 1);
    std::vector<readers::FitPoint> points, around;
    for (int i = 0; i < 3600; ++i) {
        const glm::dvec3 way = 0.05 * glm::dvec3(i % 60 - 29.5, i / 60 - 29.5, 0);
        const double far = glm::length(way);
        points.push_back({middle + way, up, 0.01, (far < 0.04 ? 80 : 1) * pi * Room::colour});
        if (far > 0.25 && far < 1)
            around.push_back({middle + way, up, 0.01, pi * Room::colour});
    }
    const auto error = [&](double bright) {
        Volume volume = field;
        readers::fit(reader("unity"), points, {.bright = bright}, volume);
        return readers::error_of(reader("unity"), volume, around).relative;
    };
    const double bent = error(0), even = error(readers::FitSettings().bright);
    EXPECT_GT(bent, 0.1);
    EXPECT_LT(even, 0.01);
}

TEST(Fit, SaysWhereItIsWorst) {
    Volume volume = Room{1}.field(0);
    for (glm::vec3& c : volume.sh[0])
        c = glm::vec3(1.0f / volume::sh_y0); // pi lux towards everywhere
    const glm::dvec3 n(0, 0, 1);
    const auto at = [&](glm::ivec3 c, double weight, double lux) {
        return readers::FitPoint{volume.grid.center(c), n, weight, pi * glm::dvec3(lux)};
    };
    std::vector<readers::FitPoint> points{at({2, 2, 2}, 1, 1), at({4, 4, 4}, 1, 3),
                                          at({4, 4, 4}, 3, 1), at({6, 5, 4}, 0.4, 9),
                                          at({6, 3, 2}, 2, 0)};
    const double mean = (1 + 3 + 3 + 0.4 * 9) / 7.4;
    readers::WorstPlace worst = readers::worst_place(reader("unity"), volume, points);
    EXPECT_NEAR(worst.error, 1 / mean, 1e-6); // 2 of 4 at the other; 8, but of a small face
    EXPECT_NEAR(glm::distance(worst.position, points[4].position), 0, 1e-9);
    points[4].weight = points[3].weight = 0.4;
    worst = readers::worst_place(reader("unity"), volume, points);
    EXPECT_NEAR(worst.error, (2.0 / 4) / ((7 + 0.4 * 9) / 5.8), 1e-6);
    EXPECT_NEAR(glm::distance(worst.position, points[1].position), 0, 1e-9);
    EXPECT_EQ(readers::worst_place(reader("unity"), volume, {}).error, 0);
}

TEST(Fit, CountsErrorEnergyAndLeakByHand) {
    Volume volume = Room{1}.field(0);
    for (glm::vec3& c : volume.sh[0])
        c = glm::vec3(1.0f / volume::sh_y0); // pi lux towards everywhere
    const glm::dvec3 p = volume.grid.center({4, 4, 4}), n(0, 0, 1);
    const std::vector<readers::FitPoint> points{{p, n, 1, pi * glm::dvec3(2, 1, 1)},
                                                {p, n, 3, pi * glm::dvec3(1, 1, 1)},
                                                {p, n, 1, glm::dvec3(0.0)}};
    const readers::SurfaceError error = readers::error_of(reader("unity"), volume, points);
    EXPECT_NEAR(error.relative, (1.0 + 3.0) / (4 + 9), 1e-6);
    const double truth = (2 * 0.2126 + 0.7152 + 0.0722) + 3;
    EXPECT_NEAR(error.energy, 5 / truth, 1e-6);
    EXPECT_NEAR(error.leak, 1 / (truth / 5), 1e-6);
    EXPECT_NEAR(readers::openness_weight(0.0), 0.05, 1e-12); // or it shines by what lies behind
    EXPECT_NEAR(readers::openness_weight(0.25), 0.525, 1e-12);
    EXPECT_EQ(readers::openness_weight(0.9), 1.0);
}

} // namespace
} // namespace lpvbake::readers
