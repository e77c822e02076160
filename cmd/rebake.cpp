// lpvbake rebake: whether a volume's own settings make the same volume of a scene.

#include "bake.h"
#include "commands.h"
#include "io/levels.h"
#include "lpvbake/error.h"
#include "options/file.h"
#include "read_light.h"
#include "report/difference.h"
#include "text.h"
#include "unchanged.h"
#include "volume/compare.h"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <set>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/rebake.txt.h"
    ;

struct RebakeOptions {
    std::string file, output;
    BakeOptions bake;
    options::Options bake_table; ///< of `bake`, which the metadata set
};

/// A folder that goes with what is in it.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = (fs::temp_directory_path() / "lpvbake-rebake-XXXXXX").string();
        if (!mkdtemp(name.data()))
            throw Error(ErrorKind::io, name + ": cannot be made; free space there, or set TMPDIR");
        path = name;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        fs::remove_all(path, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    fs::path path;
};

std::string fact_in(const Volume& volume, const char* name) {
    const auto fact = volume.metadata.find(name);
    return fact == volume.metadata.end() ? "" : fact->second;
}

/// Throws Error (invalid) for what no bake wrote as it is.
void check_baked(const std::string& file, const Volume& volume) {
    const auto refuse = [&](const std::string& why) {
        throw Error(ErrorKind::invalid, file + ": " + why);
    };
    if (fact_in(volume, "solver") == "reference")
        refuse("is of lpvbake reference, and settings of bake are needed");
    if (fact_in(volume, "settings").empty())
        refuse("has no settings of a bake in its metadata; give a volume as bake wrote it");
    if (const std::string layer = fact_in(volume, "layer"); !layer.empty())
        refuse("is the layer " + layer + "; give the volume of all light");
    for (const char* set : {"level_set", "volume_set"})
        if (const std::string manifest = fact_in(volume, set);
            !manifest.empty() && !io::is_manifest(file))
            refuse("is one of several volumes; give " + manifest);
}

/// The end of the names of the volumes, as ".vdb".
std::string kind_of(const std::string& file) {
    const std::string volume = io::is_manifest(file) ? io::level_files(file).front() : file;
    return (*io::readable_format(volume)).extension;
}

/// Which grids are others.
std::string values_text(const volume::Comparison& comparison) {
    std::string text;
    const auto add = [&](const std::string& name, const std::string& how) {
        text += (text.empty() ? "" : ", ") + name + how;
    };
    for (const volume::GridDifference& grid : comparison.grids)
        if (grid.cells > 0)
            add(grid.name,
                format(" (%llu cells, up to %.3g)", (unsigned long long)grid.cells, grid.max_abs));
    for (const std::string& name : comparison.only_a)
        add(name, " (not in the file)");
    for (const std::string& name : comparison.only_b)
        add(name, " (in the file alone)");
    return "other values: " + text;
}

/// How the new one differs, a line each.
std::vector<std::string> differences(const volume::VolumeSet& old, const volume::VolumeSet& made) {
    if (old.levels.size() != made.levels.size())
        return {format("there are %zu volumes, not %zu", made.levels.size(), old.levels.size())};
    std::vector<std::string> lines;
    for (std::size_t i = 0; i < old.levels.size(); ++i) {
        const Volume &a = made.levels[i], &b = old.levels[i];
        const std::string title = old.levels.size() > 1 ? volume::title_of(old, i) + ": " : "";
        if (const auto why = volume::lattice_difference(b.grid, a.grid)) {
            lines.push_back(title + "other cells: " + *why);
            continue;
        }
        const volume::Comparison comparison = volume::compare(a, b, {{}, 0});
        if (!comparison.identical)
            lines.push_back(title + values_text(comparison));
    }
    return lines;
}

report::Json json_of(const report::MetadataDifference& metadata) {
    report::Json different = report::Json::object();
    for (const auto& [key, values] : metadata.different)
        different[key] = {values.first, values.second};
    return {{"only_file", metadata.only_a},
            {"only_rebaked", metadata.only_b},
            {"different", different}};
}

/// Keys of what differs, after "metadata that differ: ".
std::string keys_of(const report::MetadataDifference& metadata) {
    std::string keys;
    const auto add = [&](const std::string& key) { keys += (keys.empty() ? "" : ", ") + key; };
    for (const auto& [key, value] : metadata.only_a)
        add(key);
    for (const auto& [key, value] : metadata.only_b)
        add(key);
    for (const auto& [key, values] : metadata.different)
        add(key);
    return keys;
}

void run(RebakeOptions& o) {
    const auto begin = std::chrono::steady_clock::now();
    const volume::VolumeSet old = read_levels(o.file);
    const Volume& first = old.levels.front();
    check_baked(o.file, first);
    const std::string settings = fact_in(first, "settings"),
                      output_settings = fact_in(first, "output_settings");
    const std::set<std::string> groups{"Grid", "Scene", "Light", "Air", "Solver", "Output", "Run"};
    for (const std::string& text : {settings, output_settings})
        options::read_recorded(text, o.file + ": its settings", groups, o.bake_table);
    const std::string kind = kind_of(o.file);
    if (!o.output.empty() && !options::has_extension(o.output, kind.c_str()))
        throw Error(ErrorKind::argument, o.output + ": is of another kind than " + o.file
                                             + "; its name has to end in " + kind);
    const TemporaryFolder folder;
    fs::path name = fs::path(o.file).stem(); // manifests of sets name themselves in the metadata
    if (io::is_manifest(o.file))
        name = name.stem();
    const std::string output = o.output.empty() ? (folder.path / name).string() + kind : o.output;
    o.bake.outputs.paths = {output};
    o.bake.told = false;
    // Recorded whether it was given or not.
    o.bake.any_resolution = !o.bake_table.find("resolution")->is_set();
    check_files({o.bake.scene}, {o.file}, {output});
    run_bake(o.bake, o.bake_table);

    const volume::VolumeSet made = read_levels(
        io::is_manifest(o.file) ? io::manifest_path(output, !old.places.empty()) : output);
    const std::vector<std::string> lines = differences(old, made);
    const report::MetadataDifference metadata =
        report::metadata_difference(first, made.levels.front());
    const std::string hash = fact_in(first, "bake_hash");
    const bool same_inputs = hash == fact_in(made.levels.front(), "bake_hash");
    if (o.bake.format == Format::json)
        print_json(
            {{"command", "rebake"},
             {"version", LPVBAKE_VERSION},
             {"file", o.file},
             {"scene", o.bake.scene},
             {"settings", settings},
             {"output_settings", output_settings},
             {"output", o.output.empty() ? report::Json(nullptr) : report::Json(o.output)},
             {"same", lines.empty()},
             {"same_inputs", hash.empty() ? report::Json(nullptr) : report::Json(same_inputs)},
             {"differences", lines},
             {"metadata", json_of(metadata)},
             {"seconds", seconds_since(begin)}});
    else {
        std::printf("inputs        %s\n", hash.empty()  ? "unknown: the file has no bake_hash"
                                          : same_inputs ? "the same, as options and version are"
                                                        : "others, or options or version are");
        for (const std::string& line : lines)
            std::printf("differs       %s\n", line.c_str());
        if (metadata.any())
            std::printf("metadata      differ: %s\n", keys_of(metadata).c_str());
        if (!o.output.empty())
            std::printf("wrote         %s\n", o.output.c_str());
        if (lines.empty())
            std::printf("same          %s bakes the values of %s\n", o.bake.scene.c_str(),
                        o.file.c_str());
    }
    finish_stdout();
    if (!lines.empty())
        throw Error(ErrorKind::difference,
                    o.bake.scene + ": does not bake " + o.file + ": " + lines.front());
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<RebakeOptions>();
    RebakeOptions& o = *fields;
    add_bake_options(o.bake_table, o.bake);
    options
        .text("file", o.file, "FILE",
              "Volume of bake, " + io::format_list(", ", true)
                  + ", or the .levels.json or .volumes.json of several")
        .require();
    options.text("scene", o.bake.scene, "SCENE", "Scene to bake, a .gltf or .glb").require();
    options.text("-o,--output", o.output, "FILE", "Keep the new volume, of the kind of FILE")
        .keep_to_one_run();
    add_device_option(options, o.bake);
    add_run_options(options, o.bake);
    return [fields] { run(*fields); };
}

} // namespace

options::Command rebake_command() {
    return {"rebake", "Bakes a scene by a volume's own settings, and compares.", manual, declare};
}

} // namespace lpvbake::cmd
