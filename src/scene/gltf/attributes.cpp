#include "scene/gltf/attributes.h"

#include <algorithm>

namespace lpvbake::scene::gltf {
namespace {

/// `count` elements that begin `offset` bytes into a buffer view. `stride` 0: packed.
Elements view_elements(const Document& document, int view_index, uint64_t offset, uint64_t count,
                       uint64_t stride, int component, int width, const std::string& place) {
    const View& view = document.view(view_index);
    const std::string view_place = at("bufferViews", view_index);
    const uint64_t size = component_size(component) * width;
    if (size == 0)
        document.fail(place,
                      "componentType " + std::to_string(component) + " is not one of glTF 2.0");
    if (stride == 0 || (stride < size && !view.has_valid_stride))
        stride = size;
    if (stride < size)
        document.fail(view_place, "byteStride " + std::to_string(stride)
                                      + " is less than an element of " + place);
    if (offset > view.bytes.size() || !fits(count, stride, size, view.bytes.size() - offset))
        document.fail(place, "its " + std::to_string(count) + " elements run past " + view_place);
    return {view.bytes.subspan(offset),        stride, count,
            static_cast<Component>(component), width,  false};
}

Elements accessor_elements(const Document& document, const tinygltf::Accessor& accessor, int width,
                           const std::string& place) {
    if (accessor.count == 0)
        document.fail(place, "count must be at least 1");
    Elements elements;
    if (accessor.bufferView >= 0) {
        elements = view_elements(document, accessor.bufferView, accessor.byteOffset, accessor.count,
                                 document.view(accessor.bufferView).stride, accessor.componentType,
                                 width, place);
    } else {
        elements.count = accessor.count;
        elements.width = width;
        elements.component = static_cast<Component>(accessor.componentType);
    }
    elements.normalized = accessor.normalized;
    return elements;
}

/// The elements that a sparse accessor replaces.
std::vector<uint32_t> sparse_targets(const Document& document, const tinygltf::Accessor& accessor,
                                     const std::string& place) {
    const auto& indices = accessor.sparse.indices;
    const auto component = static_cast<Component>(indices.componentType);
    if (component != Component::uint8 && component != Component::uint16
        && component != Component::uint32)
        document.fail(place, "sparse.indices.componentType is not an unsigned integer");
    std::vector<uint32_t> targets = to_indices(
        view_elements(document, indices.bufferView, indices.byteOffset, accessor.sparse.count, 0,
                      indices.componentType, 1, place + ".sparse.indices"));
    for (const uint32_t target : targets)
        if (target >= accessor.count)
            document.fail(place, "sparse index " + std::to_string(target) + " is out of range");
    return targets;
}

} // namespace

std::vector<float> read_floats(const Document& document, int index, int width,
                               const std::string& user) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(index);
    const std::string place = user + " (" + at("accessors", index) + ")";
    if (tinygltf::GetNumComponentsInType(accessor.type) != width)
        document.fail(place, width == 1    ? "must be of type SCALAR"
                             : width == 16 ? "must be of type MAT4"
                                           : "must be of type VEC" + std::to_string(width));
    const Elements elements = accessor_elements(document, accessor, width, place);
    std::vector<float> values = accessor.bufferView >= 0
                                    ? to_floats(elements)
                                    : std::vector<float>(elements.count * width, 0.0f);
    if (!accessor.sparse.isSparse)
        return values;
    const std::vector<uint32_t> targets = sparse_targets(document, accessor, place);
    const auto& sparse = accessor.sparse;
    Elements replacement =
        view_elements(document, sparse.values.bufferView, sparse.values.byteOffset, sparse.count, 0,
                      accessor.componentType, width, place + ".sparse.values");
    replacement.normalized = accessor.normalized;
    const std::vector<float> replacements = to_floats(replacement);
    for (size_t i = 0; i < targets.size(); ++i)
        std::copy_n(&replacements[i * width], width, &values[size_t{targets[i]} * width]);
    return values;
}

std::vector<uint32_t> read_indices(const Document& document, int index, const std::string& user) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(index);
    const std::string place = user + " (" + at("accessors", index) + ")";
    const auto component = static_cast<Component>(accessor.componentType);
    if (accessor.type != TINYGLTF_TYPE_SCALAR
        || (component != Component::uint8 && component != Component::uint16
            && component != Component::uint32))
        document.fail(place, "must be a SCALAR of unsigned integers");
    const Elements elements = accessor_elements(document, accessor, 1, place);
    std::vector<uint32_t> values =
        accessor.bufferView >= 0 ? to_indices(elements) : std::vector<uint32_t>(elements.count, 0u);
    if (!accessor.sparse.isSparse)
        return values;
    const std::vector<uint32_t> targets = sparse_targets(document, accessor, place);
    const std::vector<uint32_t> replacements = to_indices(view_elements(
        document, accessor.sparse.values.bufferView, accessor.sparse.values.byteOffset,
        accessor.sparse.count, 0, accessor.componentType, 1, place + ".sparse.values"));
    for (size_t i = 0; i < targets.size(); ++i)
        values[targets[i]] = replacements[i];
    return values;
}

void check_attribute_type(const Document& document, int accessor_index, bool may_be_normalized,
                          const std::string& place) {
    const tinygltf::Accessor& accessor = document.model.accessors.at(accessor_index);
    const bool is_float = accessor.componentType == static_cast<int>(Component::float32);
    if (component_size(accessor.componentType) == 0
        || accessor.componentType == static_cast<int>(Component::uint32))
        document.fail(place, "componentType " + std::to_string(accessor.componentType)
                                 + " is not allowed");
    if (!is_float && !document.quantized && !(may_be_normalized && accessor.normalized))
        document.fail(place, "must be of floats, unless KHR_mesh_quantization is used");
}

} // namespace lpvbake::scene::gltf
