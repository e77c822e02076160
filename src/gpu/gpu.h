// Vulkan compute and buffers on a device: memory, programs, and batches of dispatches.
//
// Programs may be made on any number of threads, while others use the device, too; all else that a
// device is given to (buffers, copies, batches, maps) is for one thread at a time.
//
// Nothing here or in a stage's header names a Vulkan type. Failures are Error: device (missing or
// lost), memory (out of device or host memory), failure (anything else, validation messages too).
#pragma once

#include "lpvbake/device.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::gpu {

/// Device memory bound as storage buffer, vertex or index buffer, source or target of copies. Freed
/// with the object. `bytes` may exceed max_storage_range: programs then see windows of it.
class Buffer {
public:
    Buffer();
    Buffer(const Device& device, uint64_t bytes);
    ~Buffer();
    Buffer(Buffer&&) noexcept;
    Buffer& operator=(Buffer&&) noexcept;

    uint64_t bytes() const { return bytes_; }
    struct Impl;
    Impl& impl() const { return *impl_; }

private:
    uint64_t bytes_ = 0;
    std::unique_ptr<Impl> impl_;
};

/// Copies to and from a buffer; waits until done. Goes through staging where memory is not mapped.
void upload(const Device& device, const Buffer& target, uint64_t offset,
            std::span<const std::byte> data);
void download(const Device& device, const Buffer& source, uint64_t offset,
              std::span<std::byte> data);
/// Sets every byte to zero; waits until done.
void clear(const Device& device, const Buffer& target);

/// How a program sees a window of a buffer.
enum class Binding {
    storage,       ///< storage buffer, read and written
    texels_rgba32, ///< uniform texel buffer of four floats an element, read only
    texels_r32,    ///< uniform texel buffer of one float an element, read only
    uniform,       ///< uniform buffer, read only, at most max_uniform_bytes
};
/// What every device can bind as uniform buffer.
inline constexpr uint64_t max_uniform_bytes = 16384;

/// A compute pipeline: set 0 holds one window at each of the bindings 0, 1, ...
class Program {
public:
    Program();
    /// `constants` are the 32-bit specialization constants 0, 1, ... in order.
    Program(const Device& device, std::span<const uint32_t> spirv,
            std::span<const Binding> bindings, uint32_t push_bytes,
            std::span<const uint32_t> constants);
    ~Program();
    Program(Program&&) noexcept;
    Program& operator=(Program&&) noexcept;

    struct Impl;
    Impl& impl() const { return *impl_; }

private:
    std::unique_ptr<Impl> impl_;
};

/// A part of a buffer as a program sees it. The offset obeys window_alignment; the range must not
/// exceed max_storage_range, nor max_texels elements or max_uniform_bytes where it is bound as such
/// (checked).
struct Window {
    const Buffer* buffer = nullptr;
    uint64_t offset = 0;
    uint64_t bytes = 0;
    bool operator==(const Window&) const = default;
};

/// All of a buffer.
inline Window whole(const Buffer& buffer) {
    return {&buffer, 0, buffer.bytes()};
}

/// A window over elements [first, last) of `element` bytes, widened at its start to a multiple of
/// `alignment` (DeviceInfo::window_alignment); `base` becomes where `first` lies in it.
Window window_over(const Buffer& buffer, uint64_t first, uint64_t last, uint64_t element,
                   uint64_t alignment, uint32_t& base);

struct Groups {
    uint32_t x = 1, y = 1, z = 1;
};

/// Records dispatches, then runs them in order; each sees what the ones before it wrote, and what
/// batches wrote that were submitted before. What a batch names lives until it is done.
class Batch {
public:
    explicit Batch(const Device& device);
    ~Batch(); ///< waits
    void dispatch(const Program& program, std::span<const Window> windows,
                  std::span<const std::byte> push, Groups groups);
    /// Copies bytes between buffers, ordered like a dispatch.
    void copy(const Window& source, const Window& target);
    /// What is written there until submit() is in the buffer for what is recorded from now on.
    /// Nothing that was recorded or submitted before, and is not done, may use that part.
    std::span<std::byte> stage(const Buffer& target, uint64_t offset, uint64_t bytes);
    /// Hands all that is recorded to the device. Until wait() nothing more can be recorded.
    void submit();
    /// Waits until that is done; then the batch is empty again.
    void wait();
    /// Submits and waits.
    void run();

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

} // namespace lpvbake::gpu
