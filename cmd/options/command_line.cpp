#include "options/command_line.h"

#include "lpvbake/error.h"
#include "options/file.h"
#include "options/help_text.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstdio>

namespace lpvbake::cmd::options {
namespace {

// ---------------------------------------------------------------- what is wrong with the words

std::string unknown_option(const CLI::App& app, const std::string& argument) {
    const std::string name = argument.substr(0, argument.find('='));
    const std::size_t begin = std::min(name.find_first_not_of('-'), name.size());
    std::vector<std::string> known;
    for (const CLI::Option* option : app.get_options())
        known.insert(known.end(), option->get_lnames().begin(), option->get_lnames().end());
    return "unknown option " + name + did_you_mean(name.substr(begin), known, "--");
}

/// "lpvbake diff A B".
std::string usage_of(const CLI::App& app) {
    std::string text = "lpvbake " + app.get_name();
    for (const CLI::Option* option : app.get_options())
        if (option->get_positional())
            text += " " + option->get_name(true);
    return text;
}

std::string explain_in_command(const CLI::App& app, const CLI::ParseError& error) {
    if (error.get_exit_code() == int(CLI::ExitCodes::ExtrasError)) {
        const std::vector<std::string> extras = app.remaining();
        for (const std::string& extra : extras)
            if (extra.starts_with('-')) // values of it may follow
                return unknown_option(app, extra);
        if (!extras.empty())
            return "'" + extras.front() + "' is one argument too many: " + usage_of(app);
    }
    if (error.get_exit_code() == int(CLI::ExitCodes::RequiredError))
        for (const CLI::Option* option : app.get_options())
            if (option->get_required() && option->count() == 0)
                return option->get_name() + " is missing: " + usage_of(app);
    std::string text = error.what();
    if (error.get_exit_code() == int(CLI::ExitCodes::ArgumentMismatch)) {
        const std::string name = text.substr(0, text.find(':'));
        if (const CLI::Option* option = app.get_option_no_throw(name))
            return option->count() > 1 ? name + " is given more than once; it takes one value"
                                       : name + " needs a value: " + option->get_type_name();
    }
    return text;
}

/// Which command the words name, as far as CLI11 has come.
const CLI::App* chosen_of(const CLI::App& root) {
    const std::vector<CLI::App*> chosen = root.get_subcommands();
    return chosen.empty() ? nullptr : chosen.front();
}

std::string explain(const CLI::App& root, const CLI::ParseError& error,
                    const std::vector<std::string>& words) {
    if (const CLI::App* command = chosen_of(root))
        return explain_in_command(*command, error);
    if (words.empty())
        return "no command: lpvbake COMMAND ...";
    if (words[0].starts_with('-'))
        return unknown_option(root, words[0]);
    std::vector<std::string> commands;
    for (const CLI::App* command : root.get_subcommands([](const CLI::App*) { return true; }))
        commands.push_back(command->get_name());
    return "there is no command '" + words[0] + "'" + did_you_mean(words[0], commands);
}

[[noreturn]] void fail(const CLI::App& root, ErrorKind kind, const std::string& text) {
    const CLI::App* command = chosen_of(root);
    const std::string name = command ? command->get_name() : "";
    throw Error(kind, (command ? name + ": " : "") + text + " (see lpvbake "
                          + (command ? name + " " : "") + "--help)");
}

// ---------------------------------------------------------------- rows to CLI11's options

void add_option(Option& row, CLI::App& app) {
    if (row.is_flag()) {
        // What follows "=" is ours to judge.
        app.add_flag(row.names)
            ->multi_option_policy(CLI::MultiOptionPolicy::Throw)
            ->each([&row](const std::string& text) { row.take(text); });
        return;
    }
    const CLI::callback_t take = [&row](const CLI::results_t& texts) {
        for (const std::string& text : texts)
            row.take(text);
        return true;
    };
    CLI::Option* option = app.add_option(row.names, take);
    option->type_name(row.type)->required(row.required);
    if (row.many)
        option->expected(1, CLI::detail::expected_max_vector_size)
            ->allow_extra_args(row.is_positional());
}

/// Options that may stand alone get their values then: what follows is no number.
std::vector<std::string> with_values(std::vector<std::string> words, const Options& options) {
    for (std::size_t i = 1; i < words.size(); ++i) {
        const Option* row = words[i].starts_with("--") ? options.find(words[i].substr(2)) : nullptr;
        if (row && !row->alone.empty() && (i + 1 == words.size() || !parse_number(words[i + 1])))
            words[i] += "=" + row->alone;
    }
    return words;
}

/// What the words say of themselves, right or wrong.
Asked first_look(const Commands& commands, const std::vector<std::string>& words) {
    Asked asked;
    if (!words.empty() && std::ranges::count(commands, words[0], &Command::name) > 0)
        asked.command = words[0];
    for (std::size_t i = 0; i < words.size(); ++i)
        asked.json = asked.json || words[i] == "--format=json"
                     || (words[i] == "json" && i > 0 && words[i - 1] == "--format");
    return asked;
}

/// What the options say once they are read.
void look_again(const Options& options, Asked& asked) {
    asked.values.clear();
    for (const Option& row : options.rows())
        asked.values.insert(asked.values.end(), row.given.begin(), row.given.end());
    if (const Option* format = options.find("format"); format && format->is_set())
        asked.json = format->given.back() == "json";
}

} // namespace

void run_command_line(const Commands& commands, const std::vector<std::string>& words,
                      Asked& asked) {
    asked = first_look(commands, words);
    CLI::App root("", "lpvbake");
    root.require_subcommand(1);
    root.set_version_flag("-V,--version", "lpvbake " LPVBAKE_VERSION);
    struct Declared {
        Options options;
        Action action;
    };
    std::deque<Declared> declared;
    CommandOptions all;
    Declared* chosen = nullptr;
    for (const Command& command : commands) {
        CLI::App* app = root.add_subcommand(command.name);
        Declared& own = declared.emplace_back();
        own.action = command.declare(own.options);
        all[command.name] = &own.options;
        for (Option& row : own.options.rows())
            add_option(row, *app);
        app->callback([&own, &chosen] { chosen = &own; });
    }
    std::vector<std::string> whole = words;
    if (const auto named = all.find(asked.command); named != all.end())
        whole = with_values(std::move(whole), *named->second);
    try {
        root.parse(std::vector<std::string>(whole.rbegin(), whole.rend()));
    } catch (const CLI::CallForHelp&) {
        const CLI::App* app = chosen_of(root);
        const auto command =
            std::ranges::find(commands, app ? app->get_name() : "", &Command::name);
        const std::string text = app ? help_text(*command, *all.at(command->name), help_width())
                                     : overview_text(commands, help_width());
        std::fputs(text.c_str(), stdout);
        return;
    } catch (const CLI::Success& wish) { // --version
        root.exit(wish);
        return;
    } catch (const CLI::ParseError& error) {
        fail(root, ErrorKind::argument, explain(root, error, words));
    } catch (const Error& error) {
        fail(root, error.kind, error.what());
    }
    Options& options = chosen->options;
    look_again(options, asked);
    const std::string name = chosen_of(root)->get_name();
    if (const Option* config = options.find("config"); config && config->is_set())
        read_options(config->given, name, all, options);
    look_again(options, asked);
    options.check();
    if (const Option* print = options.find("print-config"); print && print->is_set())
        std::fputs(options.config(name).c_str(), stdout);
    else
        chosen->action();
}

void take_words(const std::string& command, const std::vector<std::string>& words,
                Options& options) {
    CLI::App root("", "lpvbake");
    CLI::App* app = root.add_subcommand(command);
    app->set_help_flag();
    for (Option& row : options.rows())
        add_option(row, *app);
    std::vector<std::string> whole{command};
    whole.insert(whole.end(), words.begin(), words.end());
    whole = with_values(std::move(whole), options);
    try {
        root.parse(std::vector<std::string>(whole.rbegin(), whole.rend()));
    } catch (const CLI::ParseError& error) {
        fail(root, ErrorKind::argument, explain(root, error, whole));
    } catch (const Error& error) {
        fail(root, error.kind, error.what());
    }
    if (const Option* config = options.find("config"); config && config->is_set())
        fail(root, ErrorKind::argument,
             "--config has no place here; give the options that are in it");
    options.check();
}

} // namespace lpvbake::cmd::options
