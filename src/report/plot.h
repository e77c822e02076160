// The picture of a report: speed against error, drawn by gnuplot.
#pragma once

#include "report/report.h"

#include <string>

namespace lpvbake::report {

/// The script that draws all scenes, two panels each: on the left the error against the true
/// irradiance, with floors; on the right against the reference's same SH bands. Holds numbers, and
/// of the scene's strings the file's name and the rows' names, quoted so that gnuplot takes them
/// for nothing else. It sets no terminal.
std::string plot_script(const Report& report);

/// A text as gnuplot's single-quoted string: quotes doubled, control characters as '?'.
std::string plot_string(const std::string& text);

/// Throws Error (failure: names the package) unless gnuplot can be run.
void require_gnuplot();

/// Draws the script as SVG. gnuplot is a child process without a shell that reads the script from
/// standard input. Throws Error (failure): gnuplot is missing or says something.
std::string plot_svg(const std::string& script, std::size_t scenes);

} // namespace lpvbake::report
