#include "scene/gltf/folder.h"

#include "lpvbake/error.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>

namespace lpvbake::scene::gltf {
namespace {

namespace fs = std::filesystem;

int hex_digit(char c) {
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    if (c >= 'A' && c <= 'F')
        return c - 'A' + 10;
    return -1;
}

/// True for "http:...", "C:...", and the like: a colon before any slash.
bool has_scheme(std::string_view uri) {
    const size_t colon = uri.find(':');
    return colon != std::string_view::npos && uri.find('/') > colon;
}

bool lies_below(const fs::path& folder, const fs::path& file) {
    auto part = file.begin();
    for (const fs::path& step : folder)
        if (part == file.end() || *part++ != step)
            return false;
    return true;
}

} // namespace

uint64_t file_size(const fs::path& path, const std::string& place) {
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (!fs::exists(status))
        throw Error(ErrorKind::file, place + ": there is no such file");
    if (!fs::is_regular_file(status))
        throw Error(ErrorKind::file, place + ": is not a file");
    const uintmax_t size = fs::file_size(path, error);
    if (error)
        throw Error(ErrorKind::file, place + ": cannot be read: " + error.message());
    return size;
}

std::vector<unsigned char> read_file(const fs::path& path, const std::string& place,
                                     uint64_t most) {
    const uint64_t size = std::min(file_size(path, place), most);
    std::ifstream file(path, std::ios::binary);
    if (!file)
        throw Error(ErrorKind::file, place + ": cannot be opened: " + std::strerror(errno));
    std::vector<unsigned char> bytes(size);
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
    if (static_cast<uint64_t>(file.gcount()) != size)
        throw Error(ErrorKind::file, place + ": cannot be read to its end");
    return bytes;
}

std::string percent_decoded(std::string_view uri) {
    std::string result;
    for (size_t i = 0; i < uri.size(); ++i) {
        if (uri[i] == '%' && i + 2 < uri.size() && hex_digit(uri[i + 1]) >= 0
            && hex_digit(uri[i + 2]) >= 0) {
            result += static_cast<char>(16 * hex_digit(uri[i + 1]) + hex_digit(uri[i + 2]));
            i += 2;
        } else {
            result += uri[i];
        }
    }
    return result;
}

fs::path resolve_uri(const fs::path& folder, std::string_view uri, const std::string& place,
                     bool allow_external) {
    const std::string name = percent_decoded(uri);
    const auto refuse = [&](const std::string& why, const char* remedy) {
        throw Error(ErrorKind::invalid,
                    place + ": \"" + std::string(uri) + "\" " + why + "; " + remedy);
    };
    constexpr const char* stay_inside =
        "files have to lie in the scene's folder unless `allow_external` is given";
    if (name.empty() || name.find('\0') != std::string::npos)
        refuse("is not a file name", "repair the file or export it again");
    if (has_scheme(uri))
        refuse("is not a relative path", "files have to lie in the scene's folder");
    const fs::path relative(name);
    if (!allow_external) {
        if (name.front() == '/' || name.front() == '\\')
            refuse("is an absolute path", stay_inside);
        for (const fs::path& part : relative)
            if (part == "..")
                refuse("leads out through \"..\"", stay_inside);
    }
    std::error_code error;
    const fs::path base = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
    if (error)
        throw Error(ErrorKind::file, place + ": the scene's folder cannot be read");
    const fs::path file = fs::canonical(base / relative, error);
    if (error)
        throw Error(ErrorKind::file, place + ": \"" + name + "\": there is no such file");
    if (!allow_external && !lies_below(base, file))
        refuse("is a link that leads out", stay_inside);
    return file;
}

std::vector<unsigned char> decode_data_uri(std::string_view uri, const std::string& place) {
    const auto refuse = [&](const char* why) { throw Error(ErrorKind::invalid, place + why); };
    const size_t comma = uri.find(',');
    if (comma == std::string_view::npos || !uri.substr(0, comma).ends_with(";base64"))
        refuse(": only base64 data URIs are understood");
    uri.remove_prefix(comma + 1);
    while (uri.ends_with('='))
        uri.remove_suffix(1);
    static const std::array<int8_t, 256> values = [] {
        std::array<int8_t, 256> table;
        table.fill(-1);
        const std::string_view digits =
            "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        for (size_t i = 0; i < digits.size(); ++i)
            table[static_cast<unsigned char>(digits[i])] = static_cast<int8_t>(i);
        return table;
    }();
    std::vector<unsigned char> bytes;
    bytes.reserve(uri.size() * 3 / 4);
    uint32_t bits = 0;
    int count = 0;
    for (const char c : uri) {
        const int value = values[static_cast<unsigned char>(c)];
        if (value < 0)
            refuse(": the data URI is not base64");
        bits = bits << 6 | static_cast<uint32_t>(value);
        count += 6;
        if (count >= 8) {
            count -= 8;
            bytes.push_back(static_cast<unsigned char>(bits >> count));
        }
    }
    return bytes;
}

} // namespace lpvbake::scene::gltf
