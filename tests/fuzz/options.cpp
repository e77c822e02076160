// Option files, and the values of options, as bake takes them.
#include "fuzz.h"

#include "../../cmd/scene_options.h"
#include "../../cmd/slice_option.h"

#include <cmath>

namespace lpvbake {
namespace {

using fuzz::require;

struct Options : SceneOptions, RunOptions {
    OutputOptions outputs;
    std::string bounces;
    std::string slice = "x=0";
};

void read_options(const std::string& path) {
    Options o;
    CLI::App app("", "bake");
    OptionList list(app);
    const CLI::Option* resolution = add_grid_options(list, o);
    add_light_options(list, o);
    add_bounces_option(list, o.bounces);
    add_output_options(list, o.outputs);
    add_run_options(list, o);
    list.text("--slice", o.slice, "", "");
    settle(app, *resolution, path, o);

    require(o.resolution >= 3 && o.resolution <= 65536, "the resolution is within its limits");
    require(o.threads >= 0 && o.threads <= 1024, "so are the threads");
    require(o.max_albedo >= 0 && o.max_albedo <= 1, "and the reflectance");
    const int bounces = bounces_of(o.bounces).value_or(0);
    require(bounces >= 0 && bounces <= 10'000, "and the bounces");
    const LoadSettings load = load_settings(o.load);
    require(!load.time || std::isfinite(*load.time), "a time is finite");
    require(load.max_memory < 1ull << 62, "a size does not overflow");
    if (const auto bounds = grid_bounds(o))
        fit_grid(bounds->lo, bounds->hi, grid_settings(o));
    o.light_files.clear();
    command_line_lights(o);
    const Grid grid{{}, 1, {2, 3, 4}};
    const Slice slice = parse_slice(o.slice, grid);
    require(slice.axis >= 0 && slice.axis < 3 && slice.index >= 0
                && slice.index < grid.dims[slice.axis],
            "a slice lies in the grid");

    // What is printed reads back the same.
    std::vector<Setting> settings;
    append_grid_settings(o, settings);
    append_light_settings(o, settings);
    std::string text;
    for (const Setting& setting : settings)
        text += setting.name + (" = " + setting.toml) + "\n";
    read_config(fuzz::Folder::own().write("again.toml", text), "bake");
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string path =
        fuzz::Folder::own().write("options.toml", {reinterpret_cast<const char*>(data), size});
    fuzz::accepts([&] { read_options(path); });
    fuzz::accepts([&] { read_config_tables(path, "sweep"); });
    return 0;
}
