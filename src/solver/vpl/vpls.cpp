#include "solver/vpl/vpls.h"

namespace lpvbake::solver::vpl {

std::vector<Vpl> render_vpls(const gpu::Device& device, const Scene& scene,
                             const scene::Frame& frame, const RsmSettings& settings,
                             Progress& progress, const visibility::Visibility* glass,
                             std::span<const scene::LightLayer> layers) {
    std::vector<Vpl> vpls;
    RsmPass pass(device, scene, frame, glass);
    for (std::size_t light = 0; light < scene.lights.size(); ++light) {
        const std::size_t first = vpls.size();
        pass.render(scene.lights[light], settings.size,
                    [&](const Rsm& rsm) { cluster_vpls(rsm, frame, settings.kernel, vpls); });
        for (Vpl& vpl : std::span(vpls).subspan(first))
            for (const scene::LightLayer& layer : layers)
                vpl.layers.push_back(layer.lights[light] * vpl.power);
        progress.advance(light + 1);
    }
    return vpls;
}

} // namespace lpvbake::solver::vpl
