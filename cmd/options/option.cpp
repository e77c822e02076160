#include "options/option.h"

#include "lpvbake/error.h"
#include "options/toml.h"
#include "options/wrapped.h"

#include <algorithm>

namespace lpvbake::cmd::options {
namespace {

std::string not_empty(const std::string& text) {
    if (text.empty())
        refuse(text, "is empty");
    return text;
}

} // namespace

Option& Option::record(Recorded when) {
    recorded = when;
    return *this;
}

Option& Option::implies(std::function<std::string()> what) {
    implied = std::move(what);
    return *this;
}

Option& Option::implies(const std::string& what) {
    return implies([what] { return what; });
}

Option& Option::exclude(std::vector<std::string> others) {
    excludes = std::move(others);
    return *this;
}

Option& Option::need(const std::string& other) {
    needs = other;
    return *this;
}

Option& Option::bare(const std::string& value) {
    alone = value;
    return *this;
}

Option& Option::require() {
    required = true;
    return *this;
}

Option& Option::keep_out_of_files() {
    in_files = false;
    return *this;
}

Option& Option::keep_to_one_run() {
    of_one_run = true;
    return *this;
}

std::string Option::name() const {
    return is_positional() ? names : names.substr(names.rfind("--") + 2);
}

bool Option::is_set() const {
    return !given.empty() && given.back() != usual;
}

void Option::take(const std::string& text) {
    std::string value;
    try {
        value = read(text);
        if (type == "X|X%" && parse_number(value).value_or(0) > 1)
            value = text; // above 1 a share is taken as a percentage alone
    } catch (const Error& error) {
        throw Error(error.kind, (is_positional() ? "" : "--") + name() + ": " + error.what());
    }
    if (!many)
        given.clear();
    given.push_back(value);
}

std::string Option::toml() const {
    if (many)
        return toml_array(given);
    std::string value = given.empty() ? usual : given.back();
    if (given.empty() && implied)
        value = implied();
    return quoted || value.ends_with('%') ? toml_value(value) : value;
}

std::string Option::toml_form() const {
    const std::string form = quoted ? toml_string(type) : type;
    return many ? std::string("[").append(form).append("]") : form;
}

Option& Options::flag(const std::string& names, bool& field, const std::string& help) {
    Option& option = add(names, "", help);
    option.quoted = false;
    option.usual = "false";
    option.read = [&field](const std::string& text) {
        if (text != "true" && text != "false")
            refuse(text, "is neither true nor false; leave it out");
        field = text == "true";
        return text;
    };
    return option;
}

Option& Options::text(const std::string& names, std::string& field, const char* type,
                      const std::string& help) {
    Option& option = add(names, type, help);
    option.usual = field;
    option.read = [&field](const std::string& text) { return field = not_empty(text); };
    return option;
}

Option& Options::texts(const std::string& names, std::vector<std::string>& field, const char* type,
                       const std::string& help) {
    return values(names, field, type, not_empty, help);
}

Option& Options::add(const std::string& names, const std::string& type, const std::string& help) {
    Option& option = rows_.emplace_back();
    option.names = names;
    option.type = type;
    option.help = help;
    option.group = group_;
    return option;
}

std::vector<const Option*> Options::listed() const {
    std::vector<const Option*> listed;
    for (const Option& option : rows_)
        if (option.listed)
            listed.push_back(&option);
    return listed;
}

Option* Options::find(std::string_view name) {
    const auto row = std::ranges::find_if(rows_, [&](const Option& o) { return o.name() == name; });
    return row == rows_.end() ? nullptr : &*row;
}

const Option* Options::find(std::string_view name) const {
    return const_cast<Options*>(this)->find(name);
}

void Options::check() const {
    for (const Option& option : rows_) {
        if (option.is_given())
            for (const std::string& other : option.excludes)
                if (find(other)->is_given())
                    throw Error(ErrorKind::argument,
                                "--" + option.name() + " and --" + other + " exclude each other");
        if (option.is_set() && !option.needs.empty() && !find(option.needs)->is_set())
            throw Error(ErrorKind::argument, "--" + option.name() + " needs --" + option.needs + " "
                                                 + find(option.needs)->type);
    }
}

bool Options::is_replaced(const Option& option) const {
    return !option.is_given() && std::ranges::any_of(rows_, [&](const Option& other) {
        return other.is_given() && std::ranges::count(other.excludes, option.name()) > 0;
    });
}

std::string Options::config(const std::string& command) const {
    std::string text("["), group;
    text.append(command).append("]\n");
    for (const Option& option : rows_) {
        if (!option.in_files || option.of_one_run || option.is_positional())
            continue;
        if (option.group != group)
            text.append("\n# ").append(option.group).append("\n");
        group = option.group;
        const bool known = !option.given.empty() || !option.usual.empty() || option.implied;
        const bool holds =
            known && !is_replaced(option) && (!option.given.empty() || !option.implied);
        text.append("\n# ").append(wrapped(option.help, 98, "# "));
        text.append(holds ? "\n" : "\n#").append(option.name()).append(" = ");
        text.append(known ? option.toml() : option.toml_form()).append("\n");
    }
    return text;
}

std::string Options::recorded() const {
    std::string text;
    for (const Option& option : rows_)
        if (option.recorded == Recorded::always
                ? !is_replaced(option)
                : option.recorded == Recorded::if_changed && option.is_set())
            text += (text.empty() ? "" : "; ") + option.name() + " = " + option.toml();
    return text;
}

} // namespace lpvbake::cmd::options
