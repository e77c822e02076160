#include "io/points.h"

#include "file_error.h"
#include "image/image.h"
#include "io/atomic_file.h"
#include "io/described.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <ostream>

namespace lpvbake::io {
namespace {

std::string suffix_of(const std::string& path) {
    std::string suffix = std::filesystem::path(path).extension();
    std::ranges::transform(suffix, suffix.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return suffix;
}

/// Points on their way in, one after the other.
class Collected {
public:
    explicit Collected(const std::string& path) : path_(path) {}

    /// `where` says of which place in the file.
    void add_position(glm::dvec3 at, const auto& where) {
        if (points.positions.size() == volume::most_points)
            reject(path_,
                   format("has more than %zu points; bake them in parts", volume::most_points));
        check_finite(at, where);
        points.positions.push_back(at);
    }
    void add_normal(glm::dvec3 normal, const auto& where) {
        if (points.normals.size() == volume::most_points)
            reject(path_, format("has more than %zu normals", volume::most_points));
        check_finite(normal, where);
        const double largest =
            std::max({std::abs(normal.x), std::abs(normal.y), std::abs(normal.z)});
        if (!(largest > 0.0))
            reject(path_, where() + ": has no direction: a normal may not be 0,0,0");
        points.normals.push_back(glm::vec3(glm::normalize(normal / largest)));
    }
    volume::Points take() {
        if (points.positions.empty())
            reject(path_, "has no point");
        if (!points.normals.empty() && points.normals.size() != points.positions.size())
            reject(path_, "has " + counted(points.positions.size(), "point") + " and "
                              + counted(points.normals.size(), "normal")
                              + "; give one a point, or none");
        return std::move(points);
    }

    volume::Points points;

private:
    void check_finite(glm::dvec3 at, const auto& where) const {
        if (!(std::isfinite(at.x) && std::isfinite(at.y) && std::isfinite(at.z)))
            reject(path_, where() + ": is not finite");
    }
    const std::string& path_;
};

/// Takes a document as it is read: {"points": [[x, y, z], ...], "normals": [...]}.
class JsonReader : public nlohmann::json_sax<nlohmann::json> {
public:
    JsonReader(const std::string& path, Collected& to) : path_(path), to_(to) {}

    bool null() override { unwanted("null"); }
    bool boolean(bool) override { unwanted("a boolean"); }
    bool string(string_t&) override { unwanted("a string"); }
    bool binary(binary_t&) override { unwanted("bytes"); }
    bool number_integer(number_integer_t number) override { return take(double(number)); }
    bool number_unsigned(number_unsigned_t number) override { return take(double(number)); }
    bool number_float(number_float_t number, const string_t&) override { return take(number); }

    bool start_object(std::size_t) override {
        if (depth_++ > 0)
            unwanted("an object");
        return true;
    }
    bool end_object() override {
        --depth_;
        if (!(seen_ & 1))
            reject(path_, "lacks \"points\", an array of [x, y, z]");
        return true;
    }
    bool key(string_t& name) override {
        if (name != "points" && name != "normals")
            reject(path_, "has an unknown property " + in_quotes(name)
                              + "; there are \"points\" and \"normals\"");
        normals_ = name == "normals";
        const int bit = normals_ ? 2 : 1;
        if (seen_ & bit)
            reject(path_, "has " + in_quotes(name) + " twice");
        seen_ |= bit;
        count_ = 0;
        return true;
    }
    bool start_array(std::size_t) override {
        if (depth_ == 0 || depth_ > 2)
            unwanted("an array");
        ++depth_;
        numbers_ = 0;
        return true;
    }
    bool end_array() override {
        if (--depth_ == 1)
            return true;
        if (numbers_ != 3)
            reject(path_, place() + ": must be an array of 3 numbers");
        const auto where = [this] { return place(); };
        if (normals_)
            to_.add_normal(vector_, where);
        else
            to_.add_position(vector_, where);
        ++count_;
        return true;
    }
    bool parse_error(std::size_t, const std::string&,
                     const nlohmann::detail::exception& error) override {
        reject(path_, "not JSON of finite numbers: " + without_label(error.what()));
    }

private:
    std::string place() const {
        return (normals_ ? "normals[" : "points[") + std::to_string(count_) + "]";
    }
    bool take(double number) {
        if (depth_ != 3)
            unwanted("a number");
        if (numbers_ < 3)
            vector_[numbers_++] = number;
        else
            reject(path_, place() + ": must be an array of 3 numbers");
        return true;
    }
    [[noreturn]] void unwanted(const char* what) const {
        if (depth_ == 0 || seen_ == 0)
            reject(path_, "must be an object with \"points\", an array of [x, y, z]");
        if (depth_ == 1)
            reject(path_, std::string(normals_ ? "normals" : "points") + ": must be an array");
        reject(path_, place() + ": must be an array of 3 numbers, has " + what);
    }

    const std::string& path_;
    Collected& to_;
    int depth_ = 0, seen_ = 0, numbers_ = 0;
    bool normals_ = false;
    std::size_t count_ = 0;
    glm::dvec3 vector_{0.0};
};

void read_json(const std::string& path, std::istream& in, Collected& to) {
    JsonReader reader(path, to);
    nlohmann::json::sax_parse(in, &reader);
}

/// The number that a text is, as std::from_chars reads it; false: it is none, or more than one.
bool read_number(std::string_view text, double& number) {
    const auto is_space = [](char c) { return c == ' ' || c == '\t'; };
    while (!text.empty() && is_space(text.front()))
        text.remove_prefix(1);
    while (!text.empty() && is_space(text.back()))
        text.remove_suffix(1);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    return error == std::errc() && end == text.data() + text.size();
}

/// Lines of x,y,z or x,y,z,nx,ny,nz, below one that names them, or none.
void read_csv(const std::string& path, std::istream& in, Collected& to) {
    constexpr int most_characters = 1024;
    char text[most_characters];
    std::size_t columns = 0;
    for (std::size_t line = 1; in.getline(text, most_characters); ++line) {
        const auto where = [&] { return "line " + std::to_string(line); };
        std::string_view left(text);
        if (left.ends_with('\r'))
            left.remove_suffix(1);
        if (line == 1 && left.starts_with("\xEF\xBB\xBF")) // UTF-8, as spreadsheets say
            left.remove_prefix(3);
        if (left.empty())
            continue;
        if (line == 1 && (left == "x,y,z" || left == "x,y,z,nx,ny,nz")) {
            columns = std::size_t(std::ranges::count(left, ',')) + 1;
            continue;
        }
        double numbers[6];
        std::size_t count = 0;
        for (bool more = true; more; ++count) {
            const std::size_t comma = left.find(',');
            more = comma != left.npos;
            if (count == 6 || !read_number(left.substr(0, comma), numbers[count]))
                reject(path, where()
                                 + ": is not x,y,z or x,y,z,nx,ny,nz in numbers "
                                   "with decimal points, separated by commas");
            left.remove_prefix(more ? comma + 1 : 0);
        }
        if (columns == 0)
            columns = count;
        if ((count != 3 && count != 6) || count != columns)
            reject(path, where() + ": has " + counted(count, "column") + " instead of "
                             + (columns == 6   ? "6"
                                : columns == 3 ? "3"
                                               : "3 or 6"));
        to.add_position({numbers[0], numbers[1], numbers[2]}, where);
        if (count == 6)
            to.add_normal({numbers[3], numbers[4], numbers[5]}, where);
    }
    if (!in.eof())
        reject(path, format("has a line of %d characters or more", most_characters));
}

/// What stands behind a key of the dictionary in an NPY file's header, up to `end` in it.
std::string_view npy_value(const std::string& path, std::string_view header, std::string_view key,
                           std::string_view end) {
    const std::size_t at = header.find(key), from = at + key.size();
    const std::size_t to = at == header.npos ? at : header.find(end, from);
    if (to == header.npos)
        reject(path, "its header lacks " + std::string(key.substr(0, key.size() - 1)));
    std::string_view value = header.substr(from, to - from);
    value.remove_prefix(std::min(value.find_first_not_of(' '), value.size()));
    return value;
}

/// The numbers of a shape, such as "5, 3"; empty: it is none.
std::vector<std::size_t> npy_shape(std::string_view text) {
    std::vector<std::size_t> shape;
    while (!text.empty()) {
        const std::size_t comma = std::min(text.find(','), text.size());
        double side = 0;
        if (!read_number(text.substr(0, comma), side) || !(side >= 0) || side != std::floor(side)
            || side > 1e15)
            return {};
        shape.push_back(std::size_t(side));
        text.remove_prefix(std::min(comma + 1, text.size()));
    }
    return shape;
}

/// An array of n x 3 or n x 6 little-endian floats or doubles, or height x width of these (NumPy's
/// format 1.0 to 3.0).
void read_npy(const std::string& path, std::istream& in, Collected& to) {
    char magic[8];
    unsigned char size[4] = {};
    if (!in.read(magic, 8) || std::string_view(magic, 6) != "\x93NUMPY" || magic[6] < 1
        || magic[6] > 3 || !in.read(reinterpret_cast<char*>(size), magic[6] == 1 ? 2 : 4))
        reject(path, "is no NPY file of version 1 to 3");
    const std::size_t length =
        size[0] | size[1] << 8 | std::size_t(size[2]) << 16 | std::size_t(size[3]) << 24;
    std::string header(std::min<std::size_t>(length, 65536), ' ');
    if (length > header.size() || !in.read(header.data(), std::streamsize(length)))
        reject(path, "its header is cut off, or longer than 65536 bytes");
    const std::string_view type = npy_value(path, header, "'descr':", ",");
    if (type != "'<f4'" && type != "'<f8'")
        reject(path, "has numbers of type " + printable(type)
                         + "; write little-endian floats, '<f4' or '<f8'");
    if (npy_value(path, header, "'fortran_order':", ",") != "False")
        reject(path, "is in Fortran's order; write it in C's, as numpy.ascontiguousarray makes it");
    const std::string_view shape = npy_value(path, header, "'shape': (", ")");
    const std::vector<std::size_t> sides = npy_shape(shape);
    const std::size_t columns = sides.empty() ? 0 : sides.back();
    if (sides.size() < 2 || sides.size() > 3 || (columns != 3 && columns != 6))
        reject(path,
               "has the shape (" + printable(shape)
                   + "); it has to be (n, 3), (n, 6), (height, width, 3) or (height, width, 6)");
    double rows = 1;
    for (std::size_t i = 0; i + 1 < sides.size(); ++i)
        rows *= double(sides[i]);
    if (rows > double(volume::most_points))
        reject(path, format("has %.0f points, more than %zu; bake them in parts", rows,
                            volume::most_points));
    if (sides.size() == 3)
        to.points.width = sides[1];
    const bool is_double = type == "'<f8'";
    for (std::size_t row = 0; row < std::size_t(rows); ++row) {
        double numbers[6];
        float floats[6];
        if (!(is_double ? in.read(reinterpret_cast<char*>(numbers), std::streamsize(columns * 8))
                        : in.read(reinterpret_cast<char*>(floats), std::streamsize(columns * 4))))
            reject(path, format("ends in row %zu of %.0f", row, rows));
        if (!is_double)
            std::copy_n(floats, columns, numbers);
        const auto where = [row] { return "row " + std::to_string(row); };
        to.add_position({numbers[0], numbers[1], numbers[2]}, where);
        if (columns == 6)
            to.add_normal({numbers[3], numbers[4], numbers[5]}, where);
    }
    if (in.peek() != std::istream::traits_type::eof())
        reject(path, "goes on after its array");
}

// ---- writing ----

/// A list of numbers, each in as few digits as tell it from others of its type.
template <class T>
void put(std::ostream& out, const T* numbers, int count) {
    char text[32];
    for (int i = 0; i < count; ++i) {
        const auto [end, error] = std::to_chars(text, text + sizeof text, numbers[i]);
        out << (i == 0 ? "[" : ",") << std::string_view(text, end);
    }
    out << ']';
}

void write_json(std::ostream& out, const volume::LitPoints& lit) {
    Json head{{"format", "lpvbake points"},
              {"version", 1},
              {"sh_order", lit.light.sh_order},
              {"convention", volume::name_of(volume::ShConvention::radiance)},
              {"metadata", metadata_of(lit.light)}};
    std::string text = head.dump(1, ' ', false, Json::error_handler_t::replace);
    text.resize(text.rfind('\n'));
    out << text << ",\n \"points\": [";
    for (std::size_t i = 0; i < lit.points.positions.size(); ++i) {
        put(out << (i == 0 ? "\n" : ",\n") << "  {\"position\":", &lit.points.positions[i].x, 3);
        if (!lit.points.normals.empty())
            put(out << ",\"normal\":", &lit.points.normals[i].x, 3);
        out << ",\"sh\":";
        for (std::size_t k = 0; k < lit.light.sh.size(); ++k)
            put(out << (k == 0 ? '[' : ','), &lit.light.sh[k][i].x, 3);
        out << ']';
        if (!lit.irradiance.empty())
            put(out << ",\"irradiance\":", &lit.irradiance[i].x, 3);
        out << ",\"validity\":" << (lit.light.validity[i] > 0.0f ? 1 : 0)
            << format(",\"backs\":%.9g", double(lit.backs[i]));
        put(out << ",\"sky\":", &lit.sky[i].x, 4);
        out << '}';
    }
    out << "\n ]\n}\n";
}

template <class T>
void put_bytes(std::ostream& out, const T& value) {
    out.write(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Width and height of the picture of which points are the texels; of a list, one in each row.
std::pair<std::size_t, std::size_t> size_of(const volume::Points& points) {
    const std::size_t width = std::max<std::size_t>(points.width, 1);
    return {width, points.positions.size() / width};
}

/// A structured array, a record a point, of the points' shape (NumPy's format 1.0).
void write_npy(std::ostream& out, const volume::LitPoints& lit) {
    std::string fields = "('position', '<f8', (3,)), ";
    if (!lit.points.normals.empty())
        fields += "('normal', '<f4', (3,)), ('irradiance', '<f4', (3,)), ";
    fields += format("('sh', '<f4', (%zu, 3)), ('validity', '<f4'), ('backs', '<f4'), "
                     "('sky', '<f4', (4,))",
                     lit.light.sh.size());
    const auto [width, height] = size_of(lit.points);
    std::string header = "{'descr': [" + fields + "], 'fortran_order': False, 'shape': ("
                         + std::to_string(height) + ","
                         + (lit.points.width > 0 ? " " + std::to_string(width) : "") + "), }";
    header.resize((10 + header.size() + 1 + 63) / 64 * 64 - 10 - 1, ' ');
    header += '\n';
    out << "\x93NUMPY" << '\x01' << '\0';
    put_bytes(out, uint16_t(header.size()));
    out << header;
    for (std::size_t i = 0; i < lit.points.positions.size(); ++i) {
        put_bytes(out, lit.points.positions[i]);
        if (!lit.points.normals.empty()) {
            put_bytes(out, lit.points.normals[i]);
            put_bytes(out, lit.irradiance[i]);
        }
        for (const std::vector<glm::vec3>& coefficient : lit.light.sh)
            put_bytes(out, coefficient[i]);
        put_bytes(out, lit.light.validity[i]);
        put_bytes(out, lit.backs[i]);
        put_bytes(out, lit.sky[i]);
    }
}

/// A picture of float channels: irradiance as R, G and B, and all else in layers.
void write_exr(std::ostream& out, const volume::LitPoints& lit) {
    std::vector<image::Channel> channels;
    const auto add = [&](const std::string& layer, const char* names, const float* first) {
        const std::size_t count = std::strlen(names);
        for (std::size_t c = 0; c < count; ++c)
            channels.push_back({layer + names[c], first + c, count});
    };
    if (!lit.irradiance.empty())
        add("", "RGB", &lit.irradiance[0].x);
    for (const volume::ConstGridView& grid : volume::grids_of(lit.light, volume::light_kind()))
        add(grid.name() + '.', "RGB", grid.data);
    channels.push_back({"validity", lit.light.validity.data(), 1});
    channels.push_back({"backs", lit.backs.data(), 1});
    for (std::size_t k = 0; k < 4; ++k)
        channels.push_back({format("sky.%zu", k), &lit.sky[0].x + k, 4});
    std::map<std::string, std::string> attributes;
    const Json metadata = metadata_of(lit.light);
    for (const auto& [key, value] : metadata.items())
        attributes["lpv:" + key] = value.get<std::string>();
    attributes["lpv:sh_order"] = std::to_string(lit.light.sh_order);
    attributes["lpv:convention"] = volume::name_of(volume::ShConvention::radiance);
    const auto [width, height] = size_of(lit.points);
    image::write_exr(out, int(width), int(height), channels, attributes, "points");
}

/// A form of points' files; null: it cannot be read, or written.
struct PointFormat {
    const char* suffix;
    void (*read)(const std::string& path, std::istream& in, Collected& to);
    void (*write)(std::ostream& out, const volume::LitPoints& lit);
};

constexpr PointFormat formats[] = {{".json", read_json, write_json},
                                   {".csv", read_csv, nullptr},
                                   {".npy", read_npy, write_npy},
                                   {".exr", nullptr, write_exr}};

const PointFormat* format_of(const std::string& path) {
    const auto found = std::ranges::find(formats, suffix_of(path),
                                         [](const PointFormat& each) { return each.suffix; });
    return found == std::end(formats) ? nullptr : found;
}

std::string list_of(const auto& has) {
    std::string text;
    for (const PointFormat& each : formats)
        if (has(each))
            text += (text.empty() ? "" : ", ") + std::string(each.suffix);
    return text;
}

} // namespace

volume::Points read_points(const std::string& path) {
    const PointFormat* const form = format_of(path);
    if (!form || !form->read)
        throw Error(ErrorKind::argument,
                    path + ": unknown kind of file of points; use " + point_format_list());
    refuse_pipes(path, path);
    errno = 0;
    std::ifstream in(path, std::ios::binary);
    if (std::error_code ignored; std::filesystem::is_directory(path, ignored))
        throw Error(ErrorKind::file, path + ": is a folder");
    if (!in)
        throw Error(kind_of_file_error(errno), path + ": " + std::strerror(errno));
    Collected collected(path);
    form->read(path, in, collected);
    if (in.bad())
        throw Error(ErrorKind::io, path + ": cannot be read");
    return collected.take();
}

std::string point_format_list() {
    return list_of([](const PointFormat& each) { return each.read != nullptr; });
}

std::string lit_point_format_list() {
    return list_of([](const PointFormat& each) { return each.write != nullptr; });
}

bool is_lit_point_format(const std::string& path) {
    const PointFormat* const form = format_of(path);
    return form && form->write;
}

WriteReport write_points(const std::string& path, const volume::LitPoints& lit) {
    if (!is_lit_point_format(path))
        throw Error(ErrorKind::argument,
                    path + ": unknown kind of file for the light at points; use "
                        + lit_point_format_list());
    AtomicFile file(path);
    file.write([&](std::ostream& out) { format_of(path)->write(out, lit); });
    WriteReport report;
    report.files.push_back({path, file.seal()});
    file.publish();
    return report;
}

} // namespace lpvbake::io
