// Facts of the light that a volume holds, in metadata and as a sentence.
#include "volume/light_content.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

TEST(LightContent, IsToldInASentence) {
    const auto sentence = [](bool punctual, bool emitters, bool sky, std::optional<int> bounces) {
        return volume::sentence_of(volume::content_of(punctual, emitters, sky, bounces));
    };
    EXPECT_EQ(sentence(true, false, false, {}), "punctual lights after one reflection and more");
    EXPECT_EQ(sentence(true, false, false, 1), "punctual lights after one reflection");
    EXPECT_EQ(sentence(true, false, false, 3), "punctual lights after 1 to 3 reflections");
    EXPECT_EQ(sentence(true, true, false, 0), "emitters direct");
    EXPECT_EQ(sentence(false, false, true, {}), "sky direct and after any number of reflections");
    EXPECT_EQ(sentence(true, true, true, 1), "punctual lights after one reflection; emitters and "
                                             "sky direct and after one reflection");
    EXPECT_EQ(sentence(false, true, true, 5),
              "emitters and sky direct and after up to 5 reflections");
    EXPECT_EQ(sentence(false, false, false, {}), "");
    volume::LightContent apart = volume::content_of(false, true, true, 0);
    apart.sky->last = 1;
    EXPECT_EQ(volume::sentence_of(apart), "emitters direct; sky direct and after one reflection");
}

TEST(LightContent, ComesBackFromMetadata) {
    for (int sources = 0; sources < 8; ++sources)
        for (const std::optional<int> bounces : {std::optional<int>(), {0}, {1}, {12}}) {
            const volume::LightContent content =
                volume::content_of(sources & 1, sources & 2, sources & 4, bounces);
            std::map<std::string, std::string> metadata{{"solver", "sn"}};
            volume::set_content(content, metadata);
            EXPECT_EQ(volume::content_in(metadata), content);
            EXPECT_EQ(metadata["content"], volume::sentence_of(content));
            metadata["content"] = "sky direct"; // for people
            EXPECT_EQ(volume::content_in(metadata), content);
        }
    std::map<std::string, std::string> metadata;
    volume::set_content(volume::content_of(true, true, false, 2), metadata);
    EXPECT_EQ(metadata["punctual_reflections"], "1..2");
    EXPECT_EQ(metadata["emitter_reflections"], "0..2");
    EXPECT_EQ(metadata["sky_reflections"], "none");
}

TEST(LightContent, NamesStaticLights) {
    volume::LightContent content = volume::content_of(true, false, false, 2);
    const std::vector<std::string> names{"lamp", "a\"b"};
    volume::add_statics({}, false, 2, content);
    EXPECT_EQ(content, volume::content_of(true, false, false, 2));
    volume::add_statics(names, false, 2, content);
    EXPECT_EQ(volume::sentence_of(content),
              "punctual lights after 1 to 2 reflections; static lights direct");
    std::map<std::string, std::string> metadata;
    volume::set_content(content, metadata);
    EXPECT_EQ(metadata["static_lights"], "[\"lamp\",\"a\\u0022b\"]");
    EXPECT_EQ(volume::content_in(metadata), content);
    volume::LightContent all = volume::content_of(true, false, false, 0);
    volume::add_statics(names, true, 0, all);
    EXPECT_EQ(volume::sentence_of(all), "punctual lights direct");
    volume::set_content(volume::content_of(true, false, false, 2), metadata);
    EXPECT_FALSE(metadata.contains("static_lights"));
}

TEST(LightContent, IsUnknownUnlessAllFactsAreThere) {
    EXPECT_FALSE(volume::content_in({}));
    EXPECT_FALSE(
        volume::content_in({{"content", "sky direct and after any number of reflections"}}));
    std::map<std::string, std::string> metadata;
    volume::set_content(volume::content_of(true, true, true, {}), metadata);
    for (const char* key : {"punctual_reflections", "emitter_reflections", "sky_reflections"}) {
        std::map<std::string, std::string> less = metadata;
        less.erase(key);
        EXPECT_FALSE(volume::content_in(less)) << key;
        for (const char* wrong : {"", "1", "..", "1..", "..2", "2..1", "-1..2", "1..2 ",
                                  "0..infinity", "0x..1", "99999999999..inf", "None"}) {
            less[key] = wrong;
            EXPECT_FALSE(volume::content_in(less)) << key << wrong;
        }
    }
}

} // namespace
} // namespace lpvbake
