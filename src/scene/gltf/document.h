// A glTF file, checked and parsed: tinygltf's model of its JSON, and the bytes that it refers to.
//
// tinygltf gets the JSON after our own repairs and checks and without buffers, images and cameras,
// which are read here: it neither opens files nor decodes anything.
#pragma once

#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "scene/gltf/memory.h"
#include "scene/gltf/tinygltf.h"
#include "scene/gltf/warnings.h"

#include <tbb/concurrent_vector.h>

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

using Bytes = std::span<const unsigned char>;

/// A buffer view as its accessors see it: decompressed.
struct View {
    Bytes bytes;
    uint64_t stride = 0;             ///< bytes; 0: packed
    bool has_valid_stride = true;    ///< by glTF's rule of multiples of 4 up to 252
    std::optional<Error> fault = {}; ///< why there are no bytes, for those who want them
};

/// Where an image's file is; its bytes are fetched when somebody wants them.
struct ImageSource {
    std::string name;
    std::string uri;
    int view = -1;
};

/// A perspective camera, if it is one.
struct CameraSource {
    std::string name;
    double yfov = 0.0;   ///< radians; 0: none that can be used, of which there was a warning
    double aspect = 0.0; ///< 0: the picture's
    bool is_orthographic = false;
};

/// Every index in the model points into its array; every view lies inside its buffer, or has the
/// fault of a buffer that cannot be read, of which there is a warning, as nothing may use it. What
/// is const may be read by many threads; warnings and memory belong to one.
struct Document {
    std::string file;
    std::optional<std::filesystem::path> folder; ///< none: of standard input
    bool allow_external = false;
    bool quantized = false; ///< attributes may be integers (KHR_mesh_quantization)
    tinygltf::Model model;
    std::vector<ImageSource> images;
    std::vector<CameraSource> cameras;
    std::vector<View> views;
    Warnings warnings;
    MemoryLimit memory;

    /// `place` is a JSON path. To an invalid file that has no remedy of its own (after a
    /// semicolon), the usual one is added.
    [[noreturn]] void fail(const std::string& place, const std::string& why,
                           ErrorKind kind = ErrorKind::invalid) const;

    /// The bytes of a file beside the scene, its first `most` if it has more. Throws Error,
    /// beginning with `place`, as resolve_uri and read_file do.
    std::vector<unsigned char> file_beside(const std::string& uri, const std::string& place,
                                           uint64_t most) const;

    /// A view that has its bytes. Throws Error: why it has none.
    const View& view(int index) const;

    std::vector<std::vector<unsigned char>> storage;         ///< that views point into
    mutable tbb::concurrent_vector<std::string> beside = {}; ///< paths of the files that were read
};

/// "array[index]".
std::string at(const char* array, size_t index);

/// How messages call the scene of a path.
std::string name_of(const std::string& path);

/// Reads the file and its buffers, whole. Throws Error, as load_gltf does.
Document parse_document(const std::string& path, const LoadSettings& settings);

/// The index of what `text` names, by name or, where no name fits, by number. Throws Error
/// (argument), beginning with `setting` as it is, that lists what there is.
int find_named(const std::vector<std::string>& names, const std::string& text, const char* setting);

/// Of KHR_materials_variants.
std::vector<std::string> variant_names(const Document& document);

/// An extension's object, null if it is not there.
const tinygltf::Value* find_extension(const tinygltf::ExtensionMap& extensions, const char* name);

/// Runs f(0) to f(count - 1) on all threads. Of several exceptions the one of the lowest index is
/// thrown, whatever the threads did.
void for_all(size_t count, const std::function<void(size_t)>& f);

} // namespace lpvbake::scene::gltf
