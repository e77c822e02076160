#include "options/wrapped.h"

#include "options/values.h"

namespace lpvbake::cmd::options {

std::string wrapped(const std::string& text, std::size_t width, const std::string& indent) {
    std::string lines;
    std::size_t used = 0;
    for (const std::string& word : split(text, ' ')) {
        if (used > 0 && used + 1 + word.size() > width) {
            lines += '\n' + indent;
            used = 0;
        }
        lines += (used > 0 ? " " : "") + word;
        used += (used > 0) + word.size();
    }
    return lines;
}

} // namespace lpvbake::cmd::options
