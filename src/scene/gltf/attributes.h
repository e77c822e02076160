// Values of a document's accessors, sparse substitutions applied.
#pragma once

#include "scene/gltf/accessor.h"
#include "scene/gltf/document.h"

#include <glm/glm.hpp>

namespace lpvbake::scene::gltf {

/// `width` floats an element. `user` is the JSON path of who asks. Throws Error.
std::vector<float> read_floats(const Document& document, int accessor, int width,
                               const std::string& user);

std::vector<uint32_t> read_indices(const Document& document, int accessor, const std::string& user);

/// Throws Error unless the accessor is of floats, of integers that are normalised where
/// `may_be_normalized`, or of any where the document is quantised.
void check_attribute_type(const Document& document, int accessor, bool may_be_normalized,
                          const std::string& place);

template <int N>
std::vector<glm::vec<N, float>> to_vectors(const std::vector<float>& values) {
    std::vector<glm::vec<N, float>> vectors(values.size() / N);
    for (size_t i = 0; i < vectors.size(); ++i)
        for (int k = 0; k < N; ++k)
            vectors[i][k] = values[i * N + k];
    return vectors;
}

template <int N>
std::vector<glm::vec<N, float>> read_vectors(const Document& document, int accessor,
                                             const std::string& user) {
    return to_vectors<N>(read_floats(document, accessor, N, user));
}

} // namespace lpvbake::scene::gltf
