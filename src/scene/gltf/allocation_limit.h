// A limit on what a library allocates that believes its input.
#pragma once

#include <cstdint>

namespace lpvbake::scene::gltf {

/// While it lives, all that this thread asks of operator new, freed or not, may come to `bytes`;
/// beyond that operator new throws std::bad_alloc. Limits do not nest.
///
/// The program's operator new is replaced for this, libraries' included.
class AllocationLimit {
public:
    explicit AllocationLimit(uint64_t bytes);
    ~AllocationLimit();
    AllocationLimit(const AllocationLimit&) = delete;
    AllocationLimit& operator=(const AllocationLimit&) = delete;
};

} // namespace lpvbake::scene::gltf
