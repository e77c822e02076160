// Files of lit surfaces: any bytes after a letter ('f'), or one of ours of which words are changed,
// with the hash that fits, or which is cut off; or ('p') parts of one. What is read is then looked
// up as solvers do.
#include "fuzz.h"

#include "bake/lit_file.h"
#include "cache/cache.h"
#include "scenes.h"
#include "solver/gather/cell_zone.h"
#include "solver/gather/clusters.h"
#include "surface/stored.h"

#include <fuzzer/FuzzedDataProvider.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <sstream>

namespace lpvbake {
namespace {

const bake::LitOrigin origin{"1", "scene", "settings", "tracer"};
const Grid grid{{-1.2, -0.2, -1.2}, 0.4, {6, 6, 6}};

Scene room() {
    Scene scene = scenes::cornell_box_with_point();
    const int lamp = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(50));
    scenes::add_quad(scene, lamp, {-0.2f, 1.9f, -0.2f}, {0.4f, 0, 0}, {0, 0, 0.4f});
    return scene;
}

/// A box with a lamp and a light that is cut, in two layers, and the file of its lit surfaces.
struct Lit {
    Scene scene = room();
    scene::Frame frame = scene::frame_of(grid);
    visibility::Visibility visibility{scene, frame};
    std::string head, body; ///< of the file; the head ends with a hash and a length
    std::array<std::string, 2> part_heads, part_bodies; ///< of the same in two parts

    Lit() {
        Progress silent;
        surface::LightingSettings settings;
        settings.rays = 1 << 10;
        scene::LightLayer layer;
        layer.lights.assign(scene.lights.size(), glm::vec3(0.5f));
        layer.emissions.assign(scene.materials.size(), glm::vec3(0.25f));
        const std::vector<scene::LightLayer> layers(2, layer);
        surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, frame, settings, silent, layers);
        cache::Writer out;
        surface::put(lit, out);
        body = out.bytes();
        const std::string path = fuzz::Folder::own().write("whole.lit", "");
        bake::write_lit(path, origin, std::move(lit));
        std::ostringstream text;
        text << std::ifstream(path, std::ios::binary).rdbuf();
        fuzz::require(text.str().ends_with(body), "a file ends with the surfaces");
        head = text.str().substr(0, text.str().size() - body.size());
        settings.bounces = {};
        for (int i : {0, 1}) {
            surface::LitPart part =
                surface::light_part(scene, visibility, frame, settings, i + 1, 2, silent);
            cache::Writer bytes;
            surface::put(part, bytes);
            part_bodies[size_t(i)] = bytes.bytes();
            bake::write_lit_part(path, origin, std::move(part));
            std::ostringstream own;
            own << std::ifstream(path, std::ios::binary).rdbuf();
            part_heads[size_t(i)] = own.str().substr(0, own.str().size() - bytes.bytes().size());
        }
    }

    static std::string file_of(const std::string& head, const std::string& changed) {
        cache::Writer end;
        end.put(cache::hash_of(changed));
        end.put(uint64_t(changed.size()));
        return head.substr(0, head.size() - end.bytes().size()) + end.bytes() + changed;
    }
};

std::string changed_from(FuzzedDataProvider& input, const std::string& whole) {
    std::string bytes = whole;
    for (int count = input.ConsumeIntegralInRange(0, 8); count > 0; --count) {
        const size_t at = 4 * input.ConsumeIntegralInRange<size_t>(0, whole.size() / 4 - 2);
        const uint64_t value = input.ConsumeBool()
                                   ? input.ConsumeIntegral<uint64_t>()
                                   : input.ConsumeIntegralInRange<uint64_t>(0, 2 * whole.size());
        std::memcpy(&bytes[at], &value, input.ConsumeBool() ? 8 : 4);
    }
    if (input.ConsumeIntegralInRange(0, 7) == 0)
        bytes.resize(input.ConsumeIntegralInRange<size_t>(0, bytes.size()));
    return bytes;
}

/// Rays from the middle of the box to all sides, and all that `gather` makes of patches.
void use(const surface::LitSurfaces& lit, const visibility::Visibility& visibility) {
    for (int i = 0; i < 64; ++i) {
        const float turn = 2.4f * float(i), z = (float(i) + 0.5f) / 32 - 1;
        const float r = std::sqrt(1 - z * z);
        const glm::vec3 direction(r * std::cos(turn), r * std::sin(turn), z);
        const visibility::Hit hit = visibility.closest({glm::vec3(3), direction, 0, 100});
        const uint32_t side = lit.side(hit, direction);
        fuzz::require(side == surface::LitSurfaces::no_side || side < lit.luminance.size(),
                      "a side is one of the surfaces'");
        const glm::vec3 light = lit.leaving(hit, direction);
        fuzz::require(std::isfinite(light.x + light.y + light.z), "light is finite");
    }
    const solver::gather::Clusters clusters = solver::gather::make_clusters(lit, visibility);
    for (const solver::gather::Cluster& cluster : clusters.nodes)
        fuzz::require(cluster.count > 0
                          && size_t(cluster.first) + cluster.count <= clusters.emitters.size(),
                      "a cluster has emitters");
    const solver::gather::Occupied occupied(lit.patches, grid);
    occupied({0, 0, 0}, 1);
}

/// Two parts of which one is changed, or both are; the file that they make is as any other.
void merge(const Lit& lit, FuzzedDataProvider& input) {
    std::vector<std::string> paths;
    const int which = input.ConsumeIntegralInRange(1, 3);
    for (size_t i : {0, 1}) {
        const std::string& body = lit.part_bodies[i];
        const bool changes = (which >> i & 1) != 0;
        paths.push_back(fuzz::Folder::own().write(
            i == 0 ? "1.lit" : "2.lit",
            Lit::file_of(lit.part_heads[i], changes ? changed_from(input, body) : body)));
    }
    const std::string path = fuzz::Folder::own().write("merged.lit", "");
    Progress silent;
    if (fuzz::accepts([&] { bake::merge_lit(paths, path, silent); }))
        fuzz::accepts(
            [&] { use(bake::read_lit(path, origin, lit.scene, lit.visibility), lit.visibility); });
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    static const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    static const Lit lit;
    if (size > 0 && data[0] == 'p') {
        FuzzedDataProvider input(data + 1, size - 1);
        merge(lit, input);
        return 0;
    }
    std::string bytes;
    if (size > 0 && data[0] == 'f') {
        bytes.assign(reinterpret_cast<const char*>(data) + 1, size - 1);
    } else {
        FuzzedDataProvider input(data, size);
        bytes = input.ConsumeBool() ? Lit::file_of(lit.head, changed_from(input, lit.body))
                                    : changed_from(input, lit.head + lit.body);
    }
    const std::string path = fuzz::Folder::own().write("a.lit", bytes);
    fuzz::accepts(
        [&] { use(bake::read_lit(path, origin, lit.scene, lit.visibility), lit.visibility); });
    return 0;
}
