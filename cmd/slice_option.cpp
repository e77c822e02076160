#include "slice_option.h"

#include "error.h"

#include <charconv>

namespace lpvbake {

Slice parse_slice(const std::string& text, const Grid& grid) {
    Slice slice;
    const std::size_t axis = std::string("xyz").find(text[0]);
    const char* const end = text.data() + text.size();
    const auto is_index = [&] {
        const auto [stop, error] = std::from_chars(text.data() + 2, end, slice.index);
        return error == std::errc() && stop == end;
    };
    if (text.size() < 3 || axis == std::string::npos || text[1] != '=' || !is_index())
        throw Error(ErrorKind::argument, "--slice: '" + text + "' is not AXIS=INDEX, such as z=16");
    slice.axis = int(axis);
    const int last = grid.dims[slice.axis] - 1;
    if (slice.index < 0 || slice.index > last)
        throw Error(ErrorKind::argument, "--slice: '" + text
                                             + "' is outside the grid, whose last is " + text[0]
                                             + "=" + std::to_string(last));
    return slice;
}

} // namespace lpvbake
