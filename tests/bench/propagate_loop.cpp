// Without these GCC keeps comparisons in the inner loop, where the clamps could be vector maxima.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-trapping-math", "no-signed-zeros", "finite-math-only")
#define LPVBAKE_INDEPENDENT_ITERATIONS _Pragma("GCC ivdep")
#elif defined(__clang__)
#define LPVBAKE_INDEPENDENT_ITERATIONS _Pragma("clang loop vectorize(assume_safety)")
#else
#define LPVBAKE_INDEPENDENT_ITERATIONS
#endif

#include "propagate_loop.h"

#include <cmath>
#include <thread>
#include <vector>

namespace lpvbake::bench {
namespace {

// Basis and solid angles as in the kernel.
constexpr float sqrt_4pi = 3.5449077018110321F;
constexpr float sh_0 = 0.28209479177387814F;
constexpr float sh_1 = 0.48860251190291992F;
constexpr float far_0 = 0.4006696846F * sh_0;
constexpr float far_1 = 0.4006696846F * sh_1;
constexpr float side_0 = 0.4234313544F * sh_0;
constexpr float side_1 = 0.4234313544F * sh_1 * 0.44721359549995794F;
constexpr float lobe_0 = 0.28209479177387814F;
constexpr float lobe_1 = 0.32573500793527993F;

inline float larger(float a, float b) {
    return a > b ? a : b;
}

inline float positive(float a) {
    return a > 0.0F ? a : 0.0F;
}

// What one source sends through its five faces: d is the coefficient along the direction of travel,
// u and v are the other two.
inline void receive(float c, float d, float u, float v, float link, float& far, float& pu,
                    float& mu, float& pv, float& mv) {
    const float middle = link * (c + (2.0F * side_1 / side_0) * d);
    const float side_u = (link * (side_1 / side_0)) * u;
    const float side_v = (link * (side_1 / side_0)) * v;
    far += positive(link * ((far_0 / side_0) * c + (far_1 / side_0) * d));
    pu += positive(middle + side_u);
    mu += positive(middle - side_u);
    pv += positive(middle + side_v);
    mv += positive(middle - side_v);
}

// Magnitudes of the two pairs of side faces for both directions along an axis, see below.
inline float side_pairs(float constant, float along, float u, float v) {
    const float b0 = std::fabs(constant + 2.0F * along);
    const float b1 = std::fabs(constant - 2.0F * along);
    return (larger(b0, u) + larger(b0, v)) + (larger(b1, u) + larger(b1, v));
}

// One row of one channel. The arrays point at the first cell of the row; plane, row and layer are
// the distances to the next coefficient, to the next row and to the next layer of a front.
template <bool occluded>
void propagate_row(const float* __restrict front, float* __restrict next,
                   float* __restrict accumulator, const float* __restrict links,
                   float* __restrict flux, std::ptrdiff_t plane, std::ptrdiff_t row, int nx) {
    const std::ptrdiff_t layer = LoopGrid::front_planes * plane;
    const std::ptrdiff_t link_layer = LoopGrid::link_planes * plane;
    const float* const c0 = front;
    const float* const cy = front + plane;
    const float* const cz = front + 2 * plane;
    const float* const cx = front + 3 * plane;
    const float* const link_x = links;
    const float* const link_y = links + (occluded ? plane : 0);
    const float* const link_z = links + (occluded ? 2 * plane : 0);

    // Planes never overlap within a row.
    LPVBAKE_INDEPENDENT_ITERATIONS
    for (int x = 0; x < nx; ++x) {
        // Flux by normal, in units of side_0.
        float px = 0.0F, mx = 0.0F, py = 0.0F, my = 0.0F, pz = 0.0F, mz = 0.0F;
        const std::ptrdiff_t w = x - 1, e = x + 1, s = x - row, n = x + row, b = x - layer,
                             a = x + layer;
        receive(c0[w], cx[w], cy[w], cz[w], occluded ? link_x[w] : 1.0F, px, py, my, pz, mz);
        receive(c0[e], -cx[e], cy[e], cz[e], occluded ? link_x[x] : 1.0F, mx, py, my, pz, mz);
        receive(c0[s], cy[s], cz[s], cx[s], occluded ? link_y[s] : 1.0F, py, pz, mz, px, mx);
        receive(c0[n], -cy[n], cz[n], cx[n], occluded ? link_y[x] : 1.0F, my, pz, mz, px, mx);
        receive(c0[b], cz[b], cx[b], cy[b], occluded ? link_z[x - link_layer] : 1.0F, pz, px, mx,
                py, my);
        receive(c0[a], -cz[a], cx[a], cy[a], occluded ? link_z[x] : 1.0F, mz, px, mx, py, my);

        const float f0 = (side_0 * lobe_0) * (((px + mx) + (py + my)) + (pz + mz));
        const float fy = (side_0 * lobe_1) * (py - my);
        const float fz = (side_0 * lobe_1) * (pz - mz);
        const float fx = (side_0 * lobe_1) * (px - mx);

        // Flux of the new front through its 30 faces, two opposite faces at a time:
        // max(0, b + t) + max(0, b - t) = b + max(|b|, |t|).
        const float constant = side_0 * f0;
        const float far_constant = far_0 * f0;
        const float ty = std::fabs(side_1 * fy);
        const float tz = std::fabs(side_1 * fz);
        const float tx = std::fabs(side_1 * fx);
        const float far = (larger(std::fabs(far_constant), std::fabs(far_1 * fy))
                           + larger(std::fabs(far_constant), std::fabs(far_1 * fz)))
                          + larger(std::fabs(far_constant), std::fabs(far_1 * fx));
        const float sides = (side_pairs(constant, ty, tz, tx) + side_pairs(constant, tz, ty, tx))
                            + side_pairs(constant, tx, ty, tz);
        const float outgoing = (12.0F * constant + 3.0F * far_constant) + far + sides;
        // Nothing goes out only where nothing has come in, and f0 is 0 then.
        const float budget = sqrt_4pi * f0 / (outgoing > 0.0F ? outgoing : 1.0F);

        accumulator[x] += f0;
        accumulator[x + plane] += fy;
        accumulator[x + 2 * plane] += fz;
        accumulator[x + 3 * plane] += fx;
        next[x] = budget * f0;
        next[x + plane] = budget * fy;
        next[x + 2 * plane] = budget * fz;
        next[x + 3 * plane] = budget * fx;
        flux[x] += f0;
    }
}

} // namespace

double propagate_loop(const LoopGrid& grid, const float* front, float* next, float* accumulator,
                      const float* links, int threads) {
    std::vector<double> layer_flux(static_cast<std::size_t>(grid.nz), 0.0);
    const auto run = [&](int z_begin, int z_end) {
        std::vector<float> flux(static_cast<std::size_t>(grid.nx));
        for (int z = z_begin; z < z_end; ++z) {
            flux.assign(flux.size(), 0.0F);
            for (int y = 0; y < grid.ny; ++y) {
                for (int channel = 0; channel < 3; ++channel) {
                    const std::ptrdiff_t cell = grid.index(0, y, z, 4 * channel);
                    if (links != nullptr)
                        propagate_row<true>(front + cell, next + cell, accumulator + cell,
                                            links + grid.index(0, y, z, 0, LoopGrid::link_planes),
                                            flux.data(), grid.plane(), grid.row(), grid.nx);
                    else
                        propagate_row<false>(front + cell, next + cell, accumulator + cell, nullptr,
                                             flux.data(), grid.plane(), grid.row(), grid.nx);
                }
            }
            double sum = 0.0;
            for (const float f : flux)
                sum += f;
            layer_flux[static_cast<std::size_t>(z)] = sqrt_4pi * sum;
        }
    };
    std::vector<std::jthread> workers;
    for (int t = 1; t < threads; ++t)
        workers.emplace_back(run, grid.nz * t / threads, grid.nz * (t + 1) / threads);
    run(0, grid.nz / threads);
    workers.clear();

    double sum = 0.0;
    for (const double f : layer_flux)
        sum += f;
    return sum;
}

} // namespace lpvbake::bench
