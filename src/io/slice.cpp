#include "io/slice.h"

#include "colour/colour.h"
#include "colour/metering.h"
#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "volume/sh.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::io {
namespace {

/// The cells of a slice by rows from the top left: mean luminance, and whether inside geometry.
struct Layer {
    int width = 0, height = 0;
    std::vector<glm::vec3> colours;
    std::vector<bool> inside;
};

Layer layer_of(const Volume& volume, int axis, int index) {
    const glm::ivec3 dims = volume.grid.dims;
    if (axis < 0 || axis > 2 || index < 0 || index >= dims[axis])
        throw Error(ErrorKind::argument,
                    std::string("there is no slice ") + "xyz?"[axis & 3] + "="
                        + std::to_string(index) + "; the grid has " + std::to_string(dims.x) + " x "
                        + std::to_string(dims.y) + " x " + std::to_string(dims.z) + " cells");
    const int right = axis == 0 ? 2 : 0;
    const int vertical = axis == 1 ? 2 : 1;
    Layer layer{dims[right], dims[vertical], {}, {}};
    for (int row = 0; row < layer.height; ++row)
        for (int column = 0; column < layer.width; ++column) {
            glm::ivec3 cell;
            cell[axis] = index;
            cell[right] = column;
            cell[vertical] = axis == 1 ? row : layer.height - 1 - row;
            const size_t i = volume.grid.index(cell);
            layer.colours.push_back(volume::sh_y0 * volume.sh[0][i]);
            layer.inside.push_back(!volume.validity.empty() && volume.validity[i] == 0);
        }
    return layer;
}

SliceScale scale_of(const Layer& layer) {
    std::vector<float> luminances;
    for (size_t i = 0; i < layer.colours.size(); ++i)
        if (!layer.inside[i])
            luminances.push_back(
                float(glm::dot(glm::dvec3(layer.colours[i]), colour::rec709_luminance)));
    const std::vector<float> lit = colour::lit_of(std::move(luminances));
    if (lit.empty())
        return {};
    const float white = lit[(lit.size() - 1) * 99 / 100], median = lit[(lit.size() - 1) / 2];
    return {white, white > 10 * median ? 1 / std::log10(white / median) : 1};
}

} // namespace

double SliceScale::luminance_at(double grey) const {
    return white * std::pow(colour::srgb_to_linear(grey), 1 / exponent);
}

SliceScale slice_scale(const Volume& volume, int axis, int index) {
    return scale_of(layer_of(volume, axis, index));
}

image::Pixels slice_picture(const Volume& volume, int axis, int index,
                            std::optional<SliceScale> scale) {
    const Layer layer = layer_of(volume, axis, index);
    const auto& [width, height, colours, inside] = layer;
    const auto [white, exponent] = scale.value_or(scale_of(layer));
    // The curve is that of luminance, so that colours keep their hue.
    const auto shown = [white = white, exponent = exponent](glm::vec3 light) {
        const auto share = float(glm::dot(glm::dvec3(light), colour::rec709_luminance)) / white;
        return exponent == 1 || !(share > 0) ? light / white
                                             : light / white * std::pow(share, exponent - 1);
    };

    const int block = std::max(1, (255 + std::max(width, height)) / std::max(width, height));
    const int stripe = std::max(1, block / 4);
    image::Pixels picture{width * block, height * block, 3, {}};
    picture.samples.reserve(size_t(picture.width) * size_t(picture.height) * 3);
    for (int y = 0; y < picture.height; ++y)
        for (int x = 0; x < picture.width; ++x) {
            const size_t cell = size_t(y / block) * size_t(width) + size_t(x / block);
            const bool hatched = inside[cell] && (x + y) / stripe % 2 == 0;
            const glm::vec3 colour = shown(colours[cell]);
            for (int c = 0; c < 3; ++c)
                picture.samples.push_back(
                    hatched ? (c == 1 ? 0.0f : 0.3f)
                            : colour::linear_to_srgb(std::clamp(colour[c], 0.0f, 1.0f)));
        }
    return picture;
}

glm::vec3 false_colour(double share) {
    const auto t = float(3 * std::clamp(share, 0.0, 1.0));
    return glm::clamp(glm::vec3(t, t - 1, t - 2), 0.0f, 1.0f);
}

double error_white(std::vector<float> errors) {
    std::erase_if(errors, [](float error) { return !(error > 0); });
    if (errors.empty())
        return 1;
    std::ranges::sort(errors);
    const auto quantile = [&](std::size_t percent) {
        return double(errors[(errors.size() - 1) * percent / 100]);
    };
    return std::min({quantile(99), 6 * quantile(50), double(std::numeric_limits<float>::max())});
}

void write_png(const std::string& path, const image::Pixels& pixels) {
    AtomicFile file(path);
    const auto bytes = image::encode_png(pixels, path);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    file.seal();
    file.publish();
}

} // namespace lpvbake::io
