// Files of lights, and lights as the command line has them after a byte of 0.
#include "fuzz.h"

#include "lpvbake/scene.h"
#include "options/lights.h"
#include "scene/lights.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string text(reinterpret_cast<const char*>(data), size);
    if (text.starts_with('\0')) {
        const std::string argument = text.substr(1, text.find('\0', 1) - 1);
        fuzz::accepts([&] { scene::check_light(cmd::options::parse_sun(argument), "--sun"); });
        fuzz::accepts([&] { scene::check_light(cmd::options::parse_point(argument), "--point"); });
        fuzz::accepts([&] {
            const glm::vec3 nits = cmd::options::parse_sky(argument).luminance;
            for (int i = 0; i < 3; ++i)
                fuzz::require(nits[i] >= 0 && std::isfinite(nits[i]), "a sky is finite");
        });
        return 0;
    }
    const std::string path = fuzz::Folder::own().write("lights.json", text);
    fuzz::accepts([&] {
        std::vector<std::string> warnings;
        for (const Light& light : load_lights(path, warnings))
            scene::check_light(light, "light");
    });
    return 0;
}
