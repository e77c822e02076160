// A scene's file with all that it refers to in it. It works on the JSON as it is, so that whatever
// it does not know of stays.
#include "lpvbake/pack.h"
#include "base64.h"
#include "quoted.h"
#include "scene/gltf/container.h"
#include "scene/gltf/document.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/json_text.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace lpvbake::scene::gltf {
namespace {

using Json = nlohmann::ordered_json;

std::string_view text_of(const std::vector<unsigned char>& bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// What kind of picture the bytes are; empty: none of those that glTF files refer to.
std::string media_type(const std::vector<unsigned char>& bytes) {
    const std::string_view text = text_of(bytes);
    if (text.starts_with("\x89PNG"))
        return "image/png";
    if (text.starts_with("\xff\xd8\xff"))
        return "image/jpeg";
    if (text.starts_with("RIFF")
        && text.substr(std::min<size_t>(8, text.size())).starts_with("WEBP"))
        return "image/webp";
    if (text.starts_with("\xabKTX 20\xbb"))
        return "image/ktx2";
    if (text.starts_with("DDS "))
        return "image/vnd-ms.dds";
    return {};
}

class Packer {
public:
    Packer(const std::string& path, const LoadSettings& settings)
        : path_(path),
          settings_(settings),
          memory_(path, settings.max_memory) {}

    PackedScene pack() {
        const std::vector<unsigned char> file = read_file(path_, path_);
        memory_.take(file.size(), 2, "the file");
        const Container container = open_container(file, path_);
        memory_.take(json_elements(container.text, path_), json_element_bytes, "its JSON");
        root_ = Json::parse(container.text, nullptr, false);
        if (root_.is_discarded()) {
            Warnings warnings(path_); // which loading it gives
            root_ = parse_json(container.text, path_, warnings);
        }
        pack_buffers(container.chunk);
        if (root_.contains("images"))
            for (size_t i = 0; i < root_["images"].size(); ++i)
                pack_image(at("images", i), root_["images"][i]);
        if (!packed_.bytes.empty())
            root_["buffers"][0]["byteLength"] = packed_.bytes.size();
        find_uris("", root_);
        packed_.scene = chosen_scene();
        packed_.json = root_.dump();
        return std::move(packed_);
    }

private:
    /// The bytes of a URI that leads to a file; none of one that has them itself.
    std::optional<std::vector<unsigned char>> file_of(const Json& object,
                                                      const std::string& place) {
        const auto found = object.find("uri");
        if (found == object.end() || is_data_uri(found->get_ref<const std::string&>()))
            return {};
        const std::string full_place = path_ + ": " + place + ".uri";
        const std::filesystem::path file =
            resolve_uri(std::filesystem::path(path_).parent_path(), found->get<std::string>(),
                        full_place, settings_.allow_external);
        memory_.take(file_size(file, full_place), 2, place);
        return read_file(file, full_place);
    }

    void pack_buffers(Bytes chunk) {
        if (!root_.contains("buffers") || root_["buffers"].empty())
            return;
        Json& first = root_["buffers"][0];
        const auto length = first.at("byteLength").get<size_t>();
        std::vector<unsigned char> bytes;
        if (auto file = file_of(first, at("buffers", 0)))
            bytes = std::move(*file);
        else if (first.contains("uri"))
            bytes = decode_data_uri(first["uri"].get<std::string>(), path_ + ": buffers[0].uri");
        else
            bytes.assign(chunk.begin(), chunk.end());
        if (bytes.size() < length)
            throw Error(bytes.empty() ? ErrorKind::unsupported : ErrorKind::invalid,
                        path_ + ": buffers[0]: has " + std::to_string(bytes.size())
                            + " bytes of byteLength " + std::to_string(length)
                            + ", and the first buffer is that which a .glb holds; export it again");
        packed_.bytes.assign(bytes.begin(), bytes.begin() + std::ptrdiff_t(length));
        first.erase("uri");
        for (size_t i = 1; i < root_["buffers"].size(); ++i)
            embed(at("buffers", i), root_["buffers"][i], "application/octet-stream");
    }

    void pack_image(const std::string& place, Json& image) {
        auto bytes = file_of(image, place);
        if (!bytes)
            return;
        const std::string type = image.value("mimeType", media_type(*bytes));
        if (type.empty() || bytes->empty()) {
            image["uri"] = "data:application/octet-stream;base64," + base64(text_of(*bytes));
            return;
        }
        packed_.bytes.resize((packed_.bytes.size() + 3) / 4 * 4);
        root_["bufferViews"].push_back(
            {{"buffer", 0}, {"byteOffset", packed_.bytes.size()}, {"byteLength", bytes->size()}});
        packed_.bytes.append(bytes->begin(), bytes->end());
        if (!root_.contains("buffers"))
            root_["buffers"] = Json::array({Json::object()});
        image.erase("uri");
        image["mimeType"] = type;
        image["bufferView"] = root_["bufferViews"].size() - 1;
    }

    void embed(const std::string& place, Json& object, const std::string& type) {
        if (const auto bytes = file_of(object, place))
            object["uri"] = "data:" + type + ";base64," + base64(text_of(*bytes));
    }

    /// Of what nobody here knows.
    void find_uris(const std::string& place, const Json& json) {
        for (const auto& [key, value] : json.items()) {
            const std::string inner = json.is_array() ? place + "[" + key + "]"
                                      : place.empty() ? key
                                                      : place + "." + key;
            if (value.is_structured() && key != "extras")
                find_uris(inner, value);
            else if (key == "uri" && value.is_string() && !is_data_uri(value.get<std::string>()))
                packed_.warnings.push_back(path_ + ": " + printable(inner) + ": "
                                           + in_quotes(value.get<std::string>())
                                           + " is not packed, as nothing here knows what it is");
        }
    }

    int chosen_scene() const {
        if (settings_.scene.empty())
            return root_.value("scene", 0);
        std::vector<std::string> names;
        for (const Json& scene : root_.value("scenes", Json::array()))
            names.push_back(scene.value("name", std::string()));
        return find_named(names, settings_.scene, "`scene`");
    }

    std::string path_;
    const LoadSettings& settings_;
    MemoryLimit memory_;
    Json root_;
    PackedScene packed_;
};

} // namespace
} // namespace lpvbake::scene::gltf

namespace lpvbake {

PackedScene pack_gltf(const std::string& path, const LoadSettings& settings) {
    if (path == standard_input)
        throw Error(ErrorKind::argument,
                    "standard input: is read once, by the bake: a scene that is "
                    "to be written again has to have a file");
    try {
        return scene::gltf::Packer(path, settings).pack();
    } catch (const nlohmann::json::exception& error) {
        throw Error(ErrorKind::invalid, path + ": is not valid glTF: " + without_label(error.what())
                                            + "; repair the file or export it again");
    }
}

} // namespace lpvbake
