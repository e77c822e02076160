#include "scene/gltf/accessor.h"

#include <algorithm>
#include <cstring>
#include <limits>

namespace lpvbake::scene::gltf {
namespace {

template <typename Stored, typename Result, typename Convert>
std::vector<Result> convert(const Elements& elements, Convert to_result) {
    std::vector<Result> result(elements.count * elements.width);
    Result* out = result.data();
    for (size_t i = 0; i < elements.count; ++i) {
        const unsigned char* element = elements.bytes.data() + i * elements.stride;
        for (int k = 0; k < elements.width; ++k) {
            Stored stored; // may lie unaligned
            std::memcpy(&stored, element + k * sizeof(Stored), sizeof(Stored));
            *out++ = to_result(stored);
        }
    }
    return result;
}

template <typename Stored>
std::vector<float> integers_to_floats(const Elements& elements) {
    if (!elements.normalized)
        return convert<Stored, float>(elements, [](Stored c) { return static_cast<float>(c); });
    return convert<Stored, float>(elements, [](Stored c) {
        const double value = static_cast<double>(c) / std::numeric_limits<Stored>::max();
        return static_cast<float>(std::max(value, -1.0));
    });
}

} // namespace

size_t component_size(int type) {
    switch (static_cast<Component>(type)) {
    case Component::int8:
    case Component::uint8:
        return 1;
    case Component::int16:
    case Component::uint16:
        return 2;
    case Component::uint32:
    case Component::float32:
        return 4;
    }
    return 0;
}

bool fits(uint64_t count, uint64_t stride, uint64_t size, uint64_t available) {
    if (count == 0)
        return true;
    if (size > available)
        return false;
    return stride == 0 || count - 1 <= (available - size) / stride;
}

std::vector<float> to_floats(const Elements& elements) {
    switch (elements.component) {
    case Component::int8:
        return integers_to_floats<int8_t>(elements);
    case Component::uint8:
        return integers_to_floats<uint8_t>(elements);
    case Component::int16:
        return integers_to_floats<int16_t>(elements);
    case Component::uint16:
        return integers_to_floats<uint16_t>(elements);
    case Component::uint32:
        return integers_to_floats<uint32_t>(elements);
    case Component::float32:
        return convert<float, float>(elements, [](float c) { return c; });
    }
    return {};
}

std::vector<uint32_t> to_indices(const Elements& elements) {
    const auto same = [](auto c) { return static_cast<uint32_t>(c); };
    switch (elements.component) {
    case Component::uint8:
        return convert<uint8_t, uint32_t>(elements, same);
    case Component::uint16:
        return convert<uint16_t, uint32_t>(elements, same);
    case Component::uint32:
        return convert<uint32_t, uint32_t>(elements, same);
    default:
        return {};
    }
}

} // namespace lpvbake::scene::gltf
