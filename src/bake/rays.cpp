#include "bake/rays.h"

#include "background.h"
#include "gpu/rays.h"
#include "lpvbake/error.h"
#include "solver/gather/zone.h"

#include <cstddef>

namespace lpvbake::bake {
namespace {

using visibility::Caster;
using visibility::Ray;

// Batches are handed on as they are.
static_assert(sizeof(Ray) == sizeof(gpu::DeviceRay)
              && offsetof(Ray, direction) == offsetof(gpu::DeviceRay, direction)
              && offsetof(Ray, t_min) == offsetof(gpu::DeviceRay, t_min)
              && offsetof(Ray, t_max) == offsetof(gpu::DeviceRay, t_max));
static_assert(sizeof(Caster::Met) == sizeof(gpu::DeviceHit)
              && offsetof(Caster::Met, triangle) == offsetof(gpu::DeviceHit, triangle)
              && offsetof(Caster::Met, barycentric) == offsetof(gpu::DeviceHit, barycentric));
static_assert(Caster::none == gpu::DeviceHit::none && Caster::unsure == gpu::DeviceHit::unsure);

std::vector<gpu::DeviceTriangle> triangles_of(const visibility::CastSurfaces& surfaces) {
    std::vector<gpu::DeviceTriangle> triangles;
    triangles.reserve(surfaces.triangles.size());
    for (const visibility::CastTriangle& triangle : surfaces.triangles)
        triangles.push_back({triangle.corners, triangle.partly_clear, triangle.culled});
    return triangles;
}

class DeviceCaster : public Caster {
public:
    DeviceCaster(const visibility::CastSurfaces& surfaces, const gpu::Device& device)
        : name_("rays by " + recorded_name(device.info()) + " (" + device.info().driver + ")"),
          tracer_(device, surfaces.positions, triangles_of(surfaces),
                  solver::gather::look_program(), threads_at_work()) {}

    void nearest(std::span<const Ray> rays, std::span<Met> met) const override {
        tracer_.nearest({reinterpret_cast<const gpu::DeviceRay*>(rays.data()), rays.size()},
                        {reinterpret_cast<gpu::DeviceHit*>(met.data()), met.size()});
    }
    void look(std::span<const std::byte> given, std::span<uint32_t> answers) const override {
        tracer_.look(given, answers);
    }
    std::string name() const override { return name_; }
    size_t batch() const override { return gpu::RayTracer::batch; }

private:
    std::string name_;
    gpu::RayTracer tracer_;
};

} // namespace

const char* name_of(Rays rays) {
    switch (rays) {
    case Rays::embree:
        return "embree";
    case Rays::device:
        return "device";
    case Rays::automatic:
        break;
    }
    return "auto";
}

std::optional<Rays> rays_named(std::string_view name) {
    for (const Rays rays : all_rays)
        if (name == name_of(rays))
            return rays;
    return std::nullopt;
}

Rays available(Rays rays, const gpu::DeviceInfo& device, bool is_gather, uint64_t triangles) {
    if (rays == Rays::device && !device.traces_rays)
        throw Error(ErrorKind::device,
                    "`rays` device: '" + device.name + "' traces none; `rays` embree does");
    if (rays != Rays::automatic)
        return rays;
    // On an H200, which has no ray cores, beside 16 CPU cores: gather of 58,772 triangles at 128
    // and 256 cells took 0.82 of the time; of 36 triangles 1.03, and sn 1.0 and 1.07.
    constexpr uint64_t many = 10'000;
    const bool pays = is_gather && triangles >= many;
    return device.traces_rays && device.type != "cpu" && pays ? Rays::device : Rays::embree;
}

std::string recorded_name(const gpu::DeviceInfo& device) {
    const std::string& name = device.name;
    const std::size_t width = name.rfind(", ");
    return name.starts_with("llvmpipe (") && name.ends_with(" bits)") && width != std::string::npos
               ? name.substr(0, width) + ")"
               : name;
}

visibility::Visibility on_device(const visibility::Visibility& visibility,
                                 const gpu::Device& device) {
    const visibility::CastSurfaces surfaces = visibility.surfaces();
    if (surfaces.triangles.empty())
        return visibility.by(nullptr);
    return visibility.by(std::make_shared<DeviceCaster>(surfaces, device));
}

} // namespace lpvbake::bake
