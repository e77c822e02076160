// printf into a std::string.
#pragma once

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

} // namespace lpvbake
