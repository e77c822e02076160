#include "command_line.h"

#include "error.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <numeric>
#include <utility>

namespace lpvbake {
namespace {

/// Letters to insert, to leave out or to replace between two words.
std::size_t distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i + 1);
        for (std::size_t j = 0; j < b.size(); ++j)
            diagonal = std::exchange(
                row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, diagonal + (a[i] != b[j])}));
    }
    return row.back();
}

/// "; did you mean --resolution?", or nothing where no word is near. A beginning is near too.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix = "") {
    std::size_t least = 1 + std::max<std::size_t>(1, word.size() / 3);
    std::string nearest;
    for (const std::string& each : known)
        if (const std::size_t far =
                word.size() > 2 && each.starts_with(word) ? 1 : distance(word, each);
            far < least) {
            least = far;
            nearest = each;
        }
    return nearest.empty() ? "" : "; did you mean " + prefix + nearest + "?";
}

std::vector<std::string> long_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
        names.insert(names.end(), option->get_lnames().begin(), option->get_lnames().end());
    return names;
}

std::string unknown_option(const CLI::App& app, const std::string& argument) {
    const std::string name = argument.substr(0, argument.find('='));
    const std::size_t begin = std::min(name.find_first_not_of('-'), name.size());
    return "unknown option " + name + did_you_mean(name.substr(begin), long_names(app), "--");
}

/// "lpvbake diff A B".
std::string usage_of(const CLI::App& app) {
    std::string text = "lpvbake " + app.get_name();
    for (const CLI::Option* option : app.get_options())
        if (option->get_positional())
            text += " " + option->get_name(true);
    return text;
}

std::string explain_in_command(const CLI::App& app, const CLI::ParseError& error) {
    if (error.get_exit_code() == int(CLI::ExitCodes::ExtrasError)) {
        const std::vector<std::string> extras = app.remaining();
        for (const std::string& extra : extras)
            if (extra.starts_with('-')) // values of it may follow
                return unknown_option(app, extra);
        if (!extras.empty())
            return "'" + extras.front() + "' is one argument too many: " + usage_of(app);
    }
    if (error.get_exit_code() == int(CLI::ExitCodes::RequiredError))
        for (const CLI::Option* option : app.get_options())
            if (option->get_required() && option->count() == 0)
                return option->get_name() + " is missing: " + usage_of(app);
    const std::string text = error.what();
    if (error.get_exit_code() == int(CLI::ExitCodes::ArgumentMismatch)) {
        const std::string name = text.substr(0, text.find(':'));
        if (const CLI::Option* option = app.get_option_no_throw(name))
            return option->count() > 1 ? name + " is given more than once; it takes one value"
                                       : name + " needs a value: " + option->get_type_name();
    }
    if (error.get_exit_code() == int(CLI::ExitCodes::ConversionError)) {
        const std::size_t begin = text.find("--"), end = text.find(" = ");
        if (begin < end && end != std::string::npos)
            return text.substr(begin, end - begin) + ": '" + text.substr(end + 3)
                   + "' is neither true nor false; leave it out";
    }
    return text;
}

} // namespace

std::string explain(const CLI::App& root, const CLI::ParseError& error,
                    const std::vector<std::string>& arguments) {
    const std::vector<CLI::App*> chosen = root.get_subcommands();
    if (!chosen.empty()) {
        const std::string& command = chosen.front()->get_name();
        return command + ": " + explain_in_command(*chosen.front(), error) + " (see lpvbake "
               + command + " --help)";
    }
    std::string text = "no command: lpvbake COMMAND ...";
    if (!arguments.empty() && arguments[0].starts_with('-')) {
        text = unknown_option(root, arguments[0]);
    } else if (!arguments.empty()) {
        std::vector<std::string> commands;
        for (const CLI::App* command : root.get_subcommands([](const CLI::App*) { return true; }))
            commands.push_back(command->get_name());
        text = "there is no command '" + arguments[0] + "'" + did_you_mean(arguments[0], commands);
    }
    return text + " (see lpvbake --help)";
}

std::string choices_of(const std::vector<const char*>& names) {
    std::string choices;
    for (const char* name : names)
        choices += (choices.empty() ? "" : "|") + std::string(name);
    return choices;
}

CLI::Validator one_of(const std::string& choices) {
    return {[choices](std::string& text) -> std::string {
                for (const std::string& choice : CLI::detail::split(choices, '|'))
                    if (choice == text)
                        return {};
                return "'" + text + "' is none of " + choices;
            },
            ""};
}

std::optional<double> parse_number(const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || std::isspace(static_cast<unsigned char>(text[0])) || *end != '\0'
        || !std::isfinite(value))
        return std::nullopt;
    return value;
}

CLI::Validator within(double lo, double hi, bool whole) {
    return {[lo, hi, whole](std::string& text) -> std::string {
                const std::optional<double> value = parse_number(text);
                const bool digits = text.find_first_not_of("0123456789") == std::string::npos;
                if (value && *value >= lo && *value <= hi && (digits || !whole))
                    return {};
                return "'" + text + "' is not a " + (whole ? "whole " : "") + "number from "
                       + toml_number(lo) + " to " + toml_number(hi);
            },
            ""};
}

bool has_extension(const std::string& path, const char* extension) {
    std::string own = std::filesystem::path(path).extension().string();
    for (char& c : own)
        c = char(std::tolower(static_cast<unsigned char>(c)));
    return own == extension;
}

CLI::Validator share_or_percent() {
    return {[](std::string& text) -> std::string {
                const bool is_percent = text.ends_with('%');
                const std::optional<double> value =
                    parse_number(text.substr(0, text.size() - is_percent));
                const double share = value.value_or(0) / (is_percent ? 100 : 1);
                if (!(share >= 1e-6 && share <= 1))
                    return "'" + text + "' is not a share from 1e-6 to 1, such as 0.01 or 1%";
                text = toml_number(share);
                return {};
            },
            ""};
}

void apply_config(CLI::App& app, const std::string& path) {
    for (const ConfigEntry& entry : read_config(path, app.get_name())) {
        const std::string place = path + ":" + std::to_string(entry.line) + ": ";
        CLI::Option* option = app.get_option_no_throw(entry.key); // a positional comes first
        if (!option)
            option = app.get_option_no_throw("--" + entry.key);
        if (!option || !option->get_configurable())
            throw Error(ErrorKind::argument, place + "'" + entry.key + "' is not an option of "
                                                 + app.get_name() + " that a file can set"
                                                 + did_you_mean(entry.key, long_names(app)));
        if (option->count() > 0)
            continue;
        const bool many = option->get_items_expected_max() > 1;
        if (entry.values.size() != 1 && !many)
            throw Error(ErrorKind::argument, place + entry.key + " takes one value");
        try {
            for (const std::string& value : entry.values)
                option->add_result(option->get_expected_max() == 0
                                       ? option->get_flag_value("--" + entry.key, value)
                                       : value);
            if (!entry.values.empty())
                option->run_callback();
        } catch (const CLI::ParseError& error) {
            throw Error(ErrorKind::argument, place + error.what());
        }
    }
}

std::string toml_flag(bool value) {
    return value ? "true" : "false";
}

std::string toml_array(const std::vector<std::string>& values) {
    std::string text = "[";
    for (const std::string& value : values)
        text += (text.size() > 1 ? ", " : "") + toml_string(value);
    return text + "]";
}

void print_config(const std::vector<Setting>& settings) {
    for (const Setting& setting : settings)
        std::printf("%s%s = %s\n", setting.given ? "" : "# ", setting.name, setting.toml.c_str());
}

} // namespace lpvbake
