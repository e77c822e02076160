// Files of 3D textures: after a letter that says of which kind they are, the bytes of a KTX2 file
// ('k'), of a .glb ('b') or of a .tres ('t'), the JSON of a .glb and, after a byte of 0, its chunk
// ('g'), or a description and, after a byte of 0, the bytes of the two DDS files that it may name,
// a.dds and b.dds ('d').
#include "fuzz.h"

#include "io/dds.h"
#include "io/glb.h"
#include "io/ktx2.h"
#include "io/layout.h"
#include "io/texel.h"
#include "io/tres.h"

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

/// Whether it says anywhere that there are many cells: how much memory a machine has is not at
/// stake here.
bool claims_much(std::string_view bytes) {
    for (const std::string_view key : {"dims", "cells"})
        for (size_t at = bytes.find(key); at != std::string_view::npos;
             at = bytes.find(key, at + 1)) {
            double cells = 1, number = 0;
            for (const char c : bytes.substr(at + key.size(), 64)) {
                if (c >= '0' && c <= '9') {
                    number = 10 * number + (c - '0');
                } else {
                    cells *= std::max(1.0, number);
                    number = 0;
                }
            }
            if (!(cells * std::max(1.0, number) < 1e5))
                return true;
        }
    return false;
}

/// A .glb of this JSON and chunk.
std::string glb_of(std::string_view json, std::string_view chunk) {
    std::string bytes = "glTF";
    io::append_number(bytes, uint32_t(2));
    io::append_number(bytes, uint32_t(28 + json.size() + chunk.size()));
    io::append_number(bytes, uint32_t(json.size()));
    bytes.append("JSON").append(json);
    io::append_number(bytes, uint32_t(chunk.size()));
    return bytes.append("BIN\0", 4).append(chunk);
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    if (input.empty() || claims_much(input))
        return 0;
    const std::string_view bytes = input.substr(1);
    const fuzz::Folder& folder = fuzz::Folder::own();
    fuzz::accepts([&] {
        Volume volume;
        const size_t end = std::min(bytes.find('\0'), bytes.size());
        const std::string_view rest = bytes.substr(std::min(end + 1, bytes.size()));
        if (input[0] == 'k') {
            volume = io::read_ktx2(folder.write("a.ktx2", bytes));
        } else if (input[0] == 'b') {
            volume = io::read_glb(folder.write("a.glb", bytes));
        } else if (input[0] == 't') {
            volume = io::read_tres(folder.write("a.tres", bytes));
        } else if (input[0] == 'g') {
            volume = io::read_glb(folder.write("a.glb", glb_of(bytes.substr(0, end), rest)));
        } else {
            for (const char* name : {"a.dds", "b.dds"})
                folder.write(name, rest);
            volume = io::read_dds(folder.write("a.dds.json", bytes.substr(0, end)));
        }
        io::check_volume(volume, "file", ErrorKind::failure);
    });
    return 0;
}
