#include "command_line.h"

#include "error.h"

#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

namespace lpvbake {

CLI::Validator one_of(const char* choices) {
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
            throw Error(ExitCode::usage, place + "'" + entry.key + "' is not an option of "
                                             + app.get_name() + " that a file can set");
        if (option->count() > 0)
            continue;
        const bool many = option->get_items_expected_max() > 1;
        if (entry.values.size() != 1 && !many)
            throw Error(ExitCode::usage, place + entry.key + " takes one value");
        try {
            for (const std::string& value : entry.values)
                option->add_result(option->get_expected_max() == 0
                                       ? option->get_flag_value("--" + entry.key, value)
                                       : value);
            if (!entry.values.empty())
                option->run_callback();
        } catch (const CLI::ParseError& error) {
            throw Error(ExitCode::usage, place + error.what());
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
