// What neighbours differ by.
#include "lpvbake/error.h"
#include "report/seams.h"

#include <gtest/gtest.h>

#include <numbers>

namespace lpvbake {
namespace {

/// Cells of half a metre of one luminance, from `first` on.
Volume even(glm::ivec3 first, glm::ivec3 dims, float luminance) {
    Volume volume;
    volume.grid.cell = 0.5;
    volume.grid.origin = 0.5 * glm::dvec3(first);
    volume.grid.dims = dims;
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector(volume.grid.size(), glm::vec3(0.0f)));
    volume.sh[0].assign(volume.grid.size(),
                        glm::vec3(luminance * float(std::sqrt(4 * std::numbers::pi))));
    volume.validity.assign(volume.grid.size(), 1.0f);
    return volume;
}

TEST(Seams, AreOfTheCellsThatBothHave) {
    Volume a = even({0, 0, 0}, {6, 4, 4}, 2.0f);
    const Volume b = even({4, 1, 0}, {6, 4, 4}, 3.0f);
    report::Seam seam = report::seam_between(a, b);
    EXPECT_EQ(seam.cells, 2u * 3 * 4);
    EXPECT_NEAR(seam.share(), 1.0 / 2.5, 1e-6);
    EXPECT_NEAR(seam.off, 24 * 18 * std::numbers::pi, 1e-2);
    a.validity[a.grid.index({5, 2, 1})] = 0.0f; // is nobody's measure
    a.sh[0][a.grid.index({5, 2, 1})] = glm::vec3(1e9f);
    a.sh[0][a.grid.index({3, 2, 1})] = glm::vec3(1e9f); // not shared
    const report::Seam without = report::seam_between(a, b);
    EXPECT_EQ(without.cells, 23u);
    EXPECT_NEAR(without.share(), 1.0 / 2.5, 1e-6);
    seam += without;
    EXPECT_EQ(seam.cells, 47u);
    EXPECT_EQ(report::seam_between(a, even({9, 0, 0}, {2, 2, 2}, 1.0f)).cells, 0u);
    EXPECT_EQ(report::seam_between(a, even({9, 0, 0}, {2, 2, 2}, 1.0f)).share(), 0.0);
}

TEST(Seams, TakeOneLattice) {
    const Volume a = even({0, 0, 0}, {4, 4, 4}, 1.0f);
    Volume b = even({2, 0, 0}, {4, 4, 4}, 1.0f);
    b.grid.origin.x += 0.1;
    EXPECT_THROW(report::seam_between(a, b), Error);
    b = even({2, 0, 0}, {4, 4, 4}, 1.0f);
    b.grid.cell = 0.6;
    EXPECT_THROW(report::seam_between(a, b), Error);
}

} // namespace
} // namespace lpvbake
