#include "io/chart.h"

#include "text.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>

namespace lpvbake::io {
namespace {

constexpr int glyph_width = 5, glyph_height = 7, advance = glyph_width + 1;

struct Glyph {
    char letter;
    std::array<uint8_t, glyph_height> rows; ///< the lowest five bits, left to right
};

constexpr Glyph glyphs[] = {
    {'0', {0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e}},
    {'1', {0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e}},
    {'2', {0x0e, 0x11, 0x01, 0x06, 0x08, 0x10, 0x1f}},
    {'3', {0x1e, 0x01, 0x01, 0x0e, 0x01, 0x01, 0x1e}},
    {'4', {0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02}},
    {'5', {0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e}},
    {'6', {0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e}},
    {'7', {0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08}},
    {'8', {0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e}},
    {'9', {0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c}},
    {'.', {0x00, 0x00, 0x00, 0x00, 0x00, 0x0c, 0x0c}},
    {',', {0x00, 0x00, 0x00, 0x00, 0x0c, 0x04, 0x08}},
    {'-', {0x00, 0x00, 0x00, 0x0e, 0x00, 0x00, 0x00}},
    {'+', {0x00, 0x04, 0x04, 0x1f, 0x04, 0x04, 0x00}},
    {'=', {0x00, 0x00, 0x1f, 0x00, 0x1f, 0x00, 0x00}},
    {'%', {0x18, 0x19, 0x02, 0x04, 0x08, 0x13, 0x03}},
    {'a', {0x00, 0x00, 0x0e, 0x01, 0x0f, 0x11, 0x0f}},
    {'d', {0x01, 0x01, 0x0d, 0x13, 0x11, 0x13, 0x0d}},
    {'e', {0x00, 0x00, 0x0e, 0x11, 0x1f, 0x10, 0x0e}},
    {'f', {0x06, 0x09, 0x08, 0x1c, 0x08, 0x08, 0x08}},
    {'h', {0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x11}},
    {'i', {0x04, 0x00, 0x0c, 0x04, 0x04, 0x04, 0x0e}},
    {'m', {0x00, 0x00, 0x1a, 0x15, 0x15, 0x15, 0x15}},
    {'n', {0x00, 0x00, 0x16, 0x19, 0x11, 0x11, 0x11}},
    {'o', {0x00, 0x00, 0x0e, 0x11, 0x11, 0x11, 0x0e}},
    {'s', {0x00, 0x00, 0x0f, 0x10, 0x0e, 0x01, 0x1e}},
    {'t', {0x08, 0x08, 0x1c, 0x08, 0x08, 0x09, 0x06}},
    {'x', {0x00, 0x00, 0x11, 0x0a, 0x04, 0x0a, 0x11}},
    {'y', {0x00, 0x00, 0x11, 0x11, 0x0f, 0x01, 0x0e}},
    {'z', {0x00, 0x00, 0x1f, 0x02, 0x04, 0x08, 0x1f}},
};

constexpr glm::vec3 ink{0.9f}, paper{0.13f};

class Sheet {
public:
    Sheet(int width, int height) : pixels_{width, height, 3, {}} {
        for (int i = 0; i < width * height; ++i)
            pixels_.samples.insert(pixels_.samples.end(), {paper.x, paper.y, paper.z});
    }

    void put(int x, int y, glm::vec3 colour) {
        if (x >= 0 && y >= 0 && x < pixels_.width && y < pixels_.height)
            std::copy_n(
                &colour.x, 3,
                &pixels_
                     .samples[3 * (std::size_t(y) * std::size_t(pixels_.width) + std::size_t(x))]);
    }

    /// `anchor` is the share of the text's width that lies left of x.
    void write(std::string_view text, int x, int y, double anchor = 0) {
        x -= int(anchor * advance * double(text.size()));
        for (const char letter : text) {
            const auto* glyph = std::ranges::find(glyphs, letter, &Glyph::letter);
            for (int row = 0; glyph != std::end(glyphs) && row < glyph_height; ++row)
                for (int column = 0; column < glyph_width; ++column)
                    if (glyph->rows[std::size_t(row)] >> (glyph_width - 1 - column) & 1)
                        put(x + column, y + row, ink);
            x += advance;
        }
    }

    image::Pixels take() { return std::move(pixels_); }

private:
    image::Pixels pixels_;
};

} // namespace

image::Pixels chart(const image::Pixels& slice, const Grid& grid, int axis, const Legend& legend) {
    constexpr int left = 48, right = 24, top = 54, bottom = 30, bar_height = 12, steps = 4;
    Sheet sheet(left + slice.width + right, top + slice.height + bottom);

    sheet.write(legend.title, left, 4);
    for (int x = 0; x < slice.width; ++x)
        for (int y = 0; y < bar_height; ++y)
            sheet.put(left + x, 16 + y, legend.colour(double(x) / (slice.width - 1)));
    for (int step = 0; step <= steps; ++step) {
        const int x = left + (slice.width - 1) * step / steps;
        for (int y = 0; y < 3; ++y)
            sheet.put(x, 16 + bar_height + y, ink);
        sheet.write(format("%.3g", legend.value(double(step) / steps)), x, 33, 0.5);
    }

    for (int y = 0; y < slice.height; ++y)
        for (int x = 0; x < slice.width; ++x) {
            const float* from =
                &slice.samples[3 * (std::size_t(y) * std::size_t(slice.width) + std::size_t(x))];
            sheet.put(left + x, top + y, {from[0], from[1], from[2]});
        }
    const int across = axis == 0 ? 2 : 0, along = axis == 1 ? 2 : 1;
    for (int step = 0; step <= steps; ++step) {
        const double share = double(step) / steps;
        const int x = left + (slice.width - 1) * step / steps;
        const int y = top + (slice.height - 1) * step / steps;
        for (int tick = 0; tick < 3; ++tick) {
            sheet.put(x, top + slice.height + tick, ink);
            sheet.put(left - 1 - tick, y, ink);
        }
        const auto place = [&](int of, double at) { // of a turned grid from its corner
            return format("%.3g", (grid.is_turned() ? 0.0 : grid.origin[of])
                                      + grid.cell * grid.dims[of] * at);
        };
        sheet.write(place(across, share), x, top + slice.height + 5, 0.5);
        sheet.write(place(along, axis == 1 ? share : 1 - share), left - 5, y - 3, 1);
    }
    const auto name = [](int of) { return std::string(1, "xyz"[of]) + ", m"; };
    sheet.write(name(across), left + slice.width / 2, top + slice.height + 18, 0.5);
    sheet.write(name(along), 4, top - 16);
    return sheet.take();
}

} // namespace lpvbake::io
