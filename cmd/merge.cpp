// lpvbake merge: one volume of the parts that shards of a bake have left.

#include "bake/lit_file.h"
#include "commands.h"
#include "io/atomic_file.h"
#include "io/parts.h"
#include "io/tres.h"
#include "io/vdb.h"
#include "io/world.h"
#include "lpvbake/error.h"
#include "render/display.h"
#include "report/describe.h"
#include "scene_options.h"
#include "text.h"
#include "unchanged.h"

#include <algorithm>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/merge.txt.h"
    ;

struct MergeOptions {
    std::vector<std::string> parts;
    std::vector<std::string> outputs;
    Precision precision = Precision::full;
    Format format = Format::text;
};

/// OpenVDB files grid by grid; others have all of it in memory.
Written write(const MergeOptions& o, const std::string& path, const io::Parts& parts,
              TerminalProgress& progress) {
    io::Target generic = *io::target_named("generic");
    generic.precision = o.precision;
    const WriteReport report = io::volume_format(path) == &io::vdb_format
                                   ? io::write_merged(path, parts, o.precision, progress)
                                   : io::write_for(generic, path, parts.read(progress));
    for (const std::string& warning : report.warnings)
        progress.warn(warning);
    return {path, report.files, report.packing};
}

bool is_lit_name(const std::string& path) {
    return path.ends_with(".lit");
}

/// Parts of lit surfaces.
void run_lit(const MergeOptions& o) {
    if (o.outputs.size() != 1 || !is_lit_name(o.outputs.front()))
        throw Error(ErrorKind::argument,
                    o.parts.front() + ": parts of lit surfaces make one output, NAME.lit");
    const std::string& path = o.outputs.front();
    check_files(o.parts, {}, o.outputs);
    watch_signals();
    probe_outputs(o.outputs);
    TerminalProgress progress(ProgressStyle::none);
    const auto [file, patches] = bake::merge_lit(o.parts, path, progress);
    if (o.format == Format::json)
        print_json({{"command", "merge"},
                    {"version", LPVBAKE_VERSION},
                    {"parts", o.parts.size()},
                    {"patches", patches},
                    {"outputs", {{{"path", file.path}, {"bytes", file.bytes}}}},
                    {"warnings", progress.warnings()}});
    else
        print_outputs({{file.path, {file}, {}}});
}

void run(const MergeOptions& o, const options::Options& options) {
    if (const auto world = std::ranges::find_if(o.parts, io::is_world); world != o.parts.end())
        throw Error(ErrorKind::argument,
                    *world + ": is the plan of a world; lpvbake convert makes one volume of it");
    if (bake::is_lit(o.parts.front())) {
        run_lit(o);
        return;
    }
    for (const std::string& path : o.outputs)
        if (!io::volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": the name of an output ends in " + io::format_list()
                            + (is_lit_name(path) ? "; .lit is of parts of lit surfaces" : ""));
    for (const std::string& path : o.outputs)
        if (io::volume_format(path) == &io::tres_format)
            throw Error(ErrorKind::argument,
                        path
                            + ": holds light as Godot has it; merge to another kind, and convert "
                              "that with --target godot");
    check_files(o.parts, {}, o.outputs);
    watch_signals();
    probe_outputs(o.outputs);
    TerminalProgress progress(ProgressStyle::none);
    io::Parts parts(o.parts);
    parts.set_metadata("exposure",
                       format("%.1f", render::automatic_exposure(parts.read_first_band())));
    if (const std::string settings = output_settings(options); !settings.empty())
        parts.set_metadata("output_settings", settings);
    if (o.precision == Precision::half) // that of the parts is of a bake in float
        parts.erase_metadata("bake_hash");
    std::vector<Written> written;
    io::PublishTogether together; // all or none
    for (const std::string& path : o.outputs)
        written.push_back(write(o, path, parts, progress));
    together.publish();
    const Volume& whole = parts.whole();
    if (o.format == Format::json) {
        print_json({{"command", "merge"},
                    {"version", LPVBAKE_VERSION},
                    {"parts", o.parts.size()},
                    {"grid", report::grid_json(whole.grid)},
                    {"sh_order", whole.sh_order},
                    {"outputs", outputs_json(written)},
                    {"warnings", progress.warnings()}});
        return;
    }
    print_grid(whole.grid);
    print_outputs(written);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<MergeOptions>();
    MergeOptions& o = *fields;
    options
        .texts("parts", o.parts, "PART",
               "All parts of one bake, in any order (bake --shard, light --shard)")
        .require();
    options
        .texts("-o,--output", o.outputs, "FILE",
               "Volume to write, " + io::format_list() + ", or NAME.lit; may be repeated")
        .keep_to_one_run()
        .require();
    options.group("Output");
    options.choice(
        "--precision", o.precision,
        options::Choices<Precision>{{"float", Precision::full}, {"half", Precision::half}},
        "Of the numbers in the files");
    options.group("Run");
    add_format_option(options, o.format);
    return [fields, &options] { run(*fields, options); };
}

} // namespace

options::Command merge_command() {
    return {"merge", "Makes one volume of the parts that shards of a bake have left.", manual,
            declare};
}

} // namespace lpvbake::cmd
