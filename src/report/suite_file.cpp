// Reading a suite: every value is checked where it stands.
#include "report/suite.h"

#include "lpvbake/error.h"
#include "scene/gltf/folder.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <string_view>

namespace lpvbake::report {
namespace {

using nlohmann::json;

constexpr size_t most_cases = 10'000, most_corners = 1000;

/// A JSON value together with where it stands.
struct Place {
    const json& value;
    std::string path;

    [[noreturn]] void fail(const std::string& why) const {
        throw Error(ErrorKind::invalid, path + ": " + why);
    }
    void check_object(std::initializer_list<std::string_view> known,
                      std::initializer_list<const char*> needed = {}) const {
        if (!value.is_object())
            fail("must be an object");
        for (const auto& [key, unused] : value.items())
            if (std::ranges::find(known, key) == known.end())
                fail("has an unknown property \"" + key + "\"");
        for (const char* key : needed)
            if (!value.contains(key))
                fail(std::string("lacks \"") + key + "\"");
    }
    Place child(const std::string& key) const { return {value.at(key), path + "." + key}; }
    std::optional<Place> maybe(const char* key) const {
        return value.contains(key) ? std::optional<Place>(child(key)) : std::nullopt;
    }
    std::vector<Place> elements(size_t least, size_t most, const char* what) const {
        if (!value.is_array() || value.size() < least || value.size() > most)
            fail(std::string("must be an array of ") + what);
        std::vector<Place> all;
        for (size_t i = 0; i < value.size(); ++i)
            all.push_back({value[i], path + "[" + std::to_string(i) + "]"});
        return all;
    }
    double number(double lo, double hi) const {
        const double x = value.is_number() ? value.get<double>() : std::nan("");
        if (!(x >= lo && x <= hi)) {
            const bool bounded = hi < 1e300;
            fail(bounded   ? "must be a number from " + json(lo).dump() + " to " + json(hi).dump()
                 : lo == 0 ? "must be a number from 0 up"
                           : std::string("must be a number"));
        }
        return x;
    }
    double number() const { return number(-1e300, 1e300); }
    template <class Whole>
    Whole whole(Whole lo, Whole hi) const {
        if (!value.is_number_integer() || value < lo || value > hi)
            fail("must be a whole number from " + std::to_string(lo) + " to " + std::to_string(hi));
        return value.get<Whole>();
    }
    bool flag() const {
        if (!value.is_boolean())
            fail("must be true or false");
        return value.get<bool>();
    }
    /// Text that fits a line of a table.
    std::string line() const {
        if (!value.is_string())
            fail("must be a text");
        std::string text = value.get<std::string>();
        if (text.empty() || text.size() > 500
            || std::ranges::any_of(text, [](unsigned char c) { return c < ' ' || c == 127; }))
            fail("must be a text of one line, 1 to 500 bytes");
        return text;
    }
    glm::dvec3 vector() const {
        glm::dvec3 v;
        const std::vector<Place> numbers = elements(3, 3, "3 numbers");
        for (int i = 0; i < 3; ++i)
            v[i] = numbers[size_t(i)].number();
        return v;
    }
    /// A pair [lo, hi].
    SuiteRange range() const {
        const std::vector<Place> ends = elements(2, 2, "2 numbers, the least and the most");
        const SuiteRange r{ends[0].number(), ends[1].number()};
        if (r.lo > r.hi)
            fail("the least is above the most");
        return r;
    }
};

Bounds box(const Place& place, glm::dvec3 lo, glm::dvec3 hi) {
    if (glm::any(glm::lessThan(hi, lo)))
        place.fail("a corner of the box is inside out");
    return {lo, hi};
}

SuiteOptions options_of(const Place& place) {
    place.check_object({"resolution", "margin", "bounds", "bounces", "max-albedo", "iterations",
                        "probes", "rays", "noise"});
    SuiteOptions o;
    if (const auto p = place.maybe("resolution"))
        o.resolution = p->whole(3, 2048);
    if (const auto p = place.maybe("margin"))
        o.margin = p->whole(0, 1000);
    if (const auto p = place.maybe("bounds")) {
        glm::dvec3 ends[2];
        const std::vector<Place> numbers = p->elements(6, 6, "6 numbers");
        for (int i = 0; i < 6; ++i)
            ends[i / 3][i % 3] = numbers[size_t(i)].number();
        o.bounds = box(*p, ends[0], ends[1]);
    }
    if (const auto p = place.maybe("bounces")) {
        if (p->value == "inf")
            o.bounces.reset();
        else if (p->value.is_string())
            p->fail("must be a whole number from 0 to 10000 or \"inf\"");
        else
            o.bounces = p->whole(0, 10'000);
    }
    if (const auto p = place.maybe("max-albedo"))
        o.max_albedo = p->number(0, 1);
    if (const auto p = place.maybe("iterations"))
        o.iterations = p->whole(0, 1'000'000);
    if (const auto p = place.maybe("probes"))
        o.probes = p->whole<uint64_t>(1, 1'000'000);
    if (const auto p = place.maybe("rays"))
        o.rays = p->whole<uint64_t>(1, 1'000'000'000);
    if (const auto p = place.maybe("noise"))
        o.noise = p->number(1e-6, 1);
    return o;
}

SuiteTruth truth_of(const Place& place) {
    if (place.value == "reference")
        return TracedTruth{};
    if (place.value == "none")
        return NoTruth{};
    if (place.value == "none")
        return NoTruth{};
    if (!place.value.is_object() || place.value.size() != 1)
        place.fail("must be \"reference\", {\"furnace\": ...}, {\"polygon\": ...} or \"none\"");
    place.check_object({"furnace", "polygon"});
    if (const auto p = place.maybe("furnace")) {
        p->check_object({"emission", "albedo"}, {"emission", "albedo"});
        return FurnaceTruth{p->child("emission").number(0, 1e30),
                            p->child("albedo").number(0, 0.999)};
    }
    const Place polygon = place.child("polygon");
    polygon.check_object({"corners", "luminance"}, {"corners", "luminance"});
    PolygonTruth truth;
    truth.luminance = polygon.child("luminance").number(0, 1e30);
    for (const Place& corner :
         polygon.child("corners").elements(3, most_corners, "3 to 1000 corners"))
        truth.corners.push_back(corner.vector());
    return truth;
}

SuiteLimits limits_of(const Place& place) {
    place.check_object({"error", "energy", "leak", "negative", "same"});
    if (place.value.empty())
        place.fail("is empty: nothing could fail");
    constexpr double infinity = 1e300;
    SuiteLimits limits;
    if (const auto p = place.maybe("error"))
        limits.error = p->number(0, infinity);
    if (const auto p = place.maybe("energy"))
        limits.energy = p->range();
    if (const auto p = place.maybe("leak"))
        limits.leak = p->range();
    if (const auto p = place.maybe("negative"))
        limits.negative = p->number(0, 1);
    if (const auto p = place.maybe("same"))
        limits.same = p->number(0, infinity);
    return limits;
}

SuiteCase case_of(const Place& place, const std::filesystem::path& folder,
                  solver::SolverKinds kinds) {
    place.check_object(
        {"name", "reason", "scene", "options", "truth", "region", "same_as", "limits", "cheap"},
        {"name", "reason", "scene", "limits"});
    SuiteCase c;
    c.name = place.child("name").line();
    c.reason = place.child("reason").line();
    const Place scene = place.child("scene");
    c.scene = scene::gltf::resolve_uri(folder, scene.line(), scene.path).string();
    if (const auto p = place.maybe("options"))
        c.options = options_of(*p);
    if (const auto p = place.maybe("truth"))
        c.truth = truth_of(*p);
    if (const auto p = place.maybe("region")) {
        p->check_object({"lo", "hi", "dark"}, {"lo", "hi"});
        c.region = SuiteRegion{box(*p, p->child("lo").vector(), p->child("hi").vector()),
                               p->value.contains("dark") && p->child("dark").flag()};
    }
    if (const auto p = place.maybe("same_as")) {
        p->check_object({"case", "scale"}, {"case"});
        c.same_as = SuiteSame{p->child("case").line(), 1.0};
        if (const auto scale = p->maybe("scale"))
            c.same_as->scale = scale->number(1e-30, 1e30);
    }
    const Place limits = place.child("limits");
    if (!limits.value.is_object() || limits.value.empty())
        limits.fail("must be an object with an entry for one solver at least");
    for (const auto& [solver, unused] : limits.value.items()) {
        const Place own = limits.child(solver);
        if (!bake::find_solver(solver, kinds)) {
            std::string known;
            for (const solver::SolverKind* kind : kinds)
                known += (known.empty() ? "" : ", ") + std::string(kind->name);
            own.fail("there is no such solver; known: " + known);
        }
        SuiteLimits& of_solver = c.limits[solver] = limits_of(own);
        if (of_solver.leak && !c.region)
            own.fail("limits a leak, but the case has no \"region\"");
        if ((of_solver.error || of_solver.energy || of_solver.leak)
            && std::holds_alternative<NoTruth>(c.truth))
            own.fail("limits what needs a truth, but \"truth\" is \"none\"");
        if (of_solver.same && !c.same_as)
            own.fail("limits \"same\", but the case has no \"same_as\"");
    }
    c.cheap = place.value.contains("cheap") && place.child("cheap").flag();
    return c;
}

} // namespace

Suite load_suite(const std::string& path, solver::SolverKinds kinds) {
    const std::vector<unsigned char> text = scene::gltf::read_file(path, path);
    json root;
    try {
        root = json::parse(text.begin(), text.end());
    } catch (const json::exception& error) {
        throw Error(ErrorKind::invalid, path + ": not JSON: " + error.what());
    }
    const Place place{root, path};
    place.check_object({"cases"}, {"cases"});
    Suite suite{path, {}};
    const std::vector<Place> places =
        Place{root["cases"], path + ": cases"}.elements(1, most_cases, "1 to 10000 cases");
    for (const Place& each : places)
        suite.cases.push_back(case_of(each, std::filesystem::path(path).parent_path(), kinds));
    for (size_t i = 0; i < suite.cases.size(); ++i) {
        const auto named = [&](const std::string& name) {
            return std::ranges::find(suite.cases, name, &SuiteCase::name) - suite.cases.begin();
        };
        const SuiteCase& c = suite.cases[i];
        if (size_t(named(c.name)) != i)
            places[i].child("name").fail("\"" + c.name + "\" is the name of another case");
        if (c.same_as) {
            const size_t other = size_t(named(c.same_as->name));
            if (other == suite.cases.size() || other == i)
                places[i].child("same_as").child("case").fail("\"" + c.same_as->name
                                                              + "\" is no other case");
        }
    }
    return suite;
}

} // namespace lpvbake::report
