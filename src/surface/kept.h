// What of surfaces is kept from bake to bake: how sides are grouped, and what their rays meet. Both
// go by the patches as geometry cut them. Light cuts some further, from bake to bake others: what
// is of these is found anew each time.
#pragma once

#include "surface/elements.h"
#include "surface/lit_surfaces.h"

namespace lpvbake::surface {

/// Adds the patches as they are cut now, and where on its triangle each lies.
void add_patches(const LitSurfaces& lit, cache::Key& key);

/// The patches before light cuts any, and which of them it has left whole.
class Keeper {
public:
    /// Keeps nothing.
    Keeper() = default;
    /// Of surfaces that are not cut by light yet; does nothing without a cache, which outlives it.
    Keeper(cache::Cache* cache, const LitSurfaces& lit);
    /// They are cut now.
    void settle(const LitSurfaces& lit);

    explicit operator bool() const { return cache_ != nullptr; }
    cache::Cache& cache() const { return *cache_; }
    cache::Key key(std::string_view stage) const;
    uint32_t sides() const { return sides_; } ///< before any was cut
    bool is_whole(uint32_t side) const { return side < sides_ && whole_[side / 2] != 0; }
    bool are_whole(std::span<const uint32_t> some) const;

    /// How light has cut them so far.
    template <class Cuts>
    void add_cuts(const Cuts& cuts) {
        if (cache_ && !cuts.empty())
            cuts_ = cache::Key(cuts_).add_all(cuts).bytes();
    }
    const std::string& cuts() const { return cuts_; }

private:
    cache::Cache* cache_ = nullptr;
    std::string base_, cuts_;
    uint32_t sides_ = 0;
    std::vector<uint8_t> whole_; ///< a patch
};

/// The elements of cubes whose sides are all whole.
class KeptGroups {
public:
    /// The most elements that a cube is parted into.
    KeptGroups(const Keeper& keeper, size_t most_of_cube);

    /// Those of a cube of these sides, in rising order, as parts; empty: they are to be found.
    std::vector<std::vector<uint32_t>> find(std::span<const uint32_t> sides) const;
    /// Keeps the parts of all cubes, where they were not there.
    void keep(std::span<const std::vector<std::vector<uint32_t>>> cubes);

private:
    struct Cube {
        uint32_t elements = 0, sides = 0;
    };
    bool read(cache::Reader& in, size_t most_of_cube);

    const Keeper& keeper_;
    std::optional<cache::Key> key_; ///< to keep what is found
    std::vector<Cube> cubes_;
    std::vector<uint32_t> cube_of_; ///< a side; Elements::none
    std::vector<uint8_t> element_;  ///< of the cube; a side
};

/// What the rays of elements of whole sides meet.
class KeptRays {
public:
    static constexpr uint32_t sky = LitSurfaces::no_side - 1; ///< nothing
    static constexpr uint32_t anew =
        sky - 1; ///< a side that light had cut, or that is kept nowhere

    /// So many of each element.
    KeptRays(const Keeper& keeper, const Elements& elements, size_t rays, bool tinted);

    /// What the ray of an element meets: a side that is whole, LitSurfaces::no_side, `sky`; or
    /// `anew`.
    uint32_t there(size_t element, uint32_t ray) const {
        const uint32_t at = kept_.empty() ? Elements::none : kept_[element];
        const uint32_t side = at == Elements::none ? anew : there_[at * rays_ + ray];
        return side >= anew || keeper_.is_whole(side) ? side : anew;
    }
    /// What it has passed; of what is not to be traced anew.
    glm::vec3 tint(size_t element, uint32_t ray) const;
    /// One was traced; to be kept.
    void add(size_t element, uint32_t ray, uint32_t there, glm::vec3 tint);
    /// Keeps all that were traced, where most of them were not there.
    void keep();

private:
    bool read(cache::Reader& in);

    const Keeper& keeper_;
    const Elements& elements_;
    size_t rays_;
    bool tinted_;
    std::optional<cache::Key> key_;
    std::vector<uint32_t> of_side_;     ///< the element that is kept of each side; Elements::none
    std::vector<uint32_t> counts_;      ///< of sides that each has
    std::vector<uint32_t> there_;       ///< of its rays
    std::vector<uint32_t> tinted_rays_; ///< those that passed what tints, in rising order
    std::vector<glm::vec3> tints_;
    std::vector<uint32_t> kept_; ///< of each element; Elements::none
    std::vector<uint32_t> new_there_;
    std::vector<glm::vec3> new_tints_;
};

} // namespace lpvbake::surface
