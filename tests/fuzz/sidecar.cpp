// Sidecars of flipbooks: JSON and, after a byte of 0, floats that fill the pictures it names, of
// which a.exr and b.exr are there.
#include "fuzz.h"

#include "image/image.h"
#include "io/exr.h"
#include "io/layout.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <cstring>
#include <span>

namespace lpvbake {
namespace {

/// What the pictures of the input look like.
struct {
    int width = 1, height = 1, channels = 3;
    std::span<const uint8_t> floats;
} picture;

} // namespace

} // namespace lpvbake

namespace lpvbake::image {

/// In place of what reads and writes pictures.
Pixels decode_exr(std::span<const std::byte>, const std::string&, uint64_t) {
    Pixels pixels{picture.width, picture.height, picture.channels, {}};
    pixels.samples.resize(size_t(picture.width) * size_t(picture.height)
                          * size_t(picture.channels));
    for (size_t i = 0; picture.floats.size() >= 4 && i < pixels.samples.size(); ++i)
        std::memcpy(&pixels.samples[i], &picture.floats[i % (picture.floats.size() / 4) * 4], 4);
    return pixels;
}

Rgba8 decode_image(std::span<const std::byte>, const std::string&, uint64_t) {
    std::abort();
}

std::vector<unsigned char> encode_png(const Pixels&, const std::string&) {
    std::abort();
}

std::vector<unsigned char>
encode_exr(const Pixels&, bool, const std::map<std::string, std::string>&, const std::string&) {
    std::abort();
}

} // namespace lpvbake::image

namespace lpvbake {
namespace {

/// Takes the pictures' size from the sidecar, where that can be told. False where a volume would be
/// large: how much memory a machine has is not at stake here.
bool prepare(const std::string& json) {
    picture.width = picture.height = 1;
    picture.channels = 3;
    try {
        const auto root = nlohmann::json::parse(json);
        const auto& dims = root.at("grid").at("dims");
        const auto number = [](const nlohmann::json& value) {
            return value.is_number() ? value.get<double>() : 0;
        };
        const double x = number(dims.at(0)), y = number(dims.at(1)), z = number(dims.at(2));
        const double columns = number(root.at("layout").at("columns"));
        const double rows = number(root.at("layout").at("rows"));
        if (!(x * y * z < 1e5) || !(x * columns * y * rows < 1e5))
            return false;
        picture.width = int(std::clamp(x * columns, 1.0, 1e5));
        picture.height = int(std::clamp(y * rows, 1.0, 1e5));
        picture.channels = int(root.at("files").at(0).at("channels").size());
    } catch (const nlohmann::json::exception&) {
    }
    return picture.channels <= 64;
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    const size_t end = std::min(input.find('\0'), size);
    const std::string json(input.substr(0, end));
    picture.floats = {data + std::min(end + 1, size), size - std::min(end + 1, size)};
    if (!prepare(json))
        return 0;
    const fuzz::Folder& folder = fuzz::Folder::own();
    folder.write("a.exr", "");
    folder.write("b.exr", "");
    const std::string path = folder.write("volume.json", json);
    fuzz::accepts([&] {
        const Volume volume = io::read_exr(path);
        io::check_volume(volume, path, ErrorKind::failure);
    });
    return 0;
}
