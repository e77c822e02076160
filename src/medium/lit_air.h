// A medium as light meets it on its way between surfaces, and as it sends what it scatters.
#pragma once

#include "medium/medium_in_frame.h"
#include "scene/frame.h"
#include "visibility/air.h"
#include "volume/volume.h"

#include <cstddef>
#include <span>
#include <vector>

namespace lpvbake::medium {

/// What it takes alone.
class DarkAir : public visibility::Air {
public:
    /// In units of a frame.
    DarkAir(const Medium& medium, const scene::Frame& frame);

    float column(glm::vec3 origin, glm::vec3 direction, float begin, float end) const override;
    glm::vec3 extinction() const override { return air_.extinction(); }
    Place at(glm::vec3 place) const override;

protected:
    MediumInFrame air_;
    scene::Frame frame_;
};

class LitAir final : public DarkAir {
public:
    /// A medium in the cells of a grid along the axes, in its frame.
    LitAir(const Medium& medium, const Grid& grid, const scene::Frame& frame);

    /// From now on it sends what it scatters of light of these coefficients, [k][cell] as
    /// Volume::sh has them, of bands up to 2: band l of that of light times g^l. Of `by_density`
    /// each cell has the mean of the light times density over Medium::peak().
    void scatter(std::span<const std::vector<glm::vec3>> even,
                 std::span<const std::vector<glm::vec3>> by_density);
    /// Nothing, again.
    void be_dark() { sources_.clear(); }

    /// Mean of a cell.
    double density(std::size_t cell) const { return double(density_[cell]); }

    bool is_lit() const override { return !sources_.empty(); }
    /// In up to `most_steps` equal steps, of a cell and more, with the source of the cell in the
    /// middle of each; what all of them weigh is 1 less what is left.
    glm::vec3 sent(glm::vec3 origin, glm::vec3 direction, float begin, float end) const override;
    Place at(glm::vec3 place) const override;
    int coefficients() const override { return is_lit() ? coefficients_ : 0; }

    static constexpr int most_steps = 16;

private:
    Grid grid_;
    int coefficients_;               ///< of a cell's source
    std::vector<float> density_;     ///< mean of a cell
    std::vector<glm::vec3> sources_; ///< [coefficients_ * cell + k]
};

} // namespace lpvbake::medium
