#include "solver/sn/directions.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::solver::sn {
namespace {

// A set that is closed under the 48 symmetries of the cube integrates all harmonics but those that
// share these symmetries: of each even band l from 4 on as many as 4 a + 6 b = l has solutions. The
// m base directions, 2 m numbers, were found as zeros of the sums of these by Newton's method, of
// least norm, from random starts; of the zeros those that lie farthest apart are kept. (Spherical
// designs with the symmetry of the cube: McLaren 1963, Hardin and Sloane 1996.)
constexpr glm::dvec2 base[] = {
    // 48 directions: exact to band 7.
    {0.866246818107819, 0.422518653761124},
    // 96 directions: exact to band 9.
    {0.933259858886756, 0.355498284073690},
    {0.709159955548255, 0.636400401915070},
    // 144 directions: exact to band 11.
    {0.955228196945574, 0.273438694350983},
    {0.811000472346577, 0.567317079409947},
    {0.750601183920693, 0.544805644339350},
    // 192 directions: exact to band 15.
    {0.966789104277216, 0.223199987283101},
    {0.856452796712582, 0.458756035143220},
    {0.810414875109990, 0.578489867590129},
    {0.713609093424934, 0.576222630108369},
    // 240 directions: exact to band 17.
    {0.973650298755219, 0.214119509176880},
    {0.878449711478349, 0.466521133152850},
    {0.859237621572726, 0.396915984721474},
    {0.762036279410036, 0.631735678646109},
    {0.680752510761313, 0.606557024958618},
    // 288 directions: exact to band 19.
    {0.978084447984968, 0.190288435478829},
    {0.895709184903484, 0.369206138761404},
    {0.886734944361057, 0.458509322704219},
    {0.797522282804291, 0.525321126387152},
    {0.741315415527669, 0.657829960856723},
    {0.696368033551317, 0.570155941457391},
    // 384 directions: exact to band 23.
    {0.983592433809874, 0.151464728886142},
    {0.921756334237901, 0.348939691657313},
    {0.914601655117347, 0.395163923387623},
    {0.851686301750860, 0.418889418134262},
    {0.798892598868910, 0.598756827938108},
    {0.762565573236255, 0.561477356393263},
    {0.760665172663578, 0.620708267870515},
    {0.683301875339255, 0.567824686830672},
};

struct Set {
    int count, exact_band, first;
};
constexpr Set sets[] = {{48, 7, 0},    {96, 9, 1},    {144, 11, 3}, {192, 15, 6},
                        {240, 17, 10}, {288, 19, 15}, {384, 23, 21}};

const Set& set_of(int count) {
    return *std::find_if(std::begin(sets), std::end(sets),
                         [&](const Set& set) { return set.count == count; });
}

} // namespace

std::span<const int> sn_direction_counts() {
    static const auto counts = [] {
        std::array<int, std::size(sets)> all{};
        std::transform(std::begin(sets), std::end(sets), all.begin(),
                       [](const Set& set) { return set.count; });
        return all;
    }();
    return counts;
}

int sn_direction_count(int wanted) {
    const std::span<const int> counts = sn_direction_counts();
    const auto at = std::lower_bound(counts.begin(), counts.end(), wanted);
    return at == counts.end() ? counts.back() : *at;
}

std::span<const glm::dvec2> sn_base_directions(int count) {
    return std::span(base).subspan(size_t(set_of(count).first), size_t(count / 48));
}

int sn_exact_band(int count) {
    return set_of(count).exact_band;
}

std::vector<glm::dvec3> sn_octant_directions(int count) {
    std::vector<glm::dvec3> directions;
    for (const glm::dvec2 xy : sn_base_directions(count)) {
        const double z = std::sqrt(1.0 - glm::dot(xy, xy));
        directions.insert(directions.end(), {{xy.x, xy.y, z},
                                             {xy.x, z, xy.y},
                                             {xy.y, xy.x, z},
                                             {z, xy.x, xy.y},
                                             {xy.y, z, xy.x},
                                             {z, xy.y, xy.x}});
    }
    return directions;
}

} // namespace lpvbake::solver::sn
