#include "io/stored.h"

#include "colour/colour.h"
#include "io/layout.h"
#include "volume/sh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::io {
namespace {

void check(const Volume& canonical, const volume::Encoding& encoding, const std::string& path) {
    check_volume(canonical, path, ErrorKind::failure);
    const int highest = volume::highest_order(encoding.convention);
    if (canonical.sh_order > highest)
        throw Error(ErrorKind::unsupported,
                    path + ": the convention " + volume::name_of(encoding.convention)
                        + " has a form for order " + std::to_string(highest)
                        + " at most; the volume has order " + std::to_string(canonical.sh_order)
                        + ": set `sh_order`");
}

bool changes(const volume::Encoding& encoding) {
    return encoding.convention != volume::ShConvention::radiance
           || encoding.axes != volume::Axes::gltf;
}

std::vector<float> density_of(const Volume& canonical) {
    std::vector<float> density(canonical.grid.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, density.size()), [&](const auto& cells) {
        for (size_t i = cells.begin(); i < cells.end(); ++i)
            density[i] =
                volume::sh_y0
                * float(glm::dot(glm::dvec3(canonical.sh[0][i]), colour::rec709_luminance));
    });
    return density;
}

bool has_negative_mean(const Volume& stored) {
    return std::ranges::any_of(stored.sh[0], [](const glm::vec3& c) {
        return std::min({c.x, c.y, c.z}) < 0;
    });
}

} // namespace

Stored::Stored(const Volume& canonical, const volume::Encoding& encoding, const std::string& path)
    : encoding_(encoding) {
    check(canonical, encoding, path);
    if (!changes(encoding)) {
        shared_ = &canonical;
        density_ = density_of(canonical);
        return;
    }
    own_ = canonical;
    encode_own();
}

Stored::Stored(Volume&& canonical, const volume::Encoding& encoding, const std::string& path)
    : encoding_(encoding) {
    check(canonical, encoding, path);
    own_ = std::move(canonical);
    encode_own();
}

void Stored::encode_own() {
    volume::turn_axes(volume::from_gltf(encoding_.axes), *own_);
    density_ = density_of(*own_);
    volume::encode(encoding_.convention, own_->sh_order, own_->sh);
}

Precision Stored::precision(Precision wanted, const std::string& path, WriteReport& report) const {
    report.precision = wanted;
    if (wanted == Precision::full)
        return wanted;
    const auto why = half_misfit(volume(), has_ratios(wanted));
    if (why && has_ratios(wanted))
        throw Error(ErrorKind::unsupported, path + ": " + *why + ", as which " + name_of(wanted)
                                                + " stores all but light; use float");
    if (why) {
        report.precision = Precision::full;
        report.warnings.push_back(path + ": " + *why + "; full precision was written instead");
    } else if (wanted == Precision::rgb9e5 && has_negative_mean(volume())) {
        report.precision = Precision::half;
        report.warnings.push_back(path
                                  + ": sh_l0 has values below 0, which rgb9e5 has not; half "
                                    "precision was written instead");
    }
    return report.precision;
}

const char* name_of(Precision precision) {
    switch (precision) {
    case Precision::full:
        return "float";
    case Precision::half:
        return "half";
    case Precision::rgb9e5:
        return "rgb9e5";
    case Precision::unorm8:
        return "unorm8";
    case Precision::bc6h:
        break;
    }
    return "bc6h";
}

void decode(const volume::Encoding& encoding, const std::string& path, Volume& stored) {
    if (stored.sh_order > volume::highest_order(encoding.convention))
        throw Error(ErrorKind::invalid, path + ": order " + std::to_string(stored.sh_order)
                                            + " cannot be of the convention "
                                            + volume::name_of(encoding.convention));
    volume::decode(encoding.convention, stored.sh_order, stored.sh);
    volume::turn_axes(glm::transpose(volume::from_gltf(encoding.axes)), stored);
}

} // namespace lpvbake::io
