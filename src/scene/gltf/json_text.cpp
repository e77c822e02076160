#include "scene/gltf/json_text.h"

#include "lpvbake/error.h"
#include "quoted.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdlib>
#include <optional>

namespace lpvbake::scene::gltf {
namespace {

using nlohmann::json;

constexpr int max_depth = 200;

/// JSON text copied so that it parses, token by token.
class Reader {
public:
    explicit Reader(std::string_view text) : rest_(text), size_(text.size()) {}

    std::string copy() {
        while (!rest_.empty())
            if (rest_[0] == '"')
                copy_string();
            else if (const std::string_view token = rest_.substr(0, rest_.find_first_not_of(word));
                     !token.empty())
                copy_token(token);
            else
                keep(1);
        return std::move(copy_);
    }

    std::optional<size_t> first_byte_of_latin1; ///< that is no UTF-8

private:
    static constexpr std::string_view word =
        "+-.0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";

    void keep(size_t count) {
        copy_ += rest_.substr(0, count);
        rest_.remove_prefix(std::min(count, rest_.size()));
    }

    void copy_token(std::string_view token) {
        const bool is_word = token == "NaN" || token == "Infinity" || token == "-Infinity";
        const bool is_number = token[0] == '-' || (token[0] >= '0' && token[0] <= '9');
        if (!is_word
            && !(is_number && std::isinf(std::strtod(std::string(token).c_str(), nullptr))))
            return keep(token.size());
        copy_ += "null";
        rest_.remove_prefix(token.size());
    }

    void copy_string() {
        keep(1);
        while (!rest_.empty() && rest_[0] != '"') {
            if (rest_[0] == '\\') {
                copy_escape();
            } else if (const size_t length = utf8_length(rest_); length > 0) {
                keep(length);
            } else {
                if (!first_byte_of_latin1)
                    first_byte_of_latin1 = size_ - rest_.size();
                const auto code = static_cast<unsigned char>(rest_[0]);
                copy_ += static_cast<char>(0xc0 | code >> 6);
                copy_ += static_cast<char>(0x80 | (code & 0x3f));
                rest_.remove_prefix(1);
            }
        }
        keep(1);
    }

    /// Half of a surrogate pair, which no character has, is replaced.
    void copy_escape() {
        const auto unit = [&](size_t at) {
            const std::string digits(rest_.substr(std::min(at + 2, rest_.size()), 4));
            const bool is_one =
                rest_.substr(std::min(at, rest_.size())).starts_with("\\u")
                && digits.find_first_not_of("0123456789abcdefABCDEF") == std::string::npos;
            return is_one ? std::strtoul(digits.c_str(), nullptr, 16) : 0;
        };
        const unsigned long first = unit(0);
        if (first < 0xd800 || first > 0xdfff)
            return keep(2);
        const unsigned long second = first < 0xdc00 ? unit(6) : 0;
        if (second >= 0xdc00 && second <= 0xdfff)
            return keep(12);
        copy_ += "\\ufffd";
        rest_.remove_prefix(std::min<size_t>(6, rest_.size()));
    }

    std::string_view rest_;
    size_t size_;
    std::string copy_;
};

} // namespace

uint64_t json_elements(std::string_view text, const std::string& file) {
    uint64_t elements = 1;
    int depth = 0;
    bool in_string = false;
    for (size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (in_string) {
            if (c == '\\')
                ++i;
            else if (c == '"')
                in_string = false;
            continue;
        }
        in_string = c == '"';
        elements += c == ',' || c == '[' || c == '{';
        if (c == '[' || c == '{') {
            if (++depth > max_depth)
                throw Error(ErrorKind::invalid, file + ": the JSON is nested more than "
                                                    + std::to_string(max_depth)
                                                    + " levels deep; glTF needs a dozen");
        } else if (c == ']' || c == '}') {
            --depth;
        }
    }
    return elements;
}

json parse_json(std::string_view text, const std::string& file, Warnings& warnings) {
    if (json parsed = json::parse(text, nullptr, false); !parsed.is_discarded())
        return parsed;
    Reader reader(text);
    const std::string copy = reader.copy();
    try {
        json parsed = json::parse(copy);
        if (reader.first_byte_of_latin1)
            warnings.add("Latin-1", "byte " + std::to_string(*reader.first_byte_of_latin1),
                         "the text is not UTF-8: it is read as Latin-1; save it as UTF-8");
        return parsed;
    } catch (const json::exception& error) {
        throw Error(ErrorKind::invalid, file + ": is not JSON: " + without_label(error.what())
                                            + "; is it a glTF file, and whole?");
    }
}

} // namespace lpvbake::scene::gltf
