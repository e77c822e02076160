#include "io/points.h"

#include "file_error.h"
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

[[noreturn]] void reject(const std::string& path, const std::string& why) {
    throw Error(ErrorKind::invalid, path + ": " + why);
}

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

/// A form of points' files; null: it cannot be read, or written.
struct PointFormat {
    const char* suffix;
    void (*read)(const std::string& path, std::istream& in, Collected& to);
    void (*write)(std::ostream& out, const volume::LitPoints& lit);
};

constexpr PointFormat formats[] = {{".json", read_json, write_json}};

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
