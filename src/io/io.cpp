#include "io/io.h"

#include "error.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

namespace lpvbake {
namespace {

std::string lower_extension(const std::string& path) {
    std::string extension = std::filesystem::path(path).extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return char(std::tolower(c)); });
    return extension;
}

VolumeFormat required_format(const std::string& path) {
    if (const auto format = volume_format(path))
        return *format;
    throw Error(ExitCode::usage, path + ": unknown kind of volume file; use .vdb or .exr");
}

} // namespace

std::optional<VolumeFormat> volume_format(const std::string& path) {
    const std::string extension = lower_extension(path);
    if (extension == ".vdb")
        return VolumeFormat::vdb;
    if (extension == ".exr")
        return VolumeFormat::exr;
    return {};
}

WriteReport write_volume(const std::string& path, const Volume& volume, Precision precision,
                         const Pictures& pictures, const Encoding& encoding) {
    return required_format(path) == VolumeFormat::vdb
               ? write_vdb(path, volume, precision, encoding)
               : write_exr(path, volume, precision, pictures, encoding);
}

Volume read_volume(const std::string& path) {
    if (lower_extension(path) == ".json") // of a flipbook
        return read_exr(path);
    return required_format(path) == VolumeFormat::vdb ? read_vdb(path) : read_exr(path);
}

} // namespace lpvbake
