// Which texture holds what of a volume, channel by channel and texel by texel: what flipbooks and
// 3D textures have in common.
#pragma once

#include "image/image.h"
#include "io/pictures.h"
#include "volume/convention.h"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::io {

/// How slices of constant z stand in a picture: left to right, then down. One column is how a 3D
/// texture lies in memory.
struct Layout {
    int columns = 0;
    int rows = 0;

    /// Row-major index of a texel of a texture of `dims` in the picture of dims.x * columns texels
    /// a row.
    size_t texel(glm::ivec3 dims, glm::ivec3 at) const {
        const size_t x = size_t(at.z % columns) * size_t(dims.x) + size_t(at.x);
        const size_t y = size_t(at.z / columns) * size_t(dims.y) + size_t(at.y);
        return y * size_t(columns) * size_t(dims.x) + x;
    }
};

/// How blocks of cells make a texture: `rows` of them along y, and what is more behind along z,
/// each between `padding` copies of its outermost slices.
struct Stack {
    int blocks = 1;
    int rows = 1;
    int padding = 0;

    glm::ivec3 dims(glm::ivec3 cells) const {
        return {cells.x, cells.y * rows, (cells.z + 2 * padding) * (blocks / rows)};
    }
    /// Calls visit(texel, block, cell, whether it is padding) for all texels of a texture.
    template <class Visit>
    void for_each_texel(glm::ivec3 cells, const Layout& layout, const Visit& visit) const {
        const glm::ivec3 texture = dims(cells);
        for (int block = 0; block < blocks; ++block) {
            const glm::ivec3 first(0, block % rows * cells.y,
                                   block / rows * (cells.z + 2 * padding) + padding);
            for (int z = -padding; z < cells.z + padding; ++z) {
                const int slice = z < 0 ? 0 : z < cells.z ? z : cells.z - 1;
                size_t cell = size_t(slice) * size_t(cells.x) * size_t(cells.y);
                for (int y = 0; y < cells.y; ++y)
                    for (int x = 0; x < cells.x; ++x, ++cell)
                        visit(layout.texel(texture, first + glm::ivec3(x, y, z)), block, cell,
                              z != slice);
            }
        }
    }
};

Stack stack_of(Packing packing);

/// What texels from 0 to 1 stand for: low + (high - low) texel.
struct Range {
    float low = 0, high = 1;
};

/// What all coefficients are over in Packing::block. Volumes have it in files alone.
extern const GridKind base_kind;

/// Of each coefficient's colours, in units of the same colour of the base or, without one, those
/// above 0 in units of coefficient 0.
using Ranges = std::vector<std::array<Range, 3>>;

/// A scalar of the volume: the floats of one grid, or of one colour of an RGB grid; or, without a
/// name, zeros.
struct Component {
    std::string name; ///< e.g. sh_l1_y.g
    const float* first = nullptr;
    size_t stride = 0;               ///< floats from cell to cell
    std::optional<Range> range = {}; ///< none: texels are what they stand for
};

struct Texture {
    std::string suffix; ///< of the file's name: STEM_suffix.exr
    /// What the channels hold, block by block, all of as many channels.
    std::vector<std::vector<Component>> blocks;
    const GridKind* kind = &volume::light_kind();

    size_t channels() const { return blocks[0].size(); }
    /// Whether it holds three colours of light that have no sign: the mean over directions, the
    /// base, or a cube's sides.
    bool is_plain_colour() const;
};

/// All that a volume has, in the order of the files; with ranges its light has texels (ratios.h).
/// Throws Error (unsupported), naming `path`, for what a packing has no form for.
std::vector<Texture> textures_of(const Volume& volume, Packing packing,
                                 volume::ShConvention convention, const std::string& path,
                                 const Ranges& ranges = {});

/// The texels of a texture, 0 where it holds nothing; `volume` is what it was made of.
image::Pixels texels_of(const Texture& texture, Packing packing, const Volume& volume,
                        const Layout& layout);

/// STEM_suffix of the textures' files, with their extension.
std::vector<std::string> texture_names(const std::string& stem, const char* extension,
                                       const std::vector<Texture>& textures);

/// STEM of STEM.exr.
std::string stem_of(const std::string& path);

} // namespace lpvbake::io
