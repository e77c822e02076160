// Text in lines.
#pragma once

#include <string>

namespace lpvbake::cmd::options {

/// The text in lines of at most `width` characters where it has spaces, all but the first behind
/// `indent`.
std::string wrapped(const std::string& text, std::size_t width, const std::string& indent = "");

} // namespace lpvbake::cmd::options
