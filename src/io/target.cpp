#include "io/target.h"

#include "io/atomic_file.h"
#include "io/dds.h"
#include "io/exr.h"
#include "io/glb.h"
#include "io/ktx2.h"
#include "io/nvdb.h"
#include "io/texel.h"
#include "io/tres.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "text.h"
#include "volume/dering.h"
#include "volume/dilate.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr Pictures full_channel{.packing = Packing::channel, .no_empty_tiles = true};

constexpr Target targets[] = {
    {.name = "generic"},
    {.name = "blender",
     .encoding = {.axes = volume::Axes::blender, .corner_index = true},
     .reads = {&vdb_format}},
    {.name = "houdini", .reads = {&vdb_format}},
    {.name = "unity",
     .encoding = {volume::ShConvention::unity, volume::Axes::unity},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .dering = true,
     .notes = Notes::unity,
     .reads = {&exr_format, &dds_format}},
    {.name = "unreal",
     .encoding = {volume::ShConvention::unreal, volume::Axes::unreal},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .dering = true,
     .notes = Notes::unreal},
    {.name = "godot",
     .encoding = {.convention = volume::ShConvention::godot},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .dering = true,
     .notes = Notes::godot,
     .reads = {&exr_format, &tres_format}},
    {.name = "threejs",
     .pictures = {.packing = Packing::atlas},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .dering = true,
     .reads = {&exr_format, &ktx2_format, &glb_format}},
    {.name = "vrc",
     .encoding = {volume::ShConvention::unity, volume::Axes::unity},
     .pictures = {.packing = Packing::vrc, .no_empty_tiles = true},
     .precision = Precision::half,
     .highest_order = 1,
     .dilate = 2,
     .dering = true,
     .notes = Notes::unity,
     .reads = {&exr_format}},
    {.name = "bevy",
     .pictures = {.packing = Packing::cube},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::bevy,
     .reads = {&ktx2_format, &dds_format}},
};

WriteReport::File write_text(const std::string& path, const std::string& text) {
    AtomicFile file(path);
    file.write(text);
    const uint64_t bytes = file.seal();
    file.publish();
    return {path, bytes};
}

/// What Godot 4's importer of 3D textures reads; it adds the rest itself. Mode 3: not compressed.
std::string godot_import(const WriteReport& report) {
    return "[remap]\n\nimporter=\"3d_texture\"\ntype=\"CompressedTexture3D\"\n\n[params]\n\n"
           "compress/mode=3\nmipmaps/generate=false\nslices/horizontal="
           + std::to_string(report.columns) + "\nslices/vertical=" + std::to_string(report.rows)
           + "\n";
}

/// Pictures of slices, not 3D textures.
bool has_flipbooks(const WriteReport& report) {
    return report.columns > 0;
}

/// What every program needs: the textures, what their channels hold, and where the volume stands.
Json common_notes(const std::string& program, const std::string& path, const WriteReport& report,
                  const Grid& grid, volume::Axes axes, double units_a_metre) {
    Json names = Json::array();
    for (const WriteReport::File& file : report.files)
        if (const fs::path texture = file.path; texture.extension() != ".json")
            names.push_back(texture.filename().string());
    const std::string sidecar = volume_format(path)->sidecar;
    const glm::dvec3 lo = units_a_metre * grid.origin,
                     hi = lo + units_a_metre * grid.cell * glm::dvec3(grid.dims);
    Json volume{{"min", {lo.x, lo.y, lo.z}}, {"max", {hi.x, hi.y, hi.z}}};
    if (const glm::dquat& turn = grid.turn; grid.is_turned())
        volume["turn"] = {{"rotation", {turn.x, turn.y, turn.z, turn.w}},
                          {"about", "min: positions are first turned back"}};
    return {
        {"program", program},
        {"textures", names},
        {"channels", "see "
                         + (sidecar.empty() ? "the key lpvbake of each texture"
                                            : fs::path(path).stem().string() + sidecar)},
        {"volume", volume},
        {"units", units_a_metre == 1.0 ? "metres" : "centimetres"},
        {"axes", volume::name_of(axes)},
    };
}

/// Of a colour's texel, by what shaders make of it (metadata fit_evaluation).
std::string unity_formula(const std::string& evaluation) {
    const std::string parts = "of a colour with v = (x, y, z) and w: ";
    if (evaluation == "geomerics")
        return parts
               + "w (a + (1 - a)(p + 1) q^p), r = |v| / (2 w) but at most 1, q = (1 + v.n / |v|) / "
                 "2, p = 1 + 2 r, a = (1 - r) / (1 + r) (Geomerics, CEDEC 2015)";
    if (evaluation == "zh3")
        return parts
               + "v.n + w + 0.279508 w (0.08 r + 0.6 r^2)(3 (d.n)^2 - 1), d the direction of v's "
                 "luminance, r = 0.866025 |v.d| / w but at most 1.732051 (Roughton et al. 2024)";
    return "ShadeSH9 of UnityCG.cginc: a colour's dot(SHA, (n, 1)) + dot(SHB, n.xyzz * n.yzzx) + "
           "SHC * (n.x^2 - n.y^2)";
}

/// Names are those of UnityEditor.TextureImporter and TextureImporterSettings.
Json unity_notes(const WriteReport& report, const std::string& evaluation) {
    const Json irradiance = unity_formula(evaluation);
    if (!has_flipbooks(report))
        return {{"sampling", "uvw = (position - min) / (max - min)"},
                {"irradiance over pi", irradiance}};
    return {
        {"importer",
         {{"textureShape", "Texture3D"},
          {"flipbookColumns", report.columns},
          {"flipbookRows", report.rows},
          {"sRGBTexture", false},
          {"mipmapEnabled", false},
          {"npotScale", "None"},
          {"wrapMode", "Clamp"},
          {"filterMode", "Bilinear"},
          {"textureCompression", "Uncompressed"},
          {"format", report.precision == Precision::half ? "RGBAHalf" : "RGBAFloat"}}},
        {"sampling", "u, w = (position - min) / (max - min); v = 1 - the same, as rows run down"},
        {"irradiance over pi", irradiance},
        {"unproven", "that slices run left to right, then down, and the direction of v: look at a "
                     "slice before you trust them"},
    };
}

/// Names are those of the asset editor of volume textures, whose slices run left to right, then
/// down (UVolumeTexture::UpdateSourceFromSourceTexture of Unreal Engine 5.8).
Json unreal_notes(const Grid& grid, const WriteReport& report) {
    Json json = {
        {"source_texture",
         {{"sRGB", false},
          {"Compression Settings", "HDR (RGBA16F)"},
          {"Mip Gen Settings", "NoMipmaps"}}},
        {"volume_texture",
         {{"Source 2D Tile Size X", grid.dims.x},
          {"Source 2D Tile Size Y", grid.dims.y},
          {"Address Mode", "Clamp"}}},
        {"sampling", "uvw = (position - min) / (max - min)"},
        {"irradiance", "DotSH3(coefficients, CalcDiffuseTransferSH3(n, 1)) of SHCommon.ush"},
    };
    if (!has_flipbooks(report)) {
        json.erase("source_texture");
        json.erase("volume_texture");
    }
    return json;
}

Json godot_notes() {
    return {
        {"sampling", "uvw = (position - min) / (max - min)"},
        {"irradiance over pi",
         "0.886227 c1 + 1.023327 (cy n.y + cz n.z + cx n.x) + 0.858086 (cxy n.x n.y + cyz n.y n.z "
         "+ cxz n.x n.z) + 0.247708 cz2 (3 n.z^2 - 1) + 0.429043 cx2y2 (n.x^2 - n.y^2)"},
    };
}

Json bevy_notes(const Grid& grid, const WriteReport& report) {
    const glm::dvec3 size = grid.cell * glm::dvec3(grid.dims),
                     middle = grid.to_world(0.5 * glm::dvec3(grid.dims));
    Json texture = {{"size", {grid.dims.x, 2 * grid.dims.y, 3 * grid.dims.z}}};
    if (has_flipbooks(report))
        texture.update(
            {{"columns", report.columns},
             {"rows", report.rows},
             {"order", "slices of the 3D texture stand left to right, then down; a row of texels "
                       "runs along x, the rows of a slice along y"}});
    return {
        {"texture", texture},
        {"Transform",
         {{"translation", {middle.x, middle.y, middle.z}},
          {"rotation", {grid.turn.x, grid.turn.y, grid.turn.z, grid.turn.w}},
          {"scale", {size.x, size.y, size.z}}}},
        {"IrradianceVolume", {{"intensity", 1.0}}},
    };
}

/// A scene of Bevy 0.19 or later, in which assets go by their paths: a node whose unit cube is the
/// box. Components that it needs beside come by themselves.
std::string bevy_scene(const Grid& grid, const std::string& texture) {
    const glm::dvec3 size = grid.cell * glm::dvec3(grid.dims),
                     middle = grid.to_world(0.5 * glm::dvec3(grid.dims));
    const auto three = [](glm::dvec3 v) { return format("(%.9g, %.9g, %.9g)", v.x, v.y, v.z); };
    return "(\n  resources: {},\n  entities: {\n    4294967297: (\n      components: {\n"
           "        \"bevy_transform::components::transform::Transform\": (\n"
           "          translation: "
           + three(middle) + ",\n          rotation: "
           + format("(%.9g, %.9g, %.9g, %.9g)", grid.turn.x, grid.turn.y, grid.turn.z, grid.turn.w)
           + ",\n          scale: " + three(size)
           + ",\n        ),\n"
             "        \"bevy_light::probe::IrradianceVolume\": (\n"
             "          voxels: Path("
           + Json(texture).dump(-1, ' ', false, Json::error_handler_t::replace)
           + "),\n          intensity: 1,\n          affects_lightmapped_meshes: true,\n"
             "        ),\n      },\n    ),\n  },\n)\n";
}

/// What their name has before its extension.
const char* kind_of(Notes notes) {
    switch (notes) {
    case Notes::none:
        break;
    case Notes::godot:
        return "godot";
    case Notes::unity:
        return "unity";
    case Notes::unreal:
        return "unreal";
    case Notes::bevy:
        return "bevy";
    }
    return "";
}

std::string import_name(const std::string& picture) {
    return picture + ".import";
}

std::string bevy_scene_name(const std::string& path) {
    return fs::path(path).replace_extension(".scn.ron").string();
}

/// STEM.unity.json of STEM.exr.
std::string note_name(const std::string& path, Notes notes) {
    return fs::path(path).replace_extension().string() + "." + kind_of(notes) + ".json";
}

void write_notes(const Target& target, const std::string& path, const Grid& baked,
                 const std::string& evaluation, WriteReport& report) {
    const Grid grid = volume::turned_grid(baked, volume::from_gltf(target.encoding.axes));
    std::vector<WriteReport::File> notes;
    const auto write = [&](const char* program, const Json& own, double units_a_metre = 1.0) {
        Json json = common_notes(program, path, report, grid, target.encoding.axes, units_a_metre);
        json.update(own);
        notes.push_back(write_text(note_name(path, target.notes), json.dump(2) + "\n"));
    };
    switch (target.notes) {
    case Notes::none:
        break;
    case Notes::godot:
        for (const WriteReport::File& file : report.files)
            if (file.path.ends_with(".exr"))
                notes.push_back(write_text(import_name(file.path), godot_import(report)));
        write("Godot 4", godot_notes());
        break;
    case Notes::unity:
        write("Unity 2020.2 or later", unity_notes(report, evaluation));
        break;
    case Notes::unreal:
        write("Unreal Engine 5", unreal_notes(grid, report), 100.0);
        break;
    case Notes::bevy:
        write("Bevy", bevy_notes(grid, report));
        if (!has_flipbooks(report))
            notes.push_back(write_text(
                bevy_scene_name(path),
                bevy_scene(grid, fs::path(report.files.front().path).filename().string())));
        break;
    }
    report.files.insert(report.files.end(), notes.begin(), notes.end());
}

/// What the target does not take as it is.
std::vector<std::string> warnings_of(const Target& target, const std::string& path,
                                     const Volume& volume) {
    const std::string name = target.name;
    std::vector<std::string> warnings;
    if (volume.sh_order > target.highest_order)
        warnings.push_back(path + ": " + name + " has a form for order "
                           + std::to_string(target.highest_order)
                           + " at most: higher bands are left out");
    if (const auto fit = volume.metadata.find("fit");
        fit != volume.metadata.end() && target.dilate > 0 && fit->second != name)
        warnings.push_back(path + ": the volume is fitted to what " + fit->second + " reads, not "
                           + name);
    const auto end = std::find(target.reads.begin(), target.reads.end(), nullptr);
    const VolumeFormats reads(target.reads.begin(), end);
    if (!reads.empty() && std::find(reads.begin(), reads.end(), volume_format(path)) == reads.end())
        warnings.push_back(path + ": " + name + " reads " + format_list(" and ", false, reads)
                           + "; this has its convention and axes, and no more");
    const Packing packing = target.pictures.packing;
    if (volume_format(path)->has_pictures && !volume.others.empty()
        && (packing == Packing::cube || packing == Packing::vrc || packing == Packing::atlas)) {
        std::string kinds;
        for (const OtherGrids& other : volume.others)
            kinds += (kinds.empty() ? "" : ", ") + std::string(other.kind->name);
        warnings.push_back(path + ": the pictures of " + name + " have no place for " + kinds
                           + "; write a .vdb too");
    }
    return warnings;
}

/// The cells inside geometry of a volume that is fitted hold what is read already.
bool is_dilated(const Target& target, const Volume& volume) {
    return target.dilate > 0 && !volume.validity.empty() && !volume.metadata.contains("fit");
}

/// Negative light of a cell may be what a fit takes a thin wall's other side away by.
bool is_deringed(const Target& target, const Volume& volume) {
    return target.dering && !volume.metadata.contains("fit");
}

/// Either kind of volume, with all bands that the target has a form for and no more.
template <class AnyVolume>
WriteReport write(const Target& target, const std::string& path, AnyVolume&& volume,
                  const std::vector<std::string>& warnings) {
    const Grid grid = volume.grid;
    const auto named = volume.metadata.find("fit_evaluation");
    const std::string evaluation = named == volume.metadata.end() ? "" : named->second;
    WriteReport report = write_volume(path, std::forward<AnyVolume>(volume), target.precision,
                                      target.pictures, target.encoding);
    report.warnings.insert(report.warnings.end(), warnings.begin(), warnings.end());
    if (volume_format(path)->has_pictures)
        write_notes(target, path, grid, evaluation, report);
    return report;
}

/// Leaves out bands that the target has no form for.
void limit_order(const Target& target, Volume& volume) {
    if (volume.sh_order <= target.highest_order)
        return;
    volume.sh_order = target.highest_order;
    volume.sh.resize(size_t(volume::sh_count(target.highest_order)));
}

} // namespace

std::span<const Target> all_targets() {
    return targets;
}

const Target* target_named(std::string_view name) {
    for (const Target& target : targets)
        if (name == target.name)
            return &target;
    return nullptr;
}

Target with_precision(Target target, Precision precision) {
    target.precision = precision;
    // Programs whose formulas the notes have know of no ratios: check_precision refuses them.
    if (has_ratios(precision) && target.notes == Notes::none
        && target.pictures.packing == Packing::band)
        target.pictures.packing = precision == Precision::unorm8 ? Packing::ratio : Packing::block;
    return target;
}

WriteReport write_for(const Target& target, const std::string& path, const Volume& volume) {
    if (volume.sh_order > target.highest_order || is_dilated(target, volume)
        || is_deringed(target, volume) || target.l1_scale != 1
        || volume.metadata.contains("l1_scale"))
        return write_for(target, path, Volume(volume));
    return write(target, path, volume, warnings_of(target, path, volume));
}

WriteReport write_for(const Target& target, const std::string& path, Volume&& volume) {
    const std::vector<std::string> warnings = warnings_of(target, path, volume);
    limit_order(target, volume);
    if (is_dilated(target, volume))
        volume::dilate(volume, target.dilate);
    if (is_deringed(target, volume))
        volume::dering(volume, std::min(volume.sh_order, 2));
    volume.metadata.erase("l1_scale"); // of the file that it was read from
    if (target.l1_scale != 1) {
        scale_band_one(target.l1_scale, volume);
        volume.metadata["l1_scale"] = format("%.9g", target.l1_scale);
    }
    return write(target, path, std::move(volume), warnings);
}

uint64_t stored_bytes(const Target& target, const std::string& path, Volume grids,
                      glm::ivec3 dims) {
    const VolumeFormat& format = *volume_format(path);
    if (&format == &nvdb_format || &format == &tres_format)
        throw Error(ErrorKind::argument,
                    path + ": how many bytes it takes is not known before; use .vdb");
    limit_order(target, grids);
    const Packing packing = format.has_pictures ? target.pictures.packing : Packing::band;
    const glm::ivec3 texels = stack_of(packing).dims(dims);
    const bool is_half = target.precision == Precision::half;
    uint64_t bytes = 0;
    for (const Texture& texture : textures_of(grids, packing, target.encoding.convention, path))
        bytes += format.has_rgb9e5 ? form_of(texture, target.precision).size(texels)
                                   : uint64_t(texels.x) * uint64_t(texels.y) * uint64_t(texels.z)
                                         * texture.channels() * (is_half ? 2 : 4);
    return bytes;
}

std::vector<std::string> files_for(const Target& target, const std::string& path, Volume grids) {
    const VolumeFormat& format = *volume_format(path);
    limit_order(target, grids);
    if (!format.files)
        return {path};
    std::vector<std::string> files =
        format.files(path, grids, target.pictures, target.encoding.convention);
    const std::size_t pictures = files.size();
    if (target.notes == Notes::godot)
        for (std::size_t i = 0; i < pictures; ++i)
            if (files[i].ends_with(".exr"))
                files.push_back(import_name(files[i]));
    if (target.notes != Notes::none)
        files.push_back(note_name(path, target.notes));
    if (target.notes == Notes::bevy && &format != &exr_format)
        files.push_back(bevy_scene_name(path));
    return files;
}

} // namespace lpvbake::io

namespace lpvbake {

std::vector<const char*> target_names() {
    std::vector<const char*> names;
    for (const io::Target& target : io::targets)
        names.push_back(target.name);
    return names;
}

WriteReport write_volume(const std::string& path, Volume volume, const std::string& target,
                         std::optional<Precision> precision, const PackedScene* scene) {
    const io::Target* known = io::target_named(target);
    if (!known) {
        std::string names;
        for (const char* name : target_names())
            names += (names.empty() ? "" : ", ") + std::string(name);
        throw Error(ErrorKind::argument, "`target` " + target + " is none of " + names);
    }
    io::Target storage = io::with_precision(*known, precision.value_or(known->precision));
    storage.pictures.scene = scene;
    return io::write_for(storage, path, std::move(volume));
}

} // namespace lpvbake
