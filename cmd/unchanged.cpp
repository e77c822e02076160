#include "unchanged.h"

#include "io/atomic_file.h"
#include "io/layers.h"
#include "io/levels.h"
#include "io/parts.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "read_light.h"
#include "scene/scene_hash.h"
#include "terminal.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

constexpr const char* any_hash = "";

void check_hash(const std::string& path, const Volume& volume, const std::string& hash) {
    const auto fact = volume.metadata.find("bake_hash");
    if (fact == volume.metadata.end() || (hash != any_hash && fact->second != hash))
        throw Error(ErrorKind::invalid, path + ": is of other inputs, options or version");
}

/// The hash, and whether the files that programs read beside the numbers are there.
void check_volume(const BakeOptions& o, const std::string& path, const Volume& volume,
                  const std::string& hash) {
    check_hash(path, volume, hash);
    Volume grids; // of one cell
    grids.grid.dims = glm::ivec3(1);
    grids.sh_order = volume.sh_order;
    grids.sh.assign(volume.sh.size(), {glm::vec3(0)});
    for (const std::string& file : io::files_for(o.outputs.storage(), path, std::move(grids)))
        if (!fs::is_regular_file(file))
            throw Error(ErrorKind::file, file + ": is not there");
}

/// Of the set that is written by the name `path`, and read by `file`.
volume::VolumeSet check_set(const BakeOptions& o, const std::string& path, const std::string& file,
                            const std::string& hash) {
    volume::VolumeSet set = read_levels(file);
    if (set.bricks)
        check_hash(file, set.levels.front(), hash); // metadata are of all bricks
    else
        for (std::size_t i = 0; i < set.levels.size(); ++i)
            check_volume(o, io::member_path(path, set.places, i), set.levels[i], hash);
    return set;
}

void check_output(const BakeOptions& o, const std::string& path, const std::string& hash,
                  bool levels) {
    if (o.shard) {
        const Volume part = io::read_vdb(path);
        check_hash(path, part, hash);
        if (io::shard_of(part) != o.shard)
            throw Error(ErrorKind::invalid, path + ": is of another shard");
        return;
    }
    const auto file_of = [&](const std::string& set) {
        return io::set_path(set, o.adaptive || levels ? 2 : 1, o.places());
    };
    const volume::VolumeSet all = check_set(o, path, file_of(path), hash);
    if (const auto shard = io::shard_of(all.levels.front()))
        throw Error(ErrorKind::invalid, path + ": is a part, " + io::text_of(*shard));
    if (!o.layers.empty()) {
        const std::string manifest = io::layer_manifest_path(path);
        const std::vector<io::LayerEntry> layers = io::read_layer_manifest(manifest).layers;
        const auto listed = all.levels.front().metadata.find("layers");
        if (listed == all.levels.front().metadata.end() || listed->second != io::text_of(layers))
            throw Error(ErrorKind::invalid, manifest + ": lists other layers");
        if (o.layers_level > 0) {
            const std::string whole = io::layers_whole_path(path);
            check_set(o, whole, whole, hash);
        }
        for (const io::LayerEntry& layer : layers) {
            const std::string set = io::layer_path(path, layer.name);
            for (const Volume& level : check_set(o, set, file_of(set), hash).levels)
                if (const auto name = level.metadata.find("layer");
                    name == level.metadata.end() || name->second != layer.name)
                    throw Error(ErrorKind::invalid, set + ": is not the layer " + layer.name);
        }
    }
}

/// Empty where all outputs are as the bake would write them.
std::optional<std::string> why_bake(const BakeOptions& o, const std::string& hash, bool levels) {
    try {
        for (const std::string& path : o.outputs.paths)
            check_output(o, path, hash, levels);
    } catch (const Error& error) {
        return error.what();
    }
    return {};
}

void print_unchanged(const BakeOptions& o, const char* why, const Run& run) {
    if (o.format == Format::json) {
        print_json({{"command", "bake"},
                    {"version", LPVBAKE_VERSION},
                    {"scene", o.scene},
                    {"unchanged", true},
                    {"outputs", o.outputs.paths},
                    {"warnings", run.progress.warnings()},
                    {"seconds", run.seconds()}});
        return;
    }
    std::string paths;
    for (const std::string& path : o.outputs.paths)
        paths += (paths.empty() ? "" : ", ") + path;
    std::printf("unchanged     %s: %s\n", paths.c_str(), why);
}

/// Tells the reason or, where there is none, that outputs are left as they are and why.
bool must_bake(const BakeOptions& o, const std::optional<std::string>& reason, const char* left,
               Run& run) {
    if (reason) {
        tell("bakes: " + *reason);
        return true;
    }
    run.progress.end();
    print_unchanged(o, left, run);
    return false;
}

} // namespace

std::string output_settings(const options::Options& options) {
    std::string text;
    for (const options::Option& option : options.rows())
        if (option.group == "Output" && option.recorded == options::Recorded::never
            && option.is_set())
            text += (text.empty() ? "" : "; ") + option.name() + " = " + option.toml();
    return text;
}

std::string bake_hash(const BakeOptions& o, const options::Options& options, const Scene& scene,
                      const std::string& hash, const std::optional<PackedScene>& packed) {
    std::vector<std::string> texts{LPVBAKE_VERSION, options.recorded(), output_settings(options),
                                   hash};
    for (const Light& light : scene.lights)
        texts.push_back(light.name);
    if (o.bytes) // what they leave room for is of the kinds of files
        for (const std::string& path : o.outputs.paths)
            texts.push_back(fs::path(path).extension().string());
    for (const std::string& file :
         {o.scene, o.adjust, has_volume_file(o) ? o.volumes : std::string(),
          density_file(o.medium)}) {
        if (file.empty())
            continue;
        if (!fs::is_regular_file(file))
            return {};
        if (!o.surroundings || file != o.scene) // of which there is more than counts
            texts.push_back(scene::file_hash(file));
    }
    if (packed)
        texts.insert(texts.end(), {packed->json, packed->bytes});
    return scene::text_hash(texts);
}

bool needs_bake(const BakeOptions& o, const std::string& hash, bool levels, Run& run) {
    return must_bake(o,
                     hash.empty() ? "the scene or a file of boxes can be read but once"
                                  : why_bake(o, hash, levels),
                     "inputs, options and version are those of the bake", run);
}

bool is_missing(const BakeOptions& o, Run& run) {
    return must_bake(o, why_bake(o, any_hash, o.nests()), "are there, whole", run);
}

void write_depfile(const BakeOptions& o, const Scene& scene) {
    if (o.depfile.empty())
        return;
    std::vector<std::string> inputs = inputs_of(o);
    inputs.insert(inputs.end(), scene.file.beside.begin(), scene.file.beside.end());
    std::string text;
    const auto add = [&](const std::string& path) {
        for (const char c : path) {
            if (c == '\n')
                throw Error(ErrorKind::argument,
                            "--depfile: a path with a line end has no form in it");
            if (c == ' ' || c == '#' || c == ':')
                text += '\\';
            text += c == '$' ? "$$" : std::string(1, c);
        }
    };
    for (const std::string& path : o.outputs.paths) {
        text += text.empty() ? "" : " ";
        add(o.places() ? io::set_path(path, 2, true) : path);
    }
    text += ":";
    std::ranges::sort(inputs);
    for (const std::string& input : inputs)
        if (!input.empty() && input != "-" && (&input == inputs.data() || input != *(&input - 1))) {
            text += " \\\n  ";
            add(input);
        }
    io::AtomicFile file(o.depfile);
    file.write(text + "\n");
    file.seal();
    file.publish();
}

} // namespace lpvbake::cmd
