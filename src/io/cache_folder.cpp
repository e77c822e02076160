#include "io/cache_folder.h"

#include "file_error.h"
#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "text.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <ostream>
#include <utility>

namespace lpvbake::io {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view ending = ".lpvcache";
constexpr std::string_view temporary = ".tmp";

struct Header {
    std::array<char, 8> magic{'L', 'P', 'V', 'C', 'A', 'C', 'H', 'E'};
    uint32_t form = 1;
    uint32_t key_bytes = 0;
    uint64_t value_bytes = 0;
    std::array<uint64_t, 2> hash{};
};
static_assert(sizeof(Header) == 40);

Header header_of(const std::string& key, std::string_view value) {
    Header header;
    header.key_bytes = uint32_t(key.size());
    header.value_bytes = value.size();
    const auto of_value = cache::hash_of(value);
    std::string all = key;
    all.append(reinterpret_cast<const char*>(&of_value), sizeof of_value);
    header.hash = cache::hash_of(all);
    return header;
}

/// Whether a file is what a bake wrote under this key.
bool is_whole(std::string_view file, const std::string& key) {
    if (file.size() < sizeof(Header) + key.size() || file.substr(sizeof(Header), key.size()) != key)
        return false;
    const Header wanted = header_of(key, file.substr(sizeof(Header) + key.size()));
    return std::memcmp(&wanted, file.data(), sizeof wanted) == 0;
}

} // namespace

CacheFolder::CacheFolder(std::string folder, uint64_t most_bytes)
    : folder_(std::move(folder)),
      most_bytes_(most_bytes) {
    std::error_code error;
    fs::create_directories(folder_, error);
    if (error && !fs::is_directory(folder_))
        throw Error(kind_of_file_error(error.value()),
                    folder_ + ": cannot be made: " + error.message());
    if (!fs::is_directory(folder_))
        throw Error(ErrorKind::file, folder_ + ": is not a folder");
    trim(); // what is there may be more
}

std::string CacheFolder::place_of(const std::string& key) const {
    const auto hash = cache::hash_of(key);
    return (fs::path(folder_)
            / (format("%016llx%016llx", static_cast<unsigned long long>(hash[1]),
                      static_cast<unsigned long long>(hash[0]))
               + std::string(ending)))
        .string();
}

std::optional<std::string> CacheFolder::load(const std::string& key) {
    const std::string path = place_of(key);
    std::error_code error;
    const fs::file_status status = fs::symlink_status(path, error);
    if (!fs::exists(status))
        return std::nullopt;
    if (fs::is_regular_file(status) && fs::file_size(path, error) > most_bytes_ && !error)
        return std::nullopt; // of a bake with a larger limit
    std::string file;
    try {
        file = read_file(path, most_bytes_);
    } catch (const Error&) {
        if (fs::exists(fs::symlink_status(path, error))) // another bake may have removed it
            note_damaged(path);
        return std::nullopt;
    }
    if (!is_whole(file, key)) {
        note_damaged(path);
        return std::nullopt;
    }
    fs::last_write_time(path, fs::file_time_type::clock::now(), error); // it was used
    file.erase(0, sizeof(Header) + key.size());
    return file;
}

void CacheFolder::store(const std::string& key, std::string_view value) {
    const Header header = header_of(key, value);
    if (!writes_)
        return;
    if (sizeof header + key.size() + value.size() > most_bytes_) {
        if (!std::exchange(told_too_large_, true))
            note(folder_
                 + format(": %.3g MB are more than the cache may hold; what is as large is "
                          "not kept",
                          double(value.size()) / 1e6));
        return;
    }
    const std::string path = place_of(key);
    try {
        std::error_code error;
        if (!fs::is_regular_file(fs::symlink_status(path, error)))
            fs::remove(path, error); // a link leads elsewhere
        AtomicFile file(path);
        file.write([&](std::ostream& out) {
            out.write(reinterpret_cast<const char*>(&header), sizeof header);
            out.write(key.data(), std::streamsize(key.size()));
            out.write(value.data(), std::streamsize(value.size()));
        });
        file.publish(); // what a power cut leaves of it is found by its hash
        trim();
    } catch (const Error& failure) {
        writes_ = false;
        note(std::string(failure.what()) + "; the cache keeps nothing more");
    }
}

/// Removes what was not used for the longest time, and what killed bakes left.
void CacheFolder::trim() {
    struct File {
        fs::file_time_type used;
        uint64_t bytes;
        fs::path path;
    };
    std::vector<File> files;
    uint64_t all = 0;
    std::error_code error;
    const auto now = fs::file_time_type::clock::now();
    for (const auto& entry : fs::directory_iterator(folder_, error)) {
        const std::string name = entry.path().filename().string();
        const bool is_temporary = name.starts_with('.') && name.ends_with(temporary)
                                  && name.find(ending) != std::string::npos;
        if (!(name.ends_with(ending) || is_temporary) || !entry.is_regular_file(error))
            continue;
        const File file{entry.last_write_time(error), entry.file_size(error), entry.path()};
        if (error)
            continue; // it is gone
        if (is_temporary) {
            if (now - file.used > std::chrono::hours(1))
                fs::remove(file.path, error);
            continue;
        }
        all += file.bytes;
        files.push_back(file);
    }
    std::ranges::sort(files, {}, &File::used);
    for (const File& file : files) {
        if (all <= most_bytes_)
            break;
        fs::remove(file.path, error);
        all -= file.bytes;
    }
}

} // namespace lpvbake::io
