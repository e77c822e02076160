// Light that the operators of local radiance transfer carry from cell to cell, as an engine may do
// it a frame: no ray is traced, and lights, sky and emission may change.
//
// Each cell has a field x of incident luminance, of order 1. In a hop it takes, for the directions
// that lie nearest to the way to each of its 26 neighbours n, the light that the neighbour has from
// there, and beyond the lattice that of the sky; as far as its own visibility leaves that way open:
//
//     in = x + sum over n of  v_n P_n (x_n - x),   P_n = integral of Y Y^T over those directions
//     x' = (1 - T)^-1 (V in + e) + ((1 - T)^-1 - 1) d
//
// with T and V of transfer/local.h, v_n the share of V that way, 0 to 1, e what near surfaces emit,
// and d what lights send straight to the cell, which is no part of the field. On a way that is shut
// a cell has its own light for that of the neighbour, which V then takes away: darkness there, or
// the light of another room, would be smeared by the product of order 1 into what is open.
//
// The P_n sum to 1: a field that is the same everywhere stays as it is, and in the open a hop
// neither makes nor loses light. What it loses is direction: each hop is projected to order 1
// again, so that a beam spreads. Light moves on by hop_length a hop. It has to be the radius of the
// operators: surfaces within it are lit and shine in every hop of what passes, so that twice the
// radius gives a small lamp twice its power.
//
// This is the article's loop ("GI from Local Radiance Transfer", zhihu 653044045) with what that
// leaves open decided: there x is T in, which carries nothing through open cells, and the factor of
// a way is a triple product with the neighbour's visibility.
#pragma once

#include "lpvbake/progress.h"
#include "transfer/local.h"

#include <functional>
#include <optional>

namespace lpvbake::transfer {

/// What a field is made of; empty vectors are none.
struct Sources {
    std::vector<Light4> direct;  ///< of each cell, nits: of lights that are no part of the field
    std::vector<Light4> suns;    ///< the same of lights that are: a sky's
    std::vector<Light4> emitted; ///< local_emission()
    std::function<glm::vec3(glm::vec3)> beyond; ///< nits from a direction, beyond the lattice
};

struct PropagationSettings {
    std::optional<int> iterations; ///< hops; none: until less than `missing` is to come
    double missing = 1e-3;         ///< of all luminance
    int most = 4096;
};

struct Propagated {
    std::vector<Light4> field; ///< of each cell, nits
    int iterations = 0;
    /// Share of all luminance that more hops would add, by how the last two differ.
    double missing = 1;
};

/// The field of a volume that has its operators, on a lattice that is not turned. Advances
/// `progress` by hops. The same bits for any number of threads. Throws what `progress` throws.
Propagated propagate(const Volume& volume, const Sources& sources,
                     const PropagationSettings& settings, Progress& progress);

} // namespace lpvbake::transfer
