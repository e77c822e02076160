#include "scene/gltf/container.h"

#include "lpvbake/error.h"

#include <cstdint>
#include <cstring>

namespace lpvbake::scene::gltf {
namespace {

uint32_t little_endian(std::span<const unsigned char> bytes, size_t offset) {
    return bytes[offset] | bytes[offset + 1] << 8 | bytes[offset + 2] << 16
           | static_cast<uint32_t>(bytes[offset + 3]) << 24;
}

} // namespace

Container open_container(std::span<const unsigned char> bytes, const std::string& file) {
    const auto refuse = [&](const std::string& why) {
        throw Error(ErrorKind::invalid, file + ": " + why + "; copy or export it again");
    };
    const auto* begin = reinterpret_cast<const char*>(bytes.data());
    if (bytes.size() < 4 || std::memcmp(begin, "glTF", 4) != 0)
        return {{begin, bytes.size()}, {}};
    if (bytes.size() < 20)
        refuse("the binary glTF is cut off in its header");
    if (const uint32_t version = little_endian(bytes, 4); version != 2)
        throw Error(ErrorKind::unsupported, file + ": binary glTF version "
                                                + std::to_string(version)
                                                + (version == 1 ? ", glTF 1.0," : "")
                                                + " is not supported, 2 is; convert the file");
    const uint64_t length = little_endian(bytes, 8);
    const uint64_t json_length = little_endian(bytes, 12);
    if (length > bytes.size())
        refuse("the binary glTF is cut off: it should have " + std::to_string(length)
               + " bytes and has " + std::to_string(bytes.size()));
    if (little_endian(bytes, 16) != 0x4E4F534A || 20 + json_length > length)
        refuse("the binary glTF's first chunk is not whole JSON");
    Container container{{begin + 20, json_length}, {}};
    const uint64_t chunk = 20 + json_length;
    if (chunk + 8 > length)
        return container;
    const uint64_t chunk_length = little_endian(bytes, chunk);
    if (chunk + 8 + chunk_length > length)
        refuse("the binary glTF's second chunk runs past the file");
    if (little_endian(bytes, chunk + 4) == 0x004E4942)
        container.chunk = bytes.subspan(chunk + 8, chunk_length);
    return container;
}

} // namespace lpvbake::scene::gltf
