#include "lpvbake/scene.h"

#include "image/image.h"
#include "scene/gltf/folder.h"
#include "scene/sky.h"
#include "text.h"

#include <algorithm>

namespace lpvbake {

Sky load_sky(const std::string& path, std::vector<std::string>& warnings, double scale, double turn,
             uint64_t max_bytes) {
    constexpr double brightest = 1e12; // the sun's disc has 1.6e9
    // Samples, and texels of the same.
    const uint64_t most = std::min(max_bytes / (6 * sizeof(float)), uint64_t(1) << 28);
    scene::gltf::file_size(path, path); // what is no file is not opened
    const image::Pixels pixels = image::read_picture(path, most);
    std::vector<glm::vec3> texels;
    texels.reserve(pixels.samples.size() / 3);
    size_t bad = 0;
    for (size_t i = 0; i < pixels.samples.size(); i += 3) {
        const glm::dvec3 nits =
            scale * glm::dvec3(pixels.samples[i], pixels.samples[i + 1], pixels.samples[i + 2]);
        const bool good = nits.x >= 0.0 && nits.y >= 0.0 && nits.z >= 0.0 && nits.x <= brightest
                          && nits.y <= brightest && nits.z <= brightest;
        bad += !good;
        texels.push_back(good ? glm::vec3(nits) : glm::vec3(0.0f));
    }
    if (bad > 0)
        warnings.push_back(format("%s: %zu of %zu texels are negative, not finite or above %g nits "
                                  "and count as 0",
                                  path.c_str(), bad, texels.size(), brightest));
    if (pixels.width != 2 * pixels.height)
        warnings.push_back(format("%s: is %d x %d texels; an equirectangular picture is twice as "
                                  "wide as high",
                                  path.c_str(), pixels.width, pixels.height));
    return scene::make_sky(pixels.width, pixels.height, std::move(texels), glm::radians(turn));
}

} // namespace lpvbake
