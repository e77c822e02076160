// Rays traced by a device, in a structure that it builds over triangles
// (VK_KHR_ray_tracing_pipeline).
#pragma once

#include "gpu/gpu.h"

#include <glm/glm.hpp>

namespace lpvbake::gpu {

/// A segment origin + t * direction, t in [t_min, t_max]; direction of any length.
struct DeviceRay {
    glm::vec3 origin;
    glm::vec3 direction;
    float t_min, t_max;
};

/// What a ray meets.
struct DeviceHit {
    static constexpr uint32_t none = ~0u;
    /// It may have passed a triangle that the device knows too little of, before what it met.
    static constexpr uint32_t unsure = none - 1;
    float t;
    uint32_t triangle;     ///< or one of those
    glm::vec2 barycentric; ///< weights of the triangle's second and third vertex
};

/// What there is to know of a triangle.
struct DeviceTriangle {
    glm::uvec3 corners;
    bool unsure = false; ///< a ray that meets it may pass, and the device cannot tell
    bool culled = false; ///< a ray along (b - a) x (c - a) passes it
};

/// Traces on a device with DeviceInfo::traces_rays. Its answers are those of exact arithmetic but
/// for rounding, which is the device's own, and each is of its ray alone. May be asked by any
/// number of threads, while another one uses the device.
class RayTracer {
public:
    /// Builds the structure. There is a triangle at least, and all positions are finite. `looking`:
    /// a ray generation shader that includes gpu/trace.glsl. Throws Error (memory, device).
    /// `threads`: that ask it at a time; of more than a few some wait.
    RayTracer(const Device& device, std::span<const glm::vec3> positions,
              std::span<const DeviceTriangle> triangles, std::span<const uint32_t> looking,
              int threads);
    ~RayTracer();
    RayTracer(const RayTracer&) = delete;
    RayTracer& operator=(const RayTracer&) = delete;

    /// What it takes of so many triangles.
    struct Bytes {
        uint64_t device;   ///< of the device's memory, as long as it is there
        uint64_t building; ///< and more of it while it is made
        uint64_t host;     ///< that the device reads and writes
    };
    static Bytes bytes(const DeviceInfo& device, uint64_t triangles, int threads);

    /// Rays that the device traces at a time: of fewer each takes longer.
    static constexpr size_t batch = size_t(1) << 17;

    /// The nearest that each ray meets, at its place. Throws Error (device).
    void nearest(std::span<const DeviceRay> rays, std::span<DeviceHit> hits) const;
    /// Runs the other shader once for each answer, no more than a batch; it reads what is given, no
    /// more bytes than a batch of rays has. Throws Error (device).
    void look(std::span<const std::byte> given, std::span<uint32_t> answers) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

} // namespace lpvbake::gpu
