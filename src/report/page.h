// A report as one web page that needs nothing else.
#pragma once

#include "report/report.h"

#include <string>
#include <string_view>

namespace lpvbake::report {

/// HTML without scripts: `svg` and the slices are in it as data: URIs, and nothing is loaded. Every
/// string of the report is escaped.
std::string report_page(const Report& report, std::string_view svg);

/// A text as HTML shows it: & < > " ' as entities.
std::string html_text(const std::string& text);

} // namespace lpvbake::report
