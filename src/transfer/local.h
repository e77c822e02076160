// What the surfaces near each cell make of the light around them: operators of local radiance
// transfer.
//
// From where the light of a cell is taken (visibility/capture.h) rays go evenly in all directions,
// so far. One that meets the front of a surface sees what that reflects: rho / pi of its
// irradiance, which is that of the light around the cell, since near is near. One that meets
// nothing sees what is beyond. With weights w = 4 pi / rays, directions w_k, normals n_k and the
// factors A of sh_cosine_factor(),
//
//     T_ij = sum over fronts met of  w rho_k / pi Y_i(w_k) A_j Y_j(n_k)     RGB, 4 x 4
//     V_i  = sum over rays that meet nothing of  w Y_i(w_k)                 9 numbers
//
// With light x around a cell, coefficients of incident luminance of order 1, T x is the light off
// near surfaces that arrives at it after one reflection, (1 - T)^-1 T x after all among these
// surfaces, and the product V x what arrives from beyond. V is to order 2, with which the product
// of order 1 is exact; its first four alone are those of a mask of order 1, which near a wall makes
// up to 8 % of light from nothing.
//
// What glass lets through is in both, V by its luminance. Backs reflect nothing, as in a bake.
#pragma once

#include "lpvbake/volume.h"
#include "scene/scene.h"
#include "visibility/visibility.h"

#include <array>
#include <vector>

namespace lpvbake::transfer {

/// Rays of a cell: directions that integrate harmonics up to band 23 exactly.
inline constexpr int local_rays = 384;

/// Cells that light moves on in a hop (transfer/propagation.h): the radius with which operators
/// neither make nor lose light.
inline constexpr double hop_length = 1.331;

/// Coefficients of order 1 in the order of Volume::sh, RGB.
using Light4 = std::array<glm::vec3, 4>;

/// Of one place.
struct LocalTransfer {
    std::array<glm::vec3, 16> reflected{}; ///< T, [4 i + j]
    std::array<float, 9> visible{};        ///< V
    Light4 emitted{};                      ///< what near surfaces emit, nits
};

/// Of a place in frame units, by rays of at most `radius`, the same; inside a solid nothing but
/// what it sees of fronts.
LocalTransfer find_local_transfer(const Scene& scene, const visibility::Visibility& visibility,
                                  glm::vec3 place, float radius);

/// Adds T and V (local_transfer_kind(), local_visibility_kind()) to a volume in the frame's units
/// that has its validity: 0 in cells that are not valid. The same bits for any number of threads.
void add_local_transfer(const Scene& scene, const visibility::Visibility& visibility, float radius,
                        Volume& volume);

/// What surfaces emit that such rays meet, of each cell; empty where no surface emits.
std::vector<Light4> local_emission(const Scene& scene, const visibility::Visibility& visibility,
                                   float radius, const Volume& volume);

} // namespace lpvbake::transfer
