// A glTF file, checked and parsed: tinygltf's model of its JSON, and the bytes that it refers to.
//
// tinygltf gets the JSON after our own checks and without buffers and images, which are read here:
// it neither opens files nor decodes anything.
#pragma once

#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "scene/gltf/memory.h"
#include "scene/gltf/tinygltf.h"
#include "scene/gltf/warnings.h"

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

using Bytes = std::span<const unsigned char>;

/// A buffer view as its accessors see it: decompressed.
struct View {
    Bytes bytes;
    uint64_t stride = 0; ///< bytes; 0: packed
};

/// Where an image's file is; its bytes are fetched when somebody wants them.
struct ImageSource {
    std::string name;
    std::string uri;
    int view = -1;
};

/// Every index in the model points into its array; every view lies inside its buffer. What is
/// const may be read by many threads; warnings and memory belong to one.
struct Document {
    std::string file;
    std::filesystem::path folder;
    bool allow_external = false;
    bool quantized = false; ///< attributes may be integers (KHR_mesh_quantization)
    tinygltf::Model model;
    std::vector<ImageSource> images;
    std::vector<View> views;
    Warnings warnings;
    MemoryLimit memory;

    /// `place` is a JSON path. To an invalid file that has no remedy of its own (after a
    /// semicolon), the usual one is added.
    [[noreturn]] void fail(const std::string& place, const std::string& why,
                           ErrorKind kind = ErrorKind::invalid) const;

    std::vector<std::vector<unsigned char>> storage; ///< that views point into
};

/// "array[index]".
std::string at(const char* array, size_t index);

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
