// Bakes a glTF scene and writes the volume:
//
//     bake room.glb room.vdb
#include "bake/bake.h"
#include "error.h"
#include "io/io.h"
#include "scene/gltf/load.h"

#include <cstdio>

int main(int argc, char** argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: bake SCENE VOLUME\n");
        return 1;
    }
    try {
        const lpvbake::Scene scene = lpvbake::load_gltf(argv[1]);
        const lpvbake::gpu::Device device({}); // the first that Vulkan has
        lpvbake::BakeSettings settings;
        settings.grid.resolution = 16;
        lpvbake::Progress silent;
        const lpvbake::BakePlan plan =
            lpvbake::plan_bake(lpvbake::survey(scene), settings, device.info());
        const lpvbake::Baked baked = lpvbake::bake(scene, plan, device, silent);
        for (const lpvbake::StageReport& stage : baked.stages)
            std::printf("%-12s%7.3f s  %s\n", stage.name.c_str(), stage.seconds,
                        stage.detail.c_str());
        lpvbake::write_volume(argv[2], baked.volume, lpvbake::Precision::full);
    } catch (const lpvbake::Error& error) {
        std::fprintf(stderr, "bake: %s\n", error.what());
        return error.kind == lpvbake::ErrorKind::file ? 2 : 1;
    }
}
