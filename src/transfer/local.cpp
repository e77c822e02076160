#include "transfer/local.h"

#include "colour/colour.h"
#include "scene/material.h"
#include "scene/roles.h"
#include "solver/sn/directions.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <span>

namespace lpvbake::transfer {
namespace {

/// With what each contributes, in eights that point into one octant.
struct Looks {
    std::vector<glm::vec3> along;
    std::vector<volume::ShValues> basis; ///< to order 2

    Looks() {
        for (int octant = 0; octant < 8; ++octant) {
            const glm::dvec3 sign(octant & 1 ? -1 : 1, octant & 2 ? -1 : 1, octant & 4 ? -1 : 1);
            for (const glm::dvec3& direction : solver::sn::sn_octant_directions(local_rays)) {
                along.emplace_back(sign * direction);
                basis.push_back(volume::sh_basis(2, along.back()));
            }
        }
    }
};

const Looks& looks() {
    static const Looks all;
    return all;
}

constexpr double weight = 4 * glm::pi<double>() / local_rays;

/// Calls visit(i, hit) for each ray from a place, in their order.
template <class Visit>
void look_around(const visibility::Visibility& visibility, glm::vec3 place, float radius,
                 const Visit& visit) {
    const std::vector<glm::vec3>& along = looks().along;
    std::array<visibility::Ray, 8> rays;
    std::array<visibility::Hit, 8> hits;
    for (std::size_t first = 0; first < along.size(); first += rays.size()) {
        for (std::size_t i = 0; i < rays.size(); ++i)
            rays[i] = {place, along[first + i], 0.0f, radius};
        visibility.closest_of_eights(rays, visibility::Bundle::loose, hits);
        for (std::size_t i = 0; i < rays.size(); ++i)
            visit(first + i, hits[i]);
    }
}

/// What a surface emits where a ray meets it, of the share that is there: the ray met that by
/// chance.
glm::dvec3 emission_at(const Scene& scene, const Instance& instance, const visibility::Hit& hit,
                       float alpha) {
    if (!scene::shines(instance.role))
        return glm::dvec3(0.0);
    const Mesh& mesh = scene.meshes[std::size_t(instance.mesh)];
    const glm::vec3 covered = scene::sample_emission(scene, mesh, hit.triangle, hit.barycentric);
    return covered == glm::vec3(0.0f) ? glm::dvec3(0.0) : glm::dvec3(covered) / double(alpha);
}

} // namespace

LocalTransfer find_local_transfer(const Scene& scene, const visibility::Visibility& visibility,
                                  glm::vec3 place, float radius) {
    std::array<glm::dvec3, 16> reflected{};
    std::array<double, 9> visible{};
    std::array<glm::dvec3, 4> emitted{};
    look_around(visibility, place, radius, [&](std::size_t i, const visibility::Hit& hit) {
        const volume::ShValues& out = looks().basis[i];
        const glm::dvec3 tint = weight * glm::dvec3(hit.tint);
        if (hit.instance == visibility::no_hit) {
            const double passes = glm::dot(colour::rec709_luminance, tint);
            for (std::size_t k = 0; k < visible.size(); ++k)
                visible[k] += passes * double(out[k]);
            return;
        }
        if (hit.facing == visibility::Facing::back)
            return;
        const Instance& instance = scene.instances[hit.instance];
        const scene::SurfaceSample surface = scene::sample_surface(
            scene, scene.meshes[std::size_t(instance.mesh)], hit.triangle, hit.barycentric);
        const glm::dvec3 shone = tint * emission_at(scene, instance, hit, surface.alpha);
        for (std::size_t k = 0; k < emitted.size(); ++k)
            emitted[k] += double(out[k]) * shone;
        if (!scene::reflects(instance.role))
            return;
        const glm::vec3 normal =
            glm::dot(hit.normal, looks().along[i]) > 0.0f ? -hit.normal : hit.normal;
        const volume::ShValues in = volume::sh_basis(1, normal);
        const glm::dvec3 shade = glm::one_over_pi<double>() * tint * glm::dvec3(surface.albedo);
        for (std::size_t k = 0; k < 4; ++k)
            for (std::size_t j = 0; j < 4; ++j)
                reflected[4 * k + j] +=
                    double(out[k]) * volume::sh_cosine_factor(j > 0) * double(in[j]) * shade;
    });
    LocalTransfer local;
    std::ranges::copy(reflected, local.reflected.begin());
    std::ranges::transform(visible, local.visible.begin(), [](double v) { return float(v); });
    std::ranges::copy(emitted, local.emitted.begin());
    return local;
}

namespace {

/// Calls visit(cell, what is found there) for valid cells, on all threads.
template <class Visit>
void find_all(const Scene& scene, const visibility::Visibility& visibility, float radius,
              const Volume& volume, const Visit& visit) {
    tbb::parallel_for(std::size_t(0), volume.grid.size(), [&](std::size_t cell) {
        if (volume.is_valid(cell))
            visit(cell,
                  find_local_transfer(scene, visibility,
                                      visibility.capture(volume.grid.cell_at(cell)).point, radius));
    });
}

} // namespace

void add_local_transfer(const Scene& scene, const visibility::Visibility& visibility, float radius,
                        Volume& volume) {
    volume::set_grids(volume, volume::local_transfer_kind(), 16);
    volume::set_grids(volume, volume::local_visibility_kind(), 9);
    const std::vector<volume::GridView> reflected =
        volume::grids_of(volume, volume::local_transfer_kind());
    const std::vector<volume::GridView> visible =
        volume::grids_of(volume, volume::local_visibility_kind());
    find_all(scene, visibility, radius, volume, [&](std::size_t cell, const LocalTransfer& local) {
        for (std::size_t k = 0; k < reflected.size(); ++k)
            for (int channel = 0; channel < 3; ++channel)
                reflected[k].data[3 * cell + std::size_t(channel)] = local.reflected[k][channel];
        for (std::size_t k = 0; k < visible.size(); ++k)
            visible[k].data[cell] = local.visible[k];
    });
}

std::vector<Light4> local_emission(const Scene& scene, const visibility::Visibility& visibility,
                                   float radius, const Volume& volume) {
    if (!scene::has_emitters(scene))
        return {};
    std::vector<Light4> emitted(volume.grid.size());
    find_all(scene, visibility, radius, volume,
             [&](std::size_t cell, const LocalTransfer& local) { emitted[cell] = local.emitted; });
    return emitted;
}

} // namespace lpvbake::transfer
