// lpvbake diff: how far one volume is from another, and where.

#include "commands.h"
#include "error.h"
#include "io/io.h"
#include "io/slice.h"
#include "scene_options.h"
#include "volume/compare.h"
#include "volume/light_content.h"
#include "volume/sh.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <sstream>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/diff.txt.h"
    ;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// What idiff calls fail, failpercent and hardfail.
struct Threshold {
    double limit = 0;       ///< difference above which a sample exceeds
    double percent = 0;     ///< of the samples may exceed
    double hard = infinity; ///< no sample may differ by more
    bool given = false;
};

struct DiffOptions {
    std::string a, b;
    Threshold fail, warn;
    bool metadata = false;
    int worst = 5;
    std::vector<std::string> outputs;
    std::optional<Slice> slice;
    double slice_max = 0; ///< 0: the slice's own
    Format format = Format::text;
};

// ---------------------------------------------------------------- reading the command line

/// One name for a volume's files: that of a flipbook's sidecar for any of its own.
fs::path identity(const std::string& path) {
    fs::path name = fs::weakly_canonical(fs::absolute(path));
    const VolumeFormat* format = volume_format(path);
    return format && format->sidecar[0] ? name.replace_extension(format->sidecar) : name;
}

/// All that can be known to be wrong before the volumes are read.
void check_options(const DiffOptions& o) {
    bool picture = false;
    std::vector<fs::path> names;
    for (const std::string& output : o.outputs) {
        const bool png = has_extension(output, ".png");
        picture = picture || png;
        if (!png && !volume_format(output))
            throw Error(ErrorKind::argument, output + ": the name of an output ends in "
                                                 + format_list(", ") + " or .png");
        for (const std::string& input : {o.a, o.b})
            if (identity(output) == identity(input))
                throw Error(ErrorKind::argument, output + ": would replace the input " + input);
        if (std::ranges::find(names, identity(output)) != names.end())
            throw Error(ErrorKind::argument, output + ": given twice as an output");
        names.push_back(identity(output));
    }
    if (o.slice.has_value() != picture)
        throw Error(ErrorKind::argument,
                    "--slice and a picture belong together: --slice z=16 -o error.png");
}

// ---------------------------------------------------------------- outputs

/// The error of one layer of cells as a volume of that layer alone, whose mean luminance is the
/// false colour, white at `white`; that is chosen where it is 0.
Volume false_colours(const Volume& a, const Volume& b, const std::vector<float>& cell_error,
                     Slice slice, double& white) {
    Volume layer;
    layer.grid = a.grid;
    layer.grid.dims[slice.axis] = 1;
    layer.sh_order = 0;
    layer.sh.resize(1);
    std::vector<float> errors;
    glm::ivec3 cell;
    for (cell.z = 0; cell.z < a.grid.dims.z; ++cell.z)
        for (cell.y = 0; cell.y < a.grid.dims.y; ++cell.y)
            for (cell.x = 0; cell.x < a.grid.dims.x; ++cell.x)
                if (cell[slice.axis] == slice.index) {
                    errors.push_back(cell_error[a.grid.index(cell)]);
                    layer.validity.push_back(valid_in_both(a, b, a.grid.index(cell)));
                }
    if (white == 0)
        white = error_white(errors);
    for (const float error : errors)
        layer.sh[0].push_back(false_colour(error / white) / sh_y0);
    return layer;
}

/// Writes what was asked for, and puts the picture's scale into `white`.
void write_outputs(const DiffOptions& o, const Volume& a, const Volume& b,
                   const Comparison& comparison, double& white) {
    const auto base = [](const std::string& path) { return fs::path(path).filename().string(); };
    if (o.slice)
        check_slice(*o.slice, a.grid);
    white = o.slice_max;
    for (const std::string& output : o.outputs) {
        if (has_extension(output, ".png")) {
            const Volume layer = false_colours(a, b, comparison.cell_error, *o.slice, white);
            write_png(output, slice_picture(layer, o.slice->axis, 0, 1.0f));
            continue;
        }
        Volume volume = difference(a, b);
        volume.metadata = {{"content", "difference of two volumes"},
                           {"minuend", base(o.a)},
                           {"subtrahend", base(o.b)}};
        for (const std::string& warning :
             write_volume(output, std::move(volume), Precision::full).warnings)
            std::fprintf(stderr, "lpvbake: warning: %s\n", warning.c_str());
    }
}

// ---------------------------------------------------------------- the result

/// Keys that only one has, and those with two values.
struct MetadataDifference {
    std::map<std::string, std::string> only_a, only_b;
    std::map<std::string, std::pair<std::string, std::string>> different;

    bool any() const { return !only_a.empty() || !only_b.empty() || !different.empty(); }
};

MetadataDifference metadata_difference(const Volume& a, const Volume& b) {
    MetadataDifference result;
    for (const auto& [key, value] : a.metadata) {
        const auto other = b.metadata.find(key);
        if (other == b.metadata.end())
            result.only_a[key] = value;
        else if (other->second != value)
            result.different[key] = {value, other->second};
    }
    for (const auto& [key, value] : b.metadata)
        if (!a.metadata.contains(key))
            result.only_b[key] = value;
    return result;
}

/// Everything that the two forms of the result say.
struct DiffResult {
    const DiffOptions& options;
    const Volume& a;
    const Volume& b;
    const Comparison& comparison;
    MetadataDifference metadata;
    double slice_max = 0;
    std::string verdict; ///< identical, pass, warning or fail
};

/// As --slice has it.
std::string slice_text(const Slice& slice) {
    return std::string(1, "xyz"[slice.axis]) + "=" + std::to_string(slice.index);
}

Json to_json(const Threshold& threshold, uint64_t exceeding) {
    if (!threshold.given)
        return nullptr;
    return {{"limit", threshold.limit},
            {"percent", threshold.percent},
            {"hard", threshold.hard},
            {"exceeding", exceeding}};
}

std::string channel_name(int channel, const GridKind& kind = light_kind()) {
    return kind.width() == 1 ? "" : std::string(1, kind.channels[channel]);
}

Json json_of(const DiffResult& result) {
    const Comparison& c = result.comparison;
    const DiffOptions& o = result.options;
    const Grid& grid = result.b.grid;
    Json document{{"command", "diff"},
                  {"a", o.a},
                  {"b", o.b},
                  {"result", result.verdict},
                  {"grid", grid_json(grid)},
                  {"sh_order", {result.a.sh_order, result.b.sh_order}},
                  {"cells",
                   {{"valid_both", c.valid_both},
                    {"valid_only_a", c.valid_only_a},
                    {"valid_only_b", c.valid_only_b},
                    {"valid_neither", c.valid_neither}}},
                  {"samples", c.samples},
                  {"irradiance",
                   {{"mean_a", c.mean_a},
                    {"mean_b", c.mean_b},
                    {"relative_l1", c.relative_l1},
                    {"rms", c.rms},
                    {"relative_rms", c.relative_rms},
                    {"percentile95", c.percentile95},
                    {"max", c.max},
                    {"negative_a", c.negative_a},
                    {"negative_b", c.negative_b}}},
                  {"energy", {{"a", c.energy_a}, {"b", c.energy_b}, {"ratio", c.energy_ratio}}},
                  {"fail", to_json(o.fail, c.exceeding[0])},
                  {"warn", to_json(o.warn, c.exceeding[1])},
                  {"worst", Json::array()},
                  {"grids", Json::array()},
                  {"only_a", c.only_a},
                  {"only_b", c.only_b},
                  {"metadata",
                   {{"only_a", result.metadata.only_a},
                    {"only_b", result.metadata.only_b},
                    {"different", result.metadata.different}}},
                  {"slice", nullptr},
                  {"outputs", o.outputs}};
    for (const IrradianceSample& sample : c.worst)
        document["worst"].push_back({{"cell", vector_json(sample.cell)},
                                     {"position", vector_json(grid.center(sample.cell))},
                                     {"normal", vector_json(sample.normal)},
                                     {"channel", channel_name(sample.channel)},
                                     {"a", sample.a},
                                     {"b", sample.b},
                                     {"difference", sample.difference}});
    for (const GridDifference& of_grid : c.grids) {
        const std::string channel = channel_name(of_grid.channel, *of_grid.kind);
        Json entry{{"name", of_grid.name},
                   {"cells", of_grid.cells},
                   {"cells_valid_both", of_grid.cells_valid_both},
                   {"max_abs", of_grid.max_abs},
                   {"rms", of_grid.rms},
                   {"relative", of_grid.relative},
                   {"worst", nullptr}};
        if (of_grid.cells > 0)
            entry["worst"] = {{"cell", vector_json(of_grid.cell)},
                              {"position", vector_json(grid.center(of_grid.cell))},
                              {"channel", channel.empty() ? Json(nullptr) : Json(channel)},
                              {"a", of_grid.a},
                              {"b", of_grid.b}};
        document["grids"].push_back(entry);
    }
    if (o.slice)
        document["slice"] = {{"slice", slice_text(*o.slice)}, {"max", result.slice_max}};
    return document;
}

/// The parts of `text` (between semicolons or lines) that `other` lacks, each after `label`.
void print_parts(const char* label, std::string text, std::string other) {
    const auto parts = [](std::string& whole) {
        std::ranges::replace(whole, '\n', ';');
        std::vector<std::string> list = split(whole, ';');
        for (std::string& part : list)
            part.erase(0, part.find_first_not_of(' '));
        return list;
    };
    const std::vector<std::string> there = parts(other);
    for (const std::string& part : parts(text))
        if (std::ranges::find(there, part) == there.end())
            std::printf("    %s  %s\n", label, part.c_str());
}

void print_threshold(const char* name, const Threshold& threshold, uint64_t exceeding,
                     const Comparison& c) {
    if (!threshold.given)
        return;
    std::printf("%-10s %llu samples (%.4g %%) differ by more than %.4g %%; %.4g %% may", name,
                static_cast<unsigned long long>(exceeding),
                c.samples > 0 ? 100.0 * double(exceeding) / double(c.samples) : 0.0,
                100 * threshold.limit, threshold.percent);
    if (threshold.hard < infinity)
        std::printf(", none by more than %.4g %%", 100 * threshold.hard);
    std::printf("\n");
}

void print_text(const DiffResult& result) {
    const Comparison& c = result.comparison;
    const DiffOptions& o = result.options;
    const Grid& grid = result.b.grid;
    const auto number = [](uint64_t n) { return static_cast<unsigned long long>(n); };
    std::printf("A          %s\n", o.a.c_str());
    std::printf("B          %s (reference)\n", o.b.c_str());
    std::printf("grid       %d x %d x %d cells of %.6g m\n", grid.dims.x, grid.dims.y, grid.dims.z,
                grid.cell);
    if (result.a.sh_order != result.b.sh_order)
        std::printf("SH order   %d in A, %d in B: irradiance is from all bands that each has,\n"
                    "           coefficients are compared where both have them\n",
                    result.a.sh_order, result.b.sh_order);
    std::printf("valid      %llu cells in both, %llu only in A, %llu only in B, %llu in neither\n",
                number(c.valid_both), number(c.valid_only_a), number(c.valid_only_b),
                number(c.valid_neither));
    std::printf("samples    %llu (cells valid in both x 26 normals x RGB)\n", number(c.samples));
    std::printf("irradiance %.6g lx in A, %.6g lx in B on average\n", c.mean_a, c.mean_b);
    std::printf("  L1               %10.4g %%  sum |A - B| / sum B\n", 100 * c.relative_l1);
    std::printf("  RMS              %10.4g %%  of B's mean, %.4g lx\n", 100 * c.relative_rms,
                c.rms);
    std::printf("  95th percentile  %10.4g %%  of B's mean\n", 100 * c.percentile95);
    std::printf("  largest          %10.4g %%  of B's mean\n", 100 * c.max);
    std::printf("  negative         %llu samples of A, %llu of B; clamped to 0\n",
                number(c.negative_a), number(c.negative_b));
    std::printf("energy     A / B = %.6g (%.6g and %.6g nit sr in cells valid in both)\n",
                c.energy_ratio, c.energy_a, c.energy_b);
    print_threshold("fail", o.fail, c.exceeding[0], c);
    print_threshold("warn", o.warn, c.exceeding[1], c);

    if (!c.worst.empty())
        std::printf("worst cells\n");
    for (const IrradianceSample& sample : c.worst) {
        const glm::dvec3 p = grid.center(sample.cell), n = sample.normal;
        std::printf("  (%d, %d, %d) at (%.6g, %.6g, %.6g) m, normal (%.2g, %.2g, %.2g), %s: "
                    "A %.6g lx, B %.6g lx, %.4g %%\n",
                    sample.cell.x, sample.cell.y, sample.cell.z, p.x, p.y, p.z, n.x, n.y, n.z,
                    channel_name(sample.channel).c_str(), sample.a, sample.b,
                    100 * sample.difference);
    }
    for (const GridDifference& of_grid : c.grids) {
        const std::string channel = channel_name(of_grid.channel, *of_grid.kind);
        if (of_grid.cells == 0) {
            std::printf("%-14s  same\n", of_grid.name.c_str());
            continue;
        }
        const glm::dvec3 p = grid.center(of_grid.cell);
        std::printf("%-14s  max %.4g, RMS %.4g (%.4g %%); %llu cells, %llu of them valid in both\n",
                    of_grid.name.c_str(), of_grid.max_abs, of_grid.rms, 100 * of_grid.relative,
                    number(of_grid.cells), number(of_grid.cells_valid_both));
        std::printf("  max in (%d, %d, %d) at (%.6g, %.6g, %.6g) m%s%s: A %.9g, B %.9g\n",
                    of_grid.cell.x, of_grid.cell.y, of_grid.cell.z, p.x, p.y, p.z,
                    channel.empty() ? "" : ", ", channel.c_str(), double(of_grid.a),
                    double(of_grid.b));
    }
    for (const std::string& name : c.only_a)
        std::printf("%-14s  only in A\n", name.c_str());
    for (const std::string& name : c.only_b)
        std::printf("%-14s  only in B\n", name.c_str());
    const MetadataDifference& metadata = result.metadata;
    std::printf("metadata   %s\n", metadata.any() ? "different" : "same");
    for (const auto& [key, value] : metadata.only_a)
        std::printf("  lpv:%s only in A: %s\n", key.c_str(), value.c_str());
    for (const auto& [key, value] : metadata.only_b)
        std::printf("  lpv:%s only in B: %s\n", key.c_str(), value.c_str());
    for (const auto& [key, values] : metadata.different) {
        std::printf("  lpv:%s\n", key.c_str());
        print_parts("A", values.first, values.second);
        print_parts("B", values.second, values.first);
    }
    if (o.slice)
        std::printf("slice      %s, white is %.4g %% of B's mean\n", slice_text(*o.slice).c_str(),
                    100 * result.slice_max);
    for (const std::string& output : o.outputs)
        std::printf("wrote      %s\n", output.c_str());
    std::printf("result     %s\n", result.verdict.c_str());
}

/// Why the threshold is not kept; none: it is.
std::optional<std::string> offence(const Threshold& threshold, uint64_t exceeding,
                                   const Comparison& comparison) {
    std::ostringstream text;
    text.precision(4);
    if (comparison.max > threshold.hard)
        text << "a sample differs by " << 100 * comparison.max << " % of the mean, "
             << 100 * threshold.hard << " % is the limit of any";
    else if (double(exceeding) > threshold.percent / 100 * double(comparison.samples))
        text << exceeding << " of " << comparison.samples << " samples differ by more than "
             << 100 * threshold.limit << " % of the mean";
    else
        return {};
    return text.str();
}

/// How A differs, to follow "A differs from B"; none: it does not fail.
std::optional<std::string> failure(const DiffResult& result) {
    const DiffOptions& o = result.options;
    if (o.metadata && result.metadata.any())
        return " in its metadata";
    if (o.fail.given) {
        const auto why = offence(o.fail, result.comparison.exceeding[0], result.comparison);
        return why ? std::optional(": " + *why) : std::nullopt;
    }
    if (result.comparison.identical)
        return {};
    std::string grids;
    const auto list = [&](const std::string& name, const char* where) {
        grids += (grids.empty() ? "" : ", ") + name + where;
    };
    for (const GridDifference& grid : result.comparison.grids)
        if (grid.cells > 0)
            list(grid.name, "");
    for (const std::string& name : result.comparison.only_a)
        list(name, " (only in A)");
    for (const std::string& name : result.comparison.only_b)
        list(name, " (only in B)");
    return " in " + grids;
}

/// Warns where both are known to hold light, or a quantity, that the other does not.
void warn_of_light(const Volume& a, const Volume& b) {
    const auto warn = [](const std::string& of_a, const std::string& of_b) {
        std::fprintf(stderr, "lpvbake: warning: the two hold different light: %s against %s\n",
                     of_a.c_str(), of_b.c_str());
    };
    const auto light_a = content_in(a.metadata), light_b = content_in(b.metadata);
    if (light_a && light_b && *light_a != *light_b)
        warn(sentence_of(*light_a), sentence_of(*light_b));
    const auto of_a = a.metadata.find("quantity"), of_b = b.metadata.find("quantity");
    if (of_a != a.metadata.end() && of_b != b.metadata.end() && of_a->second != of_b->second)
        warn(of_a->second, of_b->second);
}

void run(const DiffOptions& o) {
    check_options(o);
    const Volume a = read_volume(o.a), b = read_volume(o.b);
    const std::string both = o.a + " and " + o.b;
    if (const auto why = lattice_difference(a.grid, b.grid))
        throw Error(ErrorKind::invalid,
                    both + " are not on one grid: " + *why
                        + "; bake both with the same --bounds, --resolution and --margin");
    warn_of_light(a, b);
    const Comparison comparison = compare(a, b, {{o.fail.limit, o.warn.limit}, o.worst});
    if (comparison.samples == 0 && !comparison.identical)
        throw Error(ErrorKind::invalid,
                    both + " have no cell that is valid in both: there is nothing to compare");
    DiffResult result{o, a, b, comparison, metadata_difference(a, b), 0, ""};
    write_outputs(o, a, b, comparison, result.slice_max);

    const std::optional<std::string> failed = failure(result);
    std::optional<std::string> warned;
    if (o.warn.given)
        warned = offence(o.warn, comparison.exceeding[1], comparison);
    result.verdict = failed                 ? "fail"
                     : warned               ? "warning"
                     : comparison.identical ? "identical"
                                            : "pass";
    o.format == Format::json ? print_json(json_of(result)) : print_text(result);
    finish_stdout();
    if (failed)
        throw Error(ErrorKind::difference, o.a + " differs from " + o.b + *failed);
    if (warned)
        std::fprintf(stderr, "lpvbake: warning: %s differs from %s: %s\n", o.a.c_str(), o.b.c_str(),
                     warned->c_str());
}

/// The three options of a threshold, which excuse a difference of values once one is given.
void add_threshold(Options& options, const std::string& name, Threshold& threshold,
                   const std::string& help, const std::string& percent_help,
                   const std::string& hard_help) {
    constexpr double most = 1e30;
    options.share("--" + name, threshold.limit, 0, most, help);
    options.number("--" + name + "-percent", threshold.percent, 0, 100, percent_help);
    options.share("--hard-" + name, threshold.hard, 0, most, hard_help).usual.clear();
}

Action declare(Options& options) {
    const auto fields = std::make_shared<DiffOptions>();
    DiffOptions& o = *fields;
    options.text("A", o.a, "FILE", "Volume to judge").require();
    options.text("B", o.b, "FILE", "Reference").require();

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
                  "Volume of A - B (" + format_list(", ")
                      + ") or picture of a slice (.png) to write; may be repeated");
    options.value("--slice", o.slice, "AXIS=INDEX", parse_slice,
                  "Layer of cells to draw, such as z=16; needs -o FILE.png");
    Option& white =
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
        run(*fields);
    };
}

} // namespace

Command diff_command() {
    return {"diff", "Tells how far volume A is from the reference B on the same grid.", manual,
            declare};
}

} // namespace lpvbake
