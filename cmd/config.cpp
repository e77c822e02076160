#include "config.h"

#include "error.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <fstream>
#include <string_view>

namespace lpvbake {
namespace {

class Reader {
public:
    Reader(std::string path, std::string text) : path_(std::move(path)), text_(std::move(text)) {}

    /// The one table [name]; or, if `many`, a list of entries for each [[name]].
    std::vector<std::vector<ConfigEntry>> read(const std::string& name, bool many) {
        std::vector<std::vector<ConfigEntry>> tables(1);
        for (skip_blank(true); at_ < text_.size(); skip_blank(true)) {
            std::vector<ConfigEntry>& entries = tables.back();
            if (accept('[')) {
                const bool opened = !many || accept('[');
                if (const std::string table = word();
                    !opened || table != name || !accept(']') || (many && !accept(']')))
                    fail("expected the table " + (many ? "[[" + name + "]]" : "[" + name + "]"));
                if (many && !entries.empty())
                    tables.emplace_back();
            } else {
                ConfigEntry entry;
                entry.line = line_;
                entry.key = word();
                skip_blank(false);
                if (entry.key.empty() || !accept('='))
                    fail("expected key = value");
                for (const ConfigEntry& other : entries)
                    if (other.key == entry.key)
                        fail(entry.key + " is set twice");
                skip_blank(false);
                entry.values = values();
                entries.push_back(entry);
            }
            skip_blank(false);
            if (at_ < text_.size() && text_[at_] != '\n')
                fail("unexpected text after the value");
        }
        return tables;
    }

private:
    [[noreturn]] void fail(const std::string& text) const {
        throw Error(ErrorKind::argument, path_ + ":" + std::to_string(line_) + ": " + text);
    }

    bool accept(char c) {
        if (at_ >= text_.size() || text_[at_] != c)
            return false;
        ++at_;
        return true;
    }

    /// Passes spaces and comments, and line ends where the value may go on.
    void skip_blank(bool lines) {
        for (; at_ < text_.size(); ++at_) {
            const char c = text_[at_];
            if (c == '#')
                at_ = std::min(text_.find('\n', at_), text_.size()) - 1;
            else if (c == '\n' && lines)
                ++line_;
            else if (c != ' ' && c != '\t' && c != '\r')
                return;
        }
    }

    /// A bare key, number or boolean.
    std::string word() {
        const std::size_t begin = at_;
        while (at_ < text_.size()
               && (std::isalnum(static_cast<unsigned char>(text_[at_]))
                   || std::string_view("-_+.").find(text_[at_]) != std::string_view::npos))
            ++at_;
        return text_.substr(begin, at_ - begin);
    }

    std::string value() {
        if (accept('\'')) {
            const std::size_t end = text_.find_first_of("'\n", at_);
            if (end == std::string::npos || text_[end] == '\n')
                fail("a string does not end on its line");
            const std::string literal = text_.substr(at_, end - at_);
            at_ = end + 1;
            return literal;
        }
        if (!accept('"')) {
            const std::string bare = word();
            if (bare.empty())
                fail("expected a string, a number, true, false or an array of them");
            return bare;
        }
        std::string result;
        while (!accept('"')) {
            if (at_ >= text_.size() || text_[at_] == '\n')
                fail("a string does not end on its line");
            char c = text_[at_++];
            if (c == '\\') {
                const char code = at_ < text_.size() ? text_[at_++] : '\0';
                const std::size_t known = std::string_view("\"\\nt").find(code);
                if (known == std::string_view::npos)
                    fail("unknown escape in a string; '...' takes backslashes as they are");
                c = "\"\\\n\t"[known];
            }
            result += c;
        }
        return result;
    }

    std::vector<std::string> values() {
        if (!accept('['))
            return {value()};
        std::vector<std::string> result;
        for (skip_blank(true); !accept(']'); skip_blank(true)) {
            result.push_back(value());
            skip_blank(true);
            if (!accept(',') && (at_ >= text_.size() || text_[at_] != ']'))
                fail("an array misses a comma or its end");
        }
        return result;
    }

    std::string path_;
    std::string text_;
    std::size_t at_ = 0;
    int line_ = 1;
};

Reader open_config(const std::string& path) {
    constexpr std::size_t limit = 1 << 20;
    std::ifstream file(path, std::ios::binary);
    std::string text(limit + 1, '\0');
    // A folder opens, but does not read.
    if (!file || (!file.read(text.data(), std::streamsize(text.size())) && file.bad()))
        throw Error(ErrorKind::file, path + ": cannot be read");
    text.resize(std::size_t(file.gcount()));
    if (text.size() > limit)
        throw Error(ErrorKind::file, path + ": more than 1 MiB, not an option file");
    if (const std::size_t nul = text.find('\0'); nul != std::string::npos)
        throw Error(ErrorKind::argument,
                    path + ":"
                        + std::to_string(
                            1 + std::count(text.begin(), text.begin() + std::ptrdiff_t(nul), '\n'))
                        + ": has a NUL byte, so it is no text; write it anew");
    return {path, std::move(text)};
}

} // namespace

std::vector<ConfigEntry> read_config(const std::string& path, const std::string& command) {
    return open_config(path).read(command, false).front();
}

std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name) {
    return open_config(path).read(name, true);
}

std::string toml_string(const std::string& text) {
    std::string result = "\"";
    for (char c : text) {
        const std::size_t known = std::string_view("\"\\\n\t").find(c);
        if (known != std::string_view::npos) {
            result += '\\';
            result += "\"\\nt"[known];
        } else {
            result += c;
        }
    }
    return result + '"';
}

namespace {

template <class Float>
std::string shortest(Float value) {
    char digits[32];
    const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
    return {digits, end};
}

} // namespace

std::string toml_number(double value) {
    return shortest(value);
}

std::string toml_number(float value) {
    return shortest(value);
}

} // namespace lpvbake
