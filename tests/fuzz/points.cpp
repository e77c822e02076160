// Files of points: after a letter that says of which kind they are, JSON ('j'), CSV ('c') or NPY.
#include "fuzz.h"

#include "io/points.h"

#include <cmath>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    if (input.empty())
        return 0;
    const char* const name = input[0] == 'j' ? "a.json" : input[0] == 'c' ? "a.csv" : "a.npy";
    const std::string path = fuzz::Folder::own().write(name, input.substr(1));
    fuzz::accepts([&] {
        const volume::Points points = io::read_points(path);
        fuzz::require(!points.positions.empty(), "there are points");
        fuzz::require(points.normals.empty() || points.normals.size() == points.positions.size(),
                      "normals are one a point, or none");
        for (const glm::dvec3 at : points.positions)
            fuzz::require(std::isfinite(at.x) && std::isfinite(at.y) && std::isfinite(at.z),
                          "points are finite");
        for (const glm::vec3 normal : points.normals)
            fuzz::require(std::abs(glm::length(normal) - 1.0f) < 1e-5f, "normals are unit ones");
    });
    return 0;
}
