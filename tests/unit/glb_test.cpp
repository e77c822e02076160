// A volume in its scene's file: EXT_light_volume, and scenes packed into one file.
#include "io/glb.h"
#include "io/io.h"
#include "lpvbake/pack.h"
#include "scene/scene_hash.h"
#include "unit/gltf_document.h"
#include "unit/volumes.h"
#include "volume/convention.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <cstring>

using namespace lpvbake;
using nlohmann::ordered_json;

namespace {

uint32_t word(const std::string& bytes, size_t offset) {
    uint32_t value;
    std::memcpy(&value, &bytes.at(offset + 3) - 3, 4);
    return value;
}

struct Parts {
    ordered_json json;
    std::string chunk;
};

/// A file that is what its header says, to the byte.
Parts parts_of(const std::string& path) {
    const std::string bytes = slurp(path);
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(word(bytes, 4), 2u);
    EXPECT_EQ(word(bytes, 8), bytes.size());
    const uint32_t json = word(bytes, 12), chunk = word(bytes, 20 + json);
    EXPECT_EQ(bytes.substr(16, 4), "JSON");
    EXPECT_EQ(bytes.substr(24 + json, 4), std::string("BIN\0", 4));
    EXPECT_EQ(json % 4 + chunk % 4, 0u);
    EXPECT_EQ(28 + json + chunk, bytes.size());
    return {ordered_json::parse(bytes.substr(20, json)), bytes.substr(28 + json)};
}

void put(const std::string& path, const Parts& parts) {
    std::string json = parts.json.dump();
    json.resize((json.size() + 3) / 4 * 4, ' ');
    const auto number = [](size_t value) {
        const auto word = uint32_t(value);
        return std::string(reinterpret_cast<const char*>(&word), 4);
    };
    spill(path, "glTF" + number(2) + number(28 + json.size() + parts.chunk.size())
                    + number(json.size()) + "JSON" + json + number(parts.chunk.size())
                    + std::string("BIN\0", 4) + parts.chunk);
}

ordered_json& volume_in(Parts& parts) {
    return parts.json["extensions"]["EXT_light_volume"]["volumes"][0];
}

/// As equal as a lattice is that went through its middle and its size.
void expect_same(Volume read, const Volume& expected) {
    EXPECT_EQ(read.grid.dims, expected.grid.dims);
    EXPECT_NEAR(read.grid.cell, expected.grid.cell, 1e-15);
    EXPECT_LT(glm::length(read.grid.origin - expected.grid.origin), 1e-14);
    read.grid = expected.grid;
    expect_equal(read, expected);
}

/// A room of one triangle, with a buffer and pictures beside it and extensions that nobody knows.
GltfDocument document() {
    GltfDocument made;
    const int positions = made.accessor<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}, real, "VEC3");
    made.place({{"name", "wall"}, {"mesh", 0}});
    made.root["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", positions}}}}}}}};
    made.root["extensionsUsed"] = {"VENDOR_unknown"};
    made.root["extensions"]["VENDOR_unknown"] = {{"number", 0.1}, {"buffer", 0}, {"bufferView", 0}};
    made.root["extras"] = {{"uri", "kept.txt"}, {"list", {1, 2.5, nullptr, "\u00e4"}}};
    return made;
}

/// Writes it with its buffer, two pictures and a second buffer beside it.
std::string with_files(GltfDocument made, const TemporaryFolder& folder) {
    spill(folder / "room of.bin", made.bytes + "and more than byteLength says");
    spill(folder / "a.jpg", "\xff\xd8\xff picture");
    spill(folder / "b.xyz", "no picture that is known");
    spill(folder / "second.bin", "12345");
    made.root["buffers"] = {{{"byteLength", made.bytes.size()}, {"uri", "room%20of.bin"}},
                            {{"byteLength", 5}, {"uri", "second.bin"}}};
    made.root["images"] = {{{"uri", "a.jpg"}, {"name", "a"}}, {{"uri", "b.xyz"}}, {{"uri", png}}};
    spill(folder / "room.gltf", made.root.dump());
    return folder / "room.gltf";
}

WriteReport write(const std::string& path, const Volume& volume, const PackedScene* scene = nullptr,
                  Precision precision = Precision::full, io::Packing packing = io::Packing::band) {
    return io::write_volume(path, volume, precision, {.packing = packing, .scene = scene});
}

} // namespace

TEST(Glb, FullPrecisionRoundTripsExactly) {
    for (const glm::ivec3 dims : {glm::ivec3(1), glm::ivec3(7, 13, 9)})
        for (const int order : {0, 1, 2, 4})
            for (const io::Packing packing :
                 {io::Packing::band, io::Packing::channel, io::Packing::atlas}) {
                if (packing != io::Packing::band && (order == 0 || order == 4))
                    continue;
                const TemporaryFolder folder;
                const std::string path = folder / "a.glb";
                Volume volume = random_volume(dims, order, dims.x != 1, 1);
                const WriteReport report = write(path, volume, nullptr, Precision::full, packing);
                EXPECT_EQ(report.bytes(), slurp(path).size());
                EXPECT_EQ(folder.count(), 1);
                if (packing == io::Packing::atlas) {
                    volume.occlusion.clear();
                    volume.validity.clear();
                    volume.walls.clear();
                }
                expect_same(read_volume(path), volume);
            }
}

TEST(Glb, HoldsTheValuesOf3DTextures) {
    const TemporaryFolder folder;
    Volume volume = random_volume({5, 4, 3}, 2, false, 2);
    for (glm::vec3& c : volume.sh[0])
        c = glm::abs(c);
    for (const Precision precision : {Precision::half, Precision::rgb9e5}) {
        io::write_volume(folder / "a.ktx2", volume, precision);
        write(folder / "a.glb", volume, nullptr, precision);
        expect_same(read_volume(folder / "a.glb"), read_volume(folder / "a_sh_l0.ktx2"));
    }
    io::write_volume(folder / "b.glb", volume, Precision::full, {},
                     {.convention = volume::ShConvention::irradiance});
    const Volume back = read_volume(folder / "b.glb");
    for (size_t k = 0; k < back.sh.size(); ++k)
        for (size_t i = 0; i < back.sh[k].size(); ++i)
            EXPECT_LT(glm::length(back.sh[k][i] - volume.sh[k][i]), 1e-3f);
}

TEST(Glb, KeepsAllOfTheSceneAndNeedsNoOtherFile) {
    const TemporaryFolder folder;
    const GltfDocument made = document();
    const std::string source = with_files(made, folder);
    const ordered_json before = ordered_json::parse(slurp(source));
    const std::string hash = scene::scene_hash(load_gltf(source));
    const PackedScene packed = pack_gltf(source);
    EXPECT_TRUE(packed.warnings.empty());
    write(folder / "lit.glb", random_volume({3, 2, 4}, 1, false, 3), &packed);
    const TemporaryFolder alone;
    std::filesystem::copy(folder / "lit.glb", alone / "lit.glb");
    const Scene scene = load_gltf(alone / "lit.glb");
    EXPECT_EQ(scene::scene_hash(scene), hash);
    for (const std::string& warning : scene.warnings)
        EXPECT_EQ(warning.find("EXT_light_volume"), std::string::npos) << warning;

    Parts parts = parts_of(alone / "lit.glb");
    ordered_json after = parts.json;
    EXPECT_EQ(parts.chunk.substr(0, made.bytes.size()), made.bytes);
    EXPECT_FALSE(after["buffers"][0].contains("uri"));
    EXPECT_EQ((size_t(after["buffers"][0]["byteLength"]) + 3) / 4 * 4, parts.chunk.size());
    EXPECT_EQ(after["buffers"][1]["uri"], "data:application/octet-stream;base64,MTIzNDU=");
    const ordered_json image = after["images"][0], view = after["bufferViews"][1];
    EXPECT_EQ(image,
              ordered_json::parse(R"({"name": "a", "mimeType": "image/jpeg", "bufferView": 1})"));
    EXPECT_EQ(parts.chunk.substr(view["byteOffset"], view["byteLength"]), "\xff\xd8\xff picture");
    EXPECT_TRUE(std::string(after["images"][1]["uri"]).starts_with("data:application/octet"));

    // But for what was packed and added it is the same, in the same order.
    EXPECT_EQ(after["extensionsUsed"].size(), 2u);
    EXPECT_EQ(after["nodes"].size(), 2u);
    EXPECT_EQ(after["scenes"][0]["nodes"], ordered_json({0, 1}));
    after["extensionsUsed"].erase(1);
    after["extensions"].erase("EXT_light_volume");
    after["nodes"].erase(1);
    after["scenes"][0]["nodes"].erase(1);
    while (after["bufferViews"].size() > before["bufferViews"].size())
        after["bufferViews"].erase(before["bufferViews"].size());
    after["buffers"] = before["buffers"];
    after["images"] = before["images"];
    EXPECT_EQ(after, before);
}

TEST(Glb, ABinarySceneKeepsItsBytes) {
    const TemporaryFolder folder;
    GltfDocument made = document();
    const std::string fill(3, '\0'); // a chunk may be longer than its buffer
    made.root["buffers"] = {{{"byteLength", made.bytes.size()}}};
    put(folder / "room.glb", {ordered_json::parse(made.root.dump()), made.bytes + fill + "."});
    const PackedScene packed = pack_gltf(folder / "room.glb");
    EXPECT_EQ(packed.bytes, made.bytes);
    EXPECT_EQ(ordered_json::parse(packed.json), parts_of(folder / "room.glb").json);
    write(folder / "lit.glb", random_volume({3, 2, 4}, 1, false, 3), &packed);
    EXPECT_EQ(parts_of(folder / "lit.glb").chunk.substr(0, made.bytes.size()), made.bytes);
}

TEST(Glb, TheSceneThatIsNamedGetsTheNode) {
    const TemporaryFolder folder;
    GltfDocument made = document();
    made.root["scenes"].push_back({{"name", "other"}, {"nodes", {0}}});
    const std::string source = with_files(made, folder);
    const PackedScene packed = pack_gltf(source, {.scene = "other"});
    write(folder / "lit.glb", random_volume({3, 2, 4}, 0, false, 3), &packed);
    const ordered_json scenes = parts_of(folder / "lit.glb").json["scenes"];
    EXPECT_EQ(scenes[0]["nodes"], ordered_json::array({0}));
    EXPECT_EQ(scenes[1]["nodes"], ordered_json({0, 1}));
    EXPECT_EQ(error_of("other", [&] { (void)pack_gltf(source, {.scene = "other one"}); }).kind,
              ErrorKind::argument);
}

TEST(Glb, TellsOfFilesThatItCannotPack) {
    const TemporaryFolder folder;
    GltfDocument made = document();
    made.root["extensions"]["VENDOR_unknown"]["sounds"] = {{{"uri", "a.mp3"}}};
    const PackedScene packed = pack_gltf(with_files(made, folder));
    ASSERT_EQ(packed.warnings.size(), 1u);
    EXPECT_NE(packed.warnings[0].find("extensions.VENDOR_unknown.sounds[0].uri: \"a.mp3\""),
              std::string::npos)
        << packed.warnings[0];
    const WriteReport report =
        write(folder / "lit.glb", random_volume({3, 2, 4}, 0, false, 3), &packed);
    EXPECT_EQ(report.warnings, packed.warnings);
}

TEST(Glb, RefusesToPackWhatIsNotThere) {
    const TemporaryFolder folder;
    GltfDocument made = document();
    const std::string source = with_files(made, folder);
    std::filesystem::remove(folder / "a.jpg");
    EXPECT_EQ(error_of(source + ": images[0].uri", [&] { (void)pack_gltf(source); }).kind,
              ErrorKind::file);
    made.root["buffers"] = {{{"byteLength", 4}, {"uri", "../out.bin"}}};
    spill(source, made.root.dump());
    EXPECT_EQ(error_of(source, [&] { (void)pack_gltf(source); }).kind, ErrorKind::invalid);
    made.root["buffers"] = {{{"byteLength", 4}}}; // as meshopt's stand-in for what it compressed
    spill(source, made.root.dump());
    EXPECT_EQ(error_of(source + ": buffers[0]", [&] { (void)pack_gltf(source); }).kind,
              ErrorKind::unsupported);
    made.root["buffers"] = {{{"byteLength", "4"}}};
    spill(source, made.root.dump());
    EXPECT_EQ(error_of(source, [&] { (void)pack_gltf(source); }).kind, ErrorKind::invalid);
    EXPECT_EQ(error_of("standard input", [&] { (void)pack_gltf(standard_input); }).kind,
              ErrorKind::argument);
}

TEST(Glb, IsReadWhereItsNodeStands) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.glb";
    const Volume volume = random_volume({5, 4, 3}, 2, false, 4);
    write(path, volume);
    Parts parts = parts_of(path);
    // A quarter turn about y: x goes to -z, z to x; then 10 m along x.
    parts.json["nodes"].push_back({{"children", {0}},
                                   {"rotation", {0, std::sqrt(0.5), 0, std::sqrt(0.5)}},
                                   {"translation", {10, 0, 0}}});
    parts.json["scenes"][0]["nodes"] = {1};
    put(path, parts);
    Volume expected = volume;
    volume::turn_axes(glm::dmat3(0, 0, -1, 0, 1, 0, 1, 0, 0), expected);
    expected.grid.origin.x += 10;
    expect_same(read_volume(path), expected);
    // Mirrored along x, by a matrix, twice as large.
    parts.json["nodes"][1] = {{"children", {0}},
                              {"matrix", {-2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 3, 0, 1}}};
    put(path, parts);
    expected = volume;
    volume::turn_axes(glm::dmat3(-1, 0, 0, 0, 1, 0, 0, 0, 1), expected);
    expected.grid.origin = 2.0 * expected.grid.origin + glm::dvec3(0, 3, 0);
    expected.grid.cell *= 2;
    expect_same(read_volume(path), expected);
}

TEST(Glb, PriorityAndFalloffStay) {
    const TemporaryFolder folder;
    Volume volume = random_volume({3, 2, 4}, 1, false, 5);
    volume.metadata["priority"] = "-2";
    volume.metadata["falloff"] = "0.25";
    write(folder / "a.glb", volume);
    Parts parts = parts_of(folder / "a.glb");
    EXPECT_EQ(volume_in(parts)["priority"], -2);
    EXPECT_EQ(volume_in(parts)["falloff"], 0.25);
    EXPECT_FALSE(volume_in(parts)["extras"]["metadata"].contains("priority"));
    expect_same(read_volume(folder / "a.glb"), volume);
    volume_in(parts).erase("extras"); // as others write it
    put(folder / "a.glb", parts);
    EXPECT_EQ(read_volume(folder / "a.glb").metadata,
              (std::map<std::string, std::string>{{"priority", "-2"}, {"falloff", "0.25"}}));
}

TEST(Glb, TheSameBytesWhateverTheThreads) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({9, 8, 7}, 2, true, 6);
    const PackedScene packed = pack_gltf(with_files(document(), folder));
    write(folder / "a.glb", volume, &packed);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    write(folder / "b.glb", volume, &packed);
    EXPECT_EQ(slurp(folder / "a.glb"), slurp(folder / "b.glb"));
}

TEST(Glb, SaysWhatItDoesNotHold) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.glb";
    const Volume volume = random_volume({3, 2, 4}, 1, false, 7);
    const auto refused = [&](const io::Pictures& pictures, const volume::Encoding& encoding) {
        EXPECT_EQ(
            error_of(path,
                     [&] { io::write_volume(path, volume, Precision::full, pictures, encoding); })
                .kind,
            ErrorKind::unsupported);
        EXPECT_FALSE(std::filesystem::exists(path));
    };
    refused({}, {.convention = volume::ShConvention::godot});
    refused({}, {.axes = volume::Axes::unity});
    refused({io::Packing::cube}, {});
    write(folder / "lit.glb", volume);
    const PackedScene lit = pack_gltf(folder / "lit.glb");
    refused({.scene = &lit}, {});
    EXPECT_EQ(error_of("lit.glb", [&] { io::check_has_no_volume(lit, "lit.glb"); }).kind,
              ErrorKind::unsupported);
    EXPECT_TRUE(io::has_light_volume(folder / "lit.glb"));
    spill(folder / "text.glb", "{}");
    EXPECT_FALSE(io::has_light_volume(folder / "text.glb"));
}

TEST(Glb, RefusesScenesThatAreNoGltf) {
    const TemporaryFolder folder;
    for (const char* json :
         {"[]", R"({"nodes": 5})", R"({"scenes": [], "scene": 0})", R"({"bufferViews": {"a": 1}})",
          R"({"extensions": []})", R"({"extensionsUsed": "none"})", R"({"buffers": {}})"}) {
        const PackedScene scene{json, {}, 0, {}};
        EXPECT_EQ(
            error_of("lit.glb",
                     [&] {
                         write(folder / "lit.glb", random_volume({3, 2, 4}, 0, false, 3), &scene);
                     })
                .kind,
            ErrorKind::invalid)
            << json;
        spill(folder / "scene.gltf", json);
        try {
            (void)pack_gltf(folder / "scene.gltf");
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, ErrorKind::invalid) << error.what();
        }
    }
    EXPECT_EQ(folder.count(), 1);
}

TEST(Glb, RefusesBrokenFilesByName) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.glb";
    write(path, random_volume({3, 2, 4}, 1, false, 8));
    const std::string whole = slurp(path);
    const Parts good = parts_of(path);
    for (size_t size = 0; size < whole.size(); size += size < 64 ? 1 : 61) {
        spill(path, whole.substr(0, size));
        const Error error = error_of(path, [&] { (void)read_volume(path); });
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        EXPECT_TRUE(size <= 20
                    || std::string(error.what()).find("or damaged; copy it again")
                           != std::string::npos)
            << error.what();
    }
    const struct {
        const char* what;
        std::function<void(ordered_json& root, ordered_json& volume)> edit;
        ErrorKind kind = ErrorKind::invalid;
    } cases[] = {
        {"no extension", [](auto& root, auto&) { root.erase("extensions"); }},
        {"no node", [](auto& root, auto&) { root["nodes"][0].erase("extensions"); }},
        {"no such volume",
         [](auto& root, auto&) {
             root["nodes"][0]["extensions"]["EXT_light_volume"]["volume"] = 1;
         }},
        {"two nodes",
         [](auto& root, auto&) { root["nodes"].push_back(ordered_json(root["nodes"][0])); },
         ErrorKind::unsupported},
        {"a circle", [](auto& root, auto&) { root["nodes"][0]["children"] = {0}; }},
        {"no such child", [](auto& root, auto&) { root["nodes"][0]["children"] = {7}; }},
        {"turned",
         [](auto& root, auto&) {
             root["nodes"][0]["rotation"] = {0, 0.6, 0, 0.8};
         },
         ErrorKind::unsupported},
        {"not cubes", [](auto& root, auto&) { root["nodes"][0]["scale"][1] = 7; },
         ErrorKind::unsupported},
        {"flat", [](auto& root, auto&) { root["nodes"][0]["scale"][1] = 0; }},
        {"sheared",
         [](auto& root, auto&) {
             root["nodes"][0].erase("scale");
             root["nodes"][0]["matrix"] = {1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
         }},
        {"no cells", [](auto&, auto& volume) { volume["cells"][1] = 0; }},
        {"many cells", [](auto&, auto& volume) { volume["cells"][1] = 1e18; }},
        {"other cells",
         [](auto&, auto& volume) {
             volume["cells"] = {4, 2, 3};
         },
         ErrorKind::unsupported}, // whose box is not of cubes
        {"convention", [](auto&, auto& volume) { volume["convention"] = "godot"; }},
        {"order", [](auto&, auto& volume) { volume["order"] = 5; }},
        {"higher order", [](auto&, auto& volume) { volume["order"] = 2; }},
        {"textures", [](auto&, auto& volume) { volume["textures"] = ordered_json::array(); }},
        {"too few channels", [](auto&, auto& volume) { volume["textures"][0].erase("channels"); }},
        {"unknown view", [](auto&, auto& volume) { volume["textures"][0]["bufferView"] = 99; }},
        {"view of nothing", [](auto&, auto& volume) { volume["textures"][0]["bufferView"] = -1; }},
        {"another texture", [](auto&, auto& volume) { volume["textures"][4]["bufferView"] = 0; }},
        {"past the end", [](auto& root, auto&) { root["bufferViews"][0]["byteOffset"] = 1 << 30; }},
        {"another buffer", [](auto& root, auto&) { root["bufferViews"][0]["buffer"] = 1; }},
        {"outside", [](auto& root, auto&) { root["buffers"][0]["uri"] = "a.bin"; }},
        {"no KTX2", [](auto& root, auto&) { root["bufferViews"][0]["byteOffset"] = 1; }},
        {"a number for a list", [](auto&, auto& volume) { volume["textures"] = 1; }},
        {"priority", [](auto&, auto& volume) { volume["priority"] = "high"; }},
        {"nodes", [](auto& root, auto&) { root["nodes"] = "none"; }},
    };
    for (const auto& [what, edit, kind] : cases) {
        Parts parts = good;
        edit(parts.json, volume_in(parts));
        put(path, parts);
        EXPECT_EQ(error_of(path, [&] { (void)read_volume(path); }).kind, kind) << what;
    }
    put(path, good);
    EXPECT_EQ(slurp(path).size(), whole.size());
    (void)read_volume(path);
}
