// What programs show of a volume: how each looks cells up at a point of a surface, and what it
// makes of what it finds there.
#pragma once

#include "volume/levels.h"
#include "volume/sampler.h"
#include "volume/sh.h"

#include <array>
#include <span>
#include <string_view>

namespace lpvbake::readers {

/// How irradiance towards a normal n comes from the coefficients c of a lookup.
enum class Evaluation {
    linear, ///< sum of A_l c_lm Y_lm(n), as sh_irradiance
    /// Squares of n's parts times the irradiance of the axes' ends that they look to, of which each
    /// cell stores what is not negative (McTaggart 2004).
    cube,
    /// Of band 1 alone: E0 (a + (1 - a)(p + 1) q^p), E0 the mean over normals, q = (1 + d.n) / 2
    /// with d the direction of band 1, r = sqrt(3) |c_1| / (3 c_0) but at most 1, p = 1 + 2 r,
    /// a = (1 - r) / (1 + r) (Geomerics, Reconstructing Diffuse Lighting from Spherical Harmonic
    /// Data, CEDEC 2015).
    geomerics,
    /// Linear, with a zonal band 2 along the luminance of band 1, of c_0 (0.08 r + 0.6 r^2), where
    /// r = |c_1.axis| / c_0 of a colour, but at most sqrt(3), that of light from one point
    /// (Roughton et al. 2024, ZH3: Quadratic Zonal Harmonics).
    zh3,
};

/// A program that reads volumes.
struct Reader {
    const char* name;
    /// Which cells count. Programs know neither validity nor walls: their lookup is trilinear, and
    /// clamped at the outermost centres.
    Reading lookup = Reading::trilinear;
    double offset = 0; ///< cells along the normal from the point that is shaded to the lookup
    Evaluation evaluation = Evaluation::linear;
    int highest_order = 2;  ///< bands above it are not read
    bool clamped = false;   ///< its shader turns a negative sum to 0
    bool beyond_box = true; ///< false: outside of the lattice's box the volume gives nothing
    /// Shaders get the coefficients from it, and may make irradiance of them in another way.
    bool gives_coefficients = false;
    const char* source = ""; ///< where the lookup and the formula stand
};

/// lpvbake (the sampler of sampler.h and of the shaders in examples/), blender, houdini, unity,
/// unreal, godot, threejs, vrc, bevy: those of io's targets; then geomerics and zh3, which shaders
/// may take for vrc's and Unity's order 1.
std::span<const Reader> all_readers();
/// Null for an unknown name.
const Reader* reader_named(std::string_view name);

/// Null for all but "linear", "geomerics" and "zh3".
const Evaluation* evaluation_named(std::string_view name);
/// Empty for cube.
const char* name_of(Evaluation evaluation);

/// The same lookup by shaders that make irradiance of it in that way: geomerics and zh3 have bands
/// 0 and 1.
Reader with_evaluation(Reader reader, Evaluation evaluation);

/// Whether both show the same of any volume.
bool read_alike(const Reader& a, const Reader& b);

/// Bands that the reader has of a volume.
int order_of(const Reader& reader, const Volume& volume);

/// The cells that a reader looks up for a point (metres) of a surface with unit normal n, with
/// their weights, which sum to 1; all are 0 where it finds nothing.
volume::CellWeights taps_of(const Reader& reader, const Volume& volume, glm::dvec3 point,
                            glm::dvec3 n);

/// Whether irradiance is a linear map of the cells' coefficients but for what is clamped.
constexpr bool is_linear(const Reader& reader) {
    return reader.evaluation == Evaluation::linear || reader.evaluation == Evaluation::cube;
}

/// Whether negative irradiance of the sum of bands 0 to 2 is what the reader shows.
constexpr bool shows_ringing(const Reader& reader) {
    return reader.evaluation == Evaluation::linear && reader.highest_order <= 2;
}

/// T_k of the first sh_count(order) coefficients, the others 0: a linear reader shows the sum over
/// taps of weight * sum_k T_k c_k, one colour, lux from nits.
std::array<double, volume::sh_count(volume::sh_max_order)> transfer_of(const Reader& reader,
                                                                       int order, glm::dvec3 n);

/// Irradiance (lux, RGB) that the reader shows at a point (metres) of unit normal n. Sums over taps
/// are rounded to single precision; lpvbake's row gives the bits of read_irradiance.
glm::dvec3 irradiance(const Reader& reader, const Volume& volume, glm::dvec3 point, glm::dvec3 n);

/// The same of nested levels, blended (volume/levels.h); of a volume that is alone the same bits.
glm::dvec3 irradiance(const Reader& reader, const volume::Levels& levels, glm::dvec3 point,
                      glm::dvec3 n);

/// Irradiance from the coefficients (nits, RGB) of a lookup, for all evaluations but cube, which
/// has no coefficients; not clamped.
glm::dvec3 evaluate(Evaluation evaluation, std::span<const glm::vec3> coefficients, glm::dvec3 n);

} // namespace lpvbake::readers
