// glTF documents made in code, and a fixture that loads them from a folder of its own.
#pragma once

#include "lpvbake/error.h"
#include "lpvbake/scene.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace lpvbake {

/// PNG of 2 x 1 texels: (255, 0, 0, 255) and (0, 255, 51, 128).
inline constexpr const char* png =
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR42mP4z8Dwn+G/"
    "cQMAEN8DsebGrcEAAAAASUVORK5CYII=";

enum Type { int8 = 5120, uint8 = 5121, int16 = 5122, uint16 = 5123, uint32 = 5125, real = 5126 };

inline std::string base64(const std::string& bytes) {
    const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t bits = 0;
        for (size_t k = 0; k < 3; ++k)
            bits =
                bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        for (size_t k = 0; k < 4; ++k)
            text += i + k <= bytes.size() ? digits[bits >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

template <typename T>
std::string packed(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// A glTF document in the making; its one buffer is written as a data URI.
struct GltfDocument {
    nlohmann::json root = {{"asset", {{"version", "2.0"}}},
                           {"scenes", {{{"nodes", nlohmann::json::array()}}}}};
    std::string bytes;

    int append(const char* array, const nlohmann::json& value) {
        root[array].push_back(value);
        return static_cast<int>(root[array].size()) - 1;
    }

    int view(const std::string& data) {
        bytes.resize((bytes.size() + 3) / 4 * 4);
        const size_t offset = bytes.size();
        bytes += data;
        return append("bufferViews",
                      {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", data.size()}});
    }

    template <typename T>
    int accessor(const std::vector<T>& values, Type type, const std::string& shape,
                 bool normalized = false) {
        const size_t width = shape == "SCALAR" ? 1 : shape.back() - '0';
        return append("accessors", {{"bufferView", view(packed(values))},
                                    {"componentType", type},
                                    {"count", values.size() / width},
                                    {"type", shape},
                                    {"normalized", normalized}});
    }

    /// A node of the default scene.
    int place(const nlohmann::json& node) {
        const int index = append("nodes", node);
        root["scenes"][0]["nodes"].push_back(index);
        return index;
    }

    /// Places a mesh of one primitive.
    nlohmann::json& primitive(const nlohmann::json& primitive) {
        const int mesh = append("meshes", {{"primitives", {primitive}}});
        place({{"mesh", mesh}});
        return root["meshes"][mesh]["primitives"][0];
    }

    /// Places a right triangle (0,0,0) (1,0,0) (0,1,0).
    nlohmann::json& triangle() {
        return primitive(
            {{"attributes",
              {{"POSITION", accessor<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}, real, "VEC3")}}}});
    }

    std::string text() const {
        nlohmann::json copy = root;
        if (!bytes.empty() && !copy.contains("buffers"))
            copy["buffers"] = {{{"byteLength", bytes.size()},
                                {"uri", "data:application/octet-stream;base64," + base64(bytes)}}};
        return copy.dump();
    }

    std::string glb() const {
        nlohmann::json copy = root;
        copy["buffers"] = {{{"byteLength", bytes.size()}}};
        std::string text = copy.dump(), data = bytes;
        text.resize((text.size() + 3) / 4 * 4, ' ');
        data.resize((data.size() + 3) / 4 * 4);
        const auto word = [](size_t value) {
            const auto number = static_cast<uint32_t>(value);
            return std::string(reinterpret_cast<const char*>(&number), 4);
        };
        return "glTF" + word(2) + word(28 + text.size() + data.size()) + word(text.size()) + "JSON"
               + text + word(data.size()) + std::string("BIN\0", 4) + data;
    }
};

/// A triangle with UVs and one material with the PNG above as base colour.
inline GltfDocument textured(const nlohmann::json& material_extra = nlohmann::json::object()) {
    GltfDocument document;
    nlohmann::json& primitive = document.triangle();
    primitive["attributes"]["TEXCOORD_0"] =
        document.accessor<float>({0.25f, 0.5f, 0.75f, 0.5f, 1, 1}, real, "VEC2");
    primitive["material"] = 0;
    nlohmann::json material = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
    material.merge_patch(material_extra);
    document.root["materials"] = {material};
    document.root["images"] = {{{"uri", png}}};
    document.root["textures"] = {{{"source", 0}}};
    return document;
}

class Gltf : public ::testing::Test {
protected:
    void SetUp() override {
        const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
        folder_ = std::filesystem::path(::testing::TempDir())
                  / (std::string("lpvbake_gltf_") + test->name());
        std::filesystem::remove_all(folder_);
        std::filesystem::create_directories(folder_);
        path_ = (folder_ / "scene.gltf").string();
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }

    void write(const std::filesystem::path& path, const std::string& bytes) {
        std::ofstream(path, std::ios::binary) << bytes;
    }

    Scene load_text(const std::string& text, const LoadSettings& settings = {}) {
        write(path_, text);
        return load_gltf(path_, settings);
    }

    Scene load(const GltfDocument& document, const LoadSettings& settings = {}) {
        return load_text(document.text(), settings);
    }

    /// Checks that a text is refused in one line that names the file and holds `part`.
    void expect_error(const std::string& text, ErrorKind kind, const std::string& part,
                      const LoadSettings& settings = {}) {
        try {
            load_text(text, settings);
            ADD_FAILURE() << "was accepted; expected: " << part;
        } catch (const Error& error) {
            const std::string what = error.what();
            EXPECT_EQ(error.kind, kind) << what;
            EXPECT_EQ(what.rfind(path_, 0), 0u) << what;
            EXPECT_NE(what.find(part), std::string::npos) << what << "\nlacks: " << part;
            EXPECT_EQ(what.find('\n'), std::string::npos) << what;
        }
    }

    void expect_error(const GltfDocument& document, const std::string& part,
                      ErrorKind kind = ErrorKind::invalid, const LoadSettings& settings = {}) {
        expect_error(document.text(), kind, part, settings);
    }

    static void expect_warning(const Scene& scene, const std::string& part) {
        for (const std::string& warning : scene.warnings)
            if (warning.find(part) != std::string::npos)
                return;
        ADD_FAILURE() << "no warning holds: " << part;
    }

    std::filesystem::path folder_;
    std::string path_;
};

inline std::vector<glm::dvec3> world_positions(const Scene& scene, size_t instance = 0) {
    std::vector<glm::dvec3> result;
    for (const glm::vec3 p : scene.meshes[scene.instances[instance].mesh].positions)
        result.emplace_back(scene.instances[instance].to_world * glm::dvec4(p, 1.0));
    return result;
}

inline void expect_near(glm::dvec3 a, glm::dvec3 b, double tolerance = 1e-6) {
    EXPECT_LT(glm::distance(a, b), tolerance) << a.x << " " << a.y << " " << a.z;
}

} // namespace lpvbake
