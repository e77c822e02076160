#include "volume/light_content.h"

#include <charconv>
#include <cstdio>
#include <string_view>

namespace lpvbake::volume {
namespace {

struct Fact {
    const char* key;
    std::optional<Reflections> LightContent::*value;
};
constexpr Fact facts[] = {{"punctual_reflections", &LightContent::punctual},
                          {"emitter_reflections", &LightContent::emitters},
                          {"sky_reflections", &LightContent::sky}};
constexpr const char* statics_key = "static_lights";

std::string text_of(const std::optional<Reflections>& reflections) {
    if (!reflections)
        return "none";
    return std::to_string(reflections->first) + ".."
           + (reflections->last ? std::to_string(*reflections->last) : "inf");
}

/// A whole number from 0 up.
std::optional<int> number(std::string_view text) {
    int value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || value < 0)
        return {};
    return value;
}

/// False where the text is none of text_of.
bool parse(std::string_view text, std::optional<Reflections>& reflections) {
    reflections.reset();
    if (text == "none")
        return true;
    const size_t dots = text.find("..");
    if (dots == std::string_view::npos)
        return false;
    const std::string_view end = text.substr(dots + 2);
    const std::optional<int> first = number(text.substr(0, dots)), last = number(end);
    if (!first || (!last && end != "inf") || (last && *last < *first))
        return false;
    reflections = {*first, last};
    return true;
}

/// "punctual lights after one reflection and more".
std::string after(const char* sources, const Reflections& reflections) {
    const std::optional<int> last = reflections.last;
    return std::string(sources) + " after "
           + (!last       ? std::string("one reflection and more")
              : last == 1 ? std::string("one reflection")
                          : "1 to " + std::to_string(*last) + " reflections");
}

/// "emitters direct and after one reflection".
std::string direct_and(const char* sources, const Reflections& reflections) {
    if (reflections.first > 0)
        return after(sources, reflections);
    const std::optional<int> last = reflections.last;
    return std::string(sources) + " direct"
           + (!last       ? std::string(" and after any number of reflections")
              : last == 0 ? std::string()
              : last == 1 ? std::string(" and after one reflection")
                          : " and after up to " + std::to_string(*last) + " reflections");
}

} // namespace

LightContent content_of(bool punctual, bool emitters, bool sky, std::optional<int> bounces) {
    LightContent content;
    if (punctual && bounces != 0)
        content.punctual = {1, bounces};
    if (emitters)
        content.emitters = {0, bounces};
    if (sky)
        content.sky = {0, bounces};
    return content;
}

void add_statics(std::span<const std::string> names, bool all, std::optional<int> bounces,
                 LightContent& content) {
    if (names.empty())
        return;
    for (const std::string& name : names) {
        content.statics += content.statics.empty() ? "[" : ",";
        content.statics += '"';
        for (const char c : name) {
            char escaped[8] = {c};
            if (static_cast<unsigned char>(c) < 0x20 || c == '"' || c == '\\')
                std::snprintf(escaped, sizeof escaped, "\\u%04x", static_cast<unsigned>(c));
            content.statics += escaped;
        }
        content.statics += '"';
    }
    content.statics += ']';
    if (all)
        content.punctual = {0, bounces};
}

std::string sentence_of(const LightContent& content) {
    std::string sentence;
    const auto add = [&](const std::string& part) {
        sentence += (sentence.empty() ? "" : "; ") + part;
    };
    if (content.punctual)
        add(direct_and("punctual lights", *content.punctual));
    if (!content.statics.empty() && !(content.punctual && content.punctual->first == 0))
        add("static lights direct");
    if (content.emitters && content.emitters == content.sky) {
        add(direct_and("emitters and sky", *content.sky));
        return sentence;
    }
    if (content.emitters)
        add(direct_and("emitters", *content.emitters));
    if (content.sky)
        add(direct_and("sky", *content.sky));
    return sentence;
}

void set_content(const LightContent& content, std::map<std::string, std::string>& metadata) {
    metadata["content"] = sentence_of(content);
    for (const Fact& fact : facts)
        metadata[fact.key] = text_of(content.*fact.value);
    metadata.erase(statics_key);
    if (!content.statics.empty())
        metadata[statics_key] = content.statics;
}

std::optional<LightContent> content_in(const std::map<std::string, std::string>& metadata) {
    LightContent content;
    for (const Fact& fact : facts)
        if (const auto found = metadata.find(fact.key);
            found == metadata.end() || !parse(found->second, content.*fact.value))
            return {};
    if (const auto statics = metadata.find(statics_key); statics != metadata.end())
        content.statics = statics->second;
    return content;
}

} // namespace lpvbake::volume
