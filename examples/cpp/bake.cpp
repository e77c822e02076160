// Bakes a glTF scene and writes the volume:
//
//     bake room.glb room.vdb
#include "lpvbake/bake.h"
#include "lpvbake/error.h"
#include "lpvbake/file.h"

#include <cstdio>
#include <utility>

int main(int argc, char** argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: bake SCENE VOLUME\n");
        return 1;
    }
    try {
        const lpvbake::Scene scene = lpvbake::load_gltf(argv[1]);
        const lpvbake::gpu::Device device({}); // the first that Vulkan has
        lpvbake::BakeRequest request;
        request.resolution = 16;
        const lpvbake::BakeForecast forecast = lpvbake::forecast(scene, request, device.info());
        std::printf("%s: about %.2g s\n", forecast.choice.c_str(), forecast.seconds);
        lpvbake::Baked baked = lpvbake::bake_volume(scene, request, device);
        for (const lpvbake::StageReport& stage : baked.stages)
            std::printf("%-12s%7.3f s  %s\n", stage.name.c_str(), stage.seconds,
                        stage.detail.c_str());
        lpvbake::write_volume(argv[2], std::move(baked.volume));
    } catch (const lpvbake::Error& error) {
        std::fprintf(stderr, "bake: %s\n", error.what());
        return error.kind == lpvbake::ErrorKind::file ? 2 : 1;
    }
}
