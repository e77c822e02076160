#include "scene/gltf/meshes.h"

#include "scene/gltf/attributes.h"
#include "scene/gltf/compression.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

namespace lpvbake::scene::gltf {
namespace {

constexpr uint64_t max_vertices = uint64_t{1} << 31; ///< of one primitive; also its indices

std::vector<glm::uvec3> triangles_of(const std::vector<uint32_t>& indices, int mode) {
    std::vector<glm::uvec3> triangles;
    const size_t count = indices.size();
    if (mode == TINYGLTF_MODE_TRIANGLES) {
        triangles.resize(count / 3);
        for (size_t i = 0; i < triangles.size(); ++i)
            triangles[i] = {indices[3 * i], indices[3 * i + 1], indices[3 * i + 2]};
        return triangles;
    }
    for (size_t i = 0; i + 2 < count; ++i)
        if (mode == TINYGLTF_MODE_TRIANGLE_STRIP)
            triangles.emplace_back(indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]);
        else
            triangles.emplace_back(indices[i + 1], indices[i + 2], indices[0]);
    return triangles;
}

template <typename Vector>
bool is_finite(const Vector& value) {
    for (int k = 0; k < Vector::length(); ++k)
        if (!std::isfinite(value[k]))
            return false;
    return true;
}

struct Warning {
    std::string kind, place, what;
};

struct DecodedPrimitive {
    Mesh mesh;
    std::vector<Warning> warnings;
};

class PrimitiveReader {
public:
    PrimitiveReader(const Document& document, const Shape& shape, size_t primitive)
        : document_(document),
          shape_(shape),
          source_(document.model.meshes.at(shape.mesh).primitives.at(primitive)),
          place_(at("meshes", shape.mesh) + "." + at("primitives", primitive)) {}

    DecodedPrimitive read(const SourceMaterial& material) {
        if (const auto* draco = find_extension(source_.extensions, "KHR_draco_mesh_compression"))
            read_draco(*draco);
        mesh_.positions = read<3>("POSITION", false);
        read_triangles();
        check_positions("POSITION");
        read_normals();
        mesh_.colors = read_colors();
        if (material.material.base_color_texture >= 0)
            mesh_.uv = read_uv(material.base_uv, material);
        if (material.material.emission_texture >= 0)
            mesh_.uv_emission = read_uv(material.emission_uv, material);
        if (shape_.skin >= 0)
            apply_skin();
        return {std::move(mesh_), std::move(warnings_)};
    }

private:
    std::string attribute_place(const std::string& name) const {
        return place_ + ".attributes." + name;
    }

    void warn(const std::string& kind, const std::string& place, const std::string& what) {
        warnings_.push_back({kind, place, what});
    }

    void read_draco(const tinygltf::Value& extension) {
        const std::string place = place_ + ".extensions.KHR_draco_mesh_compression";
        if (source_.mode != TINYGLTF_MODE_TRIANGLES || source_.indices < 0)
            document_.fail(place, "only triangles with indices can be compressed");
        const DracoLimits limits{
            document_.model.accessors.at(source_.attributes.at("POSITION")).count,
            document_.model.accessors.at(source_.indices).count};
        draco_ = decode_draco(document_.view(extension.Get("bufferView").GetNumberAsInt()).bytes,
                              limits, document_.file + ": " + place);
        for (const auto& [name, unused] : source_.attributes)
            if (const tinygltf::Value& ids = extension.Get("attributes"); ids.Has(name))
                draco_id_[name] = ids.Get(name).GetNumberAsInt();
    }

    /// What Draco holds of an attribute; none where the primitive has it uncompressed.
    std::optional<Elements> draco_elements(const std::string& name, int width) const {
        const auto id = draco_id_.find(name);
        if (id == draco_id_.end())
            return std::nullopt;
        const auto attribute = draco_->attributes.find(id->second);
        if (attribute == draco_->attributes.end() || attribute->second.width != width)
            document_.fail(place_ + ".extensions.KHR_draco_mesh_compression.attributes." + name,
                           "the Draco data have no attribute " + std::to_string(id->second) + " of "
                               + std::to_string(width) + " components; compress the file again");
        const auto& [bytes, component, unused] = attribute->second;
        return Elements{bytes,
                        component_size(static_cast<int>(component)) * width,
                        draco_->vertices,
                        component,
                        width,
                        document_.model.accessors.at(source_.attributes.at(name)).normalized};
    }

    bool has(const std::string& name) const { return source_.attributes.contains(name); }

    /// `width` floats a vertex, morph targets applied.
    std::vector<float> read_values(const std::string& name, int width, bool may_be_normalized) {
        const int accessor = source_.attributes.at(name);
        const std::string place = attribute_place(name);
        if (name != "POSITION"
            && document_.model.accessors.at(accessor).count != mesh_.positions.size())
            document_.fail(place, "has another count than POSITION");
        check_attribute_type(document_, accessor, may_be_normalized, place);
        const std::optional<Elements> compressed = draco_elements(name, width);
        std::vector<float> values =
            compressed ? to_floats(*compressed) : read_floats(document_, accessor, width, place);
        morph(values, name, width);
        return values;
    }

    template <int N>
    std::vector<glm::vec<N, float>> read(const std::string& name, bool may_be_normalized) {
        return to_vectors<N>(read_values(name, N, may_be_normalized));
    }

    /// values += weight * target, for every target (glTF 2.0, section 3.7.2.2).
    void morph(std::vector<float>& values, const std::string& name, int width) const {
        for (size_t i = 0; i < std::min(source_.targets.size(), shape_.weights.size()); ++i) {
            const auto target = source_.targets[i].find(name);
            if (target == source_.targets[i].end() || shape_.weights[i] == 0.0)
                continue;
            const std::string place = place_ + "." + at("targets", i) + "." + name;
            check_attribute_type(document_, target->second, true, place);
            const std::vector<float> offsets = read_floats(document_, target->second, width, place);
            if (offsets.size() != values.size())
                document_.fail(place, "has another count than the attribute that it changes");
            for (size_t k = 0; k < values.size(); ++k)
                values[k] += static_cast<float>(shape_.weights[i]) * offsets[k];
        }
    }

    void read_triangles() {
        std::vector<uint32_t> indices;
        const size_t vertices = mesh_.positions.size();
        if (draco_) {
            indices = std::move(draco_->indices);
        } else if (source_.indices >= 0) {
            indices = read_indices(document_, source_.indices, place_ + ".indices");
        } else {
            indices.resize(vertices);
            for (size_t i = 0; i < vertices; ++i)
                indices[i] = static_cast<uint32_t>(i);
        }
        for (size_t i = 0; i < indices.size(); ++i)
            if (indices[i] >= vertices)
                document_.fail(place_ + ".indices", "index " + std::to_string(indices[i]) + " at "
                                                        + std::to_string(i)
                                                        + " is out of range: there are "
                                                        + std::to_string(vertices) + " vertices");
        if (indices.size() < 3
            || (source_.mode == TINYGLTF_MODE_TRIANGLES && indices.size() % 3 != 0))
            warn("incomplete triangles", place_ + (source_.indices >= 0 ? ".indices" : ""),
                 "not whole triangles: " + counted(indices.size(), "index", "indices")
                     + ", the rest of which is ignored; export the mesh again");
        mesh_.triangles = triangles_of(indices, source_.mode);
    }

    /// Vertices of no triangle may be anything; they become 0 so that nobody meets them.
    void check_positions(const char* name) {
        std::vector<size_t> broken;
        for (size_t i = 0; i < mesh_.positions.size(); ++i)
            if (!is_finite(mesh_.positions[i]))
                broken.push_back(i);
        if (broken.empty())
            return;
        for (const glm::uvec3& triangle : mesh_.triangles)
            for (int corner = 0; corner < 3; ++corner)
                if (std::binary_search(broken.begin(), broken.end(), triangle[corner]))
                    document_.fail(attribute_place(name), "value of vertex "
                                                              + std::to_string(triangle[corner])
                                                              + " is not finite");
        for (const size_t vertex : broken)
            mesh_.positions[vertex] = glm::vec3(0.0f);
    }

    /// Normals of no length are made from the triangles around; others are brought to length 1.
    void read_normals() {
        if (!has("NORMAL"))
            return;
        mesh_.normals = read<3>("NORMAL", true);
        const bool is_morphed = !shape_.weights.empty();
        size_t bad = 0;
        std::vector<bool> lost(mesh_.normals.size());
        for (size_t i = 0; i < mesh_.normals.size(); ++i) {
            const float length = glm::length(mesh_.normals[i]);
            const bool usable = std::isfinite(length) && length > 1e-6f;
            bad += !usable || (std::abs(length - 1.0f) > 0.1f && !is_morphed);
            lost[i] = !usable;
            if (usable)
                mesh_.normals[i] /= length;
        }
        if (std::find(lost.begin(), lost.end(), true) != lost.end())
            make_normals(lost);
        if (bad > 0)
            warn("normals", attribute_place("NORMAL"),
                 "not of length 1 and replaced: " + std::to_string(bad) + " of "
                     + counted(mesh_.normals.size(), "normal")
                     + " (light goes by the triangles' own); export again, or without normals");
    }

    void make_normals(const std::vector<bool>& lost) {
        // In double: the squares of a small triangle's sides underflow in single precision.
        std::vector<glm::dvec3> sums(lost.size(), glm::dvec3(0.0));
        for (const glm::uvec3& t : mesh_.triangles) {
            const glm::dvec3 a(mesh_.positions[t.x]);
            const glm::dvec3 normal = glm::cross(glm::dvec3(mesh_.positions[t.y]) - a,
                                                 glm::dvec3(mesh_.positions[t.z]) - a);
            for (int corner = 0; corner < 3; ++corner)
                sums[t[corner]] += normal;
        }
        for (size_t i = 0; i < lost.size(); ++i)
            if (lost[i]) {
                const double length = glm::length(sums[i]);
                mesh_.normals[i] = std::isnormal(length) ? glm::vec3(sums[i] / length)
                                                         : glm::vec3(0.0f, 1.0f, 0.0f);
            }
    }

    std::vector<glm::vec4> read_colors() {
        if (!has("COLOR_0"))
            return {};
        std::vector<glm::vec4> colors;
        const int accessor = source_.attributes.at("COLOR_0");
        if (document_.model.accessors.at(accessor).type == TINYGLTF_TYPE_VEC3)
            for (const glm::vec3 color : read<3>("COLOR_0", true))
                colors.emplace_back(color, 1.0f);
        else
            colors = read<4>("COLOR_0", true);
        size_t broken = 0;
        for (glm::vec4& color : colors) {
            if (!is_finite(color)) {
                color = glm::vec4(1.0f);
                ++broken;
            }
            color = glm::clamp(color, 0.0f, 1.0f);
        }
        if (broken > 0)
            warn("colours", attribute_place("COLOR_0"),
                 "not finite, replaced by white: " + counted(broken, "colour")
                     + "; export the mesh again");
        return colors;
    }

    std::vector<glm::vec2> read_uv(const UvSource& source, const SourceMaterial& material) {
        const std::string name = "TEXCOORD_" + std::to_string(source.set);
        if (!has(name)) {
            warn("missing texture coordinates", place_ + ".attributes",
                 name + " is missing, which a texture of " + material.place
                     + " needs: its corner is used; export the mesh with its coordinates");
            return std::vector<glm::vec2>(mesh_.positions.size(), glm::vec2(0.0f));
        }
        std::vector<glm::vec2> uv = read<2>(name, true);
        size_t broken = 0;
        for (glm::vec2& coordinate : uv) {
            if (!source.is_identity())
                coordinate = source(coordinate);
            if (!is_finite(coordinate)) {
                coordinate = glm::vec2(0.0f);
                ++broken;
            }
        }
        if (broken > 0)
            warn("texture coordinates", attribute_place(name),
                 "not finite, replaced by 0: " + counted(broken, "coordinate")
                     + "; export the mesh again");
        return uv;
    }

    /// Linear blend skinning (glTF 2.0, section 3.7.3.3). Weights are brought to a sum of 1.
    void apply_skin() {
        const size_t count = mesh_.positions.size();
        std::vector<glm::dmat4> blended(count, glm::dmat4(0.0));
        std::vector<double> sums(count, 0.0);
        std::vector<uint32_t> first_joint(count, 0);
        int sets = 0;
        for (; has("JOINTS_" + std::to_string(sets)); ++sets) {
            const std::string joints_name = "JOINTS_" + std::to_string(sets);
            const std::string weights_name = "WEIGHTS_" + std::to_string(sets);
            if (!has(weights_name))
                document_.fail(place_ + ".attributes", weights_name + " is missing");
            const std::vector<float> joints = read_joints(joints_name);
            const std::vector<float> weights = read_values(weights_name, 4, true);
            for (size_t i = 0; i < 4 * count; ++i) {
                const auto joint = static_cast<uint32_t>(joints[i]);
                if (joint >= shape_.joints.size())
                    document_.fail(attribute_place(joints_name),
                                   "joint " + std::to_string(joint)
                                       + " is out of range: " + at("skins", shape_.skin) + " has "
                                       + std::to_string(shape_.joints.size()));
                if (sets == 0 && i % 4 == 0)
                    first_joint[i / 4] = joint;
                if (const double weight = weights[i]; weight > 0.0 && std::isfinite(weight)) {
                    blended[i / 4] += weight * shape_.joints[joint];
                    sums[i / 4] += weight;
                }
            }
        }
        if (sets == 0)
            document_.fail(place_ + ".attributes", "JOINTS_0 is missing, which a skin needs");
        size_t loose = 0;
        for (size_t i = 0; i < count; ++i) {
            if (sums[i] > 0.0) {
                blended[i] /= sums[i];
            } else {
                blended[i] = shape_.joints[first_joint[i]];
                ++loose;
            }
            const glm::dvec3 position(blended[i] * glm::dvec4(mesh_.positions[i], 1.0));
            mesh_.positions[i] = position;
            if (!mesh_.normals.empty()) {
                const glm::dvec3 turned = turn_normal(glm::dmat3(blended[i]), mesh_.normals[i]);
                if (const double length = glm::length(turned); std::isnormal(length))
                    mesh_.normals[i] = turned / length;
            }
        }
        if (loose > 0)
            warn("weights", attribute_place("WEIGHTS_0"),
                 "without weight, left to their first joint: "
                     + counted(loose, "vertex", "vertices") + "; export the mesh again");
        check_positions("WEIGHTS_0");
        const auto mirrors = [](const glm::dmat4& joint) {
            return glm::determinant(glm::dmat3(joint)) < 0.0;
        };
        if (std::all_of(shape_.joints.begin(), shape_.joints.end(), mirrors))
            for (glm::uvec3& triangle : mesh_.triangles)
                std::swap(triangle.y, triangle.z);
    }

    /// By the matrix of cofactors, which unlike the inverse always exists.
    static glm::dvec3 turn_normal(const glm::dmat3& m, glm::dvec3 normal) {
        return glm::cross(m[1], m[2]) * normal.x + glm::cross(m[2], m[0]) * normal.y
               + glm::cross(m[0], m[1]) * normal.z;
    }

    std::vector<float> read_joints(const std::string& name) {
        const tinygltf::Accessor& accessor =
            document_.model.accessors.at(source_.attributes.at(name));
        const auto component = static_cast<Component>(accessor.componentType);
        const std::string place = attribute_place(name);
        if ((component != Component::uint8 && component != Component::uint16)
            || accessor.normalized)
            document_.fail(place, "must be of bytes or shorts without sign");
        if (accessor.count != mesh_.positions.size())
            document_.fail(place, "has another count than POSITION");
        if (const std::optional<Elements> compressed = draco_elements(name, 4))
            return to_floats(*compressed);
        return read_floats(document_, source_.attributes.at(name), 4, place);
    }

    const Document& document_;
    const Shape& shape_;
    const tinygltf::Primitive& source_;
    const std::string place_;
    std::optional<DracoMesh> draco_;
    std::map<std::string, int> draco_id_; ///< by attribute
    Mesh mesh_;
    std::vector<Warning> warnings_;
};

/// The material that a variant gives a primitive (KHR_materials_variants); without one its own.
int material_of(const tinygltf::Primitive& primitive, int variant) {
    const auto* extension = find_extension(primitive.extensions, "KHR_materials_variants");
    if (variant >= 0 && extension) {
        const tinygltf::Value& mappings = extension->Get("mappings");
        for (size_t i = 0; i < mappings.ArrayLen(); ++i) {
            const tinygltf::Value& mapping = mappings.Get(static_cast<int>(i));
            const tinygltf::Value& variants = mapping.Get("variants");
            for (size_t k = 0; k < variants.ArrayLen(); ++k)
                if (variants.Get(static_cast<int>(k)).GetNumberAsInt() == variant)
                    return mapping.Get("material").GetNumberAsInt();
        }
    }
    return primitive.material;
}

/// Memory for what a primitive becomes and for what is in the way.
void take_memory(Document& document, const tinygltf::Primitive& primitive, int positions,
                 bool is_skinned, const std::string& place) {
    const uint64_t vertices = document.model.accessors.at(positions).count;
    const uint64_t indices =
        primitive.indices >= 0 ? document.model.accessors.at(primitive.indices).count : vertices;
    if (vertices > max_vertices || indices > max_vertices)
        document.fail(place, "has more than 2^31 vertices or indices; split the mesh",
                      ErrorKind::memory);
    document.memory.take(vertices, is_skinned ? 256 : 96, place);
    document.memory.take(indices, 8 + (primitive.mode == TINYGLTF_MODE_TRIANGLES ? 4 : 12), place);
}

} // namespace

Jobs collect_jobs(Document& document, const LoadSettings& settings, const Graph& graph,
                  Roles& roles) {
    int variant = -1;
    if (!settings.variant.empty())
        variant = find_named(variant_names(document), settings.variant, "`variant`");
    Jobs result;
    std::map<int, int> material_index;
    uint64_t not_triangles = 0, without_positions = 0;
    std::vector<bool> is_placed(graph.shapes.size());
    for (const PlacedShape& placed : graph.placed)
        is_placed[placed.shape] = true;
    for (size_t shape = 0; shape < graph.shapes.size(); ++shape) {
        const int mesh = graph.shapes[shape].mesh;
        const std::vector<tinygltf::Primitive>& primitives = document.model.meshes[mesh].primitives;
        const size_t begin = result.jobs.size();
        for (size_t i = 0; i < primitives.size() && is_placed[shape]; ++i) {
            const tinygltf::Primitive& primitive = primitives[i];
            const std::string place = at("meshes", mesh) + "." + at("primitives", i);
            if (primitive.mode > TINYGLTF_MODE_TRIANGLE_FAN)
                document.fail(place + ".mode", std::to_string(primitive.mode) + " is not a mode");
            if (primitive.mode < TINYGLTF_MODE_TRIANGLES) {
                ++not_triangles;
                continue;
            }
            const auto positions = primitive.attributes.find("POSITION");
            if (positions == primitive.attributes.end()) {
                ++without_positions;
                continue;
            }
            const int material = material_of(primitive, variant);
            const RoleFit fit = roles.of_material(material);
            if (fit.excluded)
                continue;
            take_memory(document, primitive, positions->second, graph.shapes[shape].skin >= 0,
                        place);
            const auto [entry, is_new] =
                material_index.try_emplace(material, static_cast<int>(result.materials.size()));
            if (is_new)
                result.materials.push_back(material);
            result.jobs.push_back({static_cast<int>(shape), i, entry->second, fit.rule});
        }
        result.of_shape.emplace_back(begin, result.jobs.size());
    }
    if (not_triangles > 0)
        document.warnings.add("points and lines", "meshes",
                              "ignored: " + counted(not_triangles, "primitive")
                                  + " of points or lines, without a surface; give them one if "
                                    "they should block light");
    if (without_positions > 0)
        document.warnings.add("no positions", "meshes",
                              "ignored: " + counted(without_positions, "primitive")
                                  + " without POSITION; export the file again");
    return result;
}

std::vector<Mesh> read_meshes(Document& document, const Graph& graph, const Jobs& jobs,
                              const std::vector<SourceMaterial>& materials,
                              const std::vector<bool>& wanted) {
    std::vector<DecodedPrimitive> decoded(jobs.jobs.size());
    for_all(jobs.jobs.size(), [&](size_t i) {
        const Job& job = jobs.jobs[i];
        if (wanted[i])
            decoded[i] = PrimitiveReader(document, graph.shapes[job.shape], job.primitive)
                             .read(materials[job.material]);
    });
    std::vector<Mesh> meshes;
    for (size_t i = 0; i < decoded.size(); ++i) {
        Mesh& mesh = decoded[i].mesh;
        mesh.name = document.model.meshes[graph.shapes[jobs.jobs[i].shape].mesh].name;
        mesh.material = jobs.jobs[i].material;
        meshes.push_back(std::move(mesh));
        for (const Warning& warning : decoded[i].warnings)
            document.warnings.add(warning.kind, warning.place, warning.what);
    }
    return meshes;
}

} // namespace lpvbake::scene::gltf
