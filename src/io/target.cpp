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
    {.name = "blender", .encoding = {.axes = Axes::blender, .corner_index = true}},
    {.name = "houdini"},
    {.name = "unity",
     .encoding = {ShConvention::unity, Axes::unity},
     .pictures = full_channel,
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2,
     .notes = Notes::unity},
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
     .notes = Notes::godot},
    {.name = "threejs",
     .pictures = {.packing = Packing::atlas},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2},
    {.name = "vrc",
     .encoding = {ShConvention::unity, Axes::unity},
     .pictures = {.packing = Packing::vrc, .no_empty_tiles = true},
     .precision = Precision::half,
     .highest_order = 1,
     .dilate = 2,
     .notes = Notes::unity},
    {.name = "bevy",
     .pictures = {.packing = Packing::cube},
     .precision = Precision::half,
     .highest_order = 2,
     .dilate = 2},
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

Json pictures_of(const WriteReport& report) {
    Json names = Json::array();
    for (const WriteReport::File& file : report.files)
        if (const fs::path path = file.path; path.extension() == ".exr")
            names.push_back(path.filename().string());
    return names;
}

Json box_of(const Grid& grid, double scale) {
    const glm::dvec3 lo = scale * grid.origin, hi = lo + scale * grid.cell * glm::dvec3(grid.dims);
    return {{"min", {lo.x, lo.y, lo.z}}, {"max", {hi.x, hi.y, hi.z}}};
}

/// Names are those of UnityEditor.TextureImporter and TextureImporterSettings.
Json unity_notes(const WriteReport& report, const Grid& grid) {
    return {
        {"program", "Unity 2020.2 or later"},
        {"textures", pictures_of(report)},
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
          {"format", "RGBAHalf"}}},
        {"volume", box_of(grid, 1.0)},
        {"units", "metres"},
        {"sampling", "u, w = (position - min) / (max - min); v = 1 - the same, as rows run down"},
        {"unproven", "that slices run left to right, then down, and the direction of v: look at a "
                     "slice before you trust them"},
    };
}

/// Names are those of the asset editor of volume textures, whose slices run left to right, then
/// down (UVolumeTexture::UpdateSourceFromSourceTexture of Unreal Engine 5.8).
Json unreal_notes(const WriteReport& report, const Grid& grid) {
    return {
        {"program", "Unreal Engine 5"},
        {"textures", pictures_of(report)},
        {"source_texture",
         {{"sRGB", false},
          {"Compression Settings", "HDR (RGBA16F)"},
          {"Mip Gen Settings", "None"}}},
        {"volume_texture",
         {{"Source 2D Tile Size X", grid.dims.x}, {"Source 2D Tile Size Y", grid.dims.y}}},
        {"volume", box_of(grid, 100.0)},
        {"units", "centimetres"},
        {"sampling", "uvw = (position - min) / (max - min)"},
    };
}

} // namespace

std::span<const Target> targets() {
    return all_targets;
}

const Target* target_named(std::string_view name) {
    for (const Target& target : all_targets)
        if (name == target.name)
            return &target;
    return nullptr;
}

WriteReport write_for(const Target& target, const std::string& path, const Volume& volume) {
    const bool shortened = volume.sh_order > target.highest_order;
    const bool dilated = target.dilate > 0 && !volume.validity.empty();
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
    if (target.notes == Notes::none || volume_format(path) != VolumeFormat::exr)
        return report;

    const Grid grid = turned_grid(volume.grid, from_gltf(target.encoding.axes));
    const std::string stem = fs::path(path).replace_extension().string();
    std::vector<WriteReport::File> notes;
    if (target.notes == Notes::godot)
        for (const WriteReport::File& file : report.files) {
            if (file.path.ends_with(".exr"))
                notes.push_back(write_text(file.path + ".import", godot_import(report)));
        }
    else if (target.notes == Notes::unity)
        notes.push_back(write_text(stem + ".unity.json", unity_notes(report, grid).dump(2) + "\n"));
    else
        notes.push_back(
            write_text(stem + ".unreal.json", unreal_notes(report, grid).dump(2) + "\n"));
    report.files.insert(report.files.end(), notes.begin(), notes.end());
    return report;
}

} // namespace lpvbake
