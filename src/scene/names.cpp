#include "scene/names.h"

#include "text.h"

namespace lpvbake::scene {
namespace {

std::string called(const char* what, const std::string& name, int index) {
    return name.empty() ? format("%s %d", what, index) : format("%s \"%s\"", what, name.c_str());
}

} // namespace

std::string name_of_surface(const Scene& scene, uint32_t instance) {
    const int mesh = scene.instances[instance].mesh;
    const int material = scene.meshes[size_t(mesh)].material;
    return called("material", scene.materials[size_t(material)].name, material) + " of "
           + called("mesh", scene.meshes[size_t(mesh)].name, mesh);
}

} // namespace lpvbake::scene
