// lpvbake diff: how far one volume is from another, and where.

#include "colour/colour.h"
#include "commands.h"
#include "io/chart.h"
#include "io/io.h"
#include "io/levels.h"
#include "io/slice.h"
#include "lpvbake/error.h"
#include "report/difference.h"
#include "scene_options.h"
#include "text.h"
#include "volume/light_content.h"
#include "volume/sh.h"
#include "world_volume.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/diff.txt.h"
    ;

struct DiffOptions {
    std::string a, b;
    WorldOptions world_a, world_b;
    report::Threshold fail, warn;
    bool metadata = false;
    int worst = 5;
    std::vector<std::string> outputs;
    std::optional<options::Slice> slice;
    double slice_max = 0; ///< 0: the slice's own
    Format format = Format::text;
};

// ---------------------------------------------------------------- reading the command line

/// All that can be known to be wrong before the volumes are read.
void check_options(const DiffOptions& o) {
    bool picture = false;
    for (const std::string& output : o.outputs) {
        const bool png = options::has_extension(output, ".png");
        picture = picture || png;
        if (!png && !io::volume_format(output))
            throw Error(ErrorKind::argument, output + ": the name of an output ends in "
                                                 + io::format_list(", ") + " or .png");
    }
    check_scenario(o.world_a, {o.a, o.b});
    std::vector<std::string> inputs{o.a, o.b};
    for (const auto& [path, world] : {std::pair(o.a, &o.world_a), {o.b, &o.world_b}})
        if (io::is_world(path))
            std::ranges::copy(files_of(open_world(path, *world)), std::back_inserter(inputs));
    check_files({}, inputs, o.outputs);
    if (o.slice.has_value() != picture)
        throw Error(ErrorKind::argument,
                    "--slice and a picture belong together: --slice z=16 -o error.png");
}

// ---------------------------------------------------------------- outputs

/// Gives cells that are not valid what the nearest valid one has, at most three cells away in the
/// layer.
void spread(Volume& layer) {
    constexpr int reach = 3, width = 2 * reach + 1;
    const Volume known = layer;
    const Grid& grid = layer.grid;
    for (std::size_t i = 0; i < known.validity.size(); ++i) {
        if (known.validity[i] != 0)
            continue;
        int nearest = reach * reach + 1;
        for (int n = 0; n < width * width * width; ++n) {
            const glm::ivec3 way =
                glm::ivec3(n % width, n / width % width, n / width / width) - reach;
            const glm::ivec3 there = grid.cell_at(i) + way;
            const int distance = way.x * way.x + way.y * way.y + way.z * way.z;
            if (distance >= nearest || !grid.contains(there)
                || known.validity[grid.index(there)] == 0)
                continue;
            nearest = distance;
            layer.sh[0][i] = known.sh[0][grid.index(there)];
            layer.validity[i] = 1;
        }
    }
}

/// The error of one layer of cells as a volume of that layer alone, whose mean luminance is the
/// false colour, white at `white`; that is chosen where it is 0. Where few cells are valid in both,
/// as of probes, each is spread over those around it.
Volume false_colours(const Volume& a, const Volume& b, const std::vector<float>& cell_error,
                     options::Slice slice, double& white) {
    Volume layer;
    layer.grid = a.grid;
    layer.grid.dims[slice.axis] = 1;
    layer.sh_order = 0;
    layer.sh.resize(1);
    std::vector<float> errors, valid;
    glm::ivec3 cell;
    for (cell.z = 0; cell.z < a.grid.dims.z; ++cell.z)
        for (cell.y = 0; cell.y < a.grid.dims.y; ++cell.y)
            for (cell.x = 0; cell.x < a.grid.dims.x; ++cell.x)
                if (cell[slice.axis] == slice.index) {
                    errors.push_back(cell_error[a.grid.index(cell)]);
                    layer.validity.push_back(volume::valid_in_both(a, b, a.grid.index(cell)));
                    if (layer.validity.back() != 0)
                        valid.push_back(errors.back());
                }
    if (white == 0)
        white = io::error_white(valid);
    for (const float error : errors)
        layer.sh[0].push_back(io::false_colour(error / white) / volume::sh_y0);
    if (10 * valid.size() < errors.size())
        spread(layer);
    return layer;
}

/// As --slice has it.
std::string slice_text(const options::Slice& slice) {
    return std::string(1, "xyz"[slice.axis]) + "=" + std::to_string(slice.index);
}

/// Writes what was asked for, and puts the picture's scale into `white`.
void write_outputs(const DiffOptions& o, const Volume& a, const Volume& b,
                   const volume::Comparison& comparison, double& white) {
    const auto base = [](const std::string& path) { return fs::path(path).filename().string(); };
    if (o.slice)
        options::check_slice(*o.slice, a.grid);
    white = o.slice_max;
    for (const std::string& output : o.outputs) {
        if (options::has_extension(output, ".png")) {
            const Volume layer = false_colours(a, b, comparison.cell_error, *o.slice, white);
            const io::Legend legend{slice_text(*o.slice) + ", % of mean",
                                    [](double share) {
                                        const glm::vec3 linear = io::false_colour(share);
                                        return glm::vec3(colour::linear_to_srgb(linear.r),
                                                         colour::linear_to_srgb(linear.g),
                                                         colour::linear_to_srgb(linear.b));
                                    },
                                    [&white](double share) { return 100 * white * share; }};
            io::write_png(output,
                          io::chart(io::slice_picture(layer, o.slice->axis, 0, io::SliceScale{}),
                                    a.grid, o.slice->axis, legend));
            continue;
        }
        Volume volume = volume::difference(a, b);
        volume.metadata = {{"content", "difference of two volumes"},
                           {"minuend", base(o.a)},
                           {"subtrahend", base(o.b)}};
        for (const std::string& warning :
             io::write_volume(output, std::move(volume), Precision::full).warnings)
            print_warning(warning);
    }
}

/// Warns where both are known to hold light, or a quantity, that the other does not.
void warn_of_light(const DiffOptions& o, const Volume& a, const Volume& b) {
    const auto warn = [&](const std::string& of_a, const std::string& of_b) {
        print_warning(o.a + ": holds other light than " + o.b + ": " + of_a + " against " + of_b);
    };
    const auto light_a = volume::content_in(a.metadata), light_b = volume::content_in(b.metadata);
    if (light_a && light_b && *light_a != *light_b)
        warn(volume::sentence_of(*light_a), volume::sentence_of(*light_b));
    const auto of_a = a.metadata.find("quantity"), of_b = b.metadata.find("quantity");
    if (of_a != a.metadata.end() && of_b != b.metadata.end() && of_a->second != of_b->second)
        warn(of_a->second, of_b->second);
}

/// Throws Error (invalid) where there is nothing to compare.
report::Difference compare(const DiffOptions& o, const Volume& a, const Volume& b) {
    const std::string both = o.a + " and " + o.b;
    if (const auto why = volume::lattice_difference(a.grid, b.grid))
        throw Error(ErrorKind::invalid,
                    both + " are not on one grid: " + *why
                        + "; bake both with the same --bounds, --resolution and --margin");
    report::Difference difference{o.a,
                                  o.b,
                                  a,
                                  b,
                                  volume::compare(a, b, {{o.fail.limit, o.warn.limit}, o.worst}),
                                  o.fail,
                                  o.warn,
                                  o.metadata,
                                  report::metadata_difference(a, b)};
    const volume::Comparison& comparison = difference.comparison;
    if (comparison.samples == 0 && !comparison.identical)
        throw Error(ErrorKind::invalid,
                    both + " have no cell that is valid in both: there is nothing to compare");
    return difference;
}

/// What is told when all is printed.
void judge(const report::Difference& difference) {
    const std::string &a = difference.path_a, &b = difference.path_b;
    if (const auto failed = report::failure(difference))
        throw Error(ErrorKind::difference, a + " differs from " + b + *failed);
    if (const auto warned = report::warning(difference))
        print_warning(a + ": differs from " + b + ": " + *warned);
}

/// Throws Error (invalid) unless both have the same members.
void check_sets(const DiffOptions& o, const volume::VolumeSet& a, const volume::VolumeSet& b) {
    const char* what = a.places.empty() ? "levels" : "volumes";
    if (a.places.empty() != b.places.empty())
        throw Error(ErrorKind::invalid, o.a + " and " + o.b
                                            + ": one is of nested levels, the other of volumes "
                                              "beside each other; give the files of one each");
    if (a.levels.size() != b.levels.size())
        throw Error(ErrorKind::invalid,
                    format("%s has %zu %s, %s %zu", o.a.c_str(), a.levels.size(), what, o.b.c_str(),
                           b.levels.size()));
    for (std::size_t i = 0; i < a.places.size(); ++i)
        if (a.places[i].name != b.places[i].name)
            throw Error(ErrorKind::invalid, o.a + " has a volume " + a.places[i].name + " where "
                                                + o.b + " has " + b.places[i].name);
}

/// Of nested levels or volumes beside each other, or of bricks as one volume.
void tell_of(const DiffOptions& o, const std::vector<report::Difference>& differences,
             const char* what = "levels") {
    if (o.format == Format::json) {
        report::Json levels = report::Json::array();
        for (const report::Difference& difference : differences) {
            levels.push_back(report::difference_json(difference));
            levels.back()["slice"] = nullptr;
            levels.back()["outputs"] = report::Json::array();
        }
        print_json({{"command", "diff"}, {"a", o.a}, {"b", o.b}, {what, levels}});
    } else {
        for (const report::Difference& difference : differences)
            print_text(report::difference_text(difference) + "result     "
                       + report::verdict(difference) + "\n");
    }
    finish_stdout();
    for (const report::Difference& difference : differences)
        judge(difference);
}

/// Of a set, each with its own.
void run_levels(const DiffOptions& o) {
    if (!io::is_manifest(o.a) || !io::is_manifest(o.b))
        throw Error(ErrorKind::argument, o.a + " and " + o.b
                                             + ": one is a set of volumes, the other one volume; "
                                               "first lpvbake convert --flatten levels, or give "
                                               "the file of one");
    if (!o.outputs.empty())
        throw Error(ErrorKind::argument,
                    o.outputs.front() + ": no output is made of a set; give the files of one");
    const volume::VolumeSet a = io::read_levels(o.a), b = io::read_levels(o.b);
    if (a.bricks || b.bricks) {
        if (!(a.bricks == b.bricks))
            throw Error(ErrorKind::invalid, o.a + " and " + o.b
                                                + " have not the same bricks; first lpvbake "
                                                  "convert --flatten them");
        const Volume all_a = volume::stacked(a.levels), all_b = volume::stacked(b.levels);
        warn_of_light(o, all_a, all_b);
        tell_of(o, {compare(o, all_a, all_b)});
        return;
    }
    check_sets(o, a, b);
    std::vector<report::Difference> differences;
    for (std::size_t level = 0; level < a.levels.size(); ++level) {
        DiffOptions own = o;
        own.a += " " + volume::title_of(a, level);
        own.b += " " + volume::title_of(b, level);
        warn_of_light(own, a.levels[level], b.levels[level]);
        differences.push_back(compare(own, a.levels[level], b.levels[level]));
    }
    tell_of(o, differences, a.places.empty() ? "levels" : "volumes");
}

/// Those cells of a world that lie on the grid of the other volume.
Volume read_part(const std::string& path, const WorldOptions& o, const std::string& other,
                 const Grid& grid) {
    const io::WorldVolume world = open_world(path, o);
    const glm::dvec3 begin = glm::round(world.grid.to_grid(grid.origin));
    Grid part = world.grid;
    part.origin += part.cell * begin;
    part.dims = grid.dims;
    const auto why = volume::lattice_difference(part, grid);
    if (why || glm::any(glm::lessThan(begin, glm::dvec3(0)))
        || glm::any(glm::greaterThan(begin + glm::dvec3(grid.dims), glm::dvec3(world.grid.dims))))
        throw Error(ErrorKind::invalid, other + " is no part of " + path + ": "
                                            + why.value_or("it reaches beyond the tiles")
                                            + "; bake it with the plan's --cell-size and with "
                                              "--bounds at whole cells");
    return io::read_cells(world, glm::ivec3(begin), glm::ivec3(begin) + grid.dims, o.max_memory);
}

/// Of a world and another volume what the two have in common: the volume's grid.
std::pair<Volume, Volume> read_both(const DiffOptions& o) {
    const bool of_a = io::is_world(o.a), of_b = io::is_world(o.b);
    if (of_a == of_b)
        return of_a ? std::pair(read_world(o.a, o.world_a), read_world(o.b, o.world_b))
                    : std::pair(read_volume(o.a), read_volume(o.b));
    Volume alone = read_volume(of_a ? o.b : o.a);
    if (of_a) {
        Volume part = read_part(o.a, o.world_a, o.b, alone.grid);
        return {std::move(part), std::move(alone)};
    }
    Volume part = read_part(o.b, o.world_b, o.a, alone.grid);
    return {std::move(alone), std::move(part)};
}

/// "NAME", or "NAME,NAME": of A, and of B.
void take_scenarios(DiffOptions& o) {
    const std::string both = o.world_a.scenario;
    const std::size_t comma = both.find(',');
    o.world_a.scenario = both.substr(0, comma);
    o.world_b = o.world_a;
    if (comma != both.npos)
        o.world_b.scenario = both.substr(comma + 1);
}

void run(const DiffOptions& o) {
    check_options(o);
    if (io::is_manifest(o.a) || io::is_manifest(o.b)) {
        run_levels(o);
        return;
    }
    const auto [a, b] = read_both(o);
    const report::Difference difference = compare(o, a, b);
    warn_of_light(o, a, b);
    double white = 0;
    write_outputs(o, a, b, difference.comparison, white);
    if (o.format == Format::json) {
        report::Json document = report::difference_json(difference);
        document["slice"] = nullptr;
        if (o.slice)
            document["slice"] = {{"slice", slice_text(*o.slice)}, {"max", white}};
        document["outputs"] = o.outputs;
        print_json(document);
    } else {
        print_text(report::difference_text(difference));
        if (o.slice)
            std::printf("slice      %s, white is %.4g %% of B's mean\n",
                        slice_text(*o.slice).c_str(), 100 * white);
        for (const std::string& output : o.outputs)
            std::printf("wrote      %s\n", output.c_str());
        std::printf("result     %s\n", report::verdict(difference).c_str());
    }
    finish_stdout();
    judge(difference);
}

/// The three options of a threshold, which excuse a difference of values once one is given.
void add_threshold(options::Options& options, const std::string& name, report::Threshold& threshold,
                   const std::string& help, const std::string& percent_help,
                   const std::string& hard_help) {
    constexpr double most = 1e30;
    options.share("--" + name, threshold.limit, 0, most, help);
    options.number("--" + name + "-percent", threshold.percent, 0, 100, percent_help);
    options.share("--hard-" + name, threshold.hard, 0, most, hard_help).usual.clear();
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<DiffOptions>();
    DiffOptions& o = *fields;
    options.text("A", o.a, "FILE", "Volume to judge").require();
    options.text("B", o.b, "FILE", "Reference").require();
    options.text("--scenario", o.world_a.scenario, "NAME[,NAME]",
                 "Of a .world.json the lighting that is read, or those of A and of B; of one alone "
                 "it need not be said");
    add_cells_option(options, o.world_a);

    options.group("Thresholds");
    add_threshold(options, "fail", o.fail,
                  "Difference above which a sample fails, as a fraction of B's mean irradiance",
                  "Percentage of samples that may fail",
                  "Difference that no sample may exceed; default: none");
    add_threshold(options, "warn", o.warn, "As --fail, for a warning",
                  "As --fail-percent, for a warning", "As --hard-fail, for a warning");
    options.flag("--metadata", o.metadata, "Different metadata fail too");

    options.group("Output");
    options.texts("-o,--output", o.outputs, "FILE",
                  "Volume of A - B (" + io::format_list(", ")
                      + ") or picture of a slice (.png) to write; may be repeated");
    options.value("--slice", o.slice, "AXIS=INDEX", options::parse_slice,
                  "Layer of cells to draw, such as z=16; needs -o FILE.png");
    options::Option& white =
        options.share("--slice-max", o.slice_max, 0, 1e30,
                      "Mean difference of a cell that is drawn white, as a fraction of B's mean; "
                      "default: the slice's 99th percentile, at most six times its median");
    white.usual.clear();
    white.need("slice");
    options.number("--worst", o.worst, 0, 1'000'000, "Cells to list");
    add_format_option(options, o.format);

    return [fields, &options] {
        const auto given = [&](const std::string& name) {
            return !options.find(name)->given.empty()
                   || !options.find(name + "-percent")->given.empty()
                   || !options.find("hard-" + name)->given.empty();
        };
        fields->fail.given = given("fail");
        fields->warn.given = given("warn");
        take_scenarios(*fields);
        run(*fields);
    };
}

} // namespace

options::Command diff_command() {
    return {"diff", "Tells how far volume A is from the reference B on the same grid.", manual,
            declare};
}

} // namespace lpvbake::cmd
