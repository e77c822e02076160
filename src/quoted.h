// Texts of others in messages.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace lpvbake {

/// Bytes of the UTF-8 sequence that `text` begins with (RFC 3629); 0 if it begins with none.
inline size_t utf8_length(std::string_view text) {
    if (text.empty())
        return 0;
    const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
    if (byte(0) < 0x80)
        return 1;
    const size_t length = byte(0) >= 0xf0 ? 4 : byte(0) >= 0xe0 ? 3 : 2;
    if (byte(0) < 0xc2 || byte(0) > 0xf4 || text.size() < length)
        return 0;
    for (size_t i = 1; i < length; ++i)
        if ((byte(i) & 0xc0) != 0x80)
            return 0;
    const bool is_overlong =
        (byte(0) == 0xe0 && byte(1) < 0xa0) || (byte(0) == 0xf0 && byte(1) < 0x90);
    const bool is_surrogate = byte(0) == 0xed && byte(1) >= 0xa0;
    const bool is_past_the_end = byte(0) == 0xf4 && byte(1) >= 0x90;
    return is_overlong || is_surrogate || is_past_the_end ? 0 : length;
}

/// The text on one line of at most about `most` bytes: control characters as "\u000a", bytes that
/// are no UTF-8 as "\xff", and "..." for what is cut off.
inline std::string printable(std::string_view text, size_t most = 120) {
    std::string result;
    char escaped[8];
    while (!text.empty()) {
        if (result.size() >= most)
            return result + "...";
        const size_t length = utf8_length(text);
        const auto first = static_cast<unsigned char>(text[0]);
        const unsigned control =
            length == 2 && first == 0xc2 ? static_cast<unsigned char>(text[1]) : first;
        if (length == 0) {
            std::snprintf(escaped, sizeof escaped, "\\x%02x", static_cast<unsigned>(first));
            result += escaped;
        } else if (control < 0x20 || (control >= 0x7f && control < 0xa0)) {
            std::snprintf(escaped, sizeof escaped, "\\u%04x", control);
            result += escaped;
        } else {
            result += text.substr(0, length);
        }
        text.remove_prefix(length == 0 ? 1 : length);
    }
    return result;
}

/// What a library's exception says, without the name in brackets that it begins with.
inline std::string without_label(std::string_view what) {
    what.remove_prefix(std::min(what.size(), what.find("] ") + 2));
    return printable(what, 300);
}

/// On one line, and in quotes.
inline std::string in_quotes(std::string_view text) {
    return '"' + printable(text) + '"';
}

/// What lists of settings, "name = value; name = value", differ in, for a message: "vpls = 100, not
/// vpls = 192"; of any other texts both.
inline std::string apart(std::string_view own, std::string_view other) {
    const auto entries = [](std::string_view list) {
        std::vector<std::string_view> parts;
        for (std::size_t end = list.find("; "); end != list.npos; end = list.find("; ")) {
            parts.push_back(list.substr(0, end));
            list.remove_prefix(end + 2);
        }
        parts.push_back(list);
        return parts;
    };
    const auto beyond = [&](std::string_view list, std::string_view known) {
        const std::vector<std::string_view> there = entries(known);
        std::string text;
        for (const std::string_view entry : entries(list))
            if (std::find(there.begin(), there.end(), entry) == there.end())
                text.append(text.empty() ? "" : "; ").append(entry);
        return text.empty() ? "none such" : printable(text);
    };
    return beyond(own, other) + ", not " + beyond(other, own);
}

} // namespace lpvbake
