#include "io/io.h"

#include "io/dds.h"
#include "io/exr.h"
#include "io/glb.h"
#include "io/ktx2.h"
#include "io/layout.h"
#include "io/levels.h"
#include "io/nvdb.h"
#include "io/tres.h"
#include "io/vdb.h"
#include "lpvbake/error.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <vector>

namespace lpvbake::io {
namespace {

constexpr const VolumeFormat* formats_known[] = {
    &vdb_format, &nvdb_format, &exr_format, &ktx2_format, &dds_format, &glb_format, &tres_format};

std::string lower(std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return char(std::tolower(c)); });
    return text;
}

const VolumeFormat& required(const VolumeFormat* format, const std::string& path,
                             VolumeFormats formats) {
    if (format)
        return *format;
    throw Error(ErrorKind::argument,
                path + ": unknown kind of volume file; use " + format_list(" or ", false, formats));
}

} // namespace

VolumeFormats volume_formats() {
    return formats_known;
}

const VolumeFormat* volume_format(const std::string& path, VolumeFormats formats) {
    const auto found = std::ranges::find(formats, lower(std::filesystem::path(path).extension()),
                                         &VolumeFormat::extension);
    return found == formats.end() ? nullptr : *found;
}

const VolumeFormat* readable_format(const std::string& path, VolumeFormats formats) {
    if (const VolumeFormat* format = volume_format(path, formats))
        return format;
    // The longest end, as .dds.json is not .json.
    const std::string name = lower(std::filesystem::path(path).filename());
    const VolumeFormat* best = nullptr;
    for (const VolumeFormat* format : formats)
        if (const std::string_view sidecar = format->sidecar;
            !sidecar.empty() && name.size() > sidecar.size() && name.ends_with(sidecar)
            && (!best || sidecar.size() > std::string_view(best->sidecar).size()))
            best = format;
    return best;
}

std::string format_list(const char* last, bool sidecars, VolumeFormats formats) {
    std::vector<std::string> all;
    for (const VolumeFormat* format : formats)
        all.emplace_back(format->extension);
    for (const VolumeFormat* format : formats)
        if (sidecars && format->sidecar[0] != '\0')
            all.emplace_back(format->sidecar);
    std::string text;
    for (size_t i = 0; i < all.size(); ++i)
        text += (i == 0 ? "" : i + 1 < all.size() ? ", " : last) + all[i];
    return text;
}

void check_precision(const std::string& path, Precision precision, Packing packing,
                     VolumeFormats formats) {
    const VolumeFormat* format = volume_format(path, formats);
    if (!format)
        return;
    if (has_ratios(precision) && !format->has_ratios)
        throw Error(ErrorKind::argument,
                    path + ": " + name_of(precision) + " is for .ktx2 and .dds; use half");
    for (const auto& [own, by] :
         {std::pair{Precision::unorm8, Packing::ratio}, std::pair{Precision::bc6h, Packing::block}})
        if ((precision == own) != (packing == by))
            throw Error(ErrorKind::argument,
                        path
                            + (precision == own
                                   ? std::string(": `precision` ") + name_of(own) + " is packed by "
                                         + name_of(by) + " alone, not by " + name_of(packing)
                                         + ", as `packing` or the target wants it; use half"
                                   : std::string(": `packing` ") + name_of(by)
                                         + " is for `precision` " + name_of(own) + " alone"));
    if (precision != Precision::rgb9e5)
        return;
    if (!format->has_rgb9e5)
        throw Error(ErrorKind::argument, path + ": rgb9e5 is for .ktx2, .dds and .glb; use half");
    if (packing != Packing::band && packing != Packing::cube)
        throw Error(ErrorKind::argument,
                    path + ": rgb9e5 holds three colours without a sign, which packing by "
                        + name_of(packing) + " has nowhere; pack by band or cube, or use half");
}

WriteReport write_volume(const std::string& path, const Volume& volume, Precision precision,
                         const Pictures& pictures, const volume::Encoding& encoding,
                         VolumeFormats formats) {
    const VolumeFormat& format = required(volume_format(path, formats), path, formats);
    check_precision(path, precision, pictures.packing, formats);
    return format.write(path, Stored(volume, encoding, path), precision, pictures);
}

WriteReport write_volume(const std::string& path, Volume&& volume, Precision precision,
                         const Pictures& pictures, const volume::Encoding& encoding,
                         VolumeFormats formats) {
    const VolumeFormat& format = required(volume_format(path, formats), path, formats);
    check_precision(path, precision, pictures.packing, formats);
    return format.write(path, Stored(std::move(volume), encoding, path), precision, pictures);
}

void scale_band_one(double factor, Volume& volume) {
    for (size_t k = 1; k < std::min<size_t>(4, volume.sh.size()); ++k)
        for (glm::vec3& c : volume.sh[k])
            c = glm::vec3(factor * glm::dvec3(c));
}

Volume read_volume(const std::string& path, volume::GridKinds kinds, VolumeFormats formats) {
    if (is_manifest(path))
        throw Error(ErrorKind::unsupported,
                    path
                        + ": lists several volumes, where one is wanted; give the file of one, or "
                          "flatten nested levels with lpvbake convert");
    Volume volume = required(readable_format(path, formats), path, formats).read(path, kinds);
    if (const auto scale = volume.metadata.find("l1_scale"); scale != volume.metadata.end()) {
        const double factor = std::strtod(scale->second.c_str(), nullptr);
        if (!(factor >= least_l1_scale && factor <= most_l1_scale))
            throw Error(ErrorKind::invalid,
                        path + ": l1_scale is '" + scale->second + "', not a factor");
        scale_band_one(1 / factor, volume);
        check_volume(volume, path, ErrorKind::invalid);
    }
    return volume;
}

} // namespace lpvbake::io

namespace lpvbake {

Volume read_volume(const std::string& path) {
    return io::read_volume(path, volume::grid_kinds());
}

} // namespace lpvbake
