// Option files: the part of TOML that a command line needs.
#pragma once

#include <string>
#include <vector>

namespace lpvbake {

/// A line `key = value`: the option's long name and what it was given.
struct ConfigEntry {
    std::string key;
    std::vector<std::string> values; ///< one, or an array's; booleans are "true" and "false"
    int line = 0;
};

/// Reads `key = value` with strings ("..." with \" \\ \n \t, '...'), numbers, booleans, arrays of
/// them on one line or several, comments, and the table header [command]; another table is an
/// error. Throws Error (file: cannot be read or above 1 MiB; argument: names file and line).
std::vector<ConfigEntry> read_config(const std::string& path, const std::string& command);

/// Reads the arrays of tables [[name]] of such a file: one list of entries a header, in order. What
/// stands before the first header belongs to a table of its own. Throws as read_config does.
std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name);

/// A string as TOML writes it, quotes included.
std::string toml_string(const std::string& text);

/// The shortest decimal that reads back as the same double.
std::string toml_number(double value);
std::string toml_number(float value); ///< as the same float

} // namespace lpvbake
