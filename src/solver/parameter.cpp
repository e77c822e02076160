#include "solver/parameter.h"

#include "text.h"

#include <charconv>
#include <cmath>
#include <cstdint>

namespace lpvbake::solver {

std::string values_of(const Parameter& parameter) {
    if (parameter.kind != ValueKind::choice)
        return (parameter.kind == ValueKind::whole ? "whole numbers from " : "numbers from ")
               + value_text(parameter, parameter.lo) + " to " + value_text(parameter, parameter.hi);
    std::string names;
    for (const char* choice : parameter.choices)
        names += (names.empty() ? "" : ", ") + std::string(choice);
    return names;
}

std::optional<double> parse_value(const Parameter& parameter, std::string_view text) {
    if (parameter.kind == ValueKind::choice) {
        for (std::size_t i = 0; i < parameter.choices.size(); ++i)
            if (text == parameter.choices[i])
                return double(i);
        return std::nullopt;
    }
    double value = 0;
    const char* const end = text.data() + text.size();
    std::from_chars_result read{};
    if (parameter.kind == ValueKind::whole) {
        int64_t whole = 0;
        read = std::from_chars(text.data(), end, whole);
        value = double(whole);
    } else {
        read = std::from_chars(text.data(), end, value);
    }
    const bool number = read.ec == std::errc() && read.ptr == end;
    return number && is_value(parameter, value) ? std::optional(value) : std::nullopt;
}

bool is_value(const Parameter& parameter, double value) {
    if (parameter.kind != ValueKind::real && value != std::floor(value))
        return false;
    return parameter.kind == ValueKind::choice
               ? value >= 0 && value < double(parameter.choices.size())
               : value >= parameter.lo && value <= parameter.hi;
}

std::string value_text(const Parameter& parameter, double value) {
    if (parameter.kind == ValueKind::choice)
        return parameter.choices[std::size_t(value)];
    char text[32]; // the shortest that reads back
    const auto [end, error] = parameter.kind == ValueKind::whole
                                  ? std::to_chars(text, text + sizeof text, int64_t(value))
                                  : std::to_chars(text, text + sizeof text, value);
    return {text, end};
}

} // namespace lpvbake::solver
