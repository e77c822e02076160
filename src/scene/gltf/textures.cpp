#include "colour/colour.h"
#include "image/header.h"
#include "image/image.h"
#include "quoted.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/materials.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

namespace lpvbake::scene::gltf {
namespace {

constexpr uint64_t max_image_texels = 1ull << 28; ///< of one image, 16384 x 16384

// ---------------------------------------------------------------- references

int extension_source(const tinygltf::Texture& texture, const char* name) {
    const auto* extension = find_extension(texture.extensions, name);
    return extension && extension->Has("source") ? extension->Get("source").GetNumberAsInt() : -1;
}

/// The images of a texture, best first; none, with a warning, if there is none that is understood.
std::vector<int> images_of(Document& document, int texture_index) {
    const tinygltf::Texture& texture = document.model.textures.at(texture_index);
    std::vector<int> images;
    for (const int image : {extension_source(texture, "EXT_texture_webp"), texture.source})
        if (image >= 0)
            images.push_back(image);
    if (!images.empty())
        return images;
    const std::string place = at("textures", texture_index);
    if (extension_source(texture, "KHR_texture_basisu") >= 0) {
        document.warnings.add("KHR_texture_basisu", place + ".extensions.KHR_texture_basisu",
                              "Basis Universal images cannot be read and there is none to fall "
                              "back on: materials use their factors alone; add a PNG, JPEG or "
                              "WebP image as source");
        return {};
    }
    std::string names;
    for (const auto& [name, unused] : texture.extensions)
        if (name != "EXT_texture_webp" && name != "KHR_texture_basisu")
            names += (names.empty() ? "" : ", ") + printable(name);
    if (!names.empty())
        document.fail(place,
                      "has no source but for " + printable(names, 400)
                          + ", which is not supported; add a PNG, JPEG or WebP image as source",
                      ErrorKind::unsupported);
    document.warnings.add("textures without source", place,
                          "has no source: materials use their factors alone; add an image");
    return {};
}

Texture texture_of(Document& document, int index) {
    Texture texture;
    const int sampler_index = document.model.textures.at(index).sampler;
    if (sampler_index < 0)
        return texture;
    const tinygltf::Sampler& sampler = document.model.samplers.at(sampler_index);
    const auto wrap = [&](int mode, const char* property) {
        switch (mode) {
        case TINYGLTF_TEXTURE_WRAP_REPEAT:
            return Wrap::repeat;
        case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
            return Wrap::mirrored_repeat;
        case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
            return Wrap::clamp_to_edge;
        default:
            document.warnings.add("wrap modes", at("samplers", sampler_index) + property,
                                  std::to_string(mode)
                                      + " is not a wrap mode: the texture is repeated; write "
                                        "10497, 33071 or 33648");
            return Wrap::repeat;
        }
    };
    texture.wrap_u = wrap(sampler.wrapS, ".wrapS");
    texture.wrap_v = wrap(sampler.wrapT, ".wrapT");
    texture.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    return texture;
}

// ---------------------------------------------------------------- images

/// Names an image in messages.
std::string place_of(const Document& document, int index) {
    const std::string& uri = document.images.at(index).uri;
    return document.file + ": " + at("images", index)
           + (uri.empty() || is_data_uri(uri) ? "" : " (" + printable(percent_decoded(uri)) + ")");
}

/// The encoded bytes of an image, its first `most` if it has more and lies in a file.
class EncodedImage {
public:
    EncodedImage(const Document& document, int index, uint64_t most) {
        const ImageSource& source = document.images.at(index);
        const std::string place = document.file + ": " + at("images", index);
        if (source.view >= 0) {
            bytes = document.view(source.view).bytes;
        } else if (is_data_uri(source.uri)) {
            storage_ = decode_data_uri(source.uri, place + ".uri");
            bytes = storage_;
        } else if (!source.uri.empty()) {
            storage_ = document.file_beside(source.uri, place + ".uri", most);
            bytes = storage_;
        } else {
            document.fail(at("images", index), "has neither a uri nor a bufferView");
        }
    }
    EncodedImage(const EncodedImage&) = delete;

    Bytes bytes;

private:
    std::vector<unsigned char> storage_;
};

image::ImageHeader header_of(const Document& document, int index) {
    constexpr uint64_t head = 1 << 20; // metadata before a JPEG's size is smaller, but for few
    for (const uint64_t most : {head, std::numeric_limits<uint64_t>::max()}) {
        const EncodedImage image(document, index, most);
        if (const auto header = image::read_image_header(std::as_bytes(image.bytes));
            header.texels() > 0)
            return header;
    }
    return {}; // the decoder says what is wrong
}

/// What is wanted of an image.
struct Need {
    bool sampled = false; ///< by a texture of the scene
    bool decoded = false;
    bool kept = true; ///< else decoded is what it would have been, of which the size is planned

    bool covers(const Need& other) const {
        return (sampled || !other.sampled) && (decoded || !other.decoded) && (kept || !other.kept);
    }
};

/// An image and what materials want to know of it.
struct DecodedImage {
    Image image;
    glm::dvec3 mean{0.0};        ///< linear
    glm::dvec3 mean_stored{0.0}; ///< of the stored values, 0 to 1
};

DecodedImage with_statistics(Image image) {
    std::array<std::array<uint64_t, 256>, 3> counts{};
    for (size_t i = 0; i < image.rgba.size(); i += 4)
        for (size_t channel = 0; channel < 3; ++channel)
            ++counts[channel][image.rgba[i + channel]];
    DecodedImage result;
    const auto texels = static_cast<double>(image.rgba.size() / 4);
    for (int channel = 0; channel < 3; ++channel)
        for (int value = 0; value < 256; ++value)
            if (const uint64_t count = counts[channel][value]; count > 0) {
                const double linear = colour::srgb_to_linear(value / 255.0);
                const double share = static_cast<double>(count) / texels;
                result.mean[channel] += share * linear;
                result.mean_stored[channel] += share * (value / 255.0);
            }
    result.image = std::move(image);
    return result;
}

/// The nearest stored value of a linear one in [0, 1]: how many of the 255 values half way between
/// lie at or below it, found from the count at the start of its 1/4096.
uint8_t stored_value(float linear) {
    constexpr int parts = 4096;
    struct Table {
        std::array<float, 256> half_ways;
        std::array<uint8_t, parts + 1> counts;
    };
    static const Table table = [] {
        Table t;
        for (int i = 0; i < 255; ++i)
            t.half_ways[i] = static_cast<float>(colour::srgb_to_linear((i + 0.5) / 255.0));
        t.half_ways[255] = 2.0f;
        for (int i = 0; i <= parts; ++i)
            t.counts[i] = static_cast<uint8_t>(
                std::upper_bound(t.half_ways.begin(), t.half_ways.end(), float(i) / parts)
                - t.half_ways.begin());
        return t;
    }();
    uint8_t value = table.counts[static_cast<int>(linear * parts)];
    while (table.half_ways[value] <= linear)
        ++value;
    return value;
}

/// Half as wide and half as high: the mean of 2 x 2 texels, colour in linear light.
Image halved(const Image& image) {
    const std::array<float, 256>& linear = colour::linear_values();
    Image half{image.name, std::max(1, image.width / 2), std::max(1, image.height / 2), {}};
    half.rgba.resize(size_t{4} * half.width * half.height);
    uint8_t* out = half.rgba.data();
    for (int y = 0; y < half.height; ++y) {
        const int rows[2] = {2 * y, std::min(2 * y + 1, image.height - 1)};
        for (int x = 0; x < half.width; ++x, out += 4) {
            const int columns[2] = {2 * x, std::min(2 * x + 1, image.width - 1)};
            float sums[3] = {};
            int alpha = 2; // rounds
            for (const int row : rows)
                for (const int column : columns) {
                    const uint8_t* texel = &image.rgba[4 * (size_t(row) * image.width + column)];
                    for (int channel = 0; channel < 3; ++channel)
                        sums[channel] += linear[texel[channel]];
                    alpha += texel[3];
                }
            for (int channel = 0; channel < 3; ++channel)
                out[channel] = stored_value(std::min(sums[channel] / 4.0f, 1.0f));
            out[3] = static_cast<uint8_t>(alpha / 4);
        }
    }
    return half;
}

std::string name_of(const Document& document, int index) {
    const std::string& name = document.images[index].name;
    return name.empty() ? place_of(document, index) : name;
}

DecodedImage load_image(const Document& document, int index, int halvings) {
    const EncodedImage encoded(document, index, std::numeric_limits<uint64_t>::max());
    image::Rgba8 decoded = image::decode_image(std::as_bytes(encoded.bytes),
                                               place_of(document, index), max_image_texels);
    DecodedImage result = with_statistics(
        {name_of(document, index), decoded.width, decoded.height, std::move(decoded.texels)});
    for (int i = 0; i < halvings; ++i)
        result.image = halved(result.image);
    return result;
}

/// An image that is wanted, and how far it got.
struct WantedImage {
    int index;
    Need need;
    image::ImageHeader header = {};
    int halvings = 0;
    std::optional<Error> fault = {}; ///< why it cannot be read
    DecodedImage image = {};

    /// Runs f, and keeps for a fault what speaks of the file alone: not of memory, of the program,
    /// or of what a user may allow.
    void attempt(const auto& f) {
        try {
            f();
        } catch (const LeadsOut&) {
            throw;
        } catch (const Error& error) {
            if (error.kind == ErrorKind::memory || error.kind == ErrorKind::failure)
                throw;
            fault = error;
        }
    }

    uint64_t texels() const { return std::max<uint64_t>(1, header.texels()); }
    bool is_to_decode() const { return need.decoded && !fault; }
};

/// Halves images until all fit into half of what memory is left.
void plan_images(Document& document, std::vector<WantedImage>& images) {
    uint64_t sum = 0, largest = 0;
    std::vector<uint64_t> texels(images.size(), 0);
    size_t count = 0, reduced = 0;
    for (size_t i = 0; i < images.size(); ++i)
        if (images[i].is_to_decode()) {
            texels[i] = images[i].texels();
            sum += texels[i];
            largest = std::max(largest, texels[i]);
            ++count;
        }
    const uint64_t limit = document.memory.left() / 2 / 4;
    while (sum > limit && largest > 4) {
        const uint64_t level = largest / 4;
        largest = 0;
        for (size_t i = 0; i < images.size(); ++i) {
            if (sum > limit && texels[i] > 4 && texels[i] >= level * 2) {
                reduced += images[i].halvings == 0;
                ++images[i].halvings;
                sum -= texels[i] - texels[i] / 4;
                texels[i] /= 4;
            }
            largest = std::max(largest, texels[i]);
        }
    }
    document.memory.take(sum, 4, "images");
    if (reduced > 0)
        document.warnings.add("images", "images",
                              "halved, once or more, to fit into memory: " + std::to_string(reduced)
                                  + " of " + std::to_string(count)
                                  + "; allow more with `max_memory` or use smaller ones");
}

/// Bytes a texel that a decoder takes on its way, at most: progressive JPEG keeps three
/// coefficients of two bytes, and there is the picture as decoded and as RGBA.
constexpr uint64_t decoding_bytes = 14;

/// Decodes images, so many at a time that what passes through memory meanwhile stays below the
/// limit on what stays. Throws Error (memory) where one alone is past it.
void decode_images(const Document& document, std::vector<WantedImage>& images) {
    std::vector<WantedImage*> open;
    for (WantedImage& image : images)
        if (image.is_to_decode() && image.need.kept)
            open.push_back(&image);
        else if (image.is_to_decode() && image.need.sampled)
            image.image.image = {name_of(document, image.index),
                                 int(image.header.width),
                                 int(image.header.height),
                                 {}};
    for (size_t begin = 0, end = 0; begin < open.size(); begin = end) {
        MemoryLimit passing(document.file, document.memory.limit());
        do
            passing.take(open[end]->texels(), decoding_bytes, at("images", open[end]->index));
        while (++end < open.size() && open[end]->texels() <= passing.left() / decoding_bytes);
        for_all(end - begin, [&](size_t i) {
            WantedImage& image = *open[begin + i];
            image.attempt([&] { image.image = load_image(document, image.index, image.halvings); });
            if (!image.need.sampled)
                image.image.image = {};
        });
    }
}

/// Reads images as far as they are needed: decoded, or their sizes, for which one whose header does
/// not tell is decoded as well.
void read_images(Document& document, std::vector<WantedImage>& images) {
    for (WantedImage& image : images)
        image.attempt([&] {
            image.header = header_of(document, image.index);
            const uint64_t texels = image.header.texels();
            if (!image.need.decoded && texels > 0 && texels <= max_image_texels)
                image.image.image = {name_of(document, image.index),
                                     int(image.header.width),
                                     int(image.header.height),
                                     {}};
            else if (!image.need.decoded)
                image.image.image = load_image(document, image.index, 0).image;
        });
    plan_images(document, images);
    decode_images(document, images);
}

/// The textures that materials use, each with the first of its images that can be read.
class Textures {
public:
    Textures(Document& document, std::vector<SourceMaterial>& materials,
             const std::vector<bool>& wanted, bool skip_colors)
        : document_(document),
          materials_(materials),
          wanted_(wanted),
          skip_colors_(skip_colors) {}

    /// Materials lose the textures that have no image.
    void read() {
        std::vector<WantedImage> open;
        do {
            std::map<int, Need> needs;
            for (size_t i = 0; i < materials_.size(); ++i) {
                SourceMaterial& material = materials_[i];
                need(material.base_texture, {true, !skip_colors_, wanted_[i]}, needs);
                need(material.emission_texture, {true, true, wanted_[i]}, needs);
                need(material.metallic_texture, {false, true, wanted_[i]}, needs);
                need(material.transmission_texture, {false, true, wanted_[i]}, needs);
                need(material.thickness_texture, {false, true, wanted_[i]}, needs);
            }
            open.clear();
            for (const auto& [image, wanted] : needs)
                if (const auto known = images_.find(image);
                    known == images_.end() || !known->second.need.covers(wanted))
                    open.push_back({image, wanted});
            read_images(document_, open);
            for (WantedImage& image : open) {
                if (image.fault)
                    leave_out(image);
                images_.insert_or_assign(image.index, std::move(image));
            }
        } while (!open.empty());
    }

    /// The image of a texture that materials have kept; null if it was not decoded.
    const DecodedImage* decoded(int texture) const {
        if (texture < 0)
            return nullptr;
        const WantedImage& image = images_.at(first_image(texture));
        return image.need.decoded ? &image.image : nullptr;
    }

    /// Puts all sampled images into the scene, by glTF's order, and the textures of materials, by
    /// theirs.
    void move_to(Scene& scene) {
        std::map<int, int> scene_image, scene_texture;
        for (auto& [index, image] : images_)
            if (image.need.sampled && !image.fault) {
                scene_image[index] = static_cast<int>(scene.images.size());
                scene.images.push_back(std::move(image.image.image));
            }
        const auto resolve = [&](int texture) {
            if (texture < 0)
                return -1;
            const auto [entry, is_new] =
                scene_texture.try_emplace(texture, static_cast<int>(scene.textures.size()));
            if (is_new) {
                scene.textures.push_back(texture_of(document_, texture));
                scene.textures.back().image = scene_image.at(first_image(texture));
            }
            return entry->second;
        };
        for (SourceMaterial& source : materials_) {
            source.material.base_color_texture = resolve(source.base_texture);
            source.material.emission_texture = resolve(source.emission_texture);
        }
    }

private:
    bool is_left_out(int image) const {
        const auto known = images_.find(image);
        return known != images_.end() && known->second.fault;
    }

    /// The first image of a texture that may still be read, -1 if there is none left.
    int first_image(int texture) const {
        for (const int image : candidates_.at(texture))
            if (!is_left_out(image))
                return image;
        return -1;
    }

    void need(int& texture, const Need& wanted, std::map<int, Need>& needs) {
        if (texture < 0)
            return;
        if (!candidates_.contains(texture))
            candidates_[texture] = images_of(document_, texture);
        const int image = first_image(texture);
        if (image < 0)
            texture = -1;
        else {
            Need& known = needs.try_emplace(image, Need{false, false, false}).first->second;
            known = {known.sampled || wanted.sampled, known.decoded || wanted.decoded,
                     known.kept || wanted.kept};
        }
    }

    void leave_out(const WantedImage& image) {
        bool is_last = false;
        for (const auto& [texture, images] : candidates_)
            is_last |= !images.empty() && images.back() == image.index;
        document_.warnings.add("images that cannot be read", *image.fault,
                               is_last ? "materials use their factors alone"
                                       : "the image to fall back on is taken");
    }

    Document& document_;
    std::vector<SourceMaterial>& materials_;
    const std::vector<bool>& wanted_; ///< of each material
    const bool skip_colors_;
    std::map<int, std::vector<int>> candidates_; ///< by glTF texture
    std::map<int, WantedImage> images_;          ///< by glTF image, as far as they were tried
};

} // namespace

std::vector<glm::dvec3> load_textures(Document& document, std::vector<SourceMaterial>& materials,
                                      const std::vector<bool>& wanted, bool skip_colors,
                                      Scene& scene) {
    Textures textures(document, materials, wanted, skip_colors);
    textures.read();
    textures.move_to(scene);
    std::vector<glm::dvec3> mean_texels;
    for (SourceMaterial& source : materials) {
        double metallic = source.metallic, transmission = source.transmission;
        double thickness = source.thickness;
        if (const DecodedImage* image = textures.decoded(source.metallic_texture))
            metallic *= image->mean_stored.b;
        const auto diffuse = static_cast<float>(1.0 - std::min(metallic, 1.0));
        for (int channel = 0; channel < 3; ++channel)
            source.material.base_color[channel] *= diffuse;
        if (const DecodedImage* image = textures.decoded(source.transmission_texture))
            transmission *= image->mean_stored.r;
        if (const DecodedImage* image = textures.decoded(source.thickness_texture))
            thickness *= image->mean_stored.g;
        source.material.transmission = static_cast<float>(transmission);
        if (thickness > 0.0)
            source.material.attenuation =
                glm::vec3(glm::pow(source.attenuation_color, glm::dvec3(thickness)));
        const DecodedImage* base = textures.decoded(source.base_texture);
        mean_texels.push_back(base ? base->mean : glm::dvec3(source.base_texture < 0 ? 1.0 : 0.0));
    }
    return mean_texels;
}

} // namespace lpvbake::scene::gltf
