#include "options/reference.h"

namespace lpvbake::cmd::options {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const Option& option) {
    const char* const recorded[] = {"never", "always", "if_changed"};
    return {{"name", option.name()},
            {"names", option.names},
            {"group", option.group},
            {"type", option.is_flag() ? Json(nullptr) : Json(option.type)},
            {"default", option.usual.empty() ? Json(nullptr) : Json(option.usual)},
            {"repeatable", option.many},
            {"required", option.required},
            {"positional", option.is_positional()},
            {"in_files", option.in_files},
            {"recorded", recorded[int(option.recorded)]},
            {"excludes", option.excludes},
            {"needs", option.needs.empty() ? Json(nullptr) : Json(option.needs)},
            {"help", option.help}};
}

/// The text in a cell of a table.
std::string cell(const std::string& text) {
    std::string escaped;
    for (const char c : text) {
        if (c == '|')
            escaped += '\\';
        escaped += c;
    }
    return escaped;
}

} // namespace

Json reference_json(const Command& command) {
    Options options;
    const Action keeps_fields = command.declare(options);
    Json list = Json::array();
    for (const Option* option : options.listed())
        list.push_back(json_of(*option));
    return {{"name", command.name},
            {"summary", command.summary},
            {"manual", command.manual},
            {"options", list}};
}

std::string reference_markdown(const Command& command) {
    Options options;
    const Action keeps_fields = command.declare(options);
    std::string text = "## lpvbake " + std::string(command.name) + "\n\n" + command.summary + "\n";
    std::string group;
    for (const Option* listed : options.listed()) {
        const Option& option = *listed;
        if (option.group != group)
            text.append("\n| ").append(option.group).append(" | default | |\n|---|---|---|\n");
        group = option.group;
        const bool usual = !option.usual.empty() && !option.implied && !option.is_flag();
        text.append("| `").append(cell(option.names)).append(option.is_flag() ? "" : " ");
        text.append(cell(option.type)).append("` | ");
        if (usual)
            text.append("`").append(cell(option.usual)).append("`");
        text.append(" | ").append(cell(option.help)).append(" |\n");
    }
    return text + "\n```\n" + command.manual + "\n```\n";
}

} // namespace lpvbake::cmd::options
