#include "verification.h"

#include "report/tables.h"
#include "text.h"

#include <cstdio>
#include <utility>

namespace lpvbake::cmd {
namespace {

const char* kind_of(const report::WrongPlace& place) {
    return place.on_surface ? "surface" : "cell";
}

} // namespace

const report::MeasuredError& wished_error(const report::Verified& verified, bool fitted) {
    return fitted || verified.cells.points == 0 ? verified.surfaces : verified.cells;
}

std::string error_text(const report::MeasuredError& error) {
    if (error.points == 0)
        return "no light arrives";
    return format("%.3g %% (%.3g to %.3g)", 100 * error.error, 100 * error.low, 100 * error.high);
}

void print_verified(const report::Verified& verified, const std::string& reader) {
    std::printf("verified      cells %s, surfaces as %s shows them %s; %s, paths' noise %s and "
                "%s %%\n",
                error_text(verified.cells).c_str(), reader.c_str(),
                error_text(verified.surfaces).c_str(),
                counted(verified.cells.points + verified.surfaces.points, "point").c_str(),
                two_digits(100 * verified.cells.noise).c_str(),
                two_digits(100 * verified.surfaces.noise).c_str());
    for (const report::WrongPlace& place : verified.worst)
        std::printf("worst         %s at %.4g,%.4g,%.4g m: %.4g lx, paths %.4g; %.2g %% of the "
                    "error\n",
                    kind_of(place), place.position.x, place.position.y, place.position.z,
                    place.shown, place.true_, 100 * place.share);
}

report::Json verified_json(const report::Verified& verified, const std::string& reader) {
    report::Json worst = report::Json::array();
    for (const report::WrongPlace& place : verified.worst)
        worst.push_back({{"where", kind_of(place)},
                         {"position", {place.position.x, place.position.y, place.position.z}},
                         {"shown", place.shown},
                         {"truth", place.true_},
                         {"share", place.share}});
    return {{"cells", report::measured_json(verified.cells)},
            {"surfaces", report::measured_json(verified.surfaces)},
            {"reader", reader},
            {"rays", verified.rays},
            {"seconds", verified.seconds},
            {"converged", verified.converged},
            {"worst", worst}};
}

void add_verified(const report::Verified& verified, Volume& volume) {
    for (const auto& [name, error] :
         {std::pair{"verified_cells", &verified.cells}, {"verified_surfaces", &verified.surfaces}})
        if (error->points > 0)
            volume.metadata[name] = format("%.6g,%.6g,%.6g,%llu", error->error, error->low,
                                           error->high, (unsigned long long)error->points);
}

} // namespace lpvbake::cmd
