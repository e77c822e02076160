#include "propagate_loop.h"

#include <algorithm>
#include <barrier>
#include <cmath>
#include <new>
#include <thread>

#ifdef __linux__
#include <sys/mman.h>
#endif

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

// One channel of a row: the light that arrives, as four runs of `pitch` floats. Every pointer is at
// the first cell of the row; `row` and `link_row` lead to the next one.
template <bool occluded>
[[gnu::noinline]] void gather(const float* __restrict below, const float* __restrict here,
                              const float* __restrict above, const float* __restrict links,
                              const float* __restrict links_below, float* __restrict received,
                              std::ptrdiff_t pitch, std::ptrdiff_t row, std::ptrdiff_t link_row,
                              int nx) {
    // Pointers to the runs: the coefficients of 1, y, z and x.
    const float *const c0 = here, *const b0 = below, *const a0 = above;
    const float *const cy = c0 + pitch, *const by = b0 + pitch, *const ay = a0 + pitch;
    const float *const cz = cy + pitch, *const bz = by + pitch, *const az = ay + pitch;
    const float *const cx = cz + pitch, *const bx = bz + pitch, *const ax = az + pitch;
    const float* const link_x = links;
    const float* const link_y = links + (occluded ? pitch : 0);
    const float* const link_z = links + (occluded ? 2 * pitch : 0);
    const float* const link_z_below = links_below + (occluded ? 2 * pitch : 0);

#pragma omp simd
    for (int x = 0; x < nx; ++x) {
        // Flux by normal, in units of side_0.
        float px = 0.0F, mx = 0.0F, py = 0.0F, my = 0.0F, pz = 0.0F, mz = 0.0F;
        const std::ptrdiff_t w = x - 1, e = x + 1, s = x - row, n = x + row;
        receive(c0[w], cx[w], cy[w], cz[w], occluded ? link_x[w] : 1.0F, px, py, my, pz, mz);
        receive(c0[e], -cx[e], cy[e], cz[e], occluded ? link_x[x] : 1.0F, mx, py, my, pz, mz);
        receive(c0[s], cy[s], cz[s], cx[s], occluded ? link_y[x - link_row] : 1.0F, py, pz, mz, px,
                mx);
        receive(c0[n], -cy[n], cz[n], cx[n], occluded ? link_y[x] : 1.0F, my, pz, mz, px, mx);
        receive(b0[x], bz[x], bx[x], by[x], occluded ? link_z_below[x] : 1.0F, pz, px, mx, py, my);
        receive(a0[x], -az[x], ax[x], ay[x], occluded ? link_z[x] : 1.0F, mz, px, mx, py, my);

        received[x] = (side_0 * lobe_0) * (((px + mx) + (py + my)) + (pz + mz));
        received[x + pitch] = (side_0 * lobe_1) * (py - my);
        received[x + 2 * pitch] = (side_0 * lobe_1) * (pz - mz);
        received[x + 3 * pitch] = (side_0 * lobe_1) * (px - mx);
    }
}

// The rest of that row: adds what has arrived to the total and makes the new front of it.
[[gnu::noinline]] void emit(const float* __restrict received, float* __restrict next,
                            float* __restrict total, float* __restrict flux, std::ptrdiff_t pitch,
                            int nx) {
#pragma omp simd
    for (int x = 0; x < nx; ++x) {
        const float f0 = received[x];
        const float fy = received[x + pitch];
        const float fz = received[x + 2 * pitch];
        const float fx = received[x + 3 * pitch];
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

        total[x] += f0;
        total[x + pitch] += fy;
        total[x + 2 * pitch] += fz;
        total[x + 3 * pitch] += fx;
        next[x] = budget * f0;
        next[x + pitch] = budget * fy;
        next[x + 2 * pitch] = budget * fz;
        next[x + 3 * pitch] = budget * fx;
        flux[x] += f0;
    }
}

} // namespace

bench::PropagateLoop::PropagateLoop(int nx, int ny, int nz, bool occluded, int threads)
    : nx_(nx),
      ny_(ny),
      nz_(nz),
      occluded_(occluded),
      threads_(std::clamp(threads, 1, nz)),
      pitch_((nx + 7) / 8 * 8 + margin),
      layer_flux_(static_cast<std::size_t>(nz)) {
    for (int t = 0; t < threads_; ++t)
        slab_.resize(static_cast<std::size_t>(nz * (t + 1) / threads_), t);
    // Room for the slabs to move: a layer at each end, two where sweeps begin side by side.
    const int slots = nz + 2 + 2 * ((threads_ - 1) / 2);
    // Past the last layer, a cell's neighbour in +x still is one float away.
    front_ = zeros(slots * layer(coefficients) + margin);
    total_ = zeros(nz * layer(coefficients) + margin);
    border_ = zeros(layer(coefficients) + margin);
    links_ = zeros(occluded ? (nz + 1) * layer(axes) + margin : margin);
}

bench::PropagateLoop::Array bench::PropagateLoop::zeros(std::ptrdiff_t count) {
    constexpr std::size_t page = std::size_t(2) << 20;
    const std::size_t bytes =
        (static_cast<std::size_t>(count) * sizeof(float) + page - 1) / page * page;
    Array array(static_cast<float*>(std::aligned_alloc(page, bytes)));
    if (!array)
        throw std::bad_alloc();
#ifdef __linux__
    madvise(array.get(), bytes, MADV_HUGEPAGE);
#endif
    std::fill_n(array.get(), bytes / sizeof(float), 0.0F);
    return array;
}

float* bench::PropagateLoop::layer_of_front(int z) {
    if (z < 0 || z >= nz_)
        return border_.get();
    const int slab = slab_[static_cast<std::size_t>(z)];
    const int shift = !moved_ ? 0 : slab % 2 == 0 ? -1 : 1;
    return front_.get() + (z + 1 + slab / 2 * 2 + shift) * layer(coefficients);
}

float& bench::PropagateLoop::front(int x, int y, int z, int k) {
    return layer_of_front(z)[cell(x, y, k, coefficients)];
}

float& bench::PropagateLoop::total(int x, int y, int z, int k) {
    return total_[static_cast<std::size_t>(z * layer(coefficients) + cell(x, y, k, coefficients))];
}

float& bench::PropagateLoop::link(int x, int y, int z, int axis) {
    return links_[static_cast<std::size_t>((z + 1) * layer(axes) + cell(x, y, axis, axes))];
}

template <bool occluded>
void bench::PropagateLoop::sweep_layer(int z, float* target, std::vector<float>& scratch) {
    float* const received = scratch.data();
    float* const flux = received + 4 * pitch_;
    std::fill_n(flux, nx_, 0.0F);
    const float* const below = layer_of_front(z - 1);
    const float* const here = layer_of_front(z);
    const float* const above = layer_of_front(z + 1);
    float* const total = total_.get() + z * layer(coefficients);
    // Layer -1 of the links is the first one in the array.
    const float* const links = links_.get() + (occluded ? (z + 1) * layer(axes) : 0);
    const float* const links_below = links - (occluded ? layer(axes) : 0);
    for (int y = 0; y < ny_; ++y) {
        const std::ptrdiff_t link = occluded ? cell(0, y, 0, axes) : 0;
        for (int k = 0; k < coefficients; k += 4) {
            const std::ptrdiff_t start = cell(0, y, k, coefficients);
            // The same channel of the next row: what comes from main memory.
            for (std::ptrdiff_t i = 0; i < 4 * pitch_; i += 16) {
                __builtin_prefetch(above + start + row(coefficients) + i);
                __builtin_prefetch(total + start + row(coefficients) + i, 1);
            }
            gather<occluded>(below + start, here + start, above + start, links + link,
                             links_below + link, received, pitch_, row(coefficients), row(axes),
                             nx_);
            emit(received, target + start, total + start, flux, pitch_, nx_);
        }
    }
    double sum = 0.0;
    for (int x = 0; x < nx_; ++x)
        sum += double(flux[x]);
    layer_flux_[static_cast<std::size_t>(z)] = double(sqrt_4pi) * sum;
}

double bench::PropagateLoop::run(int steps) {
    std::barrier first_layers(threads_);
    std::barrier layers(threads_, [this]() noexcept { moved_ = !moved_; });
    const auto work = [&](int slab) {
        const int begin = nz_ * slab / threads_, end = nz_ * (slab + 1) / threads_;
        std::vector<float> scratch(static_cast<std::size_t>(5 * pitch_));
        for (int step = 0; step < steps; ++step) {
            const bool up = (slab % 2 == 0) != moved_;
            for (int i = 0; i < end - begin; ++i) {
                const int z = up ? begin + i : end - 1 - i;
                float* const target = layer_of_front(z) + (up ? -1 : 1) * layer(coefficients);
                if (occluded_)
                    sweep_layer<true>(z, target, scratch);
                else
                    sweep_layer<false>(z, target, scratch);
                if (i == 0)
                    first_layers.arrive_and_wait();
            }
            layers.arrive_and_wait();
        }
    };
    {
        std::vector<std::jthread> workers;
        for (int slab = 1; slab < threads_; ++slab)
            workers.emplace_back(work, slab);
        work(0);
    }
    double sum = 0.0;
    for (const double flux : layer_flux_)
        sum += flux;
    return sum;
}

} // namespace lpvbake::bench
