// lpvbake convert: a volume in another file format, convention or order.

#include "commands.h"
#include "lpvbake/error.h"
#include "scene_options.h"
#include "volume/dilate.h"
#include "volume/sh.h"

#include <filesystem>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/convert.txt.h"
    ;

struct ConvertOptions {
    std::string file;
    OutputOptions outputs;
    std::optional<int> sh_order; ///< none: the volume's
    int dilate = 0;
    Format format = Format::text;
};

/// The volume without the bands above `order`. Throws Error (argument) if it has not got so many.
void limit_order(Volume& volume, int order, const std::string& path) {
    if (order > volume.sh_order)
        throw Error(ErrorKind::argument, "--sh-order: " + path + " has order "
                                             + std::to_string(volume.sh_order) + ", not "
                                             + std::to_string(order));
    volume.sh_order = order;
    volume.sh.resize(std::size_t(volume::sh_count(order)));
}

void run(const ConvertOptions& o) {
    for (const std::string& path : o.outputs.paths)
        if (!io::volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": unknown kind of volume file; use " + io::format_list());
    check_files({}, {o.file}, o.outputs.paths);
    Volume volume = read_volume(o.file);
    if (o.sh_order)
        limit_order(volume, *o.sh_order, o.file);
    if (o.dilate > 0) {
        volume::dilate(volume, o.dilate);
        volume.metadata["dilate"] = std::to_string(o.dilate);
    }
    TerminalProgress progress(ProgressStyle::none);
    const std::vector<Written> written =
        write_outputs(o.outputs, o.outputs.paths, volume, progress);
    if (o.format == Format::json) {
        print_json({{"command", "convert"},
                    {"file", o.file},
                    {"grid", report::grid_json(volume.grid)},
                    {"sh_order", volume.sh_order},
                    {"outputs", outputs_json(written)},
                    {"warnings", progress.warnings()}});
        return;
    }
    print_grid(volume.grid);
    print_outputs(written);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<ConvertOptions>();
    ConvertOptions& o = *fields;
    options.text("file", o.file, "IN", "Volume: " + io::format_list(" or ", true)).require();
    options.texts("output", o.outputs.paths, "OUT", "Volumes to write: " + io::format_list())
        .require();
    options.number("--sh-order", o.sh_order, 0, 4, "Highest band to keep; default: the volume's");
    options.number("--dilate", o.dilate, 0, 1024,
                   "Rings of cells inside geometry to fill from those around them");
    add_output_options(options, o.outputs);
    add_format_option(options, o.format);
    return [fields] { run(*fields); };
}

} // namespace

options::Command convert_command() {
    return {"convert", "Writes a volume in another format, convention or order.", manual, declare};
}

} // namespace lpvbake::cmd
