#include "options/file.h"

#include "lpvbake/error.h"
#include "options/toml.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace lpvbake::cmd::options {
namespace {

/// Letters to insert, to leave out, to replace or to swap with the next between two words.
std::size_t distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1), before, above;
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        before = std::exchange(above, row);
        row[0] = i + 1;
        for (std::size_t j = 0; j < b.size(); ++j) {
            row[j + 1] = std::min({row[j] + 1, above[j + 1] + 1, above[j] + (a[i] != b[j])});
            if (i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j])
                row[j + 1] = std::min(row[j + 1], before[j - 1] + 1);
        }
    }
    return row.back();
}

std::string place_of(const std::string& path, int line) {
    return path + ":" + std::to_string(line) + ": ";
}

/// What is given, and what that excludes.
std::set<std::string> settled_by(const Options& options) {
    std::set<std::string> settled;
    for (const Option& row : options.rows()) {
        const auto excludes = [&](const std::string& name) {
            const Option* other = options.find(name);
            return other && !other->given.empty();
        };
        if (!row.given.empty()) {
            settled.insert(row.name());
            settled.insert(row.excludes.begin(), row.excludes.end());
        } else if (std::ranges::any_of(row.excludes, excludes)) {
            settled.insert(row.name());
        }
    }
    return settled;
}

/// Throws Error (argument) unless the table is a command's, and its keys are options of that; of
/// the one before the headers, of any.
void check_table(const std::string& path, const ConfigTable& table, const std::string& command,
                 const CommandOptions& commands) {
    const std::string& whose = table.name.empty() ? command : table.name;
    std::vector<std::string> names;
    for (const auto& [name, options] : commands)
        names.push_back(name);
    if (!commands.contains(whose))
        throw Error(ErrorKind::argument, place_of(path, table.line) + "[" + whose
                                             + "] is no command" + did_you_mean(whose, names));
    for (const ConfigEntry& entry : table.entries) {
        const Option* row = commands.at(whose)->find(entry.key);
        if (!row && table.name.empty())
            for (const auto& [name, options] : commands)
                row = row ? row : options->find(entry.key);
        names.clear();
        for (const Option& each : commands.at(whose)->rows())
            names.push_back(each.name());
        if (!row)
            throw Error(ErrorKind::argument, place_of(path, entry.line) + "'" + entry.key
                                                 + "' is not an option of " + whose
                                                 + did_you_mean(entry.key, names));
        if (!row->in_files)
            throw Error(ErrorKind::argument,
                        place_of(path, entry.line) + "'" + entry.key
                            + "' belongs on the command line, not into a file");
    }
}

void take(const std::string& path, const ConfigEntry& entry, Option& row) {
    const bool apart = row.many && !entry.is_numbers;
    for (const std::string& value : apart ? entry.values : std::vector{entry.whole})
        if (!value.empty() || !row.usual.empty() || row.implied) // else as good as not given
            try {
                row.take(value);
            } catch (const Error& error) {
                throw Error(error.kind, place_of(path, entry.line) + error.what());
            }
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

void read_options(const std::vector<std::string>& paths, const std::string& command,
                  const CommandOptions& commands, Options& options) {
    std::set<std::string> settled = settled_by(options);
    for (auto path = paths.rbegin(); path != paths.rend(); ++path) {
        std::vector<ConfigTable> tables = read_config(*path);
        for (const ConfigTable& table : tables)
            check_table(*path, table, command, commands);
        std::ranges::reverse(tables); // the one before the headers comes last
        for (const ConfigTable& table : tables) {
            if (!table.name.empty() && table.name != command)
                continue;
            for (const ConfigEntry& entry : table.entries)
                if (Option* row = options.find(entry.key); row && !settled.contains(entry.key))
                    take(*path, entry, *row);
            for (const ConfigEntry& entry : table.entries)
                settled.insert(entry.key); // an empty array, too
            settled.merge(settled_by(options));
        }
    }
}

void read_recorded(const std::string& recorded, const std::string& place,
                   const std::set<std::string>& groups, Options& options) {
    std::string lines = recorded;
    bool quoted = false;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        quoted = quoted != (lines[i] == '"');
        i += quoted && lines[i] == '\\';
        if (!quoted && lines[i] == ';')
            lines[i] = '\n';
    }
    const std::set<std::string> settled = settled_by(options);
    try {
        const std::vector<ConfigTable> tables = parse_config(lines, place);
        for (const ConfigEntry& entry : tables.front().entries)
            if (Option* row = options.find(entry.key);
                row && groups.contains(row->group) && !settled.contains(entry.key))
                take(place, entry, *row);
    } catch (const Error& error) {
        throw Error(ErrorKind::invalid, error.what());
    }
}

} // namespace lpvbake::cmd::options
