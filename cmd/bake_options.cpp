#include "bake_options.h"

#include "bake/bake.h"
#include "bake/rooms.h"
#include "io/boxes.h"
#include "io/bricks.h"
#include "io/levels.h"
#include "io/points.h"
#include "layer_files.h"
#include "lpvbake/error.h"
#include "text.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <iterator>
#include <string_view>

namespace lpvbake::cmd {
namespace {

/// "FINE..COARSE".
glm::dvec2 parse_adaptive(const std::string& text) {
    const std::size_t dots = text.find("..");
    const auto fine =
        dots == std::string::npos ? std::nullopt : options::parse_number(text.substr(0, dots));
    const auto coarse = fine ? options::parse_number(text.substr(dots + 2)) : std::nullopt;
    if (!coarse || !(*fine > 0) || !(*coarse > 0))
        options::refuse(text, "is not FINE..COARSE, cells in metres");
    return {*fine, *coarse};
}

/// Of --adaptive, where neither error nor size is given.
constexpr double usual_brick_error = 0.02;

/// "X0,Y0,Z0,X1,Y1,Z1:CELL" or "NODES:CELL".
LevelOption parse_level(const std::string& text) {
    const std::size_t colon = text.rfind(':');
    const auto cell =
        colon == std::string::npos ? std::nullopt : options::parse_number(text.substr(colon + 1));
    if (!cell || !(*cell > 0))
        options::refuse(text, "is not X0,Y0,Z0,X1,Y1,Z1:CELL or NODES:CELL, in metres");
    return {parse_box(text.substr(0, colon)), *cell};
}

/// "NAME=X0,Y0,Z0,X1,Y1,Z1[:CELL]".
GivenVolume parse_volume(const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
        options::refuse(text, "is not NAME=X0,Y0,Z0,X1,Y1,Z1 or NAME=X0,Y0,Z0,X1,Y1,Z1:CELL");
    GivenVolume given{text.substr(0, equals), {}, {}};
    const std::string box = text.substr(equals + 1);
    const std::size_t colon = box.rfind(':');
    if (colon != std::string::npos) {
        given.cell = options::parse_number(box.substr(colon + 1));
        if (!given.cell || !(*given.cell > 0))
            options::refuse(text, "has no size of cells above 0, metres, behind its box");
    }
    given.box = options::parse_bounds(box.substr(0, colon));
    return given;
}

constexpr std::string_view nodes_prefix = "nodes:";
constexpr const char* auto_volumes = "auto";

// ---------------------------------------------------------------- options of solvers

/// "sn", "sn or gather".
std::string names_of(const std::vector<const solver::SolverKind*>& solvers,
                     const char* last = " or ") {
    std::string names;
    for (const solver::SolverKind* solver : solvers)
        names += (names.empty() ? "" : last) + std::string(solver->name);
    return names;
}

std::vector<const solver::SolverKind*> solvers_with(const auto& has) {
    std::vector<const solver::SolverKind*> solvers;
    std::ranges::copy_if(bake::solver_kinds(), std::back_inserter(solvers),
                         [&](const solver::SolverKind* kind) { return has(*kind); });
    return solvers;
}

/// Whether a quality makes a difference.
bool wants_transfer(const BakeOptions& o) {
    return std::ranges::any_of(o.layers, [](const std::vector<bake::LayerWish>& wishes) {
        return std::ranges::count(wishes, bake::LayerWish::Kind::transfer, &bake::LayerWish::kind)
               > 0;
    });
}

/// Highest band that is stored.
int kept_order(const io::Target& storage) {
    return std::min(storage.highest_order, volume::highest_order(storage.encoding.convention));
}

bool has_presets(const solver::SolverKind& kind) {
    return std::ranges::count_if(kind.ladder,
                                 [](const solver::Rung& rung) { return bool(rung.preset); })
           > 1;
}

/// The solvers for which the parameter, beside the others that are given, means something.
std::vector<const solver::SolverKind*> solvers_with_parameter(const BakeOptions& o,
                                                              const std::string& name) {
    return solvers_with([&](const solver::SolverKind& kind) {
        const solver::Parameter* own = solver::find_parameter(kind, name);
        if (!own || !own->needs)
            return own != nullptr;
        const auto needed = o.parameters.find(own->needs);
        return needed != o.parameters.end() && needed->second > 0;
    });
}

/// The solvers that may be taken, best first: --solver, or those that have all options that are
/// given. Throws Error (argument) that names the option that none of them has.
std::vector<const solver::SolverKind*> solvers_of(const BakeOptions& o) {
    std::vector<const solver::SolverKind*> solvers =
        o.solver ? std::vector{o.solver} : bake::Wish().solvers;
    std::string why = o.solver ? std::string("--solver ") + o.solver->name : "";
    const auto keep = [&](const std::string& option,
                          const std::vector<const solver::SolverKind*>& with) {
        std::vector<const solver::SolverKind*> left = solvers;
        std::erase_if(left, [&](const solver::SolverKind* solver) {
            return !std::ranges::count(with, solver);
        });
        if (left.empty())
            throw Error(ErrorKind::argument, "--" + option + " is an option of " + names_of(with)
                                                 + ", not of " + names_of(solvers) + " (" + why
                                                 + ")");
        if (left.size() < solvers.size())
            why = "--" + option;
        solvers = left;
    };
    if (o.scattering)
        keep("scattering",
             solvers_with([](const solver::SolverKind& kind) { return kind.in_air; }));
    if (!o.at.empty())
        keep("at", solvers_with([](const solver::SolverKind& kind) { return kind.at_places; }));
    if (o.adaptive)
        keep("adaptive",
             solvers_with([](const solver::SolverKind& kind) { return kind.at_places; }));
    if (o.places())
        keep(o.volume.empty() ? "volumes" : "volume",
             solvers_with([](const solver::SolverKind& kind) {
                 return kind.nesting == solver::Nesting::independent;
             }));
    if (o.nests())
        keep(o.levels ? "levels" : "level", solvers_with([](const solver::SolverKind& kind) {
                 return kind.nesting != solver::Nesting::none;
             }));
    const auto layered = [&](solver::Layering least, const char* option) {
        keep(option,
             solvers_with([=](const solver::SolverKind& kind) { return kind.layers >= least; }));
    };
    if (!o.layers.empty())
        layered(solver::Layering::of_lights, "layers");
    if (!o.layers.empty() && (o.nests() || o.places()))
        layered(solver::Layering::any, "layers of several volumes");
    if (wants_transfer(o))
        layered(solver::Layering::of_parts, "layers transfer");
    for (const std::vector<bake::LayerWish>& wishes : o.layers)
        if (std::ranges::any_of(wishes, [](const auto& wish) { return wish.order >= 0; }))
            layered(solver::Layering::any, "layers sky:N");
    if (o.quality)
        keep("quality", solvers_with(has_presets));
    for (const auto& [name, value] : o.parameters)
        keep(name, solvers_with_parameter(o, name));
    if (o.sh_order > 0)
        keep("sh-order " + std::to_string(o.sh_order),
             solvers_with([&](const solver::SolverKind& kind) {
                 return std::ranges::count(kind.orders, o.sh_order) > 0;
             }));
    return solvers;
}

/// A row for each parameter of a solver; those that several have share one.
void add_parameters(options::Options& options, BakeOptions& o) {
    std::vector<std::string> names;
    for (const solver::SolverKind* kind : bake::solver_kinds())
        for (const solver::Parameter& parameter : kind->parameters)
            if (std::ranges::find(names, parameter.name) == names.end())
                names.push_back(parameter.name);
    for (const std::string& name : names) {
        std::string help;
        std::vector<const solver::Parameter*> all;
        for (const solver::SolverKind* kind : bake::solver_kinds()) {
            const solver::Parameter* own = solver::find_parameter(*kind, name);
            if (!own)
                continue;
            const bool again = !all.empty() && std::string(own->help) == all.back()->help;
            all.push_back(own);
            std::string whose = kind->name;
            if (own->needs)
                whose += " with --" + std::string(own->needs);
            const std::string usual = " (" + solver::value_text(*own, own->usual) + ")";
            help += again ? "" : (help.empty() ? "" : "; ") + whose + ": " + own->help + usual;
            if (again) // "gather with --rsm-samples, lpv: ..."
                help.insert(help.rfind(all.front()->help) - 2, ", " + whose);
        }
        const bool is_choice = all.front()->kind == solver::ValueKind::choice;
        std::string type = all.front()->kind == solver::ValueKind::whole ? "N" : "X";
        if (is_choice) {
            type.clear();
            for (const char* choice : all.front()->choices)
                type.append(type.empty() ? "" : "|").append(choice);
        }
        options::Option& option = options.add("--" + name, type, help);
        option.quoted = is_choice;
        option.read = [&o, name, all](const std::string& text) {
            for (const solver::Parameter* each : all)
                if (const std::optional<double> value = solver::parse_value(*each, text)) {
                    o.parameters[name] = *value;
                    return solver::value_text(*each, *value);
                }
            options::refuse(text, "is none of its values, " + solver::values_of(*all.front()));
        };
        option.implies(solver::value_text(*all.front(), all.front()->usual))
            .record(options::Recorded::if_changed);
    }
}

void add_solver_options(options::Options& options, BakeOptions& o) {
    options.group("Solver");
    options::Choices<const solver::SolverKind*> solvers{{"auto", nullptr}};
    std::string help;
    for (const solver::SolverKind* kind : bake::solver_kinds()) {
        solvers.emplace_back(kind->name, kind);
        help += std::string(kind->name) + ": " + kind->help + "; ";
    }
    options
        .choice("--solver", o.solver, solvers,
                help + "auto: by what is wanted (--error, --time-budget) and given, else "
                    + bake::solver_kinds().front()->name)
        .record();
    options
        .share("--error", o.error, 1e-6, 1, "Error of irradiance that is wanted at most; see below")
        .implies("0.04")
        .record(options::Recorded::if_changed);
    options
        .value("--time-budget", o.seconds, "TIME", options::parse_seconds,
               "Time that a bake may take, as 2s, 500ms or 1.5min (--time is the animation's)")
        .implies("2s")
        .record(options::Recorded::if_changed);
    options
        .value("--bounces", o.bounces, "N|inf", options::parse_bounces,
               "Reflections of light at most, 0 to 10000, or all; default: 1 for lpv, inf for the "
               "others")
        .implies("inf")
        .record(options::Recorded::if_changed);
    options
        .number("--sh-order", o.sh_order, 0, 4,
                "Highest band of the spherical harmonics; 0: 1 for lpv, 2 for the others")
        .record();
    options
        .choice("--quality", o.quality,
                options::choices_named<solver::Quality>(solver::quality_names),
                names_of(solvers_with(has_presets), " and ")
                    + ": time against error (directions, clusters, rays, tolerance); default: "
                      "balanced")
        .implies("balanced")
        .exclude({"error", "time-budget"})
        .record(options::Recorded::if_changed);
    add_parameters(options, o);
}

void add_level_options(options::Options& options, BakeOptions& o) {
    options
        .values("--level", o.level, "X0,Y0,Z0,X1,Y1,Z1:CELL|NODES:CELL", parse_level,
                "Box, metres or as --bounds has it of nodes, with cells of this size; repeated: "
                "nested levels of one scene, cells "
                "powers of two of the finest, into a file each; see below")
        .exclude({"resolution", "cell-size", "bounds", "margin", "levels", "focus", "at", "bytes",
                  "rsm-samples"})
        .record(options::Recorded::if_changed);
    options
        .number("--levels", o.levels, 2, double(volume::most_levels),
                "Nested levels around --focus: cells of --cell-size there, then twice as large in "
                "boxes twice as large, the last over all of the scene or --bounds")
        .exclude({"at", "bytes", "rsm-samples"})
        .need("focus")
        .record(options::Recorded::if_changed);
    options
        .value("--focus", o.focus, "X0,Y0,Z0,X1,Y1,Z1|NODES", parse_box,
               "Box of the finest of --levels, metres, or that of nodes, as of --bounds")
        .need("levels")
        .record(options::Recorded::if_changed);
    options
        .value("--adaptive", o.adaptive, "FINE..COARSE", parse_adaptive,
               "Bricks of 8 x 8 x 8 cells, small where geometry stands and light changes: cells of "
               "FINE to COARSE metres, a power of two apart, in all of the scene or --bounds; into "
                   + io::brick_format_list()
                   + "; --error: what reading between them may lose, of "
                     "all irradiance, default 2 %; see below")
        .exclude({"resolution", "cell-size",  "margin",     "level",         "levels",
                  "focus",      "at",         "bytes",      "verify",        "rsm-samples",
                  "rsm-size",   "tolerance",  "target",     "sh-convention", "axes",
                  "packing",    "dering",     "l1-scale",   "exr-columns",   "dilate",
                  "fit",        "evaluation", "time-budget"})
        .record(options::Recorded::if_changed);
    options
        .value(
            "--max-size", o.max_size, "SIZE", options::parse_bytes,
            "Leave no more bricks of --adaptive than whose numbers fit into SIZE, as 64M, in each "
            "output: those that cost the least error go first")
        .need("adaptive")
        .record(options::Recorded::if_changed);
}

/// "inf", or a whole number from 1.
options::Bounces parse_scattering(const std::string& text) {
    const options::Bounces times = options::parse_bounces(text);
    if (times.most == 0)
        options::refuse(text, "is neither a whole number from 1 nor inf; light that is not "
                              "scattered is that without --medium");
    return times;
}

/// Some of "visibility", "channels", "shaft" and "sh".
bake::DirectSettings parse_direct(const std::string& text) {
    bake::DirectSettings direct;
    for (const std::string& part : options::split(text, ','))
        if (part == "visibility")
            direct.visibility = true;
        else if (part == "sh")
            direct.sh = true;
        else if (part == "channels")
            direct.channels = true;
        else if (part == "shaft")
            direct.shaft = true;
        else
            options::refuse(part, "is none of visibility, channels, shaft and sh");
    return direct;
}

void add_direct_options(options::Options& options, BakeOptions& o) {
    options
        .value(
            "--direct", o.direct, "visibility,channels,shaft,sh", parse_direct,
            "Keep what punctual lights send straight to cells in grids beside the field: "
            "visibility: the share of each that arrives; channels: the same, four lights a cell; "
            "shaft: where it comes through holes; sh: their light; see below")
        .exclude({"at", "adaptive"})
        .record(options::Recorded::if_changed);
    options
        .number("--shaft-closing", o.shaft_closing, 0, 1e9,
                "Metres, of --direct shaft: holes are what no disc of this radius passes")
        .need("direct")
        .record(options::Recorded::if_changed);
    options
        .number("--beams", o.beams, 1, 64,
                "Beams of --direct, --static and --medium along an edge of a cell; twice as many "
                "halve the error at shadows' edges, and take four times as long")
        .record(options::Recorded::if_changed);
    options
        .number("--sun-angle", o.sun_angle, 0, 90,
                "Degrees across the disc of directional lights, for --direct, --static and "
                "--medium; the sun's is 0.53")
        .record(options::Recorded::if_changed);
    options
        .values("--lamp-radius", o.lamp_radii, "METRES|NAMES=METRES", parse_lamp_radius,
                "Point and spot lights are spheres of this radius for --direct, --static and "
                "--medium, all or those whose names fit a pattern, such as 'Bulb*=0.03'; may be "
                "repeated; what is reflected of them stays that of points; see below")
        .record(options::Recorded::if_changed);
}

void add_local_options(options::Options& options, BakeOptions& o) {
    options
        .choice("--local-transfer", o.local_transfer,
                options::Choices<bool>{{"cells", false}, {"object", true}},
                "Keep what the surfaces within --radius of each cell make of the light around it, "
                "in grids beside the field, for render --relight lrt and engines: cells: of a "
                "scene; object: of one alone, on a lattice that is wider by the radius; see below")
        .exclude({"at", "adaptive"})
        .record(options::Recorded::if_changed);
    options
        .number(
            "--radius", o.radius, 1e-9, 1e9,
            "Metres, of --local-transfer; default: 1.331 cells, with which light that is carried "
            "from cell to cell is neither made nor lost")
        .need("local-transfer")
        .record(options::Recorded::if_changed);
}

void add_volume_options(options::Options& options, BakeOptions& o) {
    const std::vector<std::string> others{"bounds", "margin",   "level", "levels",      "focus",
                                          "at",     "adaptive", "bytes", "rsm-samples", "rsm-size"};
    options
        .values("--volume", o.volume, "NAME=X0,Y0,Z0,X1,Y1,Z1[:CELL]", parse_volume,
                "Box, metres, for a volume of its own; repeated: volumes beside each other of one "
                "scene, into a file each; cells of CELL, else of --cell-size or of the largest box "
                "by --resolution; see below")
        .exclude(others)
        .record(options::Recorded::if_changed);
    options
        .text(
            "--volumes", o.volumes, "FILE|nodes:PATTERN|auto",
            "Such volumes of a JSON file, with priorities and turned boxes, of the nodes that fit "
            "a pattern as --exclude has it, or one a room that is found; see below")
        .exclude(others)
        .record(options::Recorded::if_changed);
}

void add_layers_option(options::Options& options, BakeOptions& o) {
    options
        .values(
            "--layers", o.layers, "LAYERS", parse_layers,
            "A volume of each part of the light beside that of all, from the same rays, for "
            "lpvbake mix: lights (each), emitters (each material), sky, sky:2 (and its modes up "
            "to that band), transfer (of any sky what is seen and what is reflected, up to band 2 "
            "or that of transfer:N), suns:N@LAT,LON,MM-DD (N suns of that day, beside the scene's "
            "lights), NAME=GLOB (lights and emissive materials of such names, together); several "
            "with commas, or repeated; see below")
        .exclude({"adaptive", "bytes", "rsm-samples", "direct"})
        .record(options::Recorded::if_changed);
    options
        .number("--layers-level", o.layers_level, 0, bake::most_layers_level,
                "Layers, and what lpvbake mix makes of them, have cells 2^N times as large as the "
                "volume's: an eighth of the time and bytes for 1, a 64th for 2")
        .need("layers")
        .exclude({"at", "level", "levels", "volume", "volumes"})
        .record(options::Recorded::if_changed);
}

void add_adjust_option(options::Options& options, BakeOptions& o) {
    options
        .text("--adjust", o.adjust, "FILE",
              "JSON file of boxes whose cells are valid or not whatever geometry says, whose "
              "light is multiplied, or whose bricks are finer or coarser; see below")
        .exclude({"at"})
        .record(options::Recorded::if_changed);
}

/// "2/8".
volume::Shard parse_shard(const std::string& text) {
    constexpr double most = 1'000'000;
    const std::size_t slash = text.find('/');
    const auto index = options::parse_number(text.substr(0, slash));
    const auto count =
        slash == std::string::npos ? std::nullopt : options::parse_number(text.substr(slash + 1));
    const auto is_whole = [](double x) { return x >= 1 && x <= most && x == std::floor(x); };
    if (!index || !count || !is_whole(*index) || !is_whole(*count) || *index > *count)
        options::refuse(text, "is not i/N, whole numbers with i from 1 to N");
    return {int(*index), int(*count)};
}

void add_shard_option(options::Options& options, BakeOptions& o) {
    options
        .value("--shard", o.shard, "i/N", parse_shard,
               "Bake the i-th of N parts of the grid, slabs along z, into a part (-o PART, an "
               "OpenVDB file) of which lpvbake merge makes what one bake would have written, to "
               "the byte; by gather, or sn with --tile; see below")
        .exclude({"at",          "level",         "levels",         "focus",       "volume",
                  "volumes",     "adaptive",      "layers",         "direct",      "static",
                  "medium",      "adjust",        "local-transfer", "rsm-samples", "bytes",
                  "fit",         "evaluation",    "verify",         "target",      "precision",
                  "axes",        "sh-convention", "packing",        "dering",      "l1-scale",
                  "exr-columns", "error",         "time-budget"})
        .keep_to_one_run();
    options
        .text("--lit", o.lit, "FILE",
              "Take surfaces as lpvbake light has lit them for the same scene and options, instead "
              "of lighting them anew")
        .exclude({"at", "adaptive"})
        .keep_to_one_run();
}

} // namespace

void add_bake_options(options::Options& options, BakeOptions& o) {
    add_scene_option(options, o);
    options.texts("-o,--output", o.outputs.paths, "FILE", outputs_help()).keep_to_one_run();
    add_grid_options(options, o);
    options
        .text("--at", o.at, "FILE",
              "Bake the light at the points of a file (" + io::point_format_list()
                  + ") instead of a grid, into " + io::lit_point_format_list()
                  + "; --cell-size is how large patches of surfaces are at most then; see below")
        .exclude({"resolution", "bounds",        "margin",   "level",     "levels",
                  "focus",      "rsm-samples",   "rsm-size", "tolerance", "target",
                  "precision",  "sh-convention", "axes",     "packing",   "dering",
                  "l1-scale",   "exr-columns",   "dilate",   "fit",       "evaluation",
                  "verify",     "bytes"})
        .keep_to_one_run();
    options
        .number(
            "--surroundings", o.surroundings, 0, 1e9,
            "Leave out what is farther than X metres from --bounds, unless it emits, is as large "
            "as it is far, or stands in the sun's way: to bake a world tile by tile; see below")
        .need("bounds")
        .exclude({"at", "level", "levels", "volume", "volumes"})
        .record(options::Recorded::if_changed);
    add_shard_option(options, o);
    add_level_options(options, o);
    add_volume_options(options, o);
    add_adjust_option(options, o);
    add_direct_options(options, o);
    add_local_options(options, o);
    add_layers_option(options, o);
    add_light_options(options, o);
    add_static_option(options, o);
    add_medium_options(
        options, o.medium,
        "Air that light goes through: grids of what it scatters and of what it takes");
    options
        .value("--scattering", o.scattering, "N|inf", parse_scattering,
               "The field, too, is that in the medium, by sn: light is taken on all ways, and "
               "scattered N times at most, 1 to 10000, or until 0.1 % is missing; default: the "
               "field is as without the medium, and what it scatters of it is scattered once")
        .need("medium")
        .implies("inf")
        .record(options::Recorded::if_changed);
    add_solver_options(options, o);
    add_output_options(options, o.outputs);
    options
        .value(
            "--bytes", o.bytes, "SIZE", options::parse_bytes,
            "Of the order, resolution and precision that are not given, take those with the least "
            "expected error whose numbers fit into SIZE, as 8M, in each output; see below")
        .implies("8M")
        .record(options::Recorded::if_changed);
    options
        .number("--dilate", o.fit.dilate, 0, 1024,
                "Rings of cells inside geometry to fill from cells around them; the validity "
                "stays as it is")
        .record();
    options
        .choice(
            "--fit", o.fit.fit, options::Choices<bool>{{"none", false}, {"surfaces", true}},
            "surfaces: values with which the target's program shows on surfaces the light that "
            "arrives there, though it reads cells beyond walls; generic: our own sampler. none: "
            "the field at the cells' centres. Default: surfaces for programs that shade surfaces "
            "by the volume, none for generic, blender and houdini, and with --dilate")
        .implies([&o] { return fits(o.outputs, o.fit) ? "surfaces" : "none"; })
        .record(options::Recorded::if_changed);
    add_evaluation_option(options, o.fit);
    options
        .number(
            "--verify", o.verify, 2, 1e6,
            "Measure the error in this scene: by paths at N places, half of them cells, half on "
            "surfaces; with --error bake on until the measured one is below it")
        .bare("256");
    add_device_option(options, o);
    options.flag("--validation", o.validation,
                 "Load Vulkan's validation layer; messages are errors");
    add_isa_option(options, o);
    options::Choices<bake::Rays> rays;
    for (const bake::Rays each : bake::all_rays)
        rays.emplace_back(bake::name_of(each), each);
    options
        .choice(
            "--rays", o.rays, rays,
            "Who traces the rays of lighting, gather and sn: Embree on the CPU, or the device; "
            "auto: a GPU that can, for gather in scenes of many triangles (see lpvbake devices)")
        .record(options::Recorded::if_changed);
    add_dry_run_option(options, o,
                       "Print grid, memory, the files that will exist and an estimate of the time");
    options
        .flag("--if-changed", o.if_changed,
              "Leave outputs that inputs, options and version would bake again as they are")
        .exclude({"at"});
    options
        .flag("--if-missing", o.if_missing,
              "Leave outputs that are there, whole, as they are, of whatever inputs and options; "
              "the scene is not read then")
        .exclude({"at", "if-changed"});
    options
        .text("--depfile", o.depfile, "FILE",
              "Write a rule for Make and Ninja of the outputs and all files that were read")
        .keep_to_one_run();
    options.text(
        "--cache", o.cache, "FOLDER",
        "Keep there what geometry alone decides, and take it from there: where only lights "
        "changed, a bake is quicker and its files are the same; see below");
    options
        .value("--cache-size", o.cache_bytes, "SIZE", options::parse_bytes,
               "What its files may take together; those that were not used for the longest time "
               "go first",
               "2G")
        .need("cache");
    add_run_options(options, o);
}

bool has_volume_file(const BakeOptions& o) {
    return !o.volumes.empty() && !o.volumes.starts_with(nodes_prefix) && o.volumes != auto_volumes;
}

std::string volume_nodes(const BakeOptions& o) {
    return o.volumes.starts_with(nodes_prefix) ? o.volumes.substr(nodes_prefix.size()) : "";
}

std::vector<std::string> inputs_of(const BakeOptions& o) {
    std::vector<std::string> inputs = inputs_of(o, o);
    inputs.insert(inputs.end(), {o.adjust, o.at, o.lit, density_file(o.medium)});
    if (has_volume_file(o))
        inputs.push_back(o.volumes);
    return inputs;
}

void check_options(const BakeOptions& o) {
    check_paths("bake", o, o, o.outputs.paths, o.at, o.shard.has_value());
    check_files({o.lit}, {}, o.outputs.paths);
    if (o.outputs.paths.empty() && o.light_file.empty() && !o.dry_run)
        throw Error(ErrorKind::argument,
                    o.at.empty() ? "no output: add -o FILE" + io::format_list(" or -o FILE")
                                 : "no output: add -o FILE, " + io::lit_point_format_list());
    if (o.bytes && o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "--bytes is of outputs: add -o FILE");
    const solver::SolverKind& solver = *solvers_of(o).front();
    for (const auto& [name, value] : o.parameters)
        if (const solver::Parameter* own = solver::find_parameter(solver, name);
            own && !solver::is_value(*own, value))
            throw Error(ErrorKind::argument, "--" + name + ": the " + solver.name + " solver takes "
                                                 + solver::values_of(*own));
    check_fit(o.outputs, o.fit, o.sh_order);
    if (o.shard && o.fit.dilate > 0)
        throw Error(ErrorKind::argument, "--dilate fills cells from those of other shards; give it "
                                         "to convert, of what merge writes");
    if (!o.layers.empty() && (fits(o.outputs, o.fit) || o.outputs.storage().dering))
        throw Error(
            ErrorKind::argument,
            "--layers: a volume that is fitted, or without negative irradiance, is no sum "
            "of its layers; add --fit none --dering off, and fit what mix makes by convert");
    if ((o.beams != bake::DirectSettings().beams || o.sun_angle != 0 || !o.lamp_radii.empty())
        && !o.direct && o.statics.empty() && !o.medium.medium)
        throw Error(ErrorKind::argument, "--beams, --sun-angle and --lamp-radius are of --direct, "
                                         "--static and --medium");
    if (o.shaft_closing != bake::DirectSettings().shaft_closing && !(o.direct && o.direct->shaft))
        throw Error(ErrorKind::argument, "--shaft-closing is of --direct shaft");
    if (o.scattering && o.verify)
        throw Error(ErrorKind::argument,
                    "--verify: the field is that in a medium (--scattering), and paths know of "
                    "none; verify a bake without it");
    if (!o.medium.density.empty())
        check_files({density_file(o.medium)}, {}, o.outputs.paths);
    if (!o.adjust.empty())
        check_files({o.adjust}, {}, o.outputs.paths);
    if (has_volume_file(o))
        check_files({o.volumes}, {}, o.outputs.paths);
    if (!o.depfile.empty()) {
        std::vector<std::string> outputs = o.outputs.paths;
        outputs.push_back(o.depfile);
        check_files({}, {}, outputs, true);
        check_files(inputs_of(o), {}, {o.depfile}, true);
    }
    if (o.adaptive)
        check_brick_outputs(o.outputs);
    if (o.nests() || o.adaptive)
        check_level_outputs(o.outputs.paths, inputs_of(o, o));
    if (o.local_transfer.value_or(false) && (o.nests() || o.places() || o.grid.cell == 0))
        throw Error(ErrorKind::argument,
                    "--local-transfer object: is of one grid whose cells lie on those of other "
                    "objects; give --cell-size, and neither levels nor volumes");
    if (o.levels && o.grid.cell == 0)
        throw Error(ErrorKind::argument, "--levels: how large the finest cells are is missing: add "
                                         "--cell-size H");
}

std::vector<volume::LevelBox> levels_of(const BakeOptions& o, const Scene& scene) {
    if (!o.levels) {
        std::vector<volume::LevelBox> levels;
        for (const LevelOption& level : o.level) {
            const Bounds box = *box_in(level.box, "--level", scene);
            levels.push_back({box.lo, box.hi, level.cell});
        }
        return levels;
    }
    const std::optional<Bounds> given = o.box_in(scene);
    const Bounds box = given.value_or(bounds_of(scene));
    volume::GridSettings settings = o.grid_settings();
    settings.cell *= std::exp2(*o.levels - 1);
    // Samples on the faces of a box that is given, and around the scene as one grid has them.
    const double out = (settings.margin - (given ? 0.0 : 0.5)) * settings.cell;
    const Bounds focus = *box_in(o.focus, "--focus", scene);
    return volume::levels_around({focus.lo, focus.hi, o.grid.cell}, box.lo - out, box.hi + out,
                                 std::size_t(*o.levels));
}

namespace {

/// A node's name as a file's.
std::string plain_name(const std::string& name) {
    std::string plain = name.empty() ? "node" : name;
    std::ranges::replace_if(
        plain, [](unsigned char c) { return !std::isalnum(c) && c != '_' && c != '-' && c != '.'; },
        '_');
    return plain;
}

std::vector<volume::VolumeBox> boxes_of_nodes(const BakeOptions& o, const Scene& scene) {
    std::vector<volume::VolumeBox> boxes;
    for (const SceneFile::Box& node : scene.file.boxes) {
        const volume::Place place{plain_name(node.name),
                                  int(std::lround(node.priority.value_or(0))),
                                  node.falloff.value_or(-1)};
        boxes.push_back(volume::box_in_world(place, node.lo, node.hi, node.to_world));
        boxes.back().cell = node.cell.value_or(0);
    }
    if (boxes.empty())
        throw Error(ErrorKind::argument, scene.path + ": --volumes " + o.volumes
                                             + ": no node fits; lpvbake info lists their names");
    return boxes;
}

/// Rooms, as many as there is room for beside those that are given.
std::vector<volume::VolumeBox> found_boxes(const BakeOptions& o, const Scene& scene,
                                           std::vector<std::string>& warnings,
                                           std::string& detail) {
    const std::size_t most = io::most_places(*o.outputs.target);
    bake::RoomSettings settings;
    settings.most_rooms = most - std::min(most - 1, o.volume.size());
    bake::Rooms rooms = bake::find_rooms(scene, settings);
    detail = rooms.detail;
    if (rooms.left_out > 0)
        warnings.push_back(format(
            "%s: %s left out: %zu volumes are the most; bake it in parts", scene.path.c_str(),
            counted(rooms.left_out, "smaller room is", "smaller rooms are").c_str(), most));
    return std::move(rooms.boxes);
}

} // namespace

std::vector<volume::Place> places_of(const std::vector<volume::VolumeBox>& boxes) {
    std::vector<volume::Place> places;
    for (const volume::VolumeBox& box : boxes)
        places.push_back(box.place);
    return places;
}

std::vector<volume::VolumeBox> volumes_of(const BakeOptions& o, const Scene& scene,
                                          std::vector<std::string>& warnings, std::string& detail) {
    std::vector<volume::VolumeBox> boxes;
    if (o.volumes == auto_volumes)
        boxes = found_boxes(o, scene, warnings, detail);
    else if (o.volumes.starts_with(nodes_prefix))
        boxes = boxes_of_nodes(o, scene);
    else if (has_volume_file(o))
        boxes = io::read_boxes(o.volumes);
    for (const GivenVolume& given : o.volume)
        boxes.push_back({{given.name, 0, -1}, given.box.lo, given.box.hi, given.cell.value_or(0)});
    double longest = 0;
    for (const volume::VolumeBox& box : boxes) {
        const glm::dvec3 extent = box.hi - box.lo;
        longest = std::max({longest, extent.x, extent.y, extent.z});
    }
    for (volume::VolumeBox& box : boxes) {
        if (box.cell == 0)
            box.cell = o.grid.cell > 0 ? o.grid.cell : longest / o.grid.resolution;
        if (box.place.falloff < 0)
            box.place.falloff = box.cell;
    }
    std::vector<volume::VolumeBox> sorted = boxes;
    const std::vector<Grid> grids = volume::place_grids(sorted);
    const std::vector<volume::Place> places = places_of(sorted);
    io::check_places(*o.outputs.target, places, grids);
    std::vector<std::string> inputs = inputs_of(o, o);
    inputs.push_back(has_volume_file(o) ? o.volumes : "");
    inputs.push_back(o.adjust);
    check_level_outputs(o.outputs.paths, inputs, places);
    return boxes;
}

void add_suns(BakeOptions& o) {
    for (const std::vector<bake::LayerWish>& wishes : o.layers)
        for (const bake::LayerWish& wish : wishes)
            if (wish.kind == bake::LayerWish::Kind::suns)
                std::ranges::move(bake::suns_along(wish.arc, wish.suns),
                                  std::back_inserter(o.suns));
}

std::vector<bake::Layer> layers_of(const BakeOptions& o, const Scene& scene,
                                   const bake::BakeSettings& settings) {
    std::vector<bake::LayerWish> wishes;
    for (const std::vector<bake::LayerWish>& given : o.layers)
        wishes.insert(wishes.end(), given.begin(), given.end());
    std::vector<bake::Layer> layers = bake::make_layers(scene, wishes, !o.no_emitters);
    if (!layers.empty())
        check_layer_outputs(o.outputs.paths, layers,
                            std::max<std::size_t>(settings.levels.size(), 1),
                            places_of(settings.volumes), inputs_of(o, o), o.layers_level > 0);
    const Precision precision = o.outputs.storage().precision;
    if (std::ranges::any_of(layers, [](const bake::Layer& layer) { return layer.unit == "nits"; })
        && precision != Precision::full && precision != Precision::half)
        throw Error(ErrorKind::argument,
                    std::string("--layers: light of a sky's mode is negative in places, for "
                                "which --precision ")
                        + io::name_of(precision) + " has no form; use float or half");
    const io::Target storage = o.outputs.storage();
    if (wants_transfer(o)
        && (kept_order(storage) < volume::sh_max_order
            || storage.pictures.packing != io::Packing::band))
        throw Error(ErrorKind::argument,
                    std::string("--layers transfer: what is seen of the sky has order 4, more than "
                                "--target ")
                        + storage.name
                        + ", --sh-convention or --packing keep; bake without them, and give them "
                          "to mix");
    return layers;
}

bake::BakeSettings to_settings(const BakeOptions& o, const readers::Reader& reader) {
    bake::BakeSettings settings(*solvers_of(o).front());
    settings.grid = o.grid_settings();
    settings.emitters = !o.no_emitters;
    settings.solver.set(o.quality.value_or(solver::Quality::balanced));
    if (o.bounces)
        settings.bounces = o.bounces->most;
    if (fits(o.outputs, o.fit))
        settings.fit = &reader;
    settings.dering = o.outputs.storage().dering;
    settings.layers_level = o.layers_level;
    settings.shard = o.shard;
    settings.lit = o.lit;
    settings.surfaces_alone = !o.light_file.empty();
    settings.isa = o.isa;
    settings.rays = o.rays;
    settings.direct = o.direct.value_or(bake::DirectSettings());
    settings.direct.beams = o.beams;
    settings.direct.sun_angle = glm::radians(o.sun_angle);
    settings.direct.lamp_radii = o.lamp_radii;
    settings.direct.shaft_closing = o.shaft_closing;
    if (o.scattering)
        settings.scattering = bake::Scattering{o.scattering->most};
    settings.local_transfer = {o.local_transfer.has_value(), o.local_transfer.value_or(false),
                               o.radius.value_or(0)};
    if (!o.adjust.empty())
        settings.adjust = io::read_adjustments(o.adjust);
    for (const volume::Adjustment& box : settings.adjust)
        if (box.finer && !o.adaptive)
            throw Error(ErrorKind::unsupported,
                        o.adjust + ": \"" + (*box.finer ? "finer" : "coarser")
                            + "\" is of the bricks of --adaptive alone; give the box cells of "
                              "another size as a --level");
    if (o.adaptive)
        settings.adaptive = {o.adaptive->x, o.adaptive->y,
                             o.error.value_or(o.max_size ? 0.0 : usual_brick_error), o.max_size,
                             o.outputs.storage().precision == Precision::half ? 2 : 4};
    return settings;
}

bake::Wish wish_of(const BakeOptions& o) {
    bake::Wish wish;
    wish.solvers = solvers_of(o);
    if (o.sh_order > 0)
        wish.order = o.sh_order;
    else if (o.fit.evaluation != readers::Evaluation::linear)
        wish.order = 1;
    wish.kept_order = kept_order(o.outputs.storage());
    if (!o.adaptive) // then it is the bricks'
        wish.error = o.error;
    wish.seconds = o.seconds;
    for (const auto& [name, value] : o.parameters)
        wish.given.push_back({name.c_str(), value});
    return wish;
}

} // namespace lpvbake::cmd
