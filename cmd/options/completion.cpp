#include "options/completion.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace lpvbake::cmd::options {
namespace {

/// The values of a choice, as "a b c": what of "a|b|FILE" is no placeholder.
std::string values_of(const Option& option) {
    std::string values;
    for (const std::string& part : split(option.type, '|'))
        if (option.type.find('|') != std::string::npos
            && std::ranges::all_of(part, [](unsigned char c) {
                   return std::islower(c) || std::isdigit(c) || c == '-' || c == '_';
               }))
            values += (values.empty() ? "" : " ") + part;
    return values;
}

/// The first thing that is said of an option, in characters that no shell takes for its own.
std::string brief(const std::string& help) {
    std::string text = help.substr(0, help.find_first_of(";:,."));
    std::erase_if(text, [](char c) {
        return std::string_view("'\"`\\$[]()").find(c) != std::string_view::npos;
    });
    return text;
}

/// Declares the options of each command and calls visit(command, rows) with those that are none of
/// a place.
template <class Visit>
void for_each_command(const Commands& commands, const Visit& visit) {
    for (const Command& command : commands) {
        Options options;
        const Action keeps_fields = command.declare(options);
        std::vector<const Option*> rows;
        for (const Option* option : options.listed())
            if (!option->is_positional())
                rows.push_back(option);
        visit(command, rows);
    }
}

std::string names_of(const Commands& commands) {
    std::string names;
    for (const Command& command : commands)
        names += (names.empty() ? "" : " ") + command.name;
    return names;
}

} // namespace

std::string bash_completion(const Commands& commands) {
    std::string values, names;
    for_each_command(commands, [&](const Command& command, const std::vector<const Option*>& rows) {
        names += "    " + command.name + ") words=\"--help";
        for (const Option* option : rows) {
            for (const std::string& name : split(option->names, ',')) {
                names += " " + name;
                if (const std::string choices = values_of(*option); !choices.empty())
                    values +=
                        "    " + command.name + ":" + name + ") words=\"" + choices + "\" ;;\n";
            }
        }
        names += "\" ;;\n";
    });
    return "# bash completion of lpvbake, made by lpvbake help --format bash\n"
           "_lpvbake() {\n"
           "    local current=${COMP_WORDS[COMP_CWORD]} command=${COMP_WORDS[1]} words=\n"
           "    COMPREPLY=()\n"
           "    if ((COMP_CWORD == 1)); then\n"
           "        COMPREPLY=($(compgen -W \""
           + names_of(commands)
           + " --help --version\" -- \"$current\"))\n"
             "        return\n"
             "    fi\n"
             "    case $command:${COMP_WORDS[COMP_CWORD - 1]} in\n"
           + values
           + "    esac\n"
             "    if [[ -z $words && $current == -* ]]; then\n"
             "        case $command in\n"
           + names
           + "        esac\n"
             "    fi\n"
             "    if [[ -n $words ]]; then\n"
             "        COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
             "    else\n"
             "        compopt -o default\n"
             "    fi\n"
             "}\n"
             "complete -F _lpvbake lpvbake\n";
}

std::string zsh_completion(const Commands& commands) {
    std::string text = "#compdef lpvbake\n"
                       "# zsh completion of lpvbake, made by lpvbake help --format zsh\n"
                       "if ((CURRENT == 2)); then\n    local -a commands=(\n";
    for (const Command& command : commands)
        text += "        '" + command.name + ":" + brief(command.summary) + "'\n";
    text += "    )\n    _describe command commands\n    return\nfi\nshift "
            "words\n((CURRENT--))\ncase $words[1] in\n";
    for_each_command(commands, [&](const Command& command, const std::vector<const Option*>& rows) {
        text += command.name + ")\n    _arguments \\\n";
        for (const Option* option : rows)
            for (const std::string& name : split(option->names, ',')) {
                text += "        '";
                text += (option->many ? "*" : "") + name + "[" + brief(option->help) + "]";
                const std::string choices = values_of(*option);
                if (!choices.empty())
                    text += ":value:(" + choices + ")";
                else if (!option->is_flag())
                    text += ":value:_files";
                text += "' \\\n";
            }
        text += "        '--help[Help of this command]' '*:file:_files'\n    ;;\n";
    });
    return text + "esac\n";
}

std::string fish_completion(const Commands& commands) {
    std::string text = "# fish completion of lpvbake, made by lpvbake help --format fish\n";
    for (const Command& command : commands)
        text += "complete -c lpvbake -f -n __fish_use_subcommand -a " + command.name + " -d '"
                + brief(command.summary) + "'\n";
    for_each_command(commands, [&](const Command& command, const std::vector<const Option*>& rows) {
        const std::string start =
            "complete -c lpvbake -n '__fish_seen_subcommand_from " + command.name + "'";
        text += start + " -l help -d 'Help of this command'\n";
        for (const Option* option : rows) {
            text += start;
            for (const std::string& name : split(option->names, ','))
                text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
            const std::string choices = values_of(*option);
            if (!choices.empty())
                text += " -x -a '" + choices + "'";
            else if (!option->is_flag())
                text += " -r -F";
            text += " -d '" + brief(option->help) + "'\n";
        }
    });
    return text;
}

} // namespace lpvbake::cmd::options
