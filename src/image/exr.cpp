// EXR encoding straight through OpenEXR: of the outputs the one that every bake may ask for, and
// its ten libraries link in no time.
#include "image/image.h"

#include "background.h"
#include "lpvbake/error.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfThreading.h>

#include <algorithm>
#include <cstring>
#include <ostream>

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

/// A file in a stream, which says by its state what fails.
class StandardStream : public Imf::OStream {
public:
    StandardStream(std::ostream& out, const char* name) : Imf::OStream(name), out_(out) {}
    void write(const char* data, int count) override { out_.write(data, count); }
    uint64_t tellp() override { return out_ ? uint64_t(out_.tellp()) : 0; }
    void seekp(uint64_t position) override { out_.seekp(std::streamoff(position)); }

private:
    std::ostream& out_;
};

struct Slice {
    std::string name;
    const char* first;
    size_t stride; ///< bytes
};

/// Threads that may compress: those of the caller's arena, where they are several. OpenEXR has one
/// pool a process, which grows to as many and never shrinks: the caller may have made it for
/// itself.
int compressing_threads() {
    const int threads = threads_at_work();
    if (threads < 2)
        return 0;
    if (Imf::globalThreadCount() < threads)
        Imf::setGlobalThreadCount(threads);
    return threads;
}

void encode(Imf::OStream& stream, int width, int height, Imf::PixelType type,
            const std::vector<Slice>& slices, const std::map<std::string, std::string>& attributes,
            const std::string& name) {
    try {
        Imf::Header header(width, height);
        header.compression() = Imf::ZIP_COMPRESSION;
        for (const auto& [key, value] : attributes)
            header.insert(key, Imf::StringAttribute(value));
        Imf::FrameBuffer buffer;
        for (const Slice& slice : slices) {
            header.channels().insert(slice.name, Imf::Channel(type));
            buffer.insert(slice.name, Imf::Slice(type, const_cast<char*>(slice.first), slice.stride,
                                                 slice.stride * size_t(width)));
        }
        Imf::OutputFile file(stream, header, compressing_threads());
        file.setFrameBuffer(buffer);
        file.writePixels(height);
    } catch (const std::exception& error) {
        throw Error(ErrorKind::failure, name + ": cannot be encoded as EXR: " + error.what());
    }
}

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
    std::vector<Imath::half> halves;
    if (half)
        halves.assign(pixels.samples.begin(), pixels.samples.end());
    const size_t size = half ? sizeof(Imath::half) : sizeof(float);
    const char* const first = half ? reinterpret_cast<const char*>(halves.data())
                                   : reinterpret_cast<const char*>(pixels.samples.data());
    std::vector<Slice> slices;
    for (size_t channel = 0; channel < size_t(channels); ++channel)
        slices.push_back({names[channel], first + channel * size, size * size_t(channels)});
    MemoryStream stream(name.c_str());
    encode(stream, pixels.width, pixels.height, half ? Imf::HALF : Imf::FLOAT, slices, attributes,
           name);
    return std::move(stream.bytes);
}

void write_exr(std::ostream& out, int width, int height, const std::vector<Channel>& channels,
               const std::map<std::string, std::string>& attributes, const std::string& name) {
    std::vector<Slice> slices;
    for (const Channel& channel : channels)
        slices.push_back({channel.name, reinterpret_cast<const char*>(channel.first),
                          channel.stride * sizeof(float)});
    StandardStream stream(out, name.c_str());
    encode(stream, width, height, Imf::FLOAT, slices, attributes, name);
}

} // namespace lpvbake::image
