#include "options/man.h"

#include "options/help_text.h"

namespace lpvbake::cmd::options {
namespace {

constexpr std::size_t columns = 78;

/// So that nothing is taken for a request, and a hyphen can be copied as a minus.
std::string escaped(const std::string& text) {
    std::string result;
    bool begins_line = true;
    for (const char c : text) {
        if (begins_line && (c == '.' || c == '\''))
            result += "\\&";
        if (c == '\\')
            result += "\\e";
        else if (c == '-')
            result += "\\-";
        else
            result += c;
        begins_line = c == '\n';
    }
    return result;
}

std::string head(const std::string& name, const std::string& summary) {
    return ".TH \"" + name + "\" 1 \"\" \"lpvbake " LPVBAKE_VERSION "\"\n.SH NAME\n" + escaped(name)
           + " \\- " + escaped(summary) + "\n";
}

/// As it is, line by line.
std::string verbatim(const std::string& title, const std::string& text) {
    return ".SH " + title + "\n.nf\n" + escaped(text) + "\n.fi\n";
}

} // namespace

std::string man_page(const Commands& commands) {
    std::string page = head("lpvbake", "bakes glTF scenes into light volumes")
                       + verbatim("DESCRIPTION", overview_text(commands, columns))
                       + ".SH SEE ALSO\n";
    for (const Command& command : commands)
        page.append(&command == &commands.front() ? "" : ",\n")
            .append(".BR lpvbake\\-" + escaped(command.name) + " (1)");
    return page + "\n";
}

std::string man_page(const Command& command) {
    Options options;
    const Action keeps_fields = command.declare(options);
    std::string page = head("lpvbake-" + command.name, command.summary)
                       + ".SH SYNOPSIS\n.B lpvbake " + escaped(command.name)
                       + "\n[\\fIOPTION\\fR]...";
    for (const Option& option : options.rows())
        if (option.is_positional())
            page += option.required ? " \\fI" + escaped(option.type) + "\\fR"
                                    : " [\\fI" + escaped(option.type) + "\\fR]";
    page += '\n';
    std::string group;
    for (const Option* listed : options.listed()) {
        const Option& option = *listed;
        if (option.group != group)
            page += ".SH " + escaped(option.group) + "\n";
        group = option.group;
        page += ".TP\n\\fB" + escaped(option.is_positional() ? option.type : option.names) + "\\fR";
        if (!option.is_flag() && !option.is_positional())
            page += " \\fI" + escaped(option.type) + "\\fR";
        page += '\n' + escaped(option.help);
        if (!option.usual.empty() && !option.implied && !option.is_flag())
            page += "; default: " + escaped(option.usual);
        page += '\n';
    }
    return page + verbatim("NOTES", command.manual) + ".SH SEE ALSO\n.BR lpvbake (1)\n";
}

} // namespace lpvbake::cmd::options
