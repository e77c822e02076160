#include "options/file.h"

#include "lpvbake/error.h"
#include "options/toml.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace lpvbake::cmd::options {
namespace {

/// Letters to insert, to leave out or to replace between two words.
std::size_t distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i + 1);
        for (std::size_t j = 0; j < b.size(); ++j)
            diagonal = std::exchange(
                row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, diagonal + (a[i] != b[j])}));
    }
    return row.back();
}

} // namespace

std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix) {
    std::size_t least = 1 + std::max<std::size_t>(1, word.size() / 3);
    std::string nearest;
    for (const std::string& each : known)
        if (const std::size_t far =
                word.size() > 2 && each.starts_with(word) ? 1 : distance(word, each);
            far < least) {
            least = far;
            nearest = each;
        }
    return nearest.empty() ? "" : "; did you mean " + prefix + nearest + "?";
}

void read_options(const std::string& path, const std::string& command, Options& options) {
    std::vector<std::string> kept; // by what the command line gave
    std::vector<std::string> names;
    for (const Option& row : options.rows()) {
        names.push_back(row.name());
        if (row.given.empty())
            continue;
        kept.push_back(row.name());
        kept.insert(kept.end(), row.excludes.begin(), row.excludes.end());
        for (const Option& other : options.rows())
            if (std::ranges::count(other.excludes, row.name()) > 0)
                kept.push_back(other.name());
    }
    for (const ConfigEntry& entry : read_config(path, command)) {
        const std::string place = path + ":" + std::to_string(entry.line) + ": ";
        Option* row = options.find(entry.key);
        if (!row)
            throw Error(ErrorKind::argument, place + "'" + entry.key + "' is not an option of "
                                                 + command + did_you_mean(entry.key, names));
        if (!row->in_files)
            throw Error(ErrorKind::argument,
                        place + "'" + entry.key + "' belongs on the command line, not into a file");
        if (entry.values.size() != 1 && !row->many)
            throw Error(ErrorKind::argument, place + entry.key + " takes one value");
        if (std::ranges::count(kept, entry.key) > 0)
            continue;
        for (const std::string& value : entry.values)
            if (!value.empty() || !row->usual.empty() || row->implied) // else as good as not given
                try {
                    row->take(value);
                } catch (const Error& error) {
                    throw Error(error.kind, place + error.what());
                }
    }
}

} // namespace lpvbake::cmd::options
