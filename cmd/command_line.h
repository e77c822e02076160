// What the commands' option lists are made of.
#pragma once

#include "config.h"

#include <CLI/CLI.hpp>

#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace lpvbake {

/// Accepts one of the choices in "a|b|c".
CLI::Validator one_of(const std::string& choices);

/// The names as choices: "a|b|c".
std::string choices_of(const std::vector<const char*>& names);

/// A finite number in [lo, hi], written in digits alone if `whole`.
CLI::Validator within(double lo, double hi, bool whole);

/// A share from 1e-6 to 1, or a percentage, which becomes one.
CLI::Validator share_or_percent();

/// A finite number that is all of the text.
std::optional<double> parse_number(const std::string& text);

/// True if the path ends in the extension (with its dot, lower case), in any case.
bool has_extension(const std::string& path, const char* extension);

/// Declares a command's options, group by group.
class OptionList {
public:
    explicit OptionList(CLI::App& app) : app_(app) {}
    /// Under which heading of --help the next ones stand.
    void group(const char* name) { group_ = name; }

    template <class T>
    CLI::Option* text(const std::string& names, T& value, const char* type, const char* help) {
        return app_.add_option(names, value, help)->type_name(type)->group(group_);
    }
    /// Repeatable, one value each time: what follows may be the scene.
    CLI::Option* list(const char* names, std::vector<std::string>& values, const char* type,
                      const char* help) {
        return text(names, values, type, help)->allow_extra_args(false);
    }
    template <class T>
    CLI::Option* number(const char* names, T& value, double lo, double hi, const char* help) {
        constexpr bool whole = std::is_integral_v<T>;
        return text(names, value, whole ? "N" : "X", help)->check(within(lo, hi, whole));
    }
    CLI::Option* choice(const char* names, std::string& value, const std::string& choices,
                        const char* help) {
        return text(names, value, choices.c_str(), help)
            ->check(one_of(choices))
            ->capture_default_str();
    }
    CLI::Option* flag(const char* names, bool& value, const char* help) {
        return app_.add_flag(names, value, help)->group(group_);
    }

private:
    CLI::App& app_;
    const char* group_ = "Options";
};

/// What is wrong with a command line that does not parse, and what to do. `root` has parsed it.
std::string explain(const CLI::App& root, const CLI::ParseError& error,
                    const std::vector<std::string>& arguments);

/// Applies what the command line did not set. Throws Error (file, argument: names file and line).
void apply_config(CLI::App& app, const std::string& path);

/// What becomes of an option outside the process: all in --print-config, `shapes_result` alone in
/// the metadata of the outputs, which depend on nothing else; both for what is `given`.
struct Setting {
    const char* name;
    std::string toml;
    bool shapes_result;
    bool given = true; ///< else only a comment: what it is for, not a value
};

std::string toml_flag(bool value);
std::string toml_array(const std::vector<std::string>& values);

/// Prints settings as --config reads them.
void print_config(const std::vector<Setting>& settings);

} // namespace lpvbake
