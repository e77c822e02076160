// Files of 3D textures: after a letter that says of which kind they are, the bytes of a KTX2 file
// ('k'), or a description and, after a byte of 0, the bytes of the two DDS files that it may name,
// a.dds and b.dds ('d').
#include "fuzz.h"

#include "io/dds.h"
#include "io/ktx2.h"
#include "io/layout.h"

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

/// Whether it says anywhere that there are many cells: how much memory a machine has is not at
/// stake here.
bool claims_much(std::string_view bytes) {
    constexpr std::string_view key = "\"dims\"";
    for (size_t at = bytes.find(key); at != std::string_view::npos; at = bytes.find(key, at + 1)) {
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
        if (input[0] == 'k') {
            volume = io::read_ktx2(folder.write("a.ktx2", bytes));
        } else {
            const size_t end = std::min(bytes.find('\0'), bytes.size());
            for (const char* name : {"a.dds", "b.dds"})
                folder.write(name, bytes.substr(std::min(end + 1, bytes.size())));
            volume = io::read_dds(folder.write("a.dds.json", bytes.substr(0, end)));
        }
        io::check_volume(volume, "file", ErrorKind::failure);
    });
    return 0;
}
