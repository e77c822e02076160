#include "scene/gltf/allocation_limit.h"

#include <cstdlib>
#include <limits>
#include <new>

namespace lpvbake::scene::gltf {
namespace {

constexpr uint64_t unlimited = std::numeric_limits<uint64_t>::max();
constinit thread_local uint64_t left = unlimited;

void* allocate(size_t size) noexcept {
    if (left != unlimited) {
        if (size > left)
            return nullptr;
        left -= size;
    }
    return std::malloc(size ? size : 1);
}

void* allocate_or_throw(size_t size) {
    if (void* const memory = allocate(size))
        return memory;
    throw std::bad_alloc();
}

} // namespace

AllocationLimit::AllocationLimit(uint64_t bytes) {
    left = bytes;
}

AllocationLimit::~AllocationLimit() {
    left = unlimited;
}

} // namespace lpvbake::scene::gltf

// Every form that has a counterpart here, so that what one allocates the other can free. Those for
// over-aligned types stay the system's.
void* operator new(size_t size) {
    return lpvbake::scene::gltf::allocate_or_throw(size);
}
void* operator new[](size_t size) {
    return lpvbake::scene::gltf::allocate_or_throw(size);
}
void* operator new(size_t size, const std::nothrow_t&) noexcept {
    return lpvbake::scene::gltf::allocate(size);
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
    return lpvbake::scene::gltf::allocate(size);
}
void operator delete(void* memory) noexcept {
    std::free(memory);
}
void operator delete[](void* memory) noexcept {
    std::free(memory);
}
void operator delete(void* memory, size_t) noexcept {
    std::free(memory);
}
void operator delete[](void* memory, size_t) noexcept {
    std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
    std::free(memory);
}
void operator delete[](void* memory, const std::nothrow_t&) noexcept {
    std::free(memory);
}
