// The table of options. A row is made where a command declares the option, and is all that there is
// of it: the command line, option files, --print-config, the settings in a volume's metadata,
// --help, the written reference and the commands that a report prints go by the rows.
#pragma once

#include "options/values.h"

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace lpvbake::cmd::options {

/// Whether the value stands among the settings in the metadata of what is written, which therefore
/// depends on no other option.
enum class Recorded { never, always, if_changed };

/// A row of the table.
struct Option {
    std::string names; ///< "-o,--output", as CLI11 takes them; a bare word is positional
    std::string type;  ///< what stands for its value, as "N" or "a|b"; empty: it is a flag
    std::string help;
    std::string group;
    /// Sets the field from a text and returns the text of its value in one form. Throws Error
    /// (argument) that says what is wrong with it.
    std::function<std::string(const std::string& text)> read;
    std::string usual;       ///< the default, as `read` returns it; empty: none
    bool quoted = true;      ///< option files hold its values as strings
    std::string alone;       ///< its value where it is given without one, which is a number
    bool many = false;       ///< it may be repeated, and its values add up
    bool required = false;   ///< there is no command without it
    bool in_files = true;    ///< option files may set it
    bool of_one_run = false; ///< it names what one run reads or writes: --print-config has it not
    bool listed = true;      ///< help has it; else it is there to be refused by name
    Recorded recorded = Recorded::never;
    /// What holds where it is not given and has no default of its own, for --print-config to tell.
    std::function<std::string()> implied;
    std::vector<std::string> excludes; ///< names of what may not be given with it
    std::string needs;                 ///< the name of what has to be set with it; empty: nothing
    std::vector<std::string> given;    ///< values, as `read` returned them

    Option& record(Recorded when = Recorded::always);
    Option& implies(std::function<std::string()> what);
    Option& implies(const std::string& what);
    Option& exclude(std::vector<std::string> others);
    Option& need(const std::string& other);
    Option& require();
    Option& bare(const std::string& value);
    Option& keep_out_of_files();
    Option& keep_to_one_run();

    /// The long name without dashes.
    std::string name() const;
    bool is_positional() const { return names[0] != '-'; }
    bool is_flag() const { return type.empty(); }
    /// Given, and no flag that is false.
    bool is_given() const { return !given.empty() && !(is_flag() && given.back() == "false"); }
    /// Given, and other than the default.
    bool is_set() const;
    /// Reads a value. Throws Error (argument) that begins with the option.
    void take(const std::string& text);
    /// What `--print-config` prints behind the equals sign; empty: it has no value.
    std::string toml() const;
    /// The same where it has none: what stands for its value.
    std::string toml_form() const;
};

/// The values that a choice has, by name.
template <class T>
using Choices = std::vector<std::pair<std::string, T>>;

/// Names of the values 0, 1, ... of an enumeration.
template <class T, class Names>
Choices<T> choices_named(const Names& names) {
    Choices<T> choices;
    for (const char* name : names)
        choices.emplace_back(name, T(choices.size()));
    return choices;
}

namespace detail {
template <class T>
struct Inside {
    using type = T;
};
template <class T>
struct Inside<std::optional<T>> {
    using type = T;
};
} // namespace detail

/// The options of a command, in the order of --help. Fields outlive the table; what they hold when
/// they are declared is the default. A field that is a std::optional has none.
class Options {
public:
    Options() = default;
    Options(const Options&) = delete;
    Options& operator=(const Options&) = delete;

    /// The heading under which the next ones stand.
    void group(const char* name) { group_ = name; }

    Option& flag(const std::string& names, bool& field, const std::string& help);

    /// A text as it is.
    Option& text(const std::string& names, std::string& field, const char* type,
                 const std::string& help);
    Option& texts(const std::string& names, std::vector<std::string>& field, const char* type,
                  const std::string& help);

    /// A finite number in [lo, hi]; of an integral field in digits alone.
    template <class Field>
    Option& number(const std::string& names, Field& field, double lo, double hi,
                   const std::string& help) {
        using T = typename detail::Inside<Field>::type;
        constexpr bool whole = std::is_integral_v<T>;
        Option& option = add(names, whole ? "N" : "X", help);
        option.quoted = false;
        option.read = [&field, lo, hi](const std::string& text) {
            field = T(number_within(text, lo, hi, whole));
            return number_text(T(inner(field)));
        };
        if constexpr (std::is_same_v<T, Field>)
            option.usual = number_text(field);
        return option;
    }

    /// One of a few names.
    template <class Field, class T>
    Option& choice(const std::string& names, Field& field, Choices<T> choices,
                   const std::string& help) {
        std::string type;
        for (const auto& [name, value] : choices)
            type += (type.empty() ? "" : "|") + name;
        Option& option = add(names, type, help);
        if constexpr (std::is_same_v<T, Field>)
            for (const auto& [name, value] : choices)
                if (value == field)
                    option.usual = name;
        option.read = [&field, choices = std::move(choices), type](const std::string& text) {
            for (const auto& [name, value] : choices)
                if (name == text) {
                    field = value;
                    return text;
                }
            refuse(text, "is none of " + type);
        };
        return option;
    }

    /// Whatever a function makes of a text, or throws Error (argument) for. An empty text is as
    /// good as none. `usual` is the default, unless the field's own is.
    template <class Field, class Parse>
    Option& value(const std::string& names, Field& field, const char* type, Parse parse,
                  const std::string& help, const std::string& usual = "") {
        Option& option = add(names, type, help);
        option.read = [&field, parse](const std::string& text) {
            if (text.empty())
                refuse(text, "is empty");
            field = parse(text);
            return text;
        };
        option.usual = usual;
        if (!usual.empty())
            field = parse(usual);
        return option;
    }
    template <class T, class Parse>
    Option& values(const std::string& names, std::vector<T>& field, const char* type, Parse parse,
                   const std::string& help) {
        Option& option = add(names, type, help);
        option.many = true;
        option.read = [&field, parse](const std::string& text) {
            field.push_back(parse(text));
            return text;
        };
        return option;
    }

    /// A share in [lo, hi], or a percentage, which becomes one.
    template <class Field>
    Option& share(const std::string& names, Field& field, double lo, double hi,
                  const std::string& help) {
        Option& option = add(names, "X|X%", help);
        option.quoted = false;
        option.read = [&field, lo, hi](const std::string& text) {
            field = parse_share(text, lo, hi);
            return number_text(inner(field));
        };
        if constexpr (std::is_same_v<Field, double>)
            option.usual = number_text(field);
        return option;
    }

    /// A row as it is; `read` is left to the caller.
    Option& add(const std::string& names, const std::string& type, const std::string& help);

    std::deque<Option>& rows() { return rows_; }
    const std::deque<Option>& rows() const { return rows_; }
    /// Those that help has.
    std::vector<const Option*> listed() const;
    /// By name, positional ones first; null where there is none.
    Option* find(std::string_view name);
    const Option* find(std::string_view name) const;

    /// What options say of each other. Throws Error (argument).
    void check() const;
    /// An option file: the table of the command with all of them, below what each is; those
    /// without effect as comments.
    std::string config(const std::string& command) const;
    /// As a volume's metadata have them.
    std::string recorded() const;

private:
    template <class T>
    static const T& inner(const T& field) {
        return field;
    }
    template <class T>
    static const T& inner(const std::optional<T>& field) {
        return *field;
    }
    /// Another one that excludes it is given in its place.
    bool is_replaced(const Option& option) const;

    std::string group_ = "Options";
    std::deque<Option> rows_;
};

} // namespace lpvbake::cmd::options
