#include "options/toml.h"

#include "lpvbake/error.h"
#include "options/values.h"

// Some files do not hold what the parser asserts of them, such as "[[["; it goes on to refuse them.
#undef NDEBUG // with it, it has the compiler assume that they do
#define TOML_ASSERT(expression) static_cast<void>(0)
#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <optional>

namespace lpvbake::cmd::options {
namespace {

/// 8.0 stays no whole number.
std::string real_text(double value) {
    const std::string text = number_text(value);
    const bool looks_whole = std::isfinite(value) && text.find_first_of(".e") == std::string::npos;
    return looks_whole ? text + ".0" : text;
}

/// Whether TOML reads a number that prints as this text.
bool is_number(const std::string& text) {
    int64_t whole = 0;
    const char* const end = text.data() + text.size();
    if (const auto [stop, error] = std::from_chars(text.data(), end, whole);
        error == std::errc() && stop == end)
        return std::to_string(whole) == text;
    const std::optional<double> real = parse_number(text);
    return real && real_text(*real) == text;
}

class File {
public:
    File(std::string text, const std::string& name) : path_(name), text_(std::move(text)) {
        try {
            root_ = toml::parse(text_, path_);
        } catch (const toml::parse_error& error) {
            fail(error);
        }
    }

    const toml::table& root() const { return root_; }

    [[noreturn]] void fail(const toml::source_region& place, const std::string& text) const {
        throw Error(ErrorKind::argument,
                    path_ + ":" + std::to_string(place.begin.line) + ": " + text);
    }

    /// The entries of a table in the order of the file, but for those of which `is_table` is true.
    std::vector<ConfigEntry> entries(const toml::table& table, const auto& is_table,
                                     const std::string& expected) const {
        std::vector<std::pair<toml::source_position, ConfigEntry>> found;
        for (const auto& [key, node] : table) {
            if (is_table(key.str(), node))
                continue;
            if (node.is_table() || is_array_of_tables(node))
                fail(node.source(), "expected the table " + expected);
            found.push_back({key.source().begin,
                             entry(std::string(key.str()), node, int(key.source().begin.line))});
        }
        std::ranges::sort(found, {}, [](const auto& each) {
            return std::pair(each.first.line, each.first.column);
        });
        std::vector<ConfigEntry> entries;
        entries.reserve(found.size());
        for (auto& [place, entry] : found)
            entries.push_back(std::move(entry));
        return entries;
    }

    static bool is_array_of_tables(const toml::node& node) {
        return node.is_array() && !node.as_array()->empty()
               && node.as_array()->is_array_of_tables();
    }

private:
    [[noreturn]] void fail(const toml::parse_error& error) const {
        std::string text(error.description());
        if (text.find("redefine existing") != std::string::npos) {
            std::size_t begin = 0;
            for (auto line = error.source().begin.line; line > 1; --line)
                begin = text_.find('\n', begin) + 1;
            const std::string line = text_.substr(begin, text_.find('\n', begin) - begin);
            if (const std::size_t end = line.find_first_of(" \t=", 0); end != std::string::npos)
                text = line.substr(0, end) + " is set twice";
        }
        fail(error.source(), text);
    }

    ConfigEntry entry(const std::string& key, const toml::node& node, int line) const {
        ConfigEntry entry{key, {}, value(node, ','), false, line};
        const toml::array* array = node.as_array();
        if (!array)
            entry.values = {entry.whole};
        else
            for (const toml::node& each : *array)
                entry.values.push_back(value(each, ','));
        entry.is_numbers = array && !array->empty() && array->front().is_number();
        return entry;
    }

    /// Parts of an array stand between `separator`, of arrays in it between colons.
    std::string value(const toml::node& node, char separator) const {
        const toml::array* array = node.as_array();
        if (!array)
            return value(node);
        std::string text;
        for (const toml::node& each : *array) {
            if (&each != &array->front())
                text += separator;
            text += value(each, ':');
        }
        return text;
    }

    std::string value(const toml::node& node) const {
        if (const auto* text = node.as_string()) {
            if (text->get().find('\0') != std::string::npos)
                fail(node.source(), "a string holds a NUL character");
            return text->get();
        }
        if (const auto* flag = node.as_boolean())
            return flag->get() ? "true" : "false";
        if (const auto* whole = node.as_integer())
            return std::to_string(whole->get());
        if (const auto* real = node.as_floating_point())
            return real_text(real->get());
        fail(node.source(), "expected a string, a number, true, false or an array of them");
    }

    std::string path_;
    std::string text_;
    toml::table root_;
};

std::string text_of(const std::string& path) {
    constexpr std::size_t limit = 1 << 20;
    std::ifstream file(path, std::ios::binary);
    std::string text(limit + 1, '\0');
    // A folder opens, but does not read.
    if (!file || (!file.read(text.data(), std::streamsize(text.size())) && file.bad()))
        throw Error(ErrorKind::file, path + ": cannot be read");
    text.resize(std::size_t(file.gcount()));
    if (text.size() > limit)
        throw Error(ErrorKind::file, path + ": more than 1 MiB, not an option file");
    return text;
}

} // namespace

std::vector<ConfigTable> read_config(const std::string& path) {
    return parse_config(text_of(path), path);
}

std::vector<ConfigTable> parse_config(std::string text, const std::string& name) {
    const File file(std::move(text), name);
    const auto is_table = [](std::string_view, const toml::node& node) { return node.is_table(); };
    const auto none = [](std::string_view, const toml::node&) { return false; };
    std::vector<ConfigTable> tables{{"", file.entries(file.root(), is_table, "of a command"), 1}};
    for (const auto& [key, node] : file.root())
        if (const toml::table* table = node.as_table())
            tables.push_back({std::string(key.str()), file.entries(*table, none, "of a command"),
                              int(key.source().begin.line)});
    return tables;
}

std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name) {
    const File file(text_of(path), path);
    const std::string expected = "[[" + name + "]]";
    const auto is_own = [&](std::string_view key, const toml::node&) { return key == name; };
    const auto none = [](std::string_view, const toml::node&) { return false; };
    std::vector<std::vector<ConfigEntry>> tables{file.entries(file.root(), is_own, expected)};
    if (const toml::node* own = file.root().get(name)) {
        if (!File::is_array_of_tables(*own))
            file.fail(own->source(), "expected the table " + expected);
        for (const toml::node& each : *own->as_array())
            tables.push_back(file.entries(*each.as_table(), none, expected));
    }
    std::erase_if(tables, [](const auto& table) { return table.empty(); });
    return tables;
}

std::string toml_string(const std::string& text) {
    std::string result = "\"";
    for (const char c : text) {
        const std::size_t known = std::string_view("\"\\\n\t").find(c);
        if (known != std::string_view::npos) {
            result += '\\';
            result += "\"\\nt"[known];
        } else if (static_cast<unsigned char>(c) < ' ' || c == 127) {
            char code[8];
            std::snprintf(code, sizeof code, "\\u%04X", c);
            result += code;
        } else {
            result += c;
        }
    }
    return result + '"';
}

std::string toml_value(const std::string& text) {
    const std::vector<std::string> parts = split(text, ',');
    if (parts.size() == 1 || !std::all_of(parts.begin(), parts.end() - 1, is_number))
        return toml_string(text);
    std::string array;
    for (const std::string& part : parts) {
        array += array.empty() ? "[" : ", ";
        array += is_number(part) ? part : toml_string(part);
    }
    return array + "]";
}

std::string toml_array(const std::vector<std::string>& values) {
    std::string text = "[";
    for (const std::string& value : values) {
        text += text.size() > 1 ? ", " : "";
        text += toml_value(value);
    }
    return text + "]";
}

} // namespace lpvbake::cmd::options
