// Irradiance of a light volume, for shaders in GLSL 1.30, ES 3.00 and later.
//
// Every grid is a 3D texture of the volume's cells, filtered linearly and clamped at its edges:
// sh_l0, sh_l1_y, sh_l1_z, sh_l1_x (RGB; with order 2 also sh_l2_xy, yz, z2, xz, x2y2) and validity. Declare
// them, then include this:
//
//     #define LPV_ORDER 1           // or 2
//     uniform sampler3D lpv_sh[4];  // or 9
//     uniform sampler3D lpv_validity;
//     #define LPV_WALLS             // where there are grids wall_0 to wall_2
//     uniform sampler3D lpv_walls[3];
//
// Light over its mean is unpacked as it is looked up: of --precision unorm8
//
//     #define LPV_UNORM8
//     uniform sampler3D lpv_sh[4];  // sh_l0, ratio_r, ratio_g, ratio_b; of order 2
//                                   // 7: sh_l0, ratio_r, ratio_r2, ratio_g, ...
// of --precision bc6h
//
//     #define LPV_BC6H
//     uniform sampler3D lpv_sh[4];  // or 9, as without it
//     uniform sampler3D lpv_base;
// and of both `low` and `high` of each texture of lpv_sh, as the description has them:
//
//     uniform vec4 lpv_low[4], lpv_high[4]; // as many as lpv_sh
//
// Of nested levels (`lpvbake bake --level`) a texture holds all, one after the other along z, the finest
// first, and is as wide and as high as the largest; `low` and `high` are of one level after the other.
// lpv_levels() blends them:
//
//     #define LPV_LEVELS 3
//
// Of bricks (`lpvbake bake --adaptive`, of .exr, .ktx2 or .dds) the textures are those of NAME_atlas, and
// NAME_bricks.exr is a 3D texture, too, that is not filtered. lpv_bricks_trilinear() reads it once and the
// textures once; lpv_bricks_facing() is lpv_facing() in the finest brick:
//
//     #define LPV_BRICKS
//     uniform sampler3D lpv_brick_places;
//
// Of air (`lpvbake bake --medium`) lpv_fog() marches a view ray through grids scatter and extinction, and with
// LPV_FOG_SH through scattered_l0, ... of air that scatters forward, in LPV_ORDER:
//
//     #define LPV_FOG
//     uniform sampler3D lpv_scatter, lpv_extinction;
//     #define LPV_FOG_SH                  // then no lpv_scatter
//     uniform sampler3D lpv_scattered[4]; // or 9
//
// Coefficients are canonical, as `lpvbake bake` writes them unless --sh-convention says otherwise,
// in whatever --axes. A Lambert surface's luminance is albedo / pi times its irradiance.
//
// Where a volume is turned (grid.turn of its .json) points and normals of lookups are to be in its axes, with
// point = origin + axes * (point in them - origin); irradiance is of the world's normal all the same.

struct LpvVolume {
    vec3 origin; // corner of the first cell, metres
    float cell;  // edge of a cell, metres
};

#ifndef LPV_ORDER
#error "define LPV_ORDER as 1 or 2, the order of the volume"
#endif

#if LPV_ORDER == 1
#define LPV_EACH(DO) DO(0) DO(1) DO(2) DO(3)
struct LpvSh { vec3 c[4]; };
#else
#define LPV_EACH(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) DO(8)
struct LpvSh { vec3 c[9]; };
#endif

#ifndef LPV_UNORM8
#define LPV_EACH_TEXTURE(DO) LPV_EACH(DO)
#define LPV_TEXTURES ((LPV_ORDER + 1) * (LPV_ORDER + 1))
#elif LPV_ORDER == 1
#define LPV_EACH_TEXTURE(DO) DO(0) DO(1) DO(2) DO(3)
#define LPV_TEXTURES 4
#else
#define LPV_EACH_TEXTURE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6)
#define LPV_TEXTURES 7
#endif

#ifdef LPV_LEVELS
// The level that is read: its number, cells, and where its slices begin.
int lpv_level = 0, lpv_slice = 0;
ivec3 lpv_dims = ivec3(0);
#define LPV_DIMS lpv_dims
#define LPV_CELL(cell) ((cell) + ivec3(0, 0, lpv_slice))
#define LPV_RANGE(i) lpv_level * LPV_TEXTURES + i
#elif defined(LPV_BRICKS)
ivec3 lpv_first = ivec3(0); // the texel where the brick begins that is read
#define LPV_DIMS ivec3(9)
#define LPV_CELL(cell) ((cell) + lpv_first)
#define LPV_RANGE(i) i
#else
#define LPV_DIMS textureSize(lpv_validity, 0)
#define LPV_CELL(cell) cell
#define LPV_RANGE(i) i
#endif

// Metres to cells: cell (i, j, k) has its centre at (i, j, k).
vec3 lpv_to_lattice(LpvVolume volume, vec3 point) {
    return (point - volume.origin) / volume.cell - 0.5;
}

// ---- coefficients, of the texels of lpv_sh and lpv_base ----

LpvSh lpv_unpack(vec4 t[LPV_TEXTURES], vec3 base) {
    LpvSh sh;
#if defined(LPV_UNORM8) || defined(LPV_BC6H)
#define LPV_STRETCH(i) t[i] = lpv_low[LPV_RANGE(i)] + (lpv_high[LPV_RANGE(i)] - lpv_low[LPV_RANGE(i)]) * t[i];
    LPV_EACH_TEXTURE(LPV_STRETCH)
#endif
#ifdef LPV_UNORM8
    sh.c[0] = t[0].rgb;
    for (int k = 1; k < (LPV_ORDER + 1) * (LPV_ORDER + 1); ++k) {
        int i = (k - 1) / 4, channel = (k - 1) % 4;
        sh.c[k] = sh.c[0] * vec3(t[1 + i][channel], t[1 + LPV_ORDER + i][channel],
                                 t[1 + 2 * LPV_ORDER + i][channel]);
    }
#else
#define LPV_TAKE(k) sh.c[k] = t[k].rgb * base;
    LPV_EACH(LPV_TAKE)
#endif
    return sh;
}

#ifndef LPV_LEVELS
LpvSh lpv_filtered(vec3 uvw) {
    vec4 t[LPV_TEXTURES];
#define LPV_SAMPLE(i) t[i] = textureLod(lpv_sh[i], uvw, 0.0);
    LPV_EACH_TEXTURE(LPV_SAMPLE)
#ifdef LPV_BC6H
    return lpv_unpack(t, textureLod(lpv_base, uvw, 0.0).rgb);
#else
    return lpv_unpack(t, vec3(1.0));
#endif
}
#endif

LpvSh lpv_of_cell(ivec3 cell) {
    vec4 t[LPV_TEXTURES];
#define LPV_FETCH(i) t[i] = texelFetch(lpv_sh[i], LPV_CELL(cell), 0);
    LPV_EACH_TEXTURE(LPV_FETCH)
#ifdef LPV_BC6H
    return lpv_unpack(t, texelFetch(lpv_base, LPV_CELL(cell), 0).rgb);
#else
    return lpv_unpack(t, vec3(1.0));
#endif
}

// ---- the field at a point (metres) ----

#ifndef LPV_LEVELS
// By the texture unit: light of cells inside and behind walls leaks in.
LpvSh lpv_trilinear(LpvVolume volume, vec3 point) {
    // Textures of blocks have more texels than cells.
    return lpv_filtered((lpv_to_lattice(volume, point) + 0.5) / vec3(textureSize(lpv_sh[0], 0)));
}
#endif

bool lpv_is_valid(ivec3 cell) {
    return texelFetch(lpv_validity, LPV_CELL(cell), 0).r > 0.0;
}

// max(0, n.d)^2, d the direction to what lies `way` of the point, from 0.1 cells below it.
float lpv_faced(vec3 way, vec3 n) {
    way += 0.1 * n;
    float along = max(0.0, dot(way, n)), square = dot(way, way);
    return square > 0.0 ? along * along / square : 1.0;
}

// 0 behind a wall, 1 from 0.2 cells before it. w is the way from a cell's centre to the wall, x the
// way to the point, in cells.
float lpv_before_wall(vec3 w, vec3 x) {
    float square = dot(w, w);
    return square > 0.0 ? clamp((square - dot(w, x)) / (0.2 * sqrt(square)), 0.0, 1.0) : 1.0;
}

float lpv_before_walls(ivec3 cell, vec3 x) {
#ifdef LPV_WALLS
    return lpv_before_wall(texelFetch(lpv_walls[0], LPV_CELL(cell), 0).xyz, x)
           * lpv_before_wall(texelFetch(lpv_walls[1], LPV_CELL(cell), 0).xyz, x)
           * lpv_before_wall(texelFetch(lpv_walls[2], LPV_CELL(cell), 0).xyz, x);
#else
    return 1.0;
#endif
}

// The nearest valid cell of the 4 x 4 x 4 around; if `clear`, of those that the surface faces, less
// than 2 cells away, with the point before their walls. False if there is none.
bool lpv_nearest(vec3 at, vec3 n, ivec3 low, bool clear, out ivec3 cell) {
    ivec3 last = LPV_DIMS - 1;
    float least = clear ? 4.0 : 1e30;
    bool found = false;
    cell = low;
    for (int i = 0; i < 64; ++i) {
        ivec3 other = low - 1 + ivec3(i & 3, (i >> 2) & 3, i >> 4);
        vec3 way = vec3(other) - at;
        if (other != clamp(other, ivec3(0), last) || dot(way, way) >= least
            || !lpv_is_valid(other))
            continue;
        if (clear && lpv_faced(way, n) * lpv_before_walls(other, 0.2 * n - way) <= 0.0)
            continue;
        cell = other;
        least = dot(way, way);
        found = true;
    }
    return found;
}

#define LPV_CLEAR(k) sh.c[k] = vec3(0.0);
#define LPV_ADD(k) sh.c[k] += weight * one.c[k];

// Weights of the eight cells from `low` on around `place`, as a surface at `at` sees them: what the
// walls let pass, as if there were none, and whatever the direction. Returns their sums.
vec3 lpv_weights(vec3 place, vec3 at, vec3 n, out ivec3 low, out vec3 weights[8]) {
    ivec3 dims = LPV_DIMS;
    vec3 clamped = clamp(place, vec3(0.0), vec3(dims - 1));
    low = min(ivec3(clamped), max(dims - 2, ivec3(0)));
    vec3 share = clamped - vec3(low);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 8; ++i) {
        ivec3 corner = ivec3(i & 1, (i >> 1) & 1, i >> 2);
        ivec3 cell = min(low + corner, dims - 1);
        vec3 plain = mix(1.0 - share, share, vec3(corner)), way = vec3(cell) - at;
        float valid = lpv_is_valid(cell) ? plain.x * plain.y * plain.z : 0.0;
        float faced = valid * lpv_faced(way, n);
        weights[i] = vec3(faced * lpv_before_walls(cell, 0.2 * n - way), faced, valid);
        sum += weights[i];
    }
    return sum;
}

// At a surface of unit normal n: trilinear weights of valid cells times max(0, n.d)^2, d the
// direction to a cell's centre, so that cells behind the surface do not count, times what the
// cells' walls let pass. Where none is left, or next to none, those around half a cell further;
// else the nearest that these would leave; else without walls; else without the direction; else the
// nearest valid cell; else dark. `clear` is false where the walls or the direction had to be left
// out.
LpvSh lpv_facing(LpvVolume volume, vec3 point, vec3 n, out bool clear) {
    clear = true;
    vec3 at = lpv_to_lattice(volume, point);
    ivec3 low, cell;
    vec3 weights[8];
    vec3 sum = lpv_weights(at, at, n, low, weights);
    vec3 use = sum.x > 0.0   ? vec3(1.0 / sum.x, 0.0, 0.0)
               : sum.y > 0.0 ? vec3(0.0, 1.0 / sum.y, 0.0)
                             : vec3(0.0, 0.0, sum.z > 0.0 ? 1.0 / sum.z : 0.0);
    LpvSh sh;
    LPV_EACH(LPV_CLEAR)
    if (sum.x <= 1e-3) {
        ivec3 next_low;
        vec3 next[8];
        vec3 next_sum = lpv_weights(at + 0.5 * n, at, n, next_low, next);
        if (next_sum.x > 1e-3) {
            low = next_low;
            weights = next;
            use = vec3(1.0 / next_sum.x, 0.0, 0.0);
        }
#ifdef LPV_WALLS
        else if (sum.x <= 0.0 && lpv_nearest(at, n, low, true, cell))
            return lpv_of_cell(cell);
#endif
    }
    clear = use.x > 0.0;
    if (use.x + use.y + use.z > 0.0) {
        for (int i = 0; i < 8; ++i) {
            cell = min(low + ivec3(i & 1, (i >> 1) & 1, i >> 2), LPV_DIMS - 1);
            float weight = dot(use, weights[i]);
            LpvSh one = lpv_of_cell(cell);
            LPV_EACH(LPV_ADD)
        }
    } else if (lpv_nearest(at, n, low, false, cell)) {
        return lpv_of_cell(cell);
    }
    return sh;
}

LpvSh lpv_facing(LpvVolume volume, vec3 point, vec3 n) {
    bool clear;
    return lpv_facing(volume, point, n, clear);
}

#ifdef LPV_LEVELS
// ---- nested levels ----

// As the manifest, NAME.levels.json, has them.
struct LpvLevel {
    LpvVolume volume;
    ivec3 dims;
    int slice; // where it begins in the textures
    vec3 lo, hi; // its box; of faces that it has in common with the last level's, far outside
    float fade; // metres: the manifest's blend times the next level's cell; 0 of the last
};

// What a level weighs against the coarser ones.
float lpv_share(LpvLevel level, vec3 point) {
    if (level.fade <= 0.0)
        return 1.0;
    vec3 inside = min(point - level.lo, level.hi - point);
    float t = clamp(min(inside.x, min(inside.y, inside.z)) / level.fade, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

#define LPV_DIVIDE(k) sh.c[k] /= total;

// lpv_facing of the levels around a point, each by its share of what finer ones leave. One that has
// no cell that the surface sees does not count, unless none has; then the finest does.
LpvSh lpv_levels(LpvLevel levels[LPV_LEVELS], vec3 point, vec3 n) {
    LpvSh sh, first;
    LPV_EACH(LPV_CLEAR)
    first = sh;
    bool found = false;
    float total = 0.0, left = 1.0;
    for (int i = 0; i < LPV_LEVELS; ++i) {
        float weight = left * lpv_share(levels[i], point);
        if (weight <= 0.0)
            continue;
        lpv_level = i;
        lpv_slice = levels[i].slice;
        lpv_dims = levels[i].dims;
        bool clear;
        LpvSh one = lpv_facing(levels[i].volume, point, n, clear);
        if (!found)
            first = one;
        found = true;
        if (clear) {
            LPV_EACH(LPV_ADD)
            total += weight;
            left -= weight;
        }
    }
    if (total <= 0.0)
        return first;
    LPV_EACH(LPV_DIVIDE)
    return sh;
}
#endif

#ifdef LPV_BRICKS
// ---- bricks ----

// As the manifest, NAME.levels.json, has them.
struct LpvBricks {
    vec3 lo;    // of the box of level 0, metres
    float cell; // of level 0, metres
};

// The finest brick around a point: its first sample and cells as a volume, and lpv_first.
LpvVolume lpv_brick(LpvBricks bricks, vec3 point) {
    ivec3 places = textureSize(lpv_brick_places, 0);
    ivec3 place = clamp(ivec3(floor((point - bricks.lo) / (8.0 * bricks.cell))), ivec3(0), places - 1);
    vec4 entry = texelFetch(lpv_brick_places, place, 0);
    lpv_first = ivec3(entry.xyz);
    float cell = bricks.cell * entry.w;
    vec3 first = bricks.lo + 8.0 * cell * floor(vec3(place) / entry.w);
    return LpvVolume(first - 0.5 * cell, cell);
}

// By the texture unit, without a step between bricks.
LpvSh lpv_bricks_trilinear(LpvBricks bricks, vec3 point) {
    vec3 at = clamp(lpv_to_lattice(lpv_brick(bricks, point), point), 0.0, 8.0);
    return lpv_filtered((vec3(lpv_first) + at + 0.5) / vec3(textureSize(lpv_sh[0], 0)));
}

LpvSh lpv_bricks_facing(LpvBricks bricks, vec3 point, vec3 n) {
    return lpv_facing(lpv_brick(bricks, point), point, n);
}
#endif

#ifdef LPV_FOG
// ---- air on a view ray ----

struct LpvFog {
    vec3 light; // what air adds to what is seen, nits
    vec3 left;  // the share of what is behind it that is left
};

// Luminance that the air at a place of the textures sends on, a metre, to who looks along `view`.
vec3 lpv_scatter_at(vec3 uvw, vec3 view) {
#ifdef LPV_FOG_SH
    LpvSh sh;
#define LPV_SCATTERED(k) sh.c[k] = textureLod(lpv_scattered[k], uvw, 0.0).rgb;
    LPV_EACH(LPV_SCATTERED)
    vec3 light = 0.28209479 * sh.c[0]
                 + 0.48860251 * (sh.c[1] * view.y + sh.c[2] * view.z + sh.c[3] * view.x);
#if LPV_ORDER == 2
    light += 1.09254843 * (sh.c[4] * view.x * view.y + sh.c[5] * view.y * view.z + sh.c[7] * view.x * view.z)
             + 0.31539157 * sh.c[6] * (3.0 * view.z * view.z - 1.0)
             + 0.54627422 * sh.c[8] * (view.x * view.x - view.y * view.y);
#endif
    return max(light, 0.0);
#else
    return textureLod(lpv_scatter, uvw, 0.0).rgb;
#endif
}

// (1 - exp(-lost * way)) / lost, by its series where little is lost.
float lpv_fading(float lost, float way) {
    float x = lost * way;
    return x < 1e-2 ? way * (1.0 - x * (0.5 - x / 6.0)) : (1.0 - exp(-x)) / lost;
}

// The air of the volume on the way from `eye` along the unit vector `view`, as far as `end`, metres. Each
// of `steps` steps adds scatter (1 - exp(-extinction d)) / extinction, whatever its length d, so that even
// air is exact in one step (Hillaire 2015, Physically Based and Unified Volumetric Rendering in Frostbite).
// `place` is where in a step its air is looked up: 0.5, or a pixel's own number from 0 to 1, which turns
// bands into noise.
LpvFog lpv_fog(LpvVolume volume, vec3 eye, vec3 view, float end, int steps, float place) {
    LpvFog fog = LpvFog(vec3(0.0), vec3(1.0));
    vec3 size = volume.cell * vec3(textureSize(lpv_extinction, 0));
    vec3 to = volume.origin - eye;
    float from = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        if (view[axis] == 0.0) {
            if (to[axis] > 0.0 || to[axis] + size[axis] < 0.0)
                return fog;
            continue;
        }
        float a = to[axis] / view[axis], b = (to[axis] + size[axis]) / view[axis];
        from = max(from, min(a, b));
        end = min(end, max(a, b));
    }
    if (from >= end)
        return fog;
    float part = (end - from) / float(steps);
    for (int i = 0; i < steps; ++i) {
        vec3 uvw = (eye + (from + (float(i) + place) * part) * view - volume.origin) / size;
        vec3 lost = textureLod(lpv_extinction, uvw, 0.0).rgb;
        vec3 fading = vec3(lpv_fading(lost.r, part), lpv_fading(lost.g, part), lpv_fading(lost.b, part));
        fog.light += fog.left * fading * lpv_scatter_at(uvw, view);
        fog.left *= exp(-part * lost);
    }
    return fog;
}
#endif

// ---- irradiance (lux) on a plane of unit normal n ----

vec3 lpv_irradiance_l1(LpvSh sh, vec3 n) {
    vec3 e = 0.88622693 * sh.c[0] + 1.02332671 * (sh.c[1] * n.y + sh.c[2] * n.z + sh.c[3] * n.x);
    return max(e, 0.0);
}

// One colour: e0 + e1.n is the linear form.
float lpv_nonlinear(float e0, vec3 e1, vec3 n) {
    if (e0 <= 0.0)
        return 0.0;
    float size = length(e1), ratio = min(0.5 * size / e0, 1.0);
    float q = size > 0.0 ? clamp(0.5 + 0.5 * dot(e1, n) / size, 0.0, 1.0) : 0.5;
    float p = 1.0 + 2.0 * ratio, a = (1.0 - ratio) / (1.0 + ratio);
    return e0 * (a + (1.0 - a) * (p + 1.0) * pow(q, p));
}

// From bands 0 and 1, by a power of a cosine: never negative, the same mean over all normals, and
// light from one side falls off as it should. Enlighten's model, by Chris Doran and Graham Hazel
// (Geomerics): grahamhazel.com/blog/2017/12/22/converting-sh-radiance-to-irradiance
vec3 lpv_irradiance_l1_nonlinear(LpvSh sh, vec3 n) {
    vec3 e0 = 0.88622693 * sh.c[0];
    vec3 x = 1.02332671 * sh.c[3], y = 1.02332671 * sh.c[1], z = 1.02332671 * sh.c[2];
    return vec3(lpv_nonlinear(e0.r, vec3(x.r, y.r, z.r), n),
                lpv_nonlinear(e0.g, vec3(x.g, y.g, z.g), n),
                lpv_nonlinear(e0.b, vec3(x.b, y.b, z.b), n));
}

// One colour: the zonal band 2 that light of c0 and band 1 (along the axis) is likely to have.
float lpv_zonal(float c0, float along) {
    float ratio = c0 > 0.0 ? min(along / c0, 1.7320508) : 0.0; // that of light from one point
    return c0 * (0.08 * ratio + 0.6 * ratio * ratio);
}

// From bands 0 and 1, with a zonal band 2 along the luminance of band 1, as long as band 1 lets
// guess: sharper than the linear form, the same mean and band 1, negative where those are. Roughton
// et al. 2024, ZH3: Quadratic Zonal Harmonics.
vec3 lpv_irradiance_l1_zh3(LpvSh sh, vec3 n) {
    vec3 luminance = vec3(0.2126, 0.7152, 0.0722);
    vec3 axis = vec3(dot(luminance, sh.c[3]), dot(luminance, sh.c[1]), dot(luminance, sh.c[2]));
    vec3 e = 0.88622693 * sh.c[0] + 1.02332671 * (sh.c[1] * n.y + sh.c[2] * n.z + sh.c[3] * n.x);
    float size = length(axis);
    if (size > 0.0) {
        axis /= size;
        vec3 along = abs(sh.c[1] * axis.y + sh.c[2] * axis.z + sh.c[3] * axis.x);
        vec3 zonal = vec3(lpv_zonal(sh.c[0].r, along.r), lpv_zonal(sh.c[0].g, along.g),
                          lpv_zonal(sh.c[0].b, along.b));
        float cosine = dot(axis, n);
        e += 0.24770796 * (3.0 * cosine * cosine - 1.0) * zonal;
    }
    return max(e, 0.0);
}

#if LPV_ORDER == 2
vec3 lpv_irradiance_l2(LpvSh sh, vec3 n) {
    vec3 e = 0.88622693 * sh.c[0] + 1.02332671 * (sh.c[1] * n.y + sh.c[2] * n.z + sh.c[3] * n.x)
             + 0.85808553 * (sh.c[4] * n.x * n.y + sh.c[5] * n.y * n.z + sh.c[7] * n.x * n.z)
             + 0.24770796 * sh.c[6] * (3.0 * n.z * n.z - 1.0)
             + 0.42904277 * sh.c[8] * (n.x * n.x - n.y * n.y);
    return max(e, 0.0);
}
#endif
