// How far one volume is from another, told: what is allowed, the verdict, words and JSON.
#pragma once

#include "volume/compare.h"

#include <nlohmann/json_fwd.hpp>

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace lpvbake::report {

/// What idiff calls fail, failpercent and hardfail.
struct Threshold {
    double limit = 0;   ///< difference above which a sample exceeds
    double percent = 0; ///< of the samples may exceed
    double hard = std::numeric_limits<double>::infinity(); ///< no sample may differ by more
    bool given = false;
};

/// Keys that only one has, and those with two values.
struct MetadataDifference {
    std::map<std::string, std::string> only_a, only_b;
    std::map<std::string, std::pair<std::string, std::string>> different;

    bool any() const { return !only_a.empty() || !only_b.empty() || !different.empty(); }
};

MetadataDifference metadata_difference(const Volume& a, const Volume& b);

/// Everything that is told of A and the reference B.
struct Difference {
    std::string path_a, path_b;
    const Volume& a;
    const Volume& b;
    volume::Comparison comparison; ///< with the limits of `fail` and `warn`, in this order
    Threshold fail, warn;
    bool metadata_fails = false;
    MetadataDifference metadata;

    /// A bake beside path-traced light: that it differs is no question, and how far is told short.
    bool is_measurement() const;
};

/// How A fails, to follow "A differs from B"; none: it does not. Without `fail` any difference of
/// any value does, but none of a measurement.
std::optional<std::string> failure(const Difference& difference);
/// The same for `warn`, to follow "A differs from B: ".
std::optional<std::string> warning(const Difference& difference);
/// "identical", "pass", "warning" or "fail".
std::string verdict(const Difference& difference);

/// As `lpvbake diff --help` documents it, but for slice and outputs; its text, but for the last
/// line.
nlohmann::ordered_json difference_json(const Difference& difference);
std::string difference_text(const Difference& difference);

} // namespace lpvbake::report
