#include "scene/sun_arc.h"

#include "lpvbake/error.h"
#include "text.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace lpvbake::scene {
namespace {

constexpr int days_of_month[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};

double radians(double degrees) {
    return degrees * glm::pi<double>() / 180.0;
}

double zone_of(const SunArc& arc) {
    return std::round(arc.longitude / 15.0);
}

/// Of the year, as Spencer counts: 0 at its beginning, 2 pi at its end.
double year_angle(const SunArc& arc, double hour) {
    int day = arc.day - 1;
    for (int month = 1; month < arc.month; ++month)
        day += days_of_month[month - 1];
    return 2.0 * glm::pi<double>() / 365.0 * (day + (hour - zone_of(arc) - 12.0) / 24.0);
}

double declination(double g) {
    return 0.006918 - 0.399912 * std::cos(g) + 0.070257 * std::sin(g) - 0.006758 * std::cos(2 * g)
           + 0.000907 * std::sin(2 * g) - 0.002697 * std::cos(3 * g) + 0.00148 * std::sin(3 * g);
}

/// How far sundials are ahead of clocks of local mean time, hours.
double equation_of_time(double g) {
    return 24.0 / (2.0 * glm::pi<double>())
           * (0.0000075 + 0.001868 * std::cos(g) - 0.032077 * std::sin(g)
              - 0.014615 * std::cos(2 * g) - 0.040849 * std::sin(2 * g));
}

/// Of a sundial, at an hour of the clock.
double solar_hour(const SunArc& arc, double hour) {
    return hour + arc.longitude / 15.0 - zone_of(arc) + equation_of_time(year_angle(arc, hour));
}

int number_in(const std::string& text) {
    int value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size() ? value : 0;
}

} // namespace

glm::dvec3 towards_sun(const SunArc& arc, double hour) {
    const double d = declination(year_angle(arc, hour)), latitude = radians(arc.latitude);
    const double angle = radians(15.0 * (solar_hour(arc, hour) - 12.0)); // westwards of noon
    const double south =
        std::sin(latitude) * std::cos(d) * std::cos(angle) - std::cos(latitude) * std::sin(d);
    return {-std::cos(d) * std::sin(angle),
            std::sin(latitude) * std::sin(d) + std::cos(latitude) * std::cos(d) * std::cos(angle),
            south};
}

Daylight daylight(const SunArc& arc) {
    const auto is_up = [&](double hour) { return towards_sun(arc, hour).y > 0.0; };
    const double noon = 24.0 - solar_hour(arc, 12.0);
    if (!is_up(noon))
        throw Error(ErrorKind::argument, format("at latitude %g the sun does not rise on %02d-%02d",
                                                arc.latitude, arc.month, arc.day));
    if (is_up(noon - 12.0) && is_up(noon + 12.0))
        return {0.0, 24.0};
    const auto edge = [&](double up, double down) {
        for (int i = 0; i < 40; ++i) {
            const double middle = 0.5 * (up + down);
            (is_up(middle) ? up : down) = middle;
        }
        return 0.5 * (up + down);
    };
    return {edge(noon, noon - 12.0), edge(noon, noon + 12.0)};
}

double sun_illuminance(double elevation_sine) {
    return elevation_sine > 0.0 ? 127.5e3 * std::exp(-0.21 / elevation_sine) : 0.0;
}

SunArc parse_arc(const std::string& what, double latitude, double longitude,
                 const std::string& date) {
    const SunArc arc{latitude, longitude, number_in(date.substr(0, 2)),
                     date.size() == 5 && date[2] == '-' ? number_in(date.substr(3)) : 0};
    if (!(std::abs(latitude) <= 90.0) || !(std::abs(longitude) <= 180.0) || arc.month < 1
        || arc.month > 12 || arc.day < 1 || arc.day > days_of_month[arc.month - 1])
        throw Error(ErrorKind::argument,
                    what
                        + ": a place and a day are LATITUDE,LONGITUDE,MONTH-DAY in degrees, north "
                          "and east, as 48.1,11.6,06-21");
    return arc;
}

std::vector<double> key_hours(const SunArc& arc, int count) {
    const Daylight day = daylight(arc);
    std::vector<double> hours;
    for (int i = 0; i < count; ++i)
        hours.push_back(day.rise + (day.set - day.rise) * (i + 0.5) / count);
    return hours;
}

std::vector<double> key_weights(const SunArc& arc, std::span<const double> hours, double hour) {
    std::vector<double> weights(hours.size(), 0.0);
    const auto lux_at = [&](double at) { return sun_illuminance(towards_sun(arc, at).y); };
    const auto next = std::ranges::upper_bound(hours, hour) - hours.begin();
    const auto add = [&](std::ptrdiff_t key, double share) {
        weights[std::size_t(key)] +=
            share * double(hours.size()) * lux_at(hour) / lux_at(hours[std::size_t(key)]);
    };
    const std::ptrdiff_t last = std::ssize(hours) - 1;
    std::ptrdiff_t before = next - 1, after = next;
    double around = 0.0; // midnight lies between them
    if (next == 0 || next > last) {
        const bool sets = daylight(arc).set < 24.0;
        before = sets && next == 0 ? 0 : last;
        after = sets && next > last ? last : 0;
        around = before == after ? 0.0 : 24.0;
    }
    const double from = hours[std::size_t(before)] - (next == 0 ? around : 0.0);
    const double to = hours[std::size_t(after)] + (next > last ? around : 0.0);
    const double share = to > from ? (hour - from) / (to - from) : 0.0;
    add(before, 1.0 - share);
    if (after != before)
        add(after, share);
    return weights;
}

std::string clock_text(double hour) {
    const int minutes = int(std::floor(60.0 * hour + 0.5));
    return format("%02d:%02d", minutes / 60, minutes % 60);
}

} // namespace lpvbake::scene
