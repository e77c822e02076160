// lpvbake help: the written reference of the command line, made from the tables of options.

#include "commands.h"
#include "lpvbake/error.h"
#include "options/completion.h"
#include "options/file.h"
#include "options/help_text.h"
#include "options/man.h"
#include "options/reference.h"
#include "result.h"

#include <cstdio>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/help.txt.h"
    ;

enum class HelpFormat { text, markdown, json, man, bash, zsh, fish };

struct HelpOptions {
    std::string command;
    HelpFormat format = HelpFormat::text;
};

const char documents_of_all[] = "json";

void print_documents(const options::Commands& commands) {
    for (const options::Command& command : commands)
        if (const std::string text = options::documents_of(command); !text.empty())
            std::printf("%slpvbake %s\n\n%s", &command == &commands.front() ? "" : "\n",
                        command.name.c_str(), text.c_str());
}

void print_text(const options::Commands& commands, const std::string& command) {
    if (command == documents_of_all)
        print_documents(commands);
    else if (command.empty())
        options::run_command_line(commands, {"--help"});
    else
        options::run_command_line(commands, {command, "--help"});
}

/// For other programs that help: man, and shells, which need all commands.
std::string script_of(const HelpOptions& o, const options::Commands& commands) {
    if (o.format == HelpFormat::man)
        return o.command.empty() ? options::man_page(commands)
                                 : options::man_page(commands.front());
    return o.format == HelpFormat::bash  ? options::bash_completion(commands)
           : o.format == HelpFormat::zsh ? options::zsh_completion(commands)
                                         : options::fish_completion(commands);
}

void run(const HelpOptions& o) {
    options::Commands commands = all_commands();
    if (!o.command.empty() && o.command != documents_of_all)
        std::erase_if(commands,
                      [&](const options::Command& each) { return each.name != o.command; });
    if (commands.empty()) {
        std::vector<std::string> names{documents_of_all};
        for (const options::Command& each : all_commands())
            names.push_back(each.name);
        throw Error(ErrorKind::argument, "help: there is no command '" + o.command + "'"
                                             + options::did_you_mean(o.command, names));
    }
    if (o.format == HelpFormat::text) {
        print_text(commands, o.command);
    } else if (o.format >= HelpFormat::man) {
        std::fputs(script_of(o, commands).c_str(), stdout);
    } else if (o.format == HelpFormat::json) {
        report::Json document{
            {"command", "help"}, {"version", LPVBAKE_VERSION}, {"commands", report::Json::array()}};
        for (const options::Command& command : commands)
            document["commands"].push_back(options::reference_json(command));
        print_json(document);
    } else {
        std::printf(
            "# The command line\n\nEvery command with its options, as `lpvbake help --format "
            "markdown` prints them;\n`lpvbake help --format json` has the same for "
            "programs.\n\nTo add an option, add a row where its command declares them (`declare` "
            "in `cmd/NAME.cpp`; what\nseveral have is in `cmd/scene_options.cpp`), and run the "
            "command above into this file. A parameter of a\nsolver is a row of its kind "
            "([src/solver](../src/solver/README.md)). The command line, `--config`,\n"
            "`--print-config`, the settings in volumes' metadata, sweeps and commands of reports, "
            "`--help` and this page\nfollow from the row.\n");
        for (const options::Command& command : commands)
            std::printf("\n%s", options::reference_markdown(command).c_str());
    }
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<HelpOptions>();
    options.text("command", fields->command, "COMMAND|json",
                 "Of one command alone; json: the documents of --format json; default: of all");
    options.choice("--format", fields->format,
                   options::Choices<HelpFormat>{{"text", HelpFormat::text},
                                                {"markdown", HelpFormat::markdown},
                                                {"json", HelpFormat::json},
                                                {"man", HelpFormat::man},
                                                {"bash", HelpFormat::bash},
                                                {"zsh", HelpFormat::zsh},
                                                {"fish", HelpFormat::fish}},
                   "Form of the reference; man: a manual page; bash, zsh, fish: what the shell "
                   "completes by");
    return [fields] { run(*fields); };
}

} // namespace

options::Command help_command() {
    return {"help", "Explains commands and options, for people and for programs.", manual, declare};
}

} // namespace lpvbake::cmd
