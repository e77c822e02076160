#include "scene/gltf/folder.h"

#include "file_error.h"
#include "quoted.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

#include <unistd.h>

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

char lower(char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// True if the text starts so, but for the case of ASCII letters.
bool starts_with_letters(std::string_view text, std::string_view start) {
    return text.size() >= start.size()
           && std::equal(start.begin(), start.end(), text.begin(),
                         [](char a, char b) { return lower(a) == lower(b); });
}

bool lies_below(const fs::path& folder, const fs::path& file) {
    auto part = file.begin();
    for (const fs::path& step : folder)
        if (part == file.end() || *part++ != step)
            return false;
    return true;
}

/// The path below `base` that is `path` but for the case of letters; empty if there is none.
fs::path with_other_case(const fs::path& base, const fs::path& path) {
    fs::path found;
    for (const fs::path& part : path) {
        std::error_code error;
        fs::path next;
        if (fs::exists(base / found / part, error))
            next = part;
        for (fs::directory_iterator entry(base / found, error), end;
             next.empty() && !error && entry != end; entry.increment(error)) {
            const std::string name = entry->path().filename().string();
            if (name.size() == part.native().size() && starts_with_letters(name, part.native()))
                next = name;
        }
        if (next.empty())
            return {};
        found /= next;
    }
    return found;
}

/// The file below `base` that a URI without a file may mean: without its query or fragment, in
/// other letters. Empty if there is none.
std::string similar_file(const fs::path& base, const std::string& name) {
    for (const std::string& each : {name, name.substr(0, name.find_first_of("?#"))}) {
        const fs::path relative = fs::path(each).lexically_normal();
        if (relative.empty() || relative.is_absolute() || *relative.begin() == "..")
            continue;
        const fs::path found = with_other_case(base, relative);
        std::error_code error;
        const fs::path file = fs::canonical(base / found, error);
        if (!found.empty() && !error && lies_below(base, file) && fs::is_regular_file(file, error))
            return found.string();
    }
    return {};
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
        throw Error(kind_of_file_error(error.value()),
                    place + ": cannot be read: " + error.message());
    return size;
}

std::vector<unsigned char> read_file(const fs::path& path, const std::string& place,
                                     uint64_t most) {
    const uint64_t size = std::min(file_size(path, place), most);
    std::ifstream file(path, std::ios::binary);
    if (!file)
        throw Error(kind_of_file_error(errno),
                    place + ": cannot be opened: " + std::strerror(errno));
    std::vector<unsigned char> bytes(size);
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
    if (static_cast<uint64_t>(file.gcount()) != size)
        throw Error(ErrorKind::io, place + ": cannot be read to its end");
    return bytes;
}

std::vector<unsigned char> read_standard_input(MemoryLimit& memory) {
    constexpr size_t step = 1 << 20;
    std::vector<unsigned char> bytes;
    for (;;) {
        const size_t size = bytes.size();
        bytes.resize(size + step);
        const ssize_t count = read(STDIN_FILENO, bytes.data() + size, step);
        if (count < 0)
            throw Error(kind_of_file_error(errno),
                        std::string("standard input: cannot be read: ") + std::strerror(errno));
        memory.take(static_cast<uint64_t>(count), 1, "the file");
        bytes.resize(size + static_cast<size_t>(count));
        if (count == 0)
            return bytes;
    }
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
    const auto text = [&](const char* why, const char* remedy) {
        return place + ": " + in_quotes(uri) + " " + why + "; " + remedy;
    };
    constexpr const char* stay_inside =
        "files have to lie in the scene's folder unless `allow_external` is given";
    const auto refuse_unless_allowed = [&](bool leads_out, const char* why) {
        if (leads_out && !allow_external)
            throw LeadsOut(ErrorKind::invalid, text(why, stay_inside));
    };
    if (name.empty() || name.find('\0') != std::string::npos)
        throw Error(ErrorKind::invalid,
                    text("is not a file name", "repair the file or export it again"));
    if (has_scheme(uri))
        throw Error(ErrorKind::invalid,
                    text("is not a relative path", "files have to lie in the scene's folder"));
    refuse_unless_allowed(name.front() == '/' || name.front() == '\\', "is an absolute path");
    std::error_code error;
    const fs::path base = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
    if (error)
        throw Error(kind_of_file_error(error.value()),
                    place + ": the scene's folder cannot be read");
    std::string with_slashes = name;
    std::replace(with_slashes.begin(), with_slashes.end(), '\\', '/');
    for (const std::string& each : {name, with_slashes}) {
        const fs::path given(each), relative = allow_external ? given : given.lexically_normal();
        refuse_unless_allowed(!relative.empty() && *relative.begin() == "..",
                              "leads out through \"..\"");
        const fs::path file = fs::canonical(base / relative, error);
        if (error)
            continue;
        refuse_unless_allowed(!lies_below(base, file), "is a link that leads out");
        return file;
    }
    std::string similar = similar_file(base, with_slashes);
    if (!similar.empty())
        similar = "; there is " + in_quotes(similar) + ": rename it, or correct the URI";
    throw Error(ErrorKind::file,
                place + ": " + in_quotes(name) + ": there is no such file" + similar);
}

bool is_data_uri(std::string_view uri) {
    return starts_with_letters(uri, "data:");
}

std::vector<unsigned char> decode_data_uri(std::string_view uri, const std::string& place) {
    const auto refuse = [&](const char* why) { throw Error(ErrorKind::invalid, place + why); };
    const size_t comma = uri.find(',');
    if (comma == std::string_view::npos)
        refuse(": the data URI has no comma, after which its data stand");
    constexpr std::string_view base64 = ";base64";
    std::string_view type = uri.substr(0, comma);
    while (type.ends_with(' '))
        type.remove_suffix(1);
    std::string_view data = uri.substr(comma + 1);
    const std::string decoded =
        data.find('%') == std::string_view::npos ? std::string() : percent_decoded(data);
    if (!decoded.empty())
        data = decoded;
    if (type.size() < base64.size()
        || !starts_with_letters(type.substr(type.size() - base64.size()), base64))
        return {data.begin(), data.end()};
    static const std::array<int8_t, 256> values = [] {
        std::array<int8_t, 256> table;
        table.fill(-1);
        const std::string_view digits =
            "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        for (size_t i = 0; i < digits.size(); ++i)
            table[static_cast<unsigned char>(digits[i])] = static_cast<int8_t>(i);
        return table;
    }();
    constexpr std::string_view spaces = " \t\r\n\f\v";
    const size_t end = data.find_last_not_of("= \t\r\n\f\v") + 1;
    std::vector<unsigned char> bytes;
    bytes.reserve(data.size() * 3 / 4);
    uint32_t bits = 0;
    int count = 0;
    for (const char c : data.substr(0, end)) {
        const int value = values[static_cast<unsigned char>(c)];
        if (value < 0) {
            if (spaces.find(c) == std::string_view::npos)
                refuse(": the data URI is not base64");
            continue;
        }
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
