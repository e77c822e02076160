// Image files. OpenImageIO stays behind this header, in a module that is loaded on first use: its
// some 250 shared libraries take a third of a second to link, and many bakes need none of them. EXR
// files are written through OpenEXR itself, since every bake may write some.
#pragma once

#include <cstddef>
#include <cstdint>
#include <future>
#include <iosfwd>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::image {

/// Row-major samples from the top left, `channels` interleaved.
struct Pixels {
    int width = 0;
    int height = 0;
    int channels = 0;
    std::vector<float> samples;
};

/// 8-bit RGBA, sRGB-encoded colour, straight alpha.
struct Rgba8 {
    int width = 0;
    int height = 0;
    std::vector<uint8_t> texels;
};

/// Decodes a PNG, JPEG or WebP image (told apart by its first bytes) of any bit depth and layout to
/// 8-bit RGBA. `name` is for errors. Throws Error (invalid), also for images of more than
/// `max_texels`, before their memory is taken; Error (failure) where the module is missing.
Rgba8 decode_image(std::span<const std::byte> data, const std::string& name, uint64_t max_texels);

/// Encodes EXR: one part, scanlines, ZIP, one pixel type (half or float), channels named R, G, B, A
/// (Y where there is one; 1, 3 or 4 channels), the attributes as strings in the header. The bytes
/// depend on the arguments alone. `name` is for errors. Throws Error (failure).
std::vector<unsigned char> encode_exr(const Pixels& pixels, bool half,
                                      const std::map<std::string, std::string>& attributes,
                                      const std::string& name);

/// Samples of a picture, row-major from the top left, `stride` floats apart.
struct Channel {
    std::string name;
    const float* first;
    std::size_t stride;
};

/// Writes EXR as encode_exr does, but of float channels of any names, from where they lie, into a
/// stream that is seekable. Throws as it, and what the stream throws.
void write_exr(std::ostream& out, int width, int height, const std::vector<Channel>& channels,
               const std::map<std::string, std::string>& attributes, const std::string& name);

/// Decodes an EXR whole, channels in the order R, G, B, A. Throws Error (invalid), also for images
/// of more than `max_texels`, before their memory is taken.
Pixels decode_exr(std::span<const std::byte> data, const std::string& name, uint64_t max_texels);

/// Reads the colours of the picture in a file of any format that OpenImageIO knows: linear RGB,
/// three channels; grey ones tripled. What is stored as integers is taken to be sRGB-encoded.
/// Throws Error (file: cannot be opened; invalid: no picture, or more than `max_texels`, which is
/// known before the memory is taken).
Pixels read_picture(const std::string& path, uint64_t max_texels);

/// Encodes an 8-bit PNG; samples are display-referred values, clamped to [0, 1]; 1, 3 or 4
/// channels. The bytes depend on the arguments alone. Throws Error (failure).
std::vector<unsigned char> encode_png(const Pixels& pixels, const std::string& name);

/// Keeps the process from ending while libraries are being loaded: waits for that on destruction.
class ImageModulePreload {
public:
    ImageModulePreload() = default;
    explicit ImageModulePreload(std::shared_future<void> loading) : loading_(std::move(loading)) {}
    ImageModulePreload(ImageModulePreload&&) = default;
    ImageModulePreload& operator=(ImageModulePreload&&) = default;
    ~ImageModulePreload() {
        if (loading_.valid())
            loading_.wait();
    }
    /// True if the load was started.
    explicit operator bool() const { return loading_.valid(); }

private:
    std::shared_future<void> loading_;
};

/// Starts loading the module in the background, so that a later call does not wait. Hold the result
/// to the end of main: leaving main while libraries are being loaded is undefined. A module that
/// cannot be loaded is an error only for those who then need it.
[[nodiscard]] ImageModulePreload preload_image_module();

} // namespace lpvbake::image
