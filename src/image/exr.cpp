// EXR encoding straight through OpenEXR: of the outputs the one that every bake may ask for, and
// its ten libraries link in no time.
#include "image/image.h"

#include "lpvbake/error.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <cstring>

namespace lpvbake::image {
namespace {

/// A file in memory.
class MemoryStream : public Imf::OStream {
public:
    explicit MemoryStream(const char* name) : Imf::OStream(name) {}
    void write(const char* data, int count) override {
        bytes.resize(std::max(bytes.size(), at_ + size_t(count)));
        std::memcpy(bytes.data() + at_, data, size_t(count));
        at_ += size_t(count);
    }
    uint64_t tellp() override { return at_; }
    void seekp(uint64_t position) override { at_ = size_t(position); }

    std::vector<unsigned char> bytes;

private:
    size_t at_ = 0;
};

} // namespace

std::vector<unsigned char> encode_exr(const Pixels& pixels, bool half,
                                      const std::map<std::string, std::string>& attributes,
                                      const std::string& name) {
    const int channels = pixels.channels;
    const std::vector<const char*> names = channels == 1
                                               ? std::vector<const char*>{"Y"}
                                               : std::vector<const char*>{"R", "G", "B", "A"};
    const size_t samples = size_t(pixels.width) * size_t(pixels.height) * size_t(channels);
    if (channels < 1 || channels > 4 || channels == 2 || pixels.samples.size() != samples)
        throw Error(ErrorKind::failure, name + ": " + std::to_string(channels) + " channels and "
                                            + std::to_string(pixels.samples.size())
                                            + " samples make no picture");
    try {
        Imf::Header header(pixels.width, pixels.height);
        header.compression() = Imf::ZIP_COMPRESSION;
        for (const auto& [key, value] : attributes)
            header.insert(key, Imf::StringAttribute(value));
        const Imf::PixelType type = half ? Imf::HALF : Imf::FLOAT;
        std::vector<Imath::half> halves;
        if (half)
            halves.assign(pixels.samples.begin(), pixels.samples.end());
        const size_t size = half ? sizeof(Imath::half) : sizeof(float);
        char* const first =
            half ? reinterpret_cast<char*>(halves.data())
                 : reinterpret_cast<char*>(const_cast<float*>(pixels.samples.data()));
        Imf::FrameBuffer buffer;
        for (int channel = 0; channel < channels; ++channel) {
            header.channels().insert(names[size_t(channel)], Imf::Channel(type));
            buffer.insert(names[size_t(channel)],
                          Imf::Slice(type, first + size_t(channel) * size, size * size_t(channels),
                                     size * size_t(channels) * size_t(pixels.width)));
        }
        MemoryStream stream(name.c_str());
        {
            Imf::OutputFile file(stream, header, 0);
            file.setFrameBuffer(buffer);
            file.writePixels(pixels.height);
        }
        return std::move(stream.bytes);
    } catch (const std::exception& error) {
        throw Error(ErrorKind::failure, name + ": cannot be encoded as EXR: " + error.what());
    }
}

} // namespace lpvbake::image
