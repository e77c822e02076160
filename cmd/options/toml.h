// Option files, in TOML.
#pragma once

#include <string>
#include <vector>

namespace lpvbake::cmd::options {

/// A line `key = value`: an option's name and what it was given.
struct ConfigEntry {
    std::string key;
    std::vector<std::string> values; ///< one, or an array's; booleans are "true" and "false"
    int line = 0;
};

/// Reads `key = value`, values being strings, numbers, booleans and arrays of them, also under the
/// header [command]; another table is an error. In the order of the file. Throws Error (file:
/// cannot be read or above 1 MiB; usage: names file, line and key).
std::vector<ConfigEntry> read_config(const std::string& path, const std::string& command);

/// Reads the arrays of tables [[name]] of such a file: one list of entries a header, in order. What
/// stands before the first header is a table of its own. Throws as read_config does.
std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name);

/// A string as TOML writes it, quotes included.
std::string toml_string(const std::string& text);
std::string toml_array(const std::vector<std::string>& values);

} // namespace lpvbake::cmd::options
