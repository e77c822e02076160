#include "scene/gltf/near_jobs.h"

#include "scene/gltf/attributes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

namespace lpvbake::scene::gltf {
namespace {

/// Of values of an accessor; none where one is not finite or there are none.
std::optional<Bounds> box_of(const std::vector<float>& positions) {
    Bounds box;
    for (std::size_t i = 0; i + 2 < positions.size(); i += 3) {
        const glm::dvec3 p(positions[i], positions[i + 1], positions[i + 2]);
        if (!std::isfinite(p.x + p.y + p.z))
            return std::nullopt;
        box.lo = glm::min(box.lo, p);
        box.hi = glm::max(box.hi, p);
    }
    return box.empty() ? std::nullopt : std::optional(box);
}

/// What an accessor says of itself, with room for what a codec rounds.
std::optional<Bounds> told_box(const tinygltf::Accessor& accessor) {
    Bounds box;
    if (accessor.minValues.size() != 3 || accessor.maxValues.size() != 3)
        return std::nullopt;
    for (int axis = 0; axis < 3; ++axis) {
        box.lo[axis] = accessor.minValues[std::size_t(axis)];
        box.hi[axis] = accessor.maxValues[std::size_t(axis)];
        if (!std::isfinite(box.lo[axis]) || !std::isfinite(box.hi[axis])
            || box.hi[axis] < box.lo[axis])
            return std::nullopt;
    }
    const glm::dvec3 size = box.hi - box.lo;
    const double room = 0.25 * std::max({size.x, size.y, size.z});
    return Bounds{box.lo - room, box.hi + room};
}

/// Around a transformed box, and whatever is rounded.
Bounds placed(const Bounds& box, const glm::dmat4& to_world) {
    Bounds around;
    for (int corner = 0; corner < 8; ++corner) {
        const glm::dvec3 p(to_world
                           * glm::dvec4(corner & 1 ? box.hi.x : box.lo.x,
                                        corner & 2 ? box.hi.y : box.lo.y,
                                        corner & 4 ? box.hi.z : box.lo.z, 1.0));
        around.lo = glm::min(around.lo, p);
        around.hi = glm::max(around.hi, p);
    }
    const glm::dvec3 room = 1e-6 * (glm::abs(around.lo) + glm::abs(around.hi));
    return {around.lo - room, around.hi + room};
}

/// Boxes of primitives, each accessor looked through once.
class LocalBoxes {
public:
    LocalBoxes(const Document& document, const Graph& graph, const Jobs& jobs)
        : document_(document),
          graph_(graph) {
        std::map<int, std::string> accessors;
        for (const Job& job : jobs.jobs)
            if (const tinygltf::Primitive& primitive = primitive_of(job);
                !is_posed(job) && !is_draco(primitive))
                accessors.try_emplace(primitive.attributes.at("POSITION"),
                                      at("meshes", std::size_t(mesh_of(job))) + "."
                                          + at("primitives", job.primitive)
                                          + ".attributes.POSITION");
        const std::vector<std::pair<int, std::string>> list(accessors.begin(), accessors.end());
        std::vector<std::optional<Bounds>> boxes(list.size());
        for_all(list.size(), [&](std::size_t i) {
            check_attribute_type(document, list[i].first, false, list[i].second);
            boxes[i] = box_of(read_floats(document, list[i].first, 3, list[i].second));
        });
        for (std::size_t i = 0; i < list.size(); ++i)
            boxes_[list[i].first] = boxes[i];
    }

    /// None: it is not known.
    std::optional<Bounds> operator()(const Job& job) const {
        const tinygltf::Primitive& primitive = primitive_of(job);
        if (is_posed(job))
            return std::nullopt;
        const int accessor = primitive.attributes.at("POSITION");
        return is_draco(primitive) ? told_box(document_.model.accessors.at(std::size_t(accessor)))
                                   : boxes_.at(accessor);
    }

private:
    int mesh_of(const Job& job) const { return graph_.shapes[std::size_t(job.shape)].mesh; }
    const tinygltf::Primitive& primitive_of(const Job& job) const {
        return document_.model.meshes[std::size_t(mesh_of(job))].primitives[job.primitive];
    }
    bool is_posed(const Job& job) const {
        const Shape& shape = graph_.shapes[std::size_t(job.shape)];
        return shape.skin >= 0
               || std::ranges::any_of(shape.weights, [](double weight) { return weight != 0; });
    }
    static bool is_draco(const tinygltf::Primitive& primitive) {
        return find_extension(primitive.extensions, "KHR_draco_mesh_compression") != nullptr;
    }

    const Document& document_;
    const Graph& graph_;
    std::map<int, std::optional<Bounds>> boxes_; ///< by accessor
};

bool may_emit(const SourceMaterial& material) {
    return glm::any(glm::greaterThan(material.material.emission, glm::vec3(0.0f)));
}

} // namespace

std::vector<bool> jobs_near(const Document& document, const Graph& graph, const Jobs& jobs,
                            const std::vector<SourceMaterial>& materials, const Near& near) {
    std::vector<bool> is_near(jobs.jobs.size(), false);
    const LocalBoxes local(document, graph, jobs);
    std::vector<std::size_t> job_of; // of each instance
    std::vector<Bounds> boxes;
    std::vector<bool> emits;
    for (const PlacedShape& shape : graph.placed) {
        const auto [begin, end] = jobs.of_shape[std::size_t(shape.shape)];
        for (std::size_t job = begin; job < end; ++job) {
            const std::optional<Bounds> box = local(jobs.jobs[job]);
            if (!box) {
                is_near[job] = true;
                continue;
            }
            job_of.push_back(job);
            boxes.push_back(placed(*box, shape.to_world));
            emits.push_back(may_emit(materials[std::size_t(jobs.jobs[job].material)]));
        }
    }
    std::vector<glm::dvec3> directions = directions_of(graph.lights);
    directions.insert(directions.end(), near.directions.begin(), near.directions.end());
    const Around around(std::move(boxes), std::move(emits), directions);
    for (const Surroundings& box : near.boxes)
        for (const std::size_t instance : around(box))
            is_near[job_of[instance]] = true;
    return is_near;
}

} // namespace lpvbake::scene::gltf
