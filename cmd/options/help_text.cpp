#include "options/help_text.h"

#include "exit_code.h"
#include "options/wrapped.h"

#include <algorithm>
#include <cstdio>
#include <sstream>

#include <sys/ioctl.h>
#include <unistd.h>

namespace lpvbake::cmd::options {
namespace {

/// The parts of a manual, in its order.
struct Manual {
    std::string examples, text, documents;
};

Manual parts_of(const Command& command) {
    const std::string all = std::string("\n") + command.manual + "\n";
    const std::size_t text = all.find("\n\n"), documents = std::min(all.find("\nJSON"), all.size());
    if (text >= documents)
        return {all.substr(1, documents - 1), "", all.substr(std::min(documents + 1, all.size()))};
    return {all.substr(1, text), all.substr(text + 2, documents - text - 2),
            all.substr(std::min(documents + 1, all.size()))};
}

/// Lines flow into each other, but for those that spaces indent.
std::string reflowed(const std::string& text, std::size_t width) {
    std::string lines, flow;
    const auto end_flow = [&] {
        if (!flow.empty())
            lines.append(wrapped(flow, width)).append("\n");
        flow.clear();
    };
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
        if (!line.empty() && line[0] != ' ') {
            flow.append(flow.empty() ? "" : " ").append(line);
            continue;
        }
        end_flow();
        const std::size_t indent = std::min(line.find_first_not_of(' '), line.size());
        const std::string spaces(indent, ' ');
        lines
            .append(line.size() <= width
                        ? line
                        : spaces + wrapped(line.substr(indent), width - indent, spaces))
            .append("\n");
    }
    end_flow();
    return lines;
}

/// Names, type and default, then, from a column on, the help.
std::string row_text(const Option& option, std::size_t width) {
    constexpr std::size_t column = 30;
    const std::string indent(column, ' ');
    std::string line = "  " + option.names;
    std::replace(line.begin(), line.end(), ',', ' ');
    if (!option.is_flag())
        line.append(" ").append(option.type);
    if (!option.is_flag() && !option.usual.empty() && !option.implied)
        line.append("=").append(option.usual);
    // The names of a choice that are too many for a line.
    for (std::size_t from = 0, bar = 0; line.size() - from > width; from = bar + 2) {
        bar = line.rfind('|', from + width - 1);
        if (bar == std::string::npos || bar <= from)
            break;
        line.insert(bar + 1, "\n      ");
    }
    if (line.size() + 2 > column)
        line.append("\n").append(indent);
    else
        line.append(column - line.size(), ' ');
    return line.append(wrapped(option.help, width - column, indent)).append("\n");
}

} // namespace

std::size_t help_width() {
    constexpr std::size_t most = 100, least = 60;
    winsize window = {};
    if (isatty(STDOUT_FILENO) == 0 || ioctl(STDOUT_FILENO, TIOCGWINSZ, &window) != 0
        || window.ws_col == 0)
        return most;
    return std::clamp<std::size_t>(window.ws_col, least, most);
}

std::string overview_text(const Commands& commands, std::size_t width) {
    std::string text =
        reflowed("Bakes the indirect light of a glTF scene into a grid of spherical "
                 "harmonics, on Vulkan.\n\n"
                 "Results go to standard output, everything else to standard error.\n",
                 width);
    text += "\nUsage: lpvbake COMMAND ...\n\n";
    for (const Command& command : commands) {
        char name[16];
        std::snprintf(name, sizeof name, "  %-11s", command.name.c_str());
        text.append(name).append(wrapped(command.summary, width - 13, std::string(13, ' ')));
        text += '\n';
    }
    text +=
        "\nlpvbake help COMMAND, or COMMAND --help, explains a command, lpvbake help json what is "
        "printed\nas JSON; -V, --version is the version.\n\n"
        "Exit codes, and whether the same command may do another time:\n";
    for (const ExitCodeMeaning& row : exit_codes) {
        char code[32];
        const char* retry = row.error ? retry_names[std::size_t(row.retry)] : "";
        std::snprintf(code, sizeof code, "  %3d  %-16s  ", int(row.code), retry);
        text.append(code).append(wrapped(row.meaning, width - 25, std::string(25, ' '))) += '\n';
    }
    return text;
}

std::string help_text(const Command& command, const Options& options, std::size_t width) {
    const Manual manual = parts_of(command);
    std::string usage = "lpvbake " + command.name;
    for (const Option& option : options.rows())
        if (option.is_positional())
            usage.append(" ").append(option.required ? option.type : "[" + option.type + "]");
    std::string text = wrapped(command.summary, width) + "\n\nUsage: " + usage + " [OPTIONS]\n\n";
    text += manual.examples;
    std::string group;
    for (const Option* option : options.listed()) {
        if (option->group != group)
            text.append("\n").append(option->group).append(":\n");
        group = option->group;
        text += row_text(*option, width);
    }
    text.append("\n").append(reflowed(manual.text, width));
    if (!manual.documents.empty())
        text += "\nlpvbake help json has the documents of --format json.\n";
    return text;
}

std::string documents_of(const Command& command) {
    return parts_of(command).documents;
}

} // namespace lpvbake::cmd::options
