#include "solver/vpl/vpls.h"

namespace lpvbake::solver::vpl {

std::vector<Vpl> render_vpls(const gpu::Device& device, const Scene& scene,
                             const scene::Frame& frame, const RsmSettings& settings,
                             Progress& progress, const visibility::Visibility* glass) {
    std::vector<Vpl> vpls;
    RsmPass pass(device, scene, frame, glass);
    uint64_t done = 0;
    for (const Light& light : scene.lights) {
        pass.render(light, settings.size,
                    [&](const Rsm& rsm) { cluster_vpls(rsm, frame, settings.kernel, vpls); });
        progress.advance(++done);
    }
    return vpls;
}

} // namespace lpvbake::solver::vpl
