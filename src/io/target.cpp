#include "io/target.h"

#include "error.h"
#include "io/atomic_file.h"
#include "volume/dilate.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <filesystem>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr Pictures full_channel{.packing = Packing::channel, .no_empty_tiles = true};

constexpr Target all_targets[] = {
    {.name = "generic"},
    {.name = "blender",
     .encoding = {.axes = Axes::blender, .corner_index = true},
     .reads = VolumeFormat::vdb},
    {.name = "houdini", .reads = VolumeFormat::vdb},
    {.name = "unity",
     .encoding = {ShConvention::unity, Axes::unity},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::unity,
     .reads = VolumeFormat::exr},
    {.name = "unreal",
     .encoding = {ShConvention::unreal, Axes::unreal},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::unreal},
    {.name = "godot",
     .encoding = {.convention = ShConvention::godot},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::godot,
     .reads = VolumeFormat::exr},
    {.name = "threejs",
     .pictures = {.packing = Packing::atlas},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .reads = VolumeFormat::exr},
    {.name = "vrc",
     .encoding = {ShConvention::unity, Axes::unity},
     .pictures = {.packing = Packing::vrc, .no_empty_tiles = true},
     .precision = Precision::half,
     .highest_order = 1,
     .dilate = 2,
     .notes = Notes::unity,
     .reads = VolumeFormat::exr},
    {.name = "bevy",
     .pictures = {.packing = Packing::cube},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::bevy,
     .reads = VolumeFormat::exr},
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

/// What every program needs: the pictures, what their channels hold, and where the volume stands.
Json common_notes(const std::string& program, const std::string& stem, const WriteReport& report,
                  const Grid& grid, Axes axes, double units_a_metre) {
    Json names = Json::array();
    for (const WriteReport::File& file : report.files)
        if (const fs::path path = file.path; path.extension() == ".exr")
            names.push_back(path.filename().string());
    const glm::dvec3 lo = units_a_metre * grid.origin,
                     hi = lo + units_a_metre * grid.cell * glm::dvec3(grid.dims);
    return {
        {"program", program},
        {"textures", names},
        {"channels", "see " + fs::path(stem + ".json").filename().string()},
        {"volume", {{"min", {lo.x, lo.y, lo.z}}, {"max", {hi.x, hi.y, hi.z}}}},
        {"units", units_a_metre == 1.0 ? "metres" : "centimetres"},
        {"axes", name_of(axes)},
    };
}

/// Names are those of UnityEditor.TextureImporter and TextureImporterSettings.
Json unity_notes(const WriteReport& report) {
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
        {"irradiance over pi", "ShadeSH9 of UnityCG.cginc: a colour's dot(SHA, (n, 1)) + dot(SHB, "
                               "n.xyzz * n.yzzx) + SHC * (n.x^2 - n.y^2)"},
        {"unproven", "that slices run left to right, then down, and the direction of v: look at a "
                     "slice before you trust them"},
    };
}

/// Names are those of the asset editor of volume textures, whose slices run left to right, then
/// down (UVolumeTexture::UpdateSourceFromSourceTexture of Unreal Engine 5.8).
Json unreal_notes(const Grid& grid) {
    return {
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
    const glm::dvec3 size = grid.cell * glm::dvec3(grid.dims), middle = grid.origin + 0.5 * size;
    return {
        {"texture",
         {{"size", {grid.dims.x, 2 * grid.dims.y, 3 * grid.dims.z}},
          {"columns", report.columns},
          {"rows", report.rows},
          {"order", "slices of the 3D texture stand left to right, then down; a row of texels runs "
                    "along x, the rows of a slice along y"}}},
        {"Transform",
         {{"translation", {middle.x, middle.y, middle.z}}, {"scale", {size.x, size.y, size.z}}}},
        {"IrradianceVolume", {{"intensity", 1.0}}},
    };
}

} // namespace

const Target* target_named(std::string_view name) {
    for (const Target& target : all_targets)
        if (name == target.name)
            return &target;
    return nullptr;
}

WriteReport write_for(const Target& target, const std::string& path, const Volume& volume) {
    const bool shortened = volume.sh_order > target.highest_order;
    const auto fitted = volume.metadata.find("fit"); // its cells hold what is read, valid or not
    const bool dilated =
        target.dilate > 0 && !volume.validity.empty() && fitted == volume.metadata.end();
    std::optional<Volume> changed;
    if (shortened || dilated)
        changed = volume;
    if (shortened) {
        changed->sh_order = target.highest_order;
        changed->sh.resize(size_t(sh_count(target.highest_order)));
    }
    if (dilated)
        dilate(*changed, target.dilate);
    WriteReport report = write_volume(path, changed ? *changed : volume, target.precision,
                                      target.pictures, target.encoding);
    const std::string name = target.name;
    if (shortened)
        report.warnings.push_back(path + ": " + name + " has a form for order "
                                  + std::to_string(target.highest_order)
                                  + " at most: higher bands are left out");
    if (fitted != volume.metadata.end() && target.dilate > 0 && fitted->second != name)
        report.warnings.push_back(path + ": the volume is fitted to what " + fitted->second
                                  + " reads, not " + name);
    if (target.reads && volume_format(path) != target.reads)
        report.warnings.push_back(path + ": " + name + " reads "
                                  + (target.reads == VolumeFormat::exr ? ".exr" : ".vdb")
                                  + "; this has its convention and axes, and no more");
    if (target.notes == Notes::none || volume_format(path) != VolumeFormat::exr)
        return report;

    const Grid grid = turned_grid(volume.grid, from_gltf(target.encoding.axes));
    const std::string stem = fs::path(path).replace_extension().string();
    std::vector<WriteReport::File> notes;
    const auto write_notes = [&](const char* program, const char* kind, const Json& own,
                                 double units_a_metre = 1.0) {
        Json json = common_notes(program, stem, report, grid, target.encoding.axes, units_a_metre);
        json.update(own);
        notes.push_back(write_text(stem + "." + kind + ".json", json.dump(2) + "\n"));
    };
    switch (target.notes) {
    case Notes::none:
        break;
    case Notes::godot:
        for (const WriteReport::File& file : report.files)
            if (file.path.ends_with(".exr"))
                notes.push_back(write_text(file.path + ".import", godot_import(report)));
        write_notes("Godot 4", "godot", godot_notes());
        break;
    case Notes::unity:
        write_notes("Unity 2020.2 or later", "unity", unity_notes(report));
        break;
    case Notes::unreal:
        write_notes("Unreal Engine 5", "unreal", unreal_notes(grid), 100.0);
        break;
    case Notes::bevy:
        write_notes("Bevy", "bevy", bevy_notes(grid, report));
        break;
    }
    report.files.insert(report.files.end(), notes.begin(), notes.end());
    return report;
}

} // namespace lpvbake
