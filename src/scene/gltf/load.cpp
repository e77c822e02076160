#include "lpvbake/scene.h"

#include "background.h"
#include "quoted.h"
#include "scene/gltf/animation.h"
#include "scene/gltf/document.h"
#include "scene/gltf/materials.h"
#include "scene/gltf/meshes.h"
#include "scene/gltf/near_jobs.h"
#include "scene/gltf/nodes.h"

#include <set>

namespace lpvbake::scene::gltf {
namespace {

/// Materials that some vertex makes brighter than the rules allow. Of textures the mean counts: a
/// few white texels are clamped without a word.
size_t count_clamped(const Scene& scene, const std::vector<glm::dvec3>& mean_texel) {
    std::vector<glm::vec3> brightest_vertex(scene.materials.size(), glm::vec3(0.0f));
    for (const Mesh& mesh : scene.meshes) {
        glm::vec3& brightest = brightest_vertex[mesh.material];
        if (mesh.colors.empty())
            brightest = glm::max(brightest, glm::vec3(mesh.positions.empty() ? 0.0f : 1.0f));
        for (const glm::vec4& color : mesh.colors)
            brightest = glm::max(brightest, glm::vec3(color));
    }
    size_t count = 0;
    for (size_t i = 0; i < scene.materials.size(); ++i) {
        const glm::vec3 albedo = glm::vec3(scene.materials[i].base_color) * glm::vec3(mean_texel[i])
                                 * brightest_vertex[i];
        count += glm::any(glm::greaterThan(albedo, glm::vec3(scene.rules.max_albedo + 1e-6f)));
    }
    return count;
}

SceneFile describe(const Document& document) {
    const tinygltf::Model& model = document.model;
    SceneFile file;
    file.generator = model.asset.generator;
    file.extensions_used = model.extensionsUsed;
    file.extensions_required = model.extensionsRequired;
    for (const tinygltf::Scene& scene : model.scenes)
        file.scenes.push_back(scene.name);
    for (size_t i = 0; i < model.animations.size(); ++i)
        file.animations.push_back(
            {model.animations[i].name, duration(document, static_cast<int>(i))});
    file.variants = variant_names(document);
    return file;
}

/// What --strict makes of warnings.
void refuse_warnings(const std::vector<std::string>& warnings) {
    if (warnings.empty())
        return;
    const size_t more = warnings.size() - 1;
    throw Error(
        ErrorKind::invalid,
        warnings.front()
            + (more > 0 ? " (and " + std::to_string(more) + " more; `strict`)" : " (`strict`)"));
}

/// Of materials, of which those of wanted jobs are wanted, too.
std::vector<bool> wanted_materials(const Jobs& jobs, const std::vector<bool>& wanted) {
    std::vector<bool> materials(jobs.materials.size(), false);
    for (size_t i = 0; i < wanted.size(); ++i)
        if (wanted[i])
            materials[size_t(jobs.jobs[i].material)] = true;
    return materials;
}

/// `near`, if it is not null, is what load_near gets.
Scene load(const std::string& path, const LoadSettings& settings, const Near* near) {
    Document document = parse_document(path, settings);
    Scene scene;
    scene.path = document.file;
    scene.rules = settings.rules;
    scene.file = describe(document);
    Roles roles(document, settings.roles);
    Graph graph = walk(document, settings, read_pose(document, settings), roles);
    const Jobs jobs = collect_jobs(document, settings, graph, roles);
    roles.warn(document.warnings);

    std::vector<SourceMaterial> materials;
    size_t unlit = 0;
    for (const int index : jobs.materials) {
        materials.push_back(read_material(document, index, settings.rules));
        unlit += materials.back().unlit;
    }
    if (unlit > 0)
        document.warnings.add("unlit", "materials",
                              "lit all the same: " + std::to_string(unlit)
                                  + " with KHR_materials_unlit; give what should glow an "
                                    "emissiveFactor");
    const std::vector<bool> wanted = near && !settings.strict
                                         ? jobs_near(document, graph, jobs, materials, *near)
                                         : std::vector<bool>(jobs.jobs.size(), true);
    const std::vector<glm::dvec3> mean_texels = load_textures(
        document, materials, wanted_materials(jobs, wanted), settings.skip_colors, scene);

    scene.meshes = read_meshes(document, graph, jobs, materials, wanted);
    for (SourceMaterial& material : materials)
        scene.materials.push_back(std::move(material.material));
    std::vector<size_t> first_instance; // of each placed shape, and the end
    for (const PlacedShape& placed : graph.placed) {
        first_instance.push_back(scene.instances.size());
        const auto [begin, end] = jobs.of_shape[placed.shape];
        for (size_t mesh = begin; mesh < end; ++mesh)
            scene.instances.push_back({static_cast<int>(mesh), placed.to_world,
                                       roles.role_of(std::max(placed.rule, jobs.jobs[mesh].rule))});
    }
    first_instance.push_back(scene.instances.size());
    for (SceneFile::Node& node : graph.nodes)
        if (const size_t begin = first_instance[node.begin], end = first_instance[node.end];
            begin < end)
            scene.file.nodes.push_back({std::move(node.name), begin, end});
    scene.file.boxes = std::move(graph.boxes);
    scene.lights = std::move(graph.lights);
    scene.cameras = std::move(graph.cameras);
    std::set<std::string> beside(document.beside.begin(), document.beside.end());
    scene.file.beside.assign(beside.begin(), beside.end());
    scene.clamped_materials = count_clamped(scene, mean_texels);
    scene.warnings = document.warnings.lines();
    if (settings.strict)
        refuse_warnings(scene.warnings);
    return scene;
}

/// With errors as load_gltf has them.
Scene load_safely(const std::string& path, const LoadSettings& settings, const Near* near) {
    try {
        return load(path, settings, near);
    } catch (const Error&) {
        throw;
    } catch (const std::bad_alloc&) {
        throw Error(ErrorKind::memory,
                    name_of(path) + ": is too large for the memory of this machine");
    } catch (const std::exception& error) {
        if (is_want_of_threads(error))
            throw Error(ErrorKind::failure, want_of_threads);
        throw Error(ErrorKind::invalid, name_of(path)
                                            + ": is not valid glTF: " + printable(error.what(), 300)
                                            + "; repair the file or export it again");
    }
}

} // namespace

Scene load_near(const std::string& path, const LoadSettings& settings, const Near& near) {
    return load_safely(path, settings, &near);
}

} // namespace lpvbake::scene::gltf

namespace lpvbake {

Scene load_gltf(const std::string& path, const LoadSettings& settings) {
    return scene::gltf::load_safely(path, settings, nullptr);
}

} // namespace lpvbake
