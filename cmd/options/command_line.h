// From the words of a command line, and an option file, to a command with its options set.
#pragma once

#include "options/option.h"

#include <functional>
#include <string>
#include <vector>

namespace lpvbake::cmd::options {

/// What a command line asks for. Throws Error.
using Action = std::function<void()>;

struct Command {
    std::string name;
    const char* summary;
    const char* manual; ///< what --help says below the options
    /// Declares the options; the action sees what they were given, and keeps their fields.
    Action (*declare)(Options& options);
};
using Commands = std::vector<Command>;

/// What is known of a command line, for those who tell of its failure.
struct Asked {
    std::string command;             ///< empty: none
    bool json = false;               ///< the result's form, as far as it was read
    std::vector<std::string> values; ///< that options were given, files among them
};

/// Runs `lpvbake WORDS`, and notes in `asked` what it learns of them; with an option "config" the
/// command takes option files, with a flag "print-config" it prints one instead. Throws Error
/// (argument: what is wrong with the words, and what to do; what read_options throws), and whatever
/// the command throws.
void run_command_line(const Commands& commands, const std::vector<std::string>& words,
                      Asked& asked);
inline void run_command_line(const Commands& commands, const std::vector<std::string>& words) {
    Asked asked;
    run_command_line(commands, words, asked);
}

/// Sets options by the words of a command line of a command that has them, without --config. Throws
/// Error (argument).
void take_words(const std::string& command, const std::vector<std::string>& words,
                Options& options);

} // namespace lpvbake::cmd::options
