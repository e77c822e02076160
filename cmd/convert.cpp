// lpvbake convert: a volume in another file format, convention or order.

#include "commands.h"
#include "error.h"
#include "io/io.h"
#include "result.h"
#include "scene_options.h"
#include "terminal.h"
#include "volume/dilate.h"
#include "volume/sh.h"

#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>

namespace lpvbake {
namespace {

const char summary[] = "Writes a volume in another format, convention or order.";

const char manual[] =
    R"(Reads what bake, reference and convert write, in any convention, a flipbook also by its .json, and
writes it anew. What is not asked for becomes the default: canonical coefficients of luminance in
glTF's axes, in float.

Conventions, of canonical coefficients c (basis 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2; nits),
and the source of each program's formula:
  radiance    c (three.js LightProbe)
  irradiance  A c: pi, 2 pi / 3, pi / 4 by band; summed over the basis it is irradiance
  lpv         order 1, signs of light's travel: (pi c0, 2 pi / 3 (cy, -cz, cx)), for shaders that
              evaluate max(0, v.(0.282095, -0.488603 y, 0.488603 z, -0.488603 x)(-n)) / pi
  godot       c / pi (Godot 4, scene_forward_clustered.glsl, lightmap captures)
  unity       factors of ShadeSH9 (UnityCG.cginc, SHEvalLinearL0L1 and L2): its sum is irradiance /
              pi; packed by channel the first files are SHAr, SHAg, SHAb (RGBA = x, y, z, 1), the
              second SHBr, ...
  unreal      c with the signs - + - in band 1 and + - + - + in band 2 (Unreal Engine 5,
              SHCommon.ush, SHBasisFunction3)
Axes, of positions and directions alike (metres all the same):
  gltf (x, y, z)   unity (-x, y, z)   unreal (x, z, y)   blender (x, -z, y)

Targets:
  generic, houdini  canonical coefficients of all bands in float, glTF's axes
  blender   the same in Blender's axes; in a .vdb index i is the corner of cell i, as Blender draws
            voxel i from i to i + 1
  unity     convention and axes unity, half, packed by channel; STEM.unity.json: what to set on import
  unreal    convention and axes unreal, half, packed by channel; STEM.unreal.json
  godot     convention godot, half, packed by channel; FILE.exr.import of each picture (Godot 4) and
            STEM.godot.json
  threejs   half, one picture: the atlas of LightProbeGridWebGL (r187)
  vrc       order 1 as unity has it, half, in the three textures of VRC Light Volumes; STEM.unity.json
  bevy      half, one picture of ambient cubes (irradiance / pi): Bevy's irradiance volume; STEM.bevy.json:
            its transform. It cannot be converted back
All but the first three keep orders up to 2, and two rings of cells inside geometry are filled, as
their samplers take all cells around a point; unity, unreal, godot and vrc leave no tile of a
picture empty. An option that is given goes before what the target says, but for bands that it has
no form for. In which order Unity takes tiles and rows is not proven: its notes say what to look at.

Examples:
  lpvbake convert room.vdb room.exr
  lpvbake convert room.vdb room_unity.exr --target unity
  lpvbake convert room.json room.vdb --sh-order 1 --precision half

JSON: {"command": "convert", "file", "grid": {"dims", "cell", "origin", "cells"}, "sh_order",
"outputs": [{"path", "bytes", "files": [{"path", "bytes"}]}], "warnings"}.)";

struct ConvertOptions {
    std::string file;
    OutputOptions outputs;
    int sh_order = -1; ///< -1: the volume's
    int dilate = 0;
    std::string format = "text";
};

/// The volume without the bands above `order`. Throws Error (argument) if it has not got so many.
void limit_order(Volume& volume, int order, const std::string& path) {
    if (order > volume.sh_order)
        throw Error(ErrorKind::argument, "--sh-order: " + path + " has order "
                                             + std::to_string(volume.sh_order) + ", not "
                                             + std::to_string(order));
    volume.sh_order = order;
    volume.sh.resize(std::size_t(sh_count(order)));
}

void run(const ConvertOptions& o) {
    namespace fs = std::filesystem;
    for (const std::string& path : o.outputs.paths) {
        if (!volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": unknown kind of volume file; use " + format_list());
        std::error_code none;
        if (fs::weakly_canonical(path, none) == fs::weakly_canonical(o.file, none))
            throw Error(ErrorKind::argument, path + ": is what is read; give another name");
    }
    Volume volume = read_volume(o.file);
    if (o.sh_order >= 0)
        limit_order(volume, o.sh_order, o.file);
    if (o.dilate > 0) {
        dilate(volume, o.dilate);
        volume.metadata["dilate"] = std::to_string(o.dilate);
    }
    TerminalProgress progress(ProgressStyle::none);
    const std::vector<Written> written =
        write_outputs(o.outputs, o.outputs.paths, volume, progress);
    if (o.format == "json") {
        Json document{{"command", "convert"},           {"file", o.file},
                      {"grid", grid_json(volume.grid)}, {"sh_order", volume.sh_order},
                      {"outputs", Json::array()},       {"warnings", progress.warnings()}};
        for (const Written& each : written)
            document["outputs"].push_back(each.json());
        print_json(document);
        return;
    }
    print_grid(volume.grid);
    for (const Written& each : written)
        each.print();
}

} // namespace

void add_convert(CLI::App& root, Action& action) {
    auto options = std::make_shared<ConvertOptions>();
    CLI::App* app = root.add_subcommand("convert", summary);
    app->footer(manual);
    OptionList list(*app);
    list.text("file", options->file, "IN", ("Volume: " + format_list(" or ", true)).c_str())
        ->required();
    list.text("output", options->outputs.paths, "OUT",
              ("Volumes to write: " + format_list()).c_str())
        ->required();
    list.number("--sh-order", options->sh_order, 0, 4,
                "Highest band to keep; default: the volume's");
    list.number("--dilate", options->dilate, 0, 1024,
                "Rings of cells inside geometry to fill from those around them")
        ->capture_default_str();
    add_output_options(list, options->outputs);
    list.choice("--format", options->format, "text|json", "Form of the result");
    app->callback([&action, options] { action = [options] { run(*options); }; });
}

} // namespace lpvbake
