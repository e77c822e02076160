#include "options/wording.h"

#include <cstring>

namespace lpvbake::cmd::options {
namespace {

constexpr Wording table[] = {
    {"`lights` or a `sky`", "--default-light or light with --sun AZIMUTH,ELEVATION,LUX, --point "
                            "X,Y,Z,CD, --sky COLOUR,NITS or --lights FILE"},
    {"`adaptive`", "--adaptive"},
    {"`adjust`", "--adjust"},
    {"`allow_external`", "--allow-external"},
    {"`animation`", "--animation"},
    {"`at`", "--at"},
    {"`bounces`", "--bounces"},
    {"`bounds`", "--bounds"},
    {"`bytes`", "--bytes"},
    {"`camera`", "--camera"},
    {"`cast_only`", "--cast-only"},
    {"`cell_size`", "--cell-size"},
    {"`cull_backfaces`", "--backfaces cull"},
    {"`device`", "--device"},
    {"`direct`", "--direct"},
    {"`error`", "--error"},
    {"`exclude`", "--exclude"},
    {"`fit`", "--fit"},
    {"`flatten`", "--flatten"},
    {"`focus`", "--focus"},
    {"`height`", "height=H0:H"},
    {"`isa`", "--isa"},
    {"`iterations`", "--iterations"},
    {"`lamp_radius`", "--lamp-radius"},
    {"`layers`", "--layers"},
    {"`layers_level`", "--layers-level"},
    {"`level`", "--level"},
    {"`levels`", "--levels"},
    {"`lights_only`", "--lights-only"},
    {"`max_albedo`", "--max-albedo"},
    {"`max_memory`", "--max-memory"},
    {"`max_size`", "--max-size"},
    {"`medium`", "--medium"},
    {"`medium_bounds`", "--medium-bounds"},
    {"`no_peer`", "--no-peer"},
    {"`occlusion`", "--occlusion"},
    {"`packing`", "--packing"},
    {"`precision`", "--precision"},
    {"`rays`", "--rays"},
    {"`receive_only`", "--receive-only"},
    {"`resolution`", "--resolution"},
    {"`rows`", "--rows"},
    {"`rsm_samples`", "--rsm-samples"},
    {"`scattering`", "--scattering"},
    {"`scenario`", "--scenario"},
    {"`scene`", "--scene"},
    {"`sh_order`", "--sh-order"},
    {"`shard`", "--shard"},
    {"`sky`", "--sky"},
    {"`solver`", "--solver"},
    {"`static`", "--static"},
    {"`strict`", "--strict"},
    {"`target`", "--target"},
    {"`tile`", "--tile"},
    {"`time_budget`", "--time-budget"},
    {"`tolerance`", "--tolerance"},
    {"`variant`", "--variant"},
    {"`volume`", "--volume"},
};

} // namespace

std::span<const Wording> wordings() {
    return table;
}

std::string in_options(std::string text) {
    for (const auto& [setting, option] : table)
        for (std::size_t at = 0; (at = text.find(setting, at)) != std::string::npos;
             at += std::strlen(option))
            text.replace(at, std::strlen(setting), option);
    return text;
}

} // namespace lpvbake::cmd::options
