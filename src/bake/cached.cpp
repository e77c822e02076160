#include "bake/cached.h"

#include "visibility/walls.h"

#include <algorithm>

namespace lpvbake::bake {

cache::Key world_key(const Scene& scene, const scene::Frame& frame,
                     const visibility::Visibility& visibility) {
    cache::Key key("world");
    key.add_text(cache::program_id()).add_text(visibility.tracer());
    for (const Image& image : scene.images)
        key.add(image.width, image.height).add_all(image.rgba);
    for (const Texture& texture : scene.textures)
        key.add(texture.image, texture.wrap_u, texture.wrap_v, texture.nearest);
    for (const Material& material : scene.materials)
        key.add(material.base_color, material.base_color_texture, material.alpha_mode,
                material.alpha_cutoff, material.transmission, material.attenuation,
                material.double_sided);
    for (const Mesh& mesh : scene.meshes)
        key.add(mesh.material)
            .add_all(mesh.positions)
            .add_all(mesh.uv)
            .add_all(mesh.colors)
            .add_all(mesh.triangles);
    for (const Instance& instance : scene.instances)
        key.add(instance.mesh, instance.to_world, instance.role);
    key.add(scene.images.size(), scene.textures.size(), scene.materials.size(), scene.meshes.size(),
            scene.instances.size());
    key.add(scene.rules.max_albedo, scene.rules.metallic_black, scene.rules.cull_backfaces);
    key.add(frame.origin, frame.unit, frame.extent).add_all(frame.coarser);
    return key;
}

std::vector<std::vector<glm::vec3>> find_walls(const visibility::Visibility& visibility,
                                               const scene::Frame& frame, const Volume& volume,
                                               int first_layer, cache::Cache* cache) {
    std::vector<std::vector<glm::vec3>> walls;
    const auto make = [&] {
        walls = visibility::find_walls(visibility, volume.grid.dims, volume.validity, most_walls,
                                       walls_reach, first_layer);
    };
    if (!cache) {
        make();
        return walls;
    }
    cache::Key key = cache->key("walls");
    key.add(frame.origin, frame.unit, volume.grid.dims, first_layer).add_all(volume.validity);
    const auto read = [&](cache::Reader& in) {
        walls.assign(most_walls, {});
        return std::ranges::all_of(walls, [&](std::vector<glm::vec3>& of) {
            return in.get(of) && of.size() == volume.grid.size();
        });
    };
    if (!cache->get(key, read)) {
        make();
        cache->put(key, [&](cache::Writer& out) {
            for (const std::vector<glm::vec3>& of : walls)
                out.put(of);
        });
    }
    return walls;
}

} // namespace lpvbake::bake
