#include "scene/names.h"

#include "text.h"

namespace lpvbake::scene {
namespace {

std::string called(const char* what, const std::string& name, int index) {
    return name.empty() ? format("%s %d", what, index) : format("%s \"%s\"", what, name.c_str());
}

} // namespace

std::string endless_reflection(const Scene& scene, uint32_t instance, const std::string& at) {
    const int mesh = scene.instances[instance].mesh;
    const int material = scene.meshes[size_t(mesh)].material;
    return scene.path
           + ": light in a closed part of the scene is reflected without end, its albedo is 1, as "
             "that of "
           + called("material", scene.materials[size_t(material)].name, material) + " of "
           + called("mesh", scene.meshes[size_t(mesh)].name, mesh) + at
           + "; set `max_albedo` below 1 or a number of `bounces`";
}

} // namespace lpvbake::scene
