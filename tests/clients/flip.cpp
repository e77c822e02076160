// FLIP of two pictures as they are shown: flip A B prints a number from 0 to 1.
#include "render/flip.h"

#include "image/image.h"
#include "lpvbake/error.h"

#include <cstdio>
#include <fstream>
#include <iterator>

namespace {

lpvbake::image::Pixels read(const char* path) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(file), {});
    const lpvbake::image::Rgba8 image =
        lpvbake::image::decode_image(std::as_bytes(std::span(bytes)), path, 1 << 24);
    lpvbake::image::Pixels pixels{image.width, image.height, 3, {}};
    for (std::size_t i = 0; i < image.texels.size(); ++i)
        if (i % 4 != 3)
            pixels.samples.push_back(float(image.texels[i]) / 255.0f);
    return pixels;
}

} // namespace

int main(int count, char** arguments) {
    if (count != 3)
        return 1;
    try {
        const lpvbake::image::Pixels a = read(arguments[1]), b = read(arguments[2]);
        if (a.width != b.width || a.height != b.height)
            return 1;
        std::printf("%.4f\n", lpvbake::render::flip(a, b));
    } catch (const lpvbake::Error& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
