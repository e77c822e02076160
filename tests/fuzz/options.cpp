// Option files, and the values of options, as bake takes them.
#include "fuzz.h"

#include "options/file.h"
#include "options/toml.h"
#include "scene_options.h"

#include <cmath>

namespace lpvbake {
namespace {

using fuzz::require;

struct Fields : cmd::SceneOptions, cmd::RunOptions {
    cmd::OutputOptions outputs;
    cmd::options::Bounces bounces;
    std::optional<cmd::options::Slice> slice;

    void declare(cmd::options::Options& options) {
        cmd::add_grid_options(options, *this);
        cmd::add_light_options(options, *this);
        options.value("--bounces", bounces, "", cmd::options::parse_bounces, "");
        cmd::add_output_options(options, outputs);
        cmd::add_run_options(options, *this);
        options.value("--slice", slice, "", cmd::options::parse_slice, "", "x=0");
    }
};

void try_options(const std::string& path) {
    Fields o;
    cmd::options::Options options;
    o.declare(options);
    cmd::options::read_options({path}, "bake", {{"bake", &options}}, options);
    options.check();

    fuzz::require(o.grid.resolution >= 3 && o.grid.resolution <= 65536,
                  "the resolution is within its limits");
    fuzz::require(o.threads >= 0 && o.threads <= 1024, "so are the threads");
    fuzz::require(o.load.rules.max_albedo >= 0 && o.load.rules.max_albedo <= 1,
                  "and the reflectance");
    const int bounces = o.bounces.most.value_or(0);
    fuzz::require(bounces >= 0 && bounces <= 10'000, "and the bounces");
    fuzz::require(!o.load.time || std::isfinite(*o.load.time), "a time is finite");
    fuzz::require(o.load.max_memory < 1ull << 62, "a size does not overflow");
    if (const auto* box = std::get_if<Bounds>(&o.bounds))
        fuzz::accepts([&] { volume::fit_grid(box->lo, box->hi, o.grid_settings()); });
    o.light_files.clear();
    fuzz::accepts([&] { cmd::command_line_lights(o); });
    fuzz::accepts([&] {
        const Grid grid{{}, 1, {2, 3, 4}};
        cmd::options::check_slice(*o.slice, grid);
        fuzz::require(o.slice->axis >= 0 && o.slice->axis < 3 && o.slice->index >= 0
                          && o.slice->index < grid.dims[o.slice->axis],
                      "a slice lies in the grid");
    });

    // What is printed reads back the same.
    const std::string text = options.config("bake");
    Fields again;
    cmd::options::Options read;
    again.declare(read);
    cmd::options::read_options({fuzz::Folder::own().write("again.toml", text)}, "bake",
                               {{"bake", &read}}, read);
    fuzz::require(read.config("bake") == text, "what is printed reads back");
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string path =
        fuzz::Folder::own().write("options.toml", {reinterpret_cast<const char*>(data), size});
    fuzz::accepts([&] { try_options(path); });
    fuzz::accepts([&] { cmd::options::read_config_tables(path, "sweep"); });
    return 0;
}
