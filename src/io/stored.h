// A volume with the values that a file gets.
#pragma once

#include "lpvbake/file.h"
#include "volume/convention.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::io {

/// "float", "half", "rgb9e5", "unorm8" or "bc6h".
const char* name_of(Precision precision);

/// Whether light is stored over its mean.
constexpr bool has_ratios(Precision precision) {
    return precision == Precision::unorm8 || precision == Precision::bc6h;
}

/// A volume as a file of an encoding stores it. One that is given up is changed in place, with the
/// memory of two more grids at most; of any other a copy is made, but only where values change.
class Stored {
public:
    /// Throws Error that names `path`: failure (a grid does not fit or a value is not finite);
    /// unsupported (the convention has no form for the order). `canonical` outlives this.
    Stored(const Volume& canonical, const volume::Encoding& encoding, const std::string& path);
    Stored(Volume&& canonical, const volume::Encoding& encoding, const std::string& path);

    const Volume& volume() const { return own_ ? *own_ : *shared_; }
    const volume::Encoding& encoding() const { return encoding_; }
    /// For viewers: luminance of each cell's mean over all directions, nits, whatever the
    /// convention.
    const std::vector<float>& density() const { return density_; }
    /// What it can be stored in: full where half would not fit, half where light has a sign, with a
    /// warning that names `path`. Throws Error (unsupported) where ratios have no other.
    Precision precision(Precision wanted, const std::string& path, WriteReport& report) const;

private:
    void encode_own();

    volume::Encoding encoding_;
    const Volume* shared_ = nullptr;
    std::optional<Volume> own_;
    std::vector<float> density_;
};

/// Turns what a file of the encoding stores into a canonical volume, in place. Throws Error
/// (invalid) that names `path`.
void decode(const volume::Encoding& encoding, const std::string& path, Volume& stored);

} // namespace lpvbake::io
