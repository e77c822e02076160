// Numbers as text, and what names may be of.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace lpvbake {

/// At most 1023 characters; longer texts are cut.
__attribute__((format(printf, 1, 2))) inline std::string format(const char* pattern, ...) {
    char text[1024];
    __builtin_va_list arguments;
    __builtin_va_start(arguments, pattern);
    std::vsnprintf(text, sizeof text, pattern, arguments);
    __builtin_va_end(arguments);
    return text;
}

/// Two digits, and all before the point: "0.12", "5.3", "107".
inline std::string two_digits(double value) {
    return value < 99.5 ? format("%.2g", value) : format("%.0f", value);
}

/// "1 light", "2 lights", "3 patches"; `many` is `one` and an s unless given.
inline std::string counted(uint64_t count, const std::string& one, const std::string& many = "") {
    return std::to_string(count) + " " + (count == 1 ? one : many.empty() ? one + "s" : many);
}

/// Whether names of files have the character on any system: ASCII letters, digits, '_', '-', '.'.
inline bool is_of_file_names(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-'
           || c == '_' || c == '.';
}

/// What is said of a file, with its name in front unless it stands there; empty: it has none.
inline std::string about(const std::string& file, const std::string& text) {
    return file.empty() || text.starts_with(file) ? text : file + ": " + text;
}

} // namespace lpvbake
