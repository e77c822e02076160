// Option files, in TOML.
#pragma once

#include <string>
#include <vector>

namespace lpvbake::cmd::options {

/// A line `key = value`: an option's name and what it was given.
struct ConfigEntry {
    std::string key;
    /// One, or an array's; booleans are "true" and "false". An array in the array is one value, as
    /// the command line has it: [[1, 2, [0.5, 1, 1]]] is "1,2,0.5:1:1".
    std::vector<std::string> values;
    std::string whole;       ///< the same if all of it is one value: [1, 2] is "1,2"
    bool is_numbers = false; ///< an array that begins with a number
    int line = 0;
};

/// A table of an option file.
struct ConfigTable {
    std::string name; ///< empty: what stands before the first header
    std::vector<ConfigEntry> entries;
    int line = 0;
};

/// Reads `key = value`, values being strings, numbers, booleans and arrays of them, before the
/// first header and in tables. Entries are in the order of the file. Throws Error (file: cannot be
/// read or above 1 MiB; argument: names file, line and key).
std::vector<ConfigTable> read_config(const std::string& path);
/// The same of a text; `name` stands for the file.
std::vector<ConfigTable> parse_config(std::string text, const std::string& name);

/// Reads the arrays of tables [[name]] of such a file: one list of entries a header, in order. What
/// stands before the first header is a table of its own. Throws as read_config does.
std::vector<std::vector<ConfigEntry>> read_config_tables(const std::string& path,
                                                         const std::string& name);

/// A string as TOML writes it, quotes included.
std::string toml_string(const std::string& text);
/// An option's value: an array of numbers that commas part, of which the last may
/// be a colour; else a string.
std::string toml_value(const std::string& text);
std::string toml_array(const std::vector<std::string>& values);

} // namespace lpvbake::cmd::options
