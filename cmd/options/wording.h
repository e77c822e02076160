// Options in the words of the library.
#pragma once

#include <span>
#include <string>

namespace lpvbake::cmd::options {

/// What the library's texts say of a setting, and what the command line has for it.
struct Wording {
    const char* setting;
    const char* option;
};
std::span<const Wording> wordings();

/// A text of the library, in which settings stand as in "lower `resolution`", with options for
/// them: "lower --resolution". All other texts stay.
std::string in_options(std::string text);

} // namespace lpvbake::cmd::options
