// Parameters of solvers as data: what a command line, a sweep or a suite can set without knowing
// the solver.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace lpvbake::solver {

enum class ValueKind {
    whole,  ///< whole numbers
    real,   ///< finite numbers
    choice, ///< one of a few names; the value is its index
};

/// One thing that a kind of solver can be told. Kinds may have parameters of the same name, each
/// with a meaning, a range and a default of its own.
struct Parameter {
    const char* name; ///< lower case with dashes, unique in its kind: "rsm-size"
    ValueKind kind;
    double lo = 0, hi = 0;                  ///< least and most number
    std::span<const char* const> choices{}; ///< names that a choice has
    double usual = 0;                       ///< the default
    const char* unit = "";                  ///< what a number counts: "directions"; may be empty
    const char* help = "";                  ///< a phrase or two, without name, range and default
    /// Another parameter of the same kind: this one means nothing, and may not be set, unless that
    /// is above 0. Null: there is none.
    const char* needs = nullptr;
    /// The nearest value that is solved; null: any. Settings hold what this returns.
    double (*round)(double value) = nullptr;
};

/// "whole numbers from 48 to 384", "numbers from 0 to 1", "none, sh, face".
std::string values_of(const Parameter& parameter);

/// The value that a text says, not rounded; none if it is none of values_of().
std::optional<double> parse_value(const Parameter& parameter, std::string_view text);

/// Whether the parameter takes this number.
bool is_value(const Parameter& parameter, double value);

/// "240", "0.3", "face": parse_value() reads it back.
std::string value_text(const Parameter& parameter, double value);

struct ParameterValue {
    const char* parameter = nullptr; ///< its name; null: none
    double value = 0;
};

} // namespace lpvbake::solver
