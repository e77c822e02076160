#include "options/values.h"

#include "lpvbake/error.h"

#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace lpvbake::cmd::options {
namespace {

bool is_digits(const std::string& text) {
    return !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
}

template <class Float>
std::string shortest(Float value) {
    char digits[32];
    return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

} // namespace

void refuse(const std::string& text, const std::string& why) {
    throw Error(ErrorKind::argument, "'" + text + "' " + why);
}

std::optional<double> parse_number(const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || std::isspace(static_cast<unsigned char>(text[0])) || *end != '\0'
        || !std::isfinite(value))
        return std::nullopt;
    return value;
}

std::optional<std::vector<double>> parse_numbers(const std::string& text, char separator) {
    std::vector<double> numbers;
    for (const std::string& part : split(text, separator)) {
        const std::optional<double> value = parse_number(part);
        if (!value)
            return std::nullopt;
        numbers.push_back(*value);
    }
    return numbers;
}

double number_within(const std::string& text, double lo, double hi, bool whole) {
    const std::optional<double> value = parse_number(text);
    if (!value || *value < lo || *value > hi || (whole && !is_digits(text)))
        refuse(text, std::string("is not a ") + (whole ? "whole " : "") + "number from "
                         + number_text(lo) + " to " + number_text(hi));
    return *value;
}

std::string number_text(double value) {
    return shortest(value);
}

std::string number_text(float value) {
    return shortest(value);
}

double parse_share(const std::string& text, double lo, double hi) {
    const bool is_percent = text.ends_with('%');
    const std::optional<double> value = parse_number(text.substr(0, text.size() - is_percent));
    const double share = is_percent ? value.value_or(0) / 100 : value.value_or(0);
    if (!value || share < lo || share > hi)
        refuse(text, "is not a share from " + number_text(lo) + " to " + number_text(hi)
                         + ", such as 0.01 or 1%");
    if (share > 1 && !is_percent)
        refuse(text, "is no share up to 1, such as 0.01; say " + text + "%, or for as much as that "
                         + number_text(float(100 * share)) + "%");
    return share;
}

double parse_seconds(const std::string& text) {
    for (const auto& [unit, scale] :
         {std::pair{"ms", 1e-3}, {"min", 60.0}, {"h", 3600.0}, {"s", 1.0}, {"", 1.0}})
        if (text.ends_with(unit)) {
            const auto value = parse_number(text.substr(0, text.size() - std::strlen(unit)));
            if (value && *value > 0)
                return *value * scale;
            break;
        }
    refuse(text, "is no time above 0, such as 500ms, 2s, 1.5min or 1h");
}

uint64_t parse_bytes(const std::string& text) {
    constexpr std::string_view units = "KMGT";
    std::string digits = text;
    int shift = 0;
    const auto last =
        char(std::toupper(static_cast<unsigned char>(text.empty() ? 0 : text.back())));
    if (const size_t unit = units.find(last); unit != std::string_view::npos) {
        digits.pop_back();
        shift = 10 * (int(unit) + 1);
    }
    const std::optional<double> value = parse_number(digits);
    if (!value || !(*value > 0) || !(std::ldexp(*value, shift) < 0x1p62))
        refuse(text, "is not a size such as 512M or 4G");
    return uint64_t(std::ldexp(*value, shift));
}

Bounces parse_bounces(const std::string& text) {
    if (text == "inf")
        return {};
    const std::optional<double> value = parse_number(text);
    if (!value || !is_digits(text) || *value > 10'000)
        refuse(text, "is neither a whole number from 0 to 10000 nor inf");
    return {int(*value)};
}

Bounds parse_bounds(const std::string& text) {
    const auto numbers = parse_numbers(text);
    if (!numbers || numbers->size() != 6)
        refuse(text, "is not six finite numbers x0,y0,z0,x1,y1,z1 in metres");
    Bounds bounds;
    for (int axis = 0; axis < 3; ++axis) {
        bounds.lo[axis] = (*numbers)[std::size_t(axis)];
        bounds.hi[axis] = (*numbers)[std::size_t(axis) + 3];
        if (bounds.lo[axis] > bounds.hi[axis])
            refuse(text, std::string("has ") + "xyz"[axis] + "0 above " + "xyz"[axis] + "1");
    }
    return bounds;
}

Slice parse_slice(const std::string& text) {
    Slice slice;
    const std::size_t axis = std::string("xyz").find(text[0]);
    const char* const end = text.data() + text.size();
    const auto is_index = [&] {
        const auto [stop, error] = std::from_chars(text.data() + 2, end, slice.index);
        return error == std::errc() && stop == end;
    };
    if (text.size() < 3 || axis == std::string::npos || text[1] != '=' || !is_index())
        refuse(text, "is not AXIS=INDEX, such as z=16");
    slice.axis = int(axis);
    return slice;
}

void check_slice(const Slice& slice, const Grid& grid) {
    const int last = grid.dims[slice.axis] - 1;
    const std::string axis = std::string(1, "xyz"[slice.axis]) + "=";
    if (slice.index < 0 || slice.index > last)
        throw Error(ErrorKind::argument, "--slice: '" + axis + std::to_string(slice.index)
                                             + "' is outside the grid, whose last is " + axis
                                             + std::to_string(last));
}

bool has_extension(const std::string& path, const char* extension) {
    std::string own = std::filesystem::path(path).extension().string();
    for (char& c : own)
        c = char(std::tolower(static_cast<unsigned char>(c)));
    return own == extension;
}

std::vector<std::string> split(const std::string& text, char separator) {
    std::vector<std::string> parts(1);
    for (const char c : text)
        if (c == separator)
            parts.emplace_back();
        else
            parts.back() += c;
    return parts;
}

} // namespace lpvbake::cmd::options
