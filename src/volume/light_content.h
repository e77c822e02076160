// Which light a volume holds: facts for programs, and a sentence made of them for people.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>

namespace lpvbake::volume {

/// After how many reflections light is held: from `first` to `last`, none: any number.
struct Reflections {
    int first = 0; ///< 0: direct light too
    std::optional<int> last;

    bool operator==(const Reflections&) const = default;
};

/// What each kind of source gives; none: nothing.
struct LightContent {
    std::optional<Reflections> punctual;
    std::optional<Reflections> emitters;
    std::optional<Reflections> sky;
    /// Names of the punctual lights whose direct light is held as well, a JSON list; empty: none.
    /// Where they are all lights there are, `punctual` begins at 0.
    std::string statics;

    bool operator==(const LightContent&) const = default;
};

/// The light of a bake of these sources with up to so many reflections (none: any number): direct,
/// but for that of punctual lights, which programs add themselves.
LightContent content_of(bool punctual, bool emitters, bool sky, std::optional<int> bounces);

/// Adds the direct light of the punctual lights of these names; `all`: there are no others.
void add_statics(std::span<const std::string> names, bool all, std::optional<int> bounces,
                 LightContent& content);

/// "punctual lights after one reflection; emitters and sky direct and after one reflection".
std::string sentence_of(const LightContent& content);

/// Puts the facts into a volume's metadata, as punctual_reflections, emitter_reflections and
/// sky_reflections ("1..inf", "0..3", "none"), static_lights where there are some, and the sentence
/// as content.
void set_content(const LightContent& content, std::map<std::string, std::string>& metadata);

/// The facts that metadata tell; none where they do not tell all: then it is unknown what the
/// volume holds. The sentence is not read.
std::optional<LightContent> content_in(const std::map<std::string, std::string>& metadata);

} // namespace lpvbake::volume
