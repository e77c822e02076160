#include "io/textures.h"

#include "lpvbake/error.h"
#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <numbers>

namespace lpvbake::io {
namespace {

constexpr const char* names_of_packings[] = {"band",  "channel", "vrc",  "cube",
                                             "atlas", "ratio",   "block"};

/// The scalars of a grid.
std::vector<Component> components(const volume::ConstGridView& grid) {
    std::vector<Component> all;
    all.reserve(size_t(grid.kind->width()));
    for (int c = 0; c < grid.kind->width(); ++c)
        all.push_back({grid.channel_name(c), grid.data + c, size_t(grid.kind->width())});
    return all;
}

/// Irradiance over pi of each cell towards a side of a cube, +x, -x, +y, ...; `volume` is
/// canonical.
std::vector<glm::vec3> cube_side(const Volume& volume, size_t side) {
    std::vector<glm::vec3> values(volume.grid.size());
    glm::vec3 normal(0.0f);
    normal[int(side / 2)] = side % 2 == 0 ? 1.0f : -1.0f;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, values.size()), [&](const auto& range) {
        std::vector<float> coefficients(volume.sh.size());
        for (size_t cell = range.begin(); cell < range.end(); ++cell)
            for (int c = 0; c < 3; ++c) {
                for (size_t k = 0; k < coefficients.size(); ++k)
                    coefficients[k] = volume.sh[k][cell][c];
                values[cell][c] = std::max(0.0f, volume::sh_irradiance(coefficients, normal))
                                  / std::numbers::pi_v<float>;
            }
    });
    return values;
}

/// Names alone: see cube_picture.
Texture cube_texture() {
    Texture cube{"cube", {}, &volume::light_kind()};
    for (const char* side : {"px", "nx", "py", "ny", "pz", "nz"}) {
        cube.blocks.emplace_back();
        for (const char colour : {'r', 'g', 'b'})
            cube.blocks.back().push_back({std::string("cube_") + side + "." + colour});
    }
    return cube;
}

/// Of a volume that has no such grid, names alone.
Texture base_texture(const Volume& volume) {
    const std::vector<volume::ConstGridView> base = volume::grids_of(volume, base_kind);
    return {base_kind.name,
            {base.empty() ? std::vector<Component>{{"base.r"}, {"base.g"}, {"base.b"}}
                          : components(base[0])},
            &base_kind};
}

/// How many of these share a picture, of one, three or four channels: those of one kind.
size_t grids_in_picture(std::span<const volume::ConstGridView> grids) {
    size_t left = 1;
    while (left < grids.size() && grids[left].kind == grids[0].kind)
        ++left;
    return grids[0].kind->width() == 3 || left < 3 ? 1 : std::min<size_t>(left, 4);
}

/// Throws Error (unsupported) for what a packing has no form for.
void check_packing(const Volume& volume, Packing packing, volume::ShConvention convention,
                   const std::string& path) {
    const auto unless = [&](bool fits, const std::string& what) {
        if (!fits)
            throw Error(ErrorKind::unsupported, path + ": packing by " + what + ", not order "
                                                    + std::to_string(volume.sh_order) + " of "
                                                    + volume::name_of(convention)
                                                    + "; pack by band");
    };
    const int order = volume.sh_order;
    const bool canonical = convention == volume::ShConvention::radiance;
    switch (packing) {
    case Packing::band:
    case Packing::ratio:
    case Packing::block:
        break;
    case Packing::channel:
        unless(order == 1 || order == 2, "colour channel holds SH order 1 or 2");
        break;
    case Packing::vrc:
        unless(order == 1 && convention == volume::ShConvention::unity,
               "vrc holds SH order 1 of the convention unity");
        break;
    case Packing::cube:
        unless(canonical, "cube is made of the convention radiance");
        break;
    case Packing::atlas:
        unless(canonical && order <= 2, "atlas holds SH orders 0 to 2 of the convention radiance");
        break;
    }
}

void fill_cube(const Volume& volume, const Stack& stack, const Layout& layout,
               image::Pixels& pixels) {
    for (int side = 0; side < stack.blocks; ++side) {
        const std::vector<glm::vec3> values = cube_side(volume, size_t(side));
        stack.for_each_texel(volume.grid.dims, layout,
                             [&](size_t texel, int block, size_t cell, bool) {
                                 if (block == side)
                                     std::copy_n(&values[cell].x, 3, &pixels.samples[texel * 3]);
                             });
    }
}

} // namespace

const char* name_of(Packing packing) {
    return names_of_packings[size_t(packing)];
}

std::optional<Packing> packing_named(std::string_view name) {
    const auto found = std::ranges::find(names_of_packings, name);
    if (found == std::end(names_of_packings))
        return std::nullopt;
    return Packing(found - std::begin(names_of_packings));
}

std::vector<const char*> packing_names() {
    return {std::begin(names_of_packings), std::end(names_of_packings)};
}

Stack stack_of(Packing packing) {
    if (packing == Packing::cube)
        return {6, 2, 0};
    if (packing == Packing::atlas)
        return {7, 1, 1};
    return {};
}

std::vector<Texture> textures_of(const Volume& volume, Packing packing,
                                 volume::ShConvention convention, const std::string& path,
                                 const Ranges& ranges) {
    check_packing(volume, packing, convention, path);
    if (packing == Packing::cube)
        return {cube_texture()};
    const std::vector<volume::ConstGridView> light = volume::grids_of(volume, volume::light_kind());
    const auto colours = [&](size_t k) {
        std::vector<Component> all = components(light[k]);
        for (size_t c = 0; c < all.size() && k < ranges.size(); ++c)
            all[c].range = ranges[k][c];
        return all;
    };
    std::vector<Texture> textures;
    const auto add_band = [&](size_t k) { textures.push_back({light[k].name(), {colours(k)}}); };
    const auto add_channels = [&](const char* suffix, std::array<size_t, 4> order) {
        for (int c = 0; c < 3; ++c) {
            textures.push_back({"rgb"[c] + std::string(suffix), {{}}});
            for (const size_t k : order)
                textures.back().blocks[0].push_back(colours(k)[size_t(c)]);
        }
    };
    if (packing == Packing::vrc) {
        constexpr size_t z = 2, bands[] = {0, 3, 1}; // the coefficients 1, x and y
        for (int file = 0; file < 3; ++file) {
            add_band(bands[file]);
            textures.back().suffix = std::to_string(file);
            textures.back().blocks[0].push_back(colours(z)[size_t(file)]);
        }
        return textures;
    }
    if (packing == Packing::atlas) {
        textures.push_back({"atlas", {}});
        for (size_t i = 0; i < 28; ++i) {
            if (i % 4 == 0)
                textures[0].blocks.emplace_back();
            const size_t k = i / 3;
            textures[0].blocks.back().push_back(k < volume.sh.size() ? colours(k)[i % 3]
                                                                     : Component{});
        }
        return textures;
    }
    if (packing == Packing::block)
        textures.push_back(base_texture(volume));
    if (packing == Packing::band || packing == Packing::block) {
        for (size_t k = 0; k < volume.sh.size(); ++k)
            add_band(k);
    } else if (packing == Packing::ratio) {
        add_band(0);
        for (size_t c = 0; c < 3; ++c)
            for (size_t k = 1; k < volume.sh.size(); ++k) {
                if (k % 4 == 1)
                    textures.push_back({std::string("ratio_") + "rgb"[c]
                                            + (k > 4 ? std::to_string(k / 4 + 1) : ""),
                                        {{}}});
                textures.back().blocks[0].push_back(colours(k)[c]);
            }
    } else {
        add_channels("", convention == volume::ShConvention::unity
                             ? std::array<size_t, 4>{3, 1, 2, 0}
                             : std::array<size_t, 4>{0, 1, 2, 3});
        if (volume.sh_order == 2) {
            add_channels("2", {4, 5, 6, 7});
            add_band(8);
        }
    }
    const std::vector<volume::ConstGridView> grids = volume::grids_of(volume);
    for (size_t g = light.size(), count; g < grids.size(); g += count) {
        const volume::ConstGridView& first = grids[g];
        count = grids_in_picture(std::span(grids).subspan(g));
        if (first.kind == &base_kind)
            continue;
        const bool whole = first.k == 0 && count > 1;
        Texture& texture = textures.emplace_back(
            Texture{whole ? first.kind->name : first.name(), {{}}, first.kind});
        for (size_t i = 0; i < count; ++i)
            for (const Component& component : components(grids[g + i]))
                texture.blocks[0].push_back(component);
    }
    return textures;
}

image::Pixels texels_of(const Texture& texture, Packing packing, const Volume& volume,
                        const Layout& layout) {
    const size_t n = texture.channels();
    const Stack stack = stack_of(packing);
    const glm::ivec3 dims = stack.dims(volume.grid.dims);
    image::Pixels pixels{layout.columns * dims.x, layout.rows * dims.y, int(n), {}};
    pixels.samples.resize(size_t(pixels.width) * size_t(pixels.height) * n);
    if (packing == Packing::cube) {
        fill_cube(volume, stack, layout, pixels);
        return pixels;
    }
    stack.for_each_texel(volume.grid.dims, layout, [&](size_t texel, int block, size_t cell, bool) {
        for (size_t c = 0; c < n; ++c)
            if (const Component& from = texture.blocks[size_t(block)][c]; from.first)
                pixels.samples[texel * n + c] = from.first[cell * from.stride];
    });
    return pixels;
}

std::string stem_of(const std::string& path) {
    return std::filesystem::path(path).replace_extension().string();
}

std::vector<std::string> texture_names(const std::string& stem, const char* extension,
                                       const std::vector<Texture>& textures) {
    std::vector<std::string> names;
    for (const Texture& texture : textures)
        names.push_back(stem + "_" + texture.suffix + extension);
    return names;
}

const GridKind base_kind{
    .name = "base", .channels = "rgb", .quantity = {"what coefficients are over", "1"}};

bool Texture::is_plain_colour() const {
    return kind == &base_kind
           || (kind == &volume::light_kind() && channels() == 3
               && (suffix == "sh_l0" || suffix == "cube"));
}

} // namespace lpvbake::io
