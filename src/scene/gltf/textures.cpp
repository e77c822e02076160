#include "colour/colour.h"
#include "image/header.h"
#include "image/image.h"
#include "scene/gltf/folder.h"
#include "scene/gltf/materials.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace lpvbake::scene::gltf {
namespace {

constexpr uint64_t max_image_texels = 1ull << 28; ///< of one image, 16384 x 16384

// ---------------------------------------------------------------- references

int extension_source(const tinygltf::Texture& texture, const char* name) {
    const auto* extension = find_extension(texture.extensions, name);
    return extension && extension->Has("source") ? extension->Get("source").GetNumberAsInt() : -1;
}

/// The image of a texture; -1 if it has none that is understood.
int image_of(Document& document, int texture_index) {
    const tinygltf::Texture& texture = document.model.textures.at(texture_index);
    if (const int webp = extension_source(texture, "EXT_texture_webp"); webp >= 0)
        return webp;
    if (texture.source >= 0)
        return texture.source;
    const std::string place = at("textures", texture_index);
    if (extension_source(texture, "KHR_texture_basisu") >= 0) {
        document.warnings.add("KHR_texture_basisu", place + ".extensions.KHR_texture_basisu",
                              "Basis Universal images cannot be read and there is none to fall "
                              "back on: materials use their factors alone; add a PNG, JPEG or "
                              "WebP image as source");
        return -1;
    }
    std::string names;
    for (const auto& [name, unused] : texture.extensions)
        names += (names.empty() ? "" : ", ") + name;
    if (!names.empty())
        document.fail(place,
                      "has no source but for " + names
                          + ", which is not supported; add a PNG, JPEG or WebP image as source",
                      ErrorKind::unsupported);
    document.warnings.add("textures without source", place,
                          "has no source: materials use their factors alone; add an image");
    return -1;
}

Texture texture_of(const Document& document, int index) {
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
            document.fail(at("samplers", sampler_index) + property,
                          std::to_string(mode) + " is not a wrap mode");
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
           + (uri.empty() || uri.starts_with("data:") ? "" : " (" + percent_decoded(uri) + ")");
}

/// The encoded bytes of an image, its first `most` if it has more and lies in a file.
class EncodedImage {
public:
    EncodedImage(const Document& document, int index, uint64_t most) {
        const ImageSource& source = document.images.at(index);
        const std::string place = document.file + ": " + at("images", index);
        if (source.view >= 0) {
            bytes = document.views.at(source.view).bytes;
        } else if (source.uri.starts_with("data:")) {
            storage_ = decode_data_uri(source.uri, place + ".uri");
            bytes = storage_;
        } else if (!source.uri.empty()) {
            storage_ = read_file(
                resolve_uri(document.folder, source.uri, place + ".uri", document.allow_external),
                place + ".uri", most);
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

/// The image without texels; one that cannot be decoded is refused all the same, if its header
/// shows it.
Image size_of(const Document& document, int index) {
    const image::ImageHeader header = header_of(document, index);
    if (header.texels() == 0 || header.texels() > max_image_texels)
        return load_image(document, index, 0).image;
    return {name_of(document, index), int(header.width), int(header.height), {}};
}

struct ImagePlan {
    std::vector<int> halvings;         ///< how often each image is to be halved
    std::vector<uint64_t> full_texels; ///< of each before that
};

/// Halves images until all fit into half of what memory is left.
ImagePlan plan_images(Document& document, const std::vector<int>& images) {
    std::vector<uint64_t> texels;
    uint64_t sum = 0, largest = 0;
    for (const int image : images) {
        texels.push_back(std::max<uint64_t>(1, header_of(document, image).texels()));
        sum += texels.back();
        largest = std::max(largest, texels.back());
    }
    const std::vector<uint64_t> full_texels = texels;
    std::vector<int> halvings(images.size(), 0);
    const uint64_t limit = document.memory.left() / 2 / 4;
    size_t reduced = 0;
    while (sum > limit && largest > 4) {
        const uint64_t level = largest / 4;
        largest = 0;
        for (size_t i = 0; i < images.size(); ++i) {
            if (sum > limit && texels[i] > 4 && texels[i] >= level * 2) {
                reduced += halvings[i] == 0;
                ++halvings[i];
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
                                  + " of " + std::to_string(images.size())
                                  + "; allow more with `max_memory` or use smaller ones");
    return {halvings, full_texels};
}

/// Bytes a texel that a decoder takes on its way, at most: progressive JPEG keeps three
/// coefficients of two bytes, and there is the picture as decoded and as RGBA.
constexpr uint64_t decoding_bytes = 14;

/// Decodes images, so many at a time that what passes through memory meanwhile stays below the
/// limit on what stays. Throws Error (memory) where one alone is past it.
std::vector<DecodedImage> load_images(const Document& document, const std::vector<int>& images,
                                      const ImagePlan& plan, const std::map<int, Need>& needs) {
    std::vector<DecodedImage> decoded(images.size());
    for (size_t begin = 0, end = 0; begin < images.size(); begin = end) {
        MemoryLimit passing(document.file, document.memory.limit());
        do
            passing.take(plan.full_texels[end], decoding_bytes, at("images", images[end]));
        while (++end < images.size() && plan.full_texels[end] <= passing.left() / decoding_bytes);
        for_all(end - begin, [&](size_t i) {
            DecodedImage& image = decoded[begin + i];
            image = load_image(document, images[begin + i], plan.halvings[begin + i]);
            if (!needs.at(images[begin + i]).sampled)
                image.image = {};
        });
    }
    return decoded;
}

/// Light that passes, coloured by the base colour, as light that passes uncovered: what is
/// reflected and what passes keep their luminance (the colour of what passes is lost).
void transmit(Document& document, SourceMaterial& source, double share, glm::dvec3 mean_texel) {
    if (!(share > 0.0))
        return;
    Material& material = source.material;
    if (material.alpha_mode == AlphaMode::mask) {
        document.warnings.add("masked transmission", source.place + ".alphaMode",
                              "a material with a mask cannot transmit as well: it is taken for "
                              "opaque where the mask covers; use BLEND");
        return;
    }
    const glm::dvec3 color = glm::min(glm::dvec3(material.base_color) * mean_texel, 1.0);
    const double passing = share * glm::dot(color, colour::rec709_luminance);
    if (material.alpha_mode == AlphaMode::opaque)
        material.base_color.a = 1.0f;
    material.alpha_mode = AlphaMode::blend;
    material.base_color.a *= static_cast<float>(1.0 - passing);
    const double reflected = passing < 1.0 ? (1.0 - share) / (1.0 - passing) : 0.0;
    for (int channel = 0; channel < 3; ++channel)
        material.base_color[channel] *= static_cast<float>(reflected);
}

} // namespace

std::vector<glm::dvec3> load_textures(Document& document, std::vector<SourceMaterial>& materials,
                                      bool skip_colors, Scene& scene) {
    std::map<int, int> image_of_texture; // by glTF texture
    std::map<int, Need> needs;           // by glTF image
    const auto need = [&](int& texture, const Need& wanted) {
        if (texture < 0)
            return;
        if (!image_of_texture.contains(texture))
            image_of_texture[texture] = image_of(document, texture);
        const int image = image_of_texture[texture];
        if (image < 0)
            texture = -1;
        else
            needs[image] = {needs[image].sampled || wanted.sampled,
                            needs[image].decoded || wanted.decoded};
    };
    for (SourceMaterial& material : materials) {
        need(material.base_texture, {true, !skip_colors || material.transmission > 0.0});
        need(material.emission_texture, {true, true});
        need(material.metallic_texture, {false, true});
        need(material.transmission_texture, {false, true});
    }

    std::vector<int> images; // that are decoded
    for (const auto& [image, wanted] : needs)
        if (wanted.decoded)
            images.push_back(image);
    std::vector<DecodedImage> decoded =
        load_images(document, images, plan_images(document, images), needs);

    std::map<int, DecodedImage*> decoded_image; // null: it is not
    std::map<int, int> scene_image;
    auto next = decoded.begin();
    for (const auto& [image, wanted] : needs) {
        DecodedImage* const own = wanted.decoded ? &*next++ : nullptr;
        decoded_image[image] = own;
        if (wanted.sampled) {
            scene_image[image] = static_cast<int>(scene.images.size());
            scene.images.push_back(own ? std::move(own->image) : size_of(document, image));
        }
    }
    std::map<int, int> scene_texture; // by glTF texture
    const auto resolve = [&](int texture) {
        if (texture < 0)
            return -1;
        const auto [entry, is_new] =
            scene_texture.try_emplace(texture, static_cast<int>(scene.textures.size()));
        if (is_new) {
            scene.textures.push_back(texture_of(document, texture));
            scene.textures.back().image = scene_image.at(image_of_texture.at(texture));
        }
        return entry->second;
    };
    const auto statistics = [&](int texture) {
        return texture < 0 ? nullptr : decoded_image.at(image_of_texture.at(texture));
    };
    std::vector<glm::dvec3> mean_texels;
    for (SourceMaterial& source : materials) {
        source.material.base_color_texture = resolve(source.base_texture);
        source.material.emission_texture = resolve(source.emission_texture);
        double metallic = source.metallic, transmission = source.transmission;
        if (const DecodedImage* image = statistics(source.metallic_texture))
            metallic *= image->mean_stored.b;
        const auto diffuse = static_cast<float>(1.0 - std::min(metallic, 1.0));
        for (int channel = 0; channel < 3; ++channel)
            source.material.base_color[channel] *= diffuse;
        if (const DecodedImage* image = statistics(source.transmission_texture))
            transmission *= image->mean_stored.r;
        const DecodedImage* base = statistics(source.base_texture);
        mean_texels.push_back(base ? base->mean : glm::dvec3(source.base_texture < 0 ? 1.0 : 0.0));
        transmit(document, source, transmission, mean_texels.back());
    }
    return mean_texels;
}

} // namespace lpvbake::scene::gltf
