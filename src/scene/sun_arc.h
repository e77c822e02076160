// Where the sun stands over a day at a place on earth, and how bright it is.
#pragma once

#include <glm/glm.hpp>

#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene {

/// A day at a place. Clocks there show the zone of its longitude: UTC + longitude / 15, rounded to
/// whole hours, without summer time.
struct SunArc {
    double latitude = 0;  ///< degrees, north is positive
    double longitude = 0; ///< degrees, east is positive
    int month = 6, day = 21;
};

/// Unit vector towards the sun at an hour of the clock; y is up, +X east, -Z north. To a third of
/// a degree in this century: declination and equation of time by Spencer 1971 (Fourier series
/// representation of the position of the sun), for a year of 365 days, without refraction.
glm::dvec3 towards_sun(const SunArc& arc, double hour);

/// Between which hours of the clock the middle of the sun is above the horizon; 0 and 24 where it
/// does not set. Throws Error (argument) where it does not rise.
struct Daylight {
    double rise, set;
};
Daylight daylight(const SunArc& arc);

/// Lux of the sun under a clear sky on a plane that faces it; 0 at and below the horizon. 127.5 klx
/// exp(-0.21 / sin(elevation)): IES, Calculation procedures for daylight (Gillette and Pierpoint
/// 1984), at the mean distance of the sun.
double sun_illuminance(double elevation_sine);

/// Of degrees and a date, "06-21". Throws Error (argument), beginning with `what`, where those are no
/// place and no day.
SunArc parse_arc(const std::string& what, double latitude, double longitude,
                 const std::string& date);

/// Hours of so many suns, one in the middle of each part of the daylight.
std::vector<double> key_hours(const SunArc& arc, int count);

/// What each of the suns of such hours, which together are the mean light of the day, weighs so
/// that their sum is the sun of an hour: of those around it the means of what they light, by how
/// far it is from each, as bright as the sun is then. All 0 at night.
std::vector<double> key_weights(const SunArc& arc, std::span<const double> hours, double hour);

/// "04:05" of 4.09.
std::string clock_text(double hour);

} // namespace lpvbake::scene
