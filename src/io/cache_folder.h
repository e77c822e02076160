// The cache of bakes as a folder of files, of which several bakes at a time may have the use.
#pragma once

#include "cache/cache.h"

namespace lpvbake::io {

/// A file is one value, "HASH.lpvcache" by the hash of its key: "LPVCACHE", the form (uint32_t 1),
/// the bytes of the key (uint32_t) and of the value (uint64_t), the hash of both together (16
/// bytes), the key, the value; numbers as the machine has them. A file appears whole or not at all;
/// one whose lengths, key or hash are not what they should be is made anew. Those that were not
/// used for the longest time are removed.
class CacheFolder final : public cache::Cache {
public:
    static constexpr uint64_t usual_bytes = uint64_t(2) << 30;

    /// Makes the folder where it is not there; its files have `most_bytes` together at most. Throws
    /// Error (file).
    CacheFolder(std::string folder, uint64_t most_bytes);

private:
    std::optional<std::string> load(const std::string& key) override;
    void store(const std::string& key, std::string_view value) override;
    std::string place_of(const std::string& key) const override;
    void trim();

    std::string folder_;
    uint64_t most_bytes_;
    bool told_too_large_ = false;
    bool writes_ = true; ///< until it fails
};

} // namespace lpvbake::io
