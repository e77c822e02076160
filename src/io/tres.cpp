#include "io/tres.h"

#include "io/atomic_file.h"
#include "io/described.h"
#include "io/layout.h"
#include "lpvbake/error.h"
#include "volume/sh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <ostream>

namespace lpvbake::io {
namespace {

constexpr const char* description_format = "lpvbake probes";
constexpr size_t most_cells = size_t(1) << 20; ///< of half a gigabyte of text
constexpr size_t coefficients = 9;
constexpr uint64_t most_bytes = uint64_t(1) << 32;
constexpr std::string_view description_key = "metadata/lpvbake = ";
constexpr std::string_view light_key = "\"sh\": PackedColorArray(";

// ---- tetrahedra ----

/// The orders of a point's coordinates in a brick, largest first: each is a tetrahedron (Kuhn's
/// triangulation, which fits together from brick to brick).
constexpr std::array<std::array<int, 3>, 6> orders{
    {{0, 1, 2}, {0, 2, 1}, {2, 0, 1}, {1, 0, 2}, {1, 2, 0}, {2, 1, 0}}};

/// A node of the tree as Godot reads it: a plane, and where points over it and others go on; below
/// 0 a tetrahedron, -1 - its index.
struct Node {
    std::array<float, 4> plane;
    int32_t over, under;
};

/// Probes at the faces of the box and the centres of its cells.
class Probes {
public:
    explicit Probes(const Grid& grid) : cells_(grid.dims), count_(grid.dims + 2) {
        for (int a = 0; a < 3; ++a) {
            const double lo = grid.origin[a], hi = lo + grid.cell * grid.dims[a];
            places_[size_t(a)].push_back(lo);
            for (int i = 0; i < grid.dims[a]; ++i)
                places_[size_t(a)].push_back(lo + (i + 0.5) * grid.cell);
            places_[size_t(a)].push_back(hi);
        }
    }

    size_t size() const { return size_t(count_.x) * size_t(count_.y) * size_t(count_.z); }
    glm::dvec3 place(glm::ivec3 at) const {
        return {places_[0][size_t(at.x)], places_[1][size_t(at.y)], places_[2][size_t(at.z)]};
    }
    /// Calls visit(probe, the cell whose light it has) in the order of their numbers.
    template <class Visit>
    void for_each(const Visit& visit) const {
        for (int z = 0; z < count_.z; ++z)
            for (int y = 0; y < count_.y; ++y)
                for (int x = 0; x < count_.x; ++x) {
                    const glm::ivec3 at(x, y, z);
                    visit(at, glm::clamp(at - 1, glm::ivec3(0), cells_ - 1));
                }
    }
    /// Calls visit(probe) for the four of each tetrahedron.
    template <class Visit>
    void for_each_corner(const Visit& visit) const {
        const glm::ivec3 bricks = count_ - 1;
        for (int z = 0; z < bricks.z; ++z)
            for (int y = 0; y < bricks.y; ++y)
                for (int x = 0; x < bricks.x; ++x)
                    for (const std::array<int, 3>& order : orders) {
                        glm::ivec3 at(x, y, z);
                        visit(number(at, count_));
                        for (const int axis : order) {
                            ++at[axis];
                            visit(number(at, count_));
                        }
                    }
    }
    std::vector<Node> tree() const {
        std::vector<Node> nodes;
        add_box({0, 0, 0}, count_ - 1, nodes);
        return nodes;
    }

private:
    static size_t number(glm::ivec3 at, glm::ivec3 count) {
        return (size_t(at.z) * size_t(count.y) + size_t(at.y)) * size_t(count.x) + size_t(at.x);
    }

    /// Of the bricks [lo, hi). Children come after their parents, as Godot asks.
    int32_t add_box(glm::ivec3 lo, glm::ivec3 hi, std::vector<Node>& nodes) const {
        const glm::ivec3 size = hi - lo;
        if (size == glm::ivec3(1))
            return add_brick(lo, nodes);
        const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        const int middle = lo[axis] + size[axis] / 2;
        Node node{};
        node.plane[size_t(axis)] = 1;
        node.plane[3] = float(places_[size_t(axis)][size_t(middle)]);
        const size_t index = nodes.size();
        nodes.push_back(node);
        glm::ivec3 end = hi, begin = lo;
        end[axis] = begin[axis] = middle;
        nodes[index].under = add_box(lo, end, nodes); // the vector may move
        nodes[index].over = add_box(begin, hi, nodes);
        return int32_t(index);
    }

    /// Compares coordinates in the brick until their order is known.
    int32_t add_brick(glm::ivec3 brick, std::vector<Node>& nodes) const {
        const auto first = int32_t(nodes.size());
        const auto tetrahedron = [&](int order) {
            return int32_t(-1 - int64_t(6 * number(brick, count_ - 1)) - order);
        };
        const auto add = [&](int a, int b, int32_t over, int32_t under) {
            const glm::dvec3 lo = place(brick), side = place(brick + 1) - lo;
            glm::dvec3 normal(0);
            normal[a] = 1 / side[a];
            normal[b] = -1 / side[b];
            normal = glm::normalize(normal);
            nodes.push_back(
                {{float(normal.x), float(normal.y), float(normal.z), float(glm::dot(normal, lo))},
                 over,
                 under});
        };
        add(0, 1, first + 1, first + 3);
        add(1, 2, tetrahedron(0), first + 2);
        add(0, 2, tetrahedron(1), tetrahedron(2));
        add(0, 2, tetrahedron(3), first + 4);
        add(1, 2, tetrahedron(4), tetrahedron(5));
        return first;
    }

    glm::ivec3 cells_, count_;
    std::array<std::vector<double>, 3> places_;
};

// ---- writing ----

/// Numbers with commas between them, in pieces as they come.
class List {
public:
    explicit List(std::ostream& out) : out_(out) {}
    ~List() { flush(); }
    List(const List&) = delete;
    List& operator=(const List&) = delete;

    /// As few digits as tell it from all others, or four, which half precision has.
    void add(float value, bool four_digits = false) {
        char text[32];
        const auto [end, error] =
            four_digits ? std::to_chars(text, text + 32, value, std::chars_format::general, 4)
                        : std::to_chars(text, text + 32, value);
        append({text, end});
    }
    void add(int64_t value) { append(std::to_string(value)); }

private:
    void append(std::string_view text) {
        if (!is_first_)
            text_ += ", ";
        is_first_ = false;
        text_ += text;
        if (text_.size() > (1 << 16))
            flush();
    }
    void flush() {
        out_.write(text_.data(), std::streamsize(text_.size()));
        text_.clear();
    }

    std::ostream& out_;
    std::string text_;
    bool is_first_ = true;
};

/// The resource as Godot 4 writes it (LightmapGIData::_get_probe_data of scene/3d/lightmap_gi.cpp).
void write_resource(const Volume& volume, bool four_digits, const std::string& description,
                    std::ostream& out) {
    const Probes probes(volume.grid);
    const auto list = [&](const char* begin, const auto& fill) {
        out << begin;
        {
            List numbers(out);
            fill(numbers);
        }
        out << ")";
    };
    const auto add_three = [](List& numbers, const glm::dvec3& v) {
        for (int a = 0; a < 3; ++a)
            numbers.add(float(v[a]));
    };
    out << "[gd_resource type=\"LightmapGIData\" format=3]\n\n[resource]\n"
        << description_key << Json(description).dump() << "\n"
        << "probe_data = {\n\"baked_exposure\": 1.0,\n";
    list("\"bounds\": AABB(", [&](List& numbers) {
        add_three(numbers, volume.grid.origin);
        add_three(numbers, volume.grid.cell * glm::dvec3(volume.grid.dims));
    });
    list(",\n\"bsp\": PackedInt32Array(", [&](List& numbers) {
        for (const Node& node : probes.tree()) {
            for (const float value : node.plane)
                numbers.add(int64_t(std::bit_cast<int32_t>(value)));
            numbers.add(int64_t(node.over));
            numbers.add(int64_t(node.under));
        }
    });
    // The sky's light is in the volume.
    list(",\n\"interior\": true,\n\"lightprobe_hash\": 0,\n\"points\": PackedVector3Array(",
         [&](List& numbers) {
             probes.for_each(
                 [&](glm::ivec3 at, glm::ivec3) { add_three(numbers, probes.place(at)); });
         });
    out << ",\n";
    list(light_key.data(), [&](List& numbers) {
        probes.for_each([&](glm::ivec3, glm::ivec3 cell) {
            const size_t i = volume.grid.index(cell);
            for (size_t k = 0; k < coefficients; ++k) {
                for (int c = 0; c < 3; ++c)
                    numbers.add(k < volume.sh.size() ? volume.sh[k][i][c] : 0.0f, four_digits);
                numbers.add(int64_t(1));
            }
        });
    });
    list(",\n\"tetrahedra\": PackedInt32Array(", [&](List& numbers) {
        probes.for_each_corner([&](size_t probe) { numbers.add(int64_t(probe)); });
    });
    out << "\n}\n";
}

// ---- reading ----

/// What stands behind a key, in the whole text.
std::string_view behind(std::string_view text, std::string_view key, const std::string& path) {
    const size_t found = text.find(key);
    if (found == std::string_view::npos)
        reject(path, "has no " + std::string(key)
                         + "...: it is no volume of lpvbake, or cut off; bake it again");
    return text.substr(found + key.size());
}

/// The next number of a list. Throws Error (invalid).
float next_number(std::string_view& text, const std::string& path) {
    const size_t begin = text.find_first_not_of(", \n\r\t");
    text.remove_prefix(std::min(begin, text.size()));
    float value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc())
        reject(path,
               "has fewer numbers of light than probes, or what is no number: it is cut off or "
               "damaged; bake it again");
    text.remove_prefix(size_t(end - text.data()));
    return value;
}

std::string description_in(std::string_view text, const std::string& path) {
    const std::string_view rest = behind(text, description_key, path);
    const Json description =
        Json::parse(rest.substr(0, rest.find('\n')), nullptr, false); // Godot's strings are JSON's
    if (!description.is_string())
        reject(path, "its description is not a text on one line: it is cut off or damaged; bake it "
                     "again");
    return description.get<std::string>();
}

Volume read_text(const std::string& text, const Json& json, const std::string& path,
                 volume::GridKinds kinds) {
    Volume volume = empty_volume(path, json, description_format, kinds);
    if (volume.grid.size() > most_cells || volume.sh_order > 2)
        reject(path, "has more than 2^20 cells, or more than order 2");
    const volume::Encoding encoding = encoding_in(path, json);
    for (const GridKind* kind : kinds)
        volume::set_grids(volume, *kind,
                          kind == &volume::light_kind() ? volume::sh_count(volume.sh_order) : 0);
    std::string_view rest = behind(text, light_key, path);
    const auto is_inner = [&](glm::ivec3 at) {
        return glm::all(glm::greaterThan(at, glm::ivec3(0)))
               && glm::all(glm::lessThanEqual(at, volume.grid.dims));
    };
    Probes(volume.grid).for_each([&](glm::ivec3 at, glm::ivec3 cell) {
        const size_t i = volume.grid.index(cell);
        for (size_t k = 0; k < coefficients; ++k)
            for (int c = 0; c < 4; ++c)
                if (const float value = next_number(rest, path);
                    c < 3 && k < volume.sh.size() && is_inner(at))
                    volume.sh[k][i][c] = value;
    });
    if (!rest.starts_with(')'))
        reject(path, "has more numbers of light than probes");
    decode(encoding, path, volume);
    return volume;
}

} // namespace

constexpr VolumeFormat tres_format{.extension = ".tres",
                                   .help = "NAME.tres, probes of Godot 4's LightmapGI",
                                   .write = write_tres,
                                   .read = read_tres};

WriteReport write_tres(const std::string& path, const Stored& stored, Precision wanted,
                       const Pictures&) {
    const Volume& volume = stored.volume();
    if (stored.encoding().convention != volume::ShConvention::godot
        || stored.encoding().axes != volume::Axes::gltf || volume.sh_order > 2)
        throw Error(ErrorKind::unsupported,
                    path + ": holds light as Godot has it; add `target` godot");
    if (volume.grid.is_turned())
        throw Error(ErrorKind::unsupported,
                    path
                        + ": probes stand along the axes, and the volume is turned against them; "
                          "write .exr, .ktx2 or .dds");
    if (volume.grid.size() > most_cells)
        throw Error(ErrorKind::unsupported,
                    path + ": " + std::to_string(volume.grid.size())
                        + " cells would be more than half a gigabyte of text; at most 2^20 are "
                          "written, take fewer, or .exr");
    WriteReport report;
    const Precision precision = stored.precision(wanted, path, report);
    Json json = describe(description_format, stored, precision);
    json["metadata"] = metadata_of(volume);
    const std::string description = text_of(json);
    AtomicFile file(path);
    file.write([&](std::ostream& out) {
        write_resource(volume, precision == Precision::half, description, out);
    });
    report.files = {{path, file.seal()}};
    file.publish();
    return report;
}

Volume read_tres(const std::string& path, volume::GridKinds kinds) {
    const std::string text = read_file(path, most_bytes);
    Volume volume = read_description(path, description_in(text, path), [&](const Json& json) {
        return read_text(text, json, path, kinds);
    });
    check_volume(volume, path, ErrorKind::invalid);
    return volume;
}

} // namespace lpvbake::io
