// Pictures of slices.
#include "io/chart.h"
#include "io/slice.h"

#include "colour/colour.h"
#include "unit/volumes.h"

#include <cmath>
#include <numbers>

using namespace lpvbake;

namespace {

glm::vec3 pixel(const image::Pixels& picture, int x, int y) {
    const float* p = &picture.samples[size_t(y * picture.width + x) * 3];
    return {p[0], p[1], p[2]};
}

/// A dark volume of 4 x 3 x 2 cells, all valid.
Volume dark() {
    Volume volume;
    volume.grid = {{0, 0, 0}, 1, {4, 3, 2}};
    volume.sh.assign(4, std::vector<glm::vec3>(24));
    volume.validity.assign(24, 1);
    return volume;
}

} // namespace

TEST(Slice, CellsAreSquaresWithYUp) {
    Volume volume = dark();
    // Luminance L everywhere around has c_0 = L 2 sqrt(pi).
    const float c0 = float(2 * std::sqrt(std::numbers::pi));
    volume.sh[0][volume.grid.index({3, 2, 1})] = {10 * c0, 0, 2.14f * c0};
    const image::Pixels picture = io::slice_picture(volume, 2, 1, io::SliceScale{10.0f});
    EXPECT_EQ(picture.width, 256);
    EXPECT_EQ(picture.height, 192);
    EXPECT_EQ(picture.channels, 3);
    for (glm::ivec2 at : {glm::ivec2(192, 0), glm::ivec2(255, 63)}) {
        EXPECT_NEAR(pixel(picture, at.x, at.y).r, 1.0, 1e-6);
        EXPECT_EQ(pixel(picture, at.x, at.y).g, 0.0f);
        // sRGB 0.5 is 0.21404 in linear light.
        EXPECT_NEAR(pixel(picture, at.x, at.y).b, 0.5, 1e-4);
    }
    EXPECT_EQ(pixel(picture, 191, 0), glm::vec3(0));
    EXPECT_EQ(pixel(picture, 192, 64), glm::vec3(0));
    const image::Pixels other = io::slice_picture(volume, 2, 0, io::SliceScale{10.0f});
    EXPECT_EQ(other.samples, std::vector<float>(other.samples.size(), 0.0f));
}

TEST(Slice, OtherAxes) {
    Volume volume = dark();
    volume.sh[0][volume.grid.index({3, 0, 1})] = glm::vec3(100);
    const image::Pixels top = io::slice_picture(volume, 1, 0, io::SliceScale{}); // x right, z down
    EXPECT_EQ(top.width, 256);
    EXPECT_EQ(top.height, 128);
    EXPECT_NEAR(pixel(top, 255, 127).g, 1, 1e-6);
    EXPECT_EQ(pixel(top, 255, 0), glm::vec3(0));
    const image::Pixels side = io::slice_picture(volume, 0, 3, io::SliceScale{}); // z right, y up
    EXPECT_EQ(side.height, 3 * side.width / 2);
    EXPECT_GE(side.height, 256);
    EXPECT_NEAR(pixel(side, side.width - 1, side.height - 1).g, 1, 1e-6);
    EXPECT_EQ(pixel(side, 0, side.height - 1), glm::vec3(0));
}

TEST(Slice, ExposesForThe99thPercentile) {
    Volume volume;
    volume.grid = {{0, 0, 0}, 1, {101, 2, 1}};
    volume.sh.assign(4, std::vector<glm::vec3>(202));
    for (size_t i = 0; i < 101; ++i) // half of the slice stays black and does not count
        volume.sh[0][i] = glm::vec3(float(i + 1));
    const image::Pixels picture = io::slice_picture(volume, 2, 0);
    const int block = picture.width / 101;
    const auto at = [&](int x) { return pixel(picture, x * block, picture.height - 1).x; };
    EXPECT_NEAR(at(100), 1.0f, 1e-6);
    EXPECT_NEAR(at(99), 1.0f, 1e-6); // the hundredth of 101 values
    EXPECT_LT(at(98), 0.9999f);
    EXPECT_GT(at(98), 0.99f);
}

TEST(Slice, ShowsWhatIsDarkBesideWhatIsBright) {
    Volume volume;
    volume.grid = {{0, 0, 0}, 1, {100, 1, 1}};
    volume.sh.assign(1, std::vector<glm::vec3>(100));
    const float c0 = float(2 * std::sqrt(std::numbers::pi));
    for (std::size_t i = 0; i < 100; ++i) // most are dark: 1 to 2 nits; ten go up to 400
        volume.sh[0][i] = glm::vec3(c0 * (i < 90 ? 1 + float(i) / 90 : 40 * float(i - 89)));
    const io::SliceScale scale = io::slice_scale(volume, 2, 0);
    EXPECT_NEAR(scale.white, 360, 1e-3) << "the 99th percentile";
    const image::Pixels picture = io::slice_picture(volume, 2, 0);
    const int block = picture.width / 100;
    const auto at = [&](int x) { return pixel(picture, x * block, 0).x; };
    for (int x = 1; x < 99; ++x)
        EXPECT_GT(at(x), at(x - 1)) << x << ": no two luminances are one grey";
    EXPECT_NEAR(scale.luminance_at(at(30)), 1 + 30.0 / 90, 1e-3)
        << "the legend's numbers are right";
    const double median = colour::srgb_to_linear(at(49));
    EXPECT_NEAR(median, 0.1, 1e-4);
    // What no light gets to does not count, however much it is.
    Volume cave = volume;
    cave.grid.dims = {1000, 1, 1};
    cave.sh[0].resize(1000, glm::vec3(1e-4f));
    EXPECT_EQ(io::slice_scale(cave, 2, 0).exponent, scale.exponent);
}

TEST(Slice, AChartHasAxesAndALegend) {
    Volume volume = dark();
    const image::Pixels slice = io::slice_picture(volume, 2, 0);
    const io::Legend legend{"z = 0, nits", [](double share) { return glm::vec3(float(share)); },
                            [](double share) { return 1234 * share; }};
    const image::Pixels chart = io::chart(slice, volume.grid, 2, legend);
    const glm::ivec2 corner(48, 54);
    for (glm::ivec2 at : {glm::ivec2(0, 0), glm::ivec2(255, 191), glm::ivec2(100, 7)})
        EXPECT_EQ(pixel(chart, corner.x + at.x, corner.y + at.y), pixel(slice, at.x, at.y));
    EXPECT_EQ(pixel(chart, corner.x, 20), glm::vec3(0)) << "the bar runs from black";
    EXPECT_EQ(pixel(chart, corner.x + 255, 20), glm::vec3(1)) << "to white";
    const auto ink_in = [&](const image::Pixels& of, int x0, int y0, int x1, int y1) {
        int count = 0;
        for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x)
                count += pixel(of, x, y) == glm::vec3(0.9f);
        return count;
    };
    EXPECT_GT(ink_in(chart, 0, 0, chart.width, 12), 50) << "the title";
    EXPECT_GT(ink_in(chart, 0, 32, chart.width, 41), 50) << "the legend's numbers";
    EXPECT_GT(ink_in(chart, 0, 60, 48, chart.height), 50) << "the upward axis";
    EXPECT_GT(ink_in(chart, 48, corner.y + 192, chart.width, chart.height), 50) << "the other";
    // Numbers are those of the axis: elsewhere they are others.
    volume.grid.origin.x = -3;
    const image::Pixels moved = io::chart(slice, volume.grid, 2, legend);
    EXPECT_NE(moved.samples, chart.samples);
    EXPECT_EQ(ink_in(moved, 0, 0, moved.width, 41), ink_in(chart, 0, 0, chart.width, 41));
}

TEST(Slice, MarksTheInsideOfGeometry) {
    Volume volume = dark();
    volume.validity[volume.grid.index({1, 2, 0})] = 0;
    const image::Pixels picture = io::slice_picture(volume, 2, 0);
    int hatched = 0;
    for (int y = 0; y < picture.height; ++y)
        for (int x = 0; x < picture.width; ++x) {
            const glm::vec3 colour = pixel(picture, x, y);
            if (colour == glm::vec3(0))
                continue;
            EXPECT_TRUE(x >= 64 && x < 128 && y < 64) << x << ' ' << y;
            EXPECT_EQ(colour, glm::vec3(0.3f, 0, 0.3f));
            ++hatched;
        }
    EXPECT_NEAR(hatched, 64 * 64 / 2, 64 * 64 / 10);
}

TEST(Slice, RejectsSlicesThatDoNotExist) {
    const Volume volume = dark();
    for (glm::ivec2 bad :
         {glm::ivec2(2, 2), glm::ivec2(2, -1), glm::ivec2(3, 0), glm::ivec2(-1, 0)})
        EXPECT_EQ(error_of("4 x 3 x 2", [&] { io::slice_picture(volume, bad.x, bad.y); }).kind,
                  ErrorKind::argument);
}

TEST(Slice, PngIsWrittenWhole) {
    const TemporaryFolder folder;
    io::write_png(folder / "a.png", io::slice_picture(dark(), 2, 0));
    const std::string bytes = slurp(folder / "a.png");
    const image::Rgba8 image =
        image::decode_image(std::as_bytes(std::span(bytes)), "a.png", 1 << 20);
    EXPECT_EQ(image.width, 256);
    EXPECT_EQ(folder.count(), 1);
    EXPECT_EQ(
        error_of("none",
                 [&] { io::write_png(folder / "none/a.png", io::slice_picture(dark(), 2, 0)); })
            .kind,
        ErrorKind::file);
}
