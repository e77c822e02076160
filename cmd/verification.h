// What bake --verify finds, for people, programs and the volume's metadata.
#pragma once

#include "report/json.h"
#include "report/verify.h"

namespace lpvbake::cmd {

/// The error that a wish for one speaks of: with a fit that of surfaces, else that of the field.
const report::MeasuredError& wished_error(const report::Verified& verified, bool fitted);

/// "3.7 % (2.1 to 5.2)", or that no light arrives.
std::string error_text(const report::MeasuredError& error);
/// One line for cells and surfaces, one for each of the worst places.
void print_verified(const report::Verified& verified, const std::string& reader);
report::Json verified_json(const report::Verified& verified, const std::string& reader);
/// verified_cells and verified_surfaces: "error,low,high,points".
void add_verified(const report::Verified& verified, Volume& volume);

} // namespace lpvbake::cmd
