// What texts of the command line say. All throw Error (argument) that says what is wrong with the
// text.
#pragma once

#include "scene/scene.h"
#include "volume/grid.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::cmd::options {

[[noreturn]] void refuse(const std::string& text, const std::string& why);

/// A finite number that is all of the text; none for any other text.
std::optional<double> parse_number(const std::string& text);
/// As many of them as separators part; none unless all are.
std::optional<std::vector<double>> parse_numbers(const std::string& text, char separator = ',');

/// A number from `lo` to `hi`, in digits alone if `whole`.
double number_within(const std::string& text, double lo, double hi, bool whole);

/// The shortest decimal that reads back as the same number.
std::string number_text(double value);
std::string number_text(float value);
template <class T>
requires std::is_integral_v<T> std::string number_text(T value) {
    return std::to_string(value);
}

/// "0.01", or "1%".
double parse_share(const std::string& text, double lo, double hi);

/// Seconds of "2s", "500ms", "1.5min", "2": above 0.
double parse_seconds(const std::string& text);

/// Bytes of "1500", "512M", "4G", "0.5T".
uint64_t parse_bytes(const std::string& text);

/// Reflections at most.
struct Bounces {
    std::optional<int> most; ///< none: all
};
/// "inf", or a whole number up to 10,000.
Bounces parse_bounces(const std::string& text);

/// "X0,Y0,Z0,X1,Y1,Z1", metres.
Bounds parse_bounds(const std::string& text);

/// A layer of cells.
struct Slice {
    int axis = 0; ///< 0 x, 1 y, 2 z
    int index = 0;
};
/// "z=16".
Slice parse_slice(const std::string& text);
/// Throws Error (argument) unless the layer is one of the grid's.
void check_slice(const Slice& slice, const Grid& grid);

/// True if the path ends in the extension (with its dot, lower case), in any case.
bool has_extension(const std::string& path, const char* extension);

/// The parts between separators.
std::vector<std::string> split(const std::string& text, char separator);

} // namespace lpvbake::cmd::options
