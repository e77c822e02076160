#include "options/toml.h"

#include "lpvbake/error.h"
#include "options/values.h"

// Some files do not hold what the parser asserts of them, such as "[[["; it goes on to refuse them.
#undef NDEBUG // with it, it has the compiler assume that they do
#define TOML_ASSERT(expression) static_cast<void>(0)
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>

namespace lpvbake::cmd::options {
namespace {

class File {
public:
    explicit File(const std::string& path) : path_(path) {
        constexpr std::size_t limit = 1 << 20;
        std::ifstream file(path, std::ios::binary);
        text_.resize(limit + 1);
        // A folder opens, but does not read.
        if (!file || (!file.read(text_.data(), std::streamsize(text_.size())) && file.bad()))
            throw Error(ErrorKind::file, path + ": cannot be read");
        text_.resize(std::size_t(file.gcount()));
        if (text_.size() > limit)
            throw Error(ErrorKind::file, path + ": more than 1 MiB, not an option file");
        try {
            root_ = toml::parse(text_, path);
        } catch (const toml::parse_error& error) {
            fail(error);
        }
    }

    const toml::table& root() const { return root_; }

    [[noreturn]] void fail(const toml::source_region& place, const std::string& text) const {
        throw Error(ErrorKind::argument,
                    path_ + ":" + std::to_string(place.begin.line) + ": " + text);
    }

    /// The entries of a table in the order of the file, but for the one named `but`.
    std::vector<ConfigEntry> entries(const toml::table& table, const std::string& but,
                                     const std::string& expected) const {
        std::vector<std::pair<toml::source_position, ConfigEntry>> found;
        for (const auto& [key, node] : table) {
            if (key.str() == but)
                continue;
            if (node.is_table() || is_array_of_tables(node))
                fail(node.source(), "expected the table " + expected);
            found.push_back({key.source().begin,
                             {std::string(key.str()), values(node), int(key.source().begin.line)}});
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

    std::vector<std::string> values(const toml::node& node) const {
        if (const toml::array* array = node.as_array()) {
            std::vector<std::string> texts;
            for (const toml::node& each : *array)
                texts.push_back(value(each));
            return texts;
        }
        return {value(node)};
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
        if (const auto* real = node.as_floating_point()) {
            const std::string text = number_text(real->get());
            // 8.0 stays no whole number.
            return std::isfinite(real->get()) && std::floor(real->get()) == real->get()
                           && text.find_first_of(".e") == std::string::npos
                       ? text + ".0"
                       : text;
        }
        fail(node.source(), "expected a string, a number, true, false or an array of them");
    }

    std::string path_;
    std::string text_;
    toml::table root_;
};

} // namespace

std::vector<ConfigEntry> read_config(const std::string& path, const std::string& command) {
    const File file(path);
    const std::string expected = "[" + command + "]";
    std::vector<ConfigEntry> entries = file.entries(file.root(), command, expected);
    const toml::node* own = file.root().get(command);
    if (!own)
        return entries;
    if (!own->is_table())
        file.fail(own->source(), "expected the table " + expected);
    for (ConfigEntry& entry : file.entries(*own->as_table(), "", expected)) {
        if (std::ranges::find(entries, entry.key, &ConfigEntry::key) != entries.end())
            throw Error(ErrorKind::argument, path + ":" + std::to_string(entry.line) + ": "
                                                 + entry.key + " is set twice");
        entries.push_back(std::move(entry));
    }
    return entries;
}

std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name) {
    const File file(path);
    const std::string expected = "[[" + name + "]]";
    std::vector<std::vector<ConfigEntry>> tables{file.entries(file.root(), name, expected)};
    if (const toml::node* own = file.root().get(name)) {
        if (!File::is_array_of_tables(*own))
            file.fail(own->source(), "expected the table " + expected);
        for (const toml::node& each : *own->as_array())
            tables.push_back(file.entries(*each.as_table(), "", expected));
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

std::string toml_array(const std::vector<std::string>& values) {
    std::string text = "[";
    for (const std::string& value : values)
        text += (text.size() > 1 ? ", " : "") + toml_string(value);
    return text + "]";
}

} // namespace lpvbake::cmd::options
