#include "report/plot.h"

#include "lpvbake/error.h"
#include "text.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace lpvbake::report {
namespace {

/// Told apart with any kind of colour vision (Okabe and Ito 2008); one a grid.
constexpr std::array colours = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                "#E69F00", "#56B4E9", "#000000"};
/// gnuplot's point types: circle, square, triangle, diamond, each filled, then open.
constexpr std::array shapes = {7, 5, 9, 13, 11, 6, 4, 8, 12, 10};

/// Lines of probes in the order of floor_orders: their dashes and point types.
constexpr std::array<std::pair<const char*, int>, 3> order_styles = {
    {{"'-'", 2}, {"solid", 1}, {"'.'", 3}}};
static_assert(order_styles.size() == floor_orders.size());

const char* colour_of(std::size_t grid) {
    return colours[grid % colours.size()];
}

/// What sets a row apart besides its resolution: what its shape stands for.
std::string family_of(const RowResult& row) {
    std::string name;
    for (const auto& [option, value] : row.row.options)
        if (option != "resolution")
            name += (name.empty() ? "" : " ")
                    + (option == "solver" || option == "occlusion" ? value : option + "=" + value);
    return name.empty() ? "bake" : name;
}

/// What a logarithmic axis can show.
bool drawable(double seconds, double error) {
    return std::isfinite(seconds) && std::isfinite(error) && seconds > 0 && error > 0;
}

struct Range {
    double lo = HUGE_VAL, hi = 0;
    void add(double x) {
        lo = std::min(lo, x);
        hi = std::max(hi, x);
    }
    std::string text(double pad) const {
        return hi > 0 ? format("[%.6g:%.6g]", lo / pad, hi * pad) : "[0.1:10]";
    }
};

/// One panel: `projected` chooses which error.
class Panel {
public:
    Panel(const SceneReport& scene, bool projected) : scene_(scene), projected_(projected) {
        for (std::size_t g = 0; g < scene.grids.size(); ++g)
            add_peer(g);
        for (const RowResult& row : scene.rows)
            add_row(row);
        add_front();
    }

    std::string script() const {
        std::string text = data_;
        text += "set title "
                + plot_string(projected_ ? "against the truth in the same SH order"
                                         : "against the true irradiance")
                + "\n";
        text += "unset arrow\nunset label\n";
        Range error = error_;
        if (!projected_)
            for (std::size_t i = 0; i < floor_orders.size(); ++i)
                if (const double floor = 100 * scene_.grids.back().floor[i].relative_l1;
                    drawable(1, floor)) {
                    error.add(floor);
                    text += format("set arrow from graph 0, first %.6g to graph 1, first %.6g "
                                   "nohead dashtype 2 linecolor rgb '#666666'\n",
                                   floor, floor);
                    text += format("set label 'exact, SH L%d' at graph 0.99, first %.6g right "
                                   "offset 0, 0.5 textcolor rgb '#444444'\n",
                                   floor_orders[i], floor);
                }
        text += "set xrange " + seconds_.text(1.6) + "\nset yrange " + error.text(1.4) + "\n";
        return text + "plot " + (plots_.empty() ? "NaN notitle" : plots_) + "\n";
    }

private:
    void plot(const std::string& what) { plots_ += (plots_.empty() ? "" : ", \\\n  ") + what; }

    /// Adds a data block; returns its name.
    std::string block(const std::string& lines) {
        const std::string name = format("$%s%d", projected_ ? "right" : "left", blocks_++);
        data_ += name + " << END_OF_DATA\n" + lines + "END_OF_DATA\n";
        return name;
    }

    std::string point(double seconds, double error) {
        seconds_.add(seconds);
        error_.add(100 * error);
        return format("%.9g %.9g\n", seconds, 100 * error);
    }

    void add_peer(std::size_t g) {
        std::map<std::size_t, bool> orders; // those that rows on this grid have
        for (const RowResult& row : scene_.rows)
            if (row.grid == g)
                orders[floor_index(row.sh_order)] = true;
        for (const auto& [order, used] : orders) {
            std::string lines;
            for (const PeerPoint& peer : scene_.grids[g].peer) {
                const FieldError& error = projected_ ? peer.projected[order] : peer.error[order];
                if (drawable(peer.seconds.median, error.relative_l1))
                    lines += point(peer.seconds.median, error.relative_l1);
            }
            if (lines.empty())
                continue;
            const glm::ivec3 dims = scene_.grids[g].grid.dims;
            const bool cube = dims.x == dims.y && dims.y == dims.z;
            const std::string grid =
                cube ? format("%d^3", dims.x) : format("%dx%dx%d", dims.x, dims.y, dims.z);
            const auto& [dashes, shape] = order_styles[order];
            plot(block(lines)
                 + format(" with linespoints linewidth 1.5 dashtype %s pointtype %d pointsize 0.6 "
                          "linecolor rgb '",
                          dashes, shape)
                 + colour_of(g) + "' title "
                 + plot_string(format("path-traced probes, SH L%d, ", floor_orders[order]) + grid));
        }
    }

    double error_of_row(const RowResult& row) const {
        return projected_ ? row.projected.relative_l1 : row.error.relative_l1;
    }

    void add_row(const RowResult& row) {
        if (!drawable(row.seconds.median, error_of_row(row)))
            return;
        const std::string family = family_of(row);
        const auto found = std::ranges::find(families_, family);
        const bool first = found == families_.end();
        const std::size_t shape = std::size_t(found - families_.begin());
        if (first) {
            families_.push_back(family);
            plot(format("NaN with points pointtype %d pointsize 1.1 linecolor rgb '#444444' title ",
                        shapes[shape % shapes.size()])
                 + plot_string(family));
        }
        plot(block(point(row.seconds.median, error_of_row(row)))
             + format(" with points pointtype %d pointsize 1.1 linecolor rgb '%s' notitle",
                      shapes[shape % shapes.size()], colour_of(row.grid)));
    }

    void add_front() {
        std::vector<SpeedError> all, front;
        for (const RowResult& row : scene_.rows)
            if (drawable(row.seconds.median, error_of_row(row)))
                all.push_back({row.seconds.median, error_of_row(row)});
        const std::vector<bool> on_front = pareto_front(all);
        for (std::size_t i = 0; i < all.size(); ++i)
            if (on_front[i])
                front.push_back(all[i]);
        std::ranges::sort(front, {}, &SpeedError::seconds);
        std::string lines;
        for (const SpeedError& p : front)
            lines += point(p.seconds, p.error);
        if (!lines.empty())
            plot(block(lines)
                 + " with linespoints dashtype 3 linewidth 1.5 pointtype 6 pointsize "
                   "2 linecolor rgb '#000000' title 'Pareto front of the bakes'");
    }

    const SceneReport& scene_;
    bool projected_;
    std::string data_, plots_;
    std::vector<std::string> families_;
    Range seconds_, error_;
    int blocks_ = 0;
};

struct CloseFile {
    void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

File temporary() {
    File file(std::tmpfile());
    if (!file)
        throw Error(ErrorKind::io,
                    std::string("a temporary file cannot be made: ") + std::strerror(errno));
    return file;
}

std::string contents(std::FILE* file) {
    std::rewind(file);
    std::string text;
    char buffer[4096];
    while (const std::size_t got = std::fread(buffer, 1, sizeof buffer, file))
        text.append(buffer, got);
    return text;
}

/// What gnuplot prints when it reads `script`. The three streams are files: no pipe can fill up.
std::string run_gnuplot(const std::string& script, std::vector<std::string> arguments) {
    const File in = temporary(), out = temporary(), err = temporary();
    if (std::fwrite(script.data(), 1, script.size(), in.get()) != script.size()
        || std::fflush(in.get()) != 0)
        throw Error(ErrorKind::io, "gnuplot's script cannot be written to a temporary file");
    std::rewind(in.get());
    arguments.insert(arguments.begin(), "gnuplot");
    std::vector<char*> argv;
    for (std::string& argument : arguments)
        argv.push_back(argument.data());
    argv.push_back(nullptr);

    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, fileno(in.get()), STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, fileno(out.get()), STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, fileno(err.get()), STDERR_FILENO);
    pid_t child = 0;
    const int failed = posix_spawnp(&child, "gnuplot", &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failed == ENOENT)
        throw Error(ErrorKind::failure, "gnuplot, which draws the plot, is not installed: install "
                                        "the package gnuplot-nox, or write .csv or .json only");
    if (failed != 0)
        throw Error(ErrorKind::failure,
                    std::string("gnuplot cannot be started: ") + std::strerror(failed));
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    const std::string said = contents(err.get());
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        const std::size_t begin = said.find_first_not_of(" \n\t");
        const std::string line =
            begin == std::string::npos ? "" : said.substr(begin, said.find('\n', begin) - begin);
        throw Error(ErrorKind::failure, "gnuplot failed: " + line);
    }
    return contents(out.get());
}

} // namespace

std::string plot_string(const std::string& text) {
    std::string quoted = "'";
    for (const char c : text) {
        const auto code = static_cast<unsigned char>(c);
        quoted += c == '\'' ? "''" : std::string(1, code < 0x20 || code == 0x7f ? '?' : c);
    }
    return quoted + "'";
}

std::string plot_script(const Report& report) {
    std::string text = "set encoding utf8\n"
                       "set logscale xy\n"
                       "set xlabel 'seconds'\n"
                       "set ylabel 'relative L1 error of irradiance'\n"
                       "set format x '%g'\n"
                       "set format y '%g %%'\n"
                       "set grid xtics ytics linecolor rgb '#dddddd' linetype 1\n"
                       "set key below left Left reverse maxrows 8 samplen 3 title ' '\n"
                       "set border linecolor rgb '#444444'\n";
    text += format("set multiplot layout %zu, 2\n", std::max<std::size_t>(1, report.scenes.size()));
    for (const SceneReport& scene : report.scenes)
        for (const bool projected : {false, true}) {
            const std::string name = std::filesystem::path(scene.path).filename().string();
            text += "set xlabel " + plot_string("seconds, " + name) + " offset 0, 0.6\n";
            text += Panel(scene, projected).script();
        }
    return text + "unset multiplot\n";
}

void require_gnuplot() {
    run_gnuplot("", {"--version"});
}

std::string plot_svg(const std::string& script, std::size_t scenes) {
    const std::string terminal =
        format("set terminal svg noenhanced size 1160, %zu font 'sans-serif,13' background "
               "'#ffffff'\n",
               600 * std::max<std::size_t>(1, scenes));
    const std::string svg = run_gnuplot(terminal + script, {"--default-settings"});
    if (svg.find("</svg>") == std::string::npos)
        throw Error(ErrorKind::failure, "gnuplot drew nothing");
    return svg;
}

} // namespace lpvbake::report
