#include "report/difference.h"

#include "report/json.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>

namespace lpvbake::report {
namespace {

Json to_json(const Threshold& threshold, uint64_t exceeding) {
    if (!threshold.given)
        return nullptr;
    return {{"limit", threshold.limit},
            {"percent", threshold.percent},
            {"hard", threshold.hard},
            {"exceeding", exceeding}};
}

std::string channel_name(int channel, const GridKind& kind = volume::light_kind()) {
    return kind.width() == 1 ? "" : std::string(1, kind.channels[channel]);
}

/// The parts of `whole` (between semicolons or lines) that `other` lacks, each after `label`.
std::string parts_text(const char* label, const std::string& whole, const std::string& other) {
    const auto parts_of = [](std::string all) {
        std::ranges::replace(all, '\n', ';');
        std::vector<std::string> list;
        std::istringstream parts(all);
        for (std::string part; std::getline(parts >> std::ws, part, ';');)
            list.push_back(part.substr(0, part.find_last_not_of(' ') + 1));
        return list;
    };
    std::string text;
    const std::vector<std::string> there = parts_of(other);
    for (const std::string& part : parts_of(whole))
        if (std::ranges::find(there, part) == there.end())
            text += "    " + std::string(label) + "  " + part + "\n";
    return text;
}

std::string threshold_text(const char* name, const Threshold& threshold, uint64_t exceeding,
                           const volume::Comparison& c) {
    if (!threshold.given)
        return {};
    std::string text =
        format("%-10s %llu samples (%.4g %%) differ by more than %.4g %%; %.4g %% may", name,
               static_cast<unsigned long long>(exceeding),
               c.samples > 0 ? 100.0 * double(exceeding) / double(c.samples) : 0.0,
               100 * threshold.limit, threshold.percent);
    if (std::isfinite(threshold.hard))
        text += format(", none by more than %.4g %%", 100 * threshold.hard);
    return text + "\n";
}

bool is_traced(const Volume& volume) {
    const auto solver = volume.metadata.find("solver");
    return solver != volume.metadata.end() && solver->second == "reference";
}

std::string worst_text(const Difference& result) {
    const volume::Comparison& c = result.comparison;
    const Grid& grid = result.b.grid;
    std::string text;
    if (!c.worst.empty())
        text += format("worst cells\n");
    for (const volume::IrradianceSample& sample : c.worst) {
        const glm::dvec3 p = grid.center(sample.cell), n = sample.normal;
        text += format("  (%d, %d, %d) at (%.6g, %.6g, %.6g) m, normal (%.2g, %.2g, %.2g), %s: "
                       "A %.6g lx, B %.6g lx, %.4g %%\n",
                       sample.cell.x, sample.cell.y, sample.cell.z, p.x, p.y, p.z, n.x, n.y, n.z,
                       channel_name(sample.channel).c_str(), sample.a, sample.b,
                       100 * sample.difference);
    }
    return text;
}

std::string grid_text(const volume::GridDifference& of_grid, const Grid& grid) {
    const std::string channel = channel_name(of_grid.channel, *of_grid.kind);
    if (of_grid.cells == 0)
        return format("%-14s  same\n", of_grid.name.c_str());
    const glm::dvec3 p = grid.center(of_grid.cell);
    return format("%-14s  max %.4g, RMS %.4g (%.4g %%); %llu cells, %llu of them valid in both\n",
                  of_grid.name.c_str(), of_grid.max_abs, of_grid.rms, 100 * of_grid.relative,
                  static_cast<unsigned long long>(of_grid.cells),
                  static_cast<unsigned long long>(of_grid.cells_valid_both))
           + format("  max in (%d, %d, %d) at (%.6g, %.6g, %.6g) m%s%s: A %.9g, B %.9g\n",
                    of_grid.cell.x, of_grid.cell.y, of_grid.cell.z, p.x, p.y, p.z,
                    channel.empty() ? "" : ", ", channel.c_str(), double(of_grid.a),
                    double(of_grid.b));
}

/// Why the threshold is not kept; none: it is.
std::optional<std::string> offence(const Threshold& threshold, uint64_t exceeding,
                                   const volume::Comparison& comparison) {
    std::ostringstream text;
    text.precision(4);
    if (comparison.max > threshold.hard)
        text << "a sample differs by " << 100 * comparison.max << " % of the mean, "
             << 100 * threshold.hard << " % is the limit of any";
    else if (double(exceeding) > threshold.percent / 100 * double(comparison.samples))
        text << exceeding << " of " << comparison.samples << " samples differ by more than "
             << 100 * threshold.limit << " % of the mean";
    else
        return {};
    return text.str();
}

/// What the numbers of a measurement mean.
std::string measurement_text(const Difference& result) {
    const volume::Comparison& c = result.comparison;
    const int order_a = result.a.sh_order, order_b = result.b.sh_order;
    std::string text = format("A          %s\n", result.path_a.c_str());
    text += format("B          %s: path-traced, %s in both\n", result.path_b.c_str(),
                   counted(c.valid_both, "cell").c_str());
    text += format("error      %.3g %% on average: |A - B| of the irradiance from 26 directions at "
                   "every cell, over B's\n",
                   100 * c.relative_l1);
    const auto noise = result.b.metadata.find("noise");
    if (noise != result.b.metadata.end())
        text += format("           B is itself uncertain by %.3g %%, which adds in squares\n",
                       100 * std::strtod(noise->second.c_str(), nullptr));
    if (order_a < order_b)
        text += format("           what A's bands (order %d) cannot hold and B's (order %d) do is "
                       "part of it\n",
                       order_a, order_b);
    else
        text += format("           what bands up to order %d cannot hold is no part of it: B lacks "
                       "it, too\n",
                       order_b);
    text += format("energy     A holds %.3g %% too %s light\n", 100 * std::abs(c.energy_ratio - 1),
                   c.energy_ratio > 1 ? "much" : "little");
    text +=
        format("spread     95 of 100 values are off by less than %.3g %% of the mean (%.4g lx), "
               "the worst by %.4g %%; RMS %.3g %%\n",
               100 * c.percentile95, c.mean_b, 100 * c.max, 100 * c.relative_rms);
    if (c.negative_a > 0)
        text += format("negative   %llu values of A, taken as 0\n",
                       static_cast<unsigned long long>(c.negative_a));
    text += threshold_text("fail", result.fail, c.exceeding[0], c);
    text += threshold_text("warn", result.warn, c.exceeding[1], c);
    return text + worst_text(result);
}

} // namespace

bool Difference::is_measurement() const {
    return is_traced(b) && !is_traced(a);
}

MetadataDifference metadata_difference(const Volume& a, const Volume& b) {
    MetadataDifference result;
    for (const auto& [key, value] : a.metadata) {
        const auto other = b.metadata.find(key);
        if (other == b.metadata.end())
            result.only_a[key] = value;
        else if (other->second != value)
            result.different[key] = {value, other->second};
    }
    for (const auto& [key, value] : b.metadata)
        if (!a.metadata.contains(key))
            result.only_b[key] = value;
    return result;
}

std::optional<std::string> failure(const Difference& result) {
    if (result.metadata_fails && result.metadata.any())
        return " in its metadata";
    if (result.fail.given) {
        const auto why = offence(result.fail, result.comparison.exceeding[0], result.comparison);
        return why ? std::optional(": " + *why) : std::nullopt;
    }
    if (result.comparison.identical || result.is_measurement())
        return {};
    std::string grids;
    const auto list = [&](const std::string& name, const char* where) {
        grids += (grids.empty() ? "" : ", ") + name + where;
    };
    for (const volume::GridDifference& grid : result.comparison.grids)
        if (grid.cells > 0)
            list(grid.name, "");
    for (const std::string& name : result.comparison.only_a)
        list(name, " (only in A)");
    for (const std::string& name : result.comparison.only_b)
        list(name, " (only in B)");
    return " in " + grids;
}

std::optional<std::string> warning(const Difference& result) {
    return result.warn.given
               ? offence(result.warn, result.comparison.exceeding[1], result.comparison)
               : std::nullopt;
}

std::string verdict(const Difference& result) {
    return failure(result)               ? "fail"
           : warning(result)             ? "warning"
           : result.comparison.identical ? "identical"
                                         : "pass";
}

namespace {

/// What packing for files added to a volume's error; none: nothing is known to.
std::optional<double> packing_error(const Volume& volume, const char* key = "packing_error") {
    const auto found = volume.metadata.find(key);
    if (found == volume.metadata.end())
        return {};
    return std::strtod(found->second.c_str(), nullptr);
}

std::string packing_text(const char* name, const Volume& volume) {
    const auto cells = packing_error(volume);
    if (!cells)
        return {};
    return format("packed     %s: that added %.3g %% to its error at cells, %.3g %% between them\n",
                  name, 100 * *cells,
                  100 * packing_error(volume, "packing_error_filtered").value_or(*cells));
}

} // namespace

Json difference_json(const Difference& result) {
    const volume::Comparison& c = result.comparison;
    const Grid& grid = result.b.grid;
    Json document{{"command", "diff"},
                  {"a", result.path_a},
                  {"b", result.path_b},
                  {"result", verdict(result)},
                  {"grid", grid_json(grid)},
                  {"sh_order", {result.a.sh_order, result.b.sh_order}},
                  {"cells",
                   {{"valid_both", c.valid_both},
                    {"valid_only_a", c.valid_only_a},
                    {"valid_only_b", c.valid_only_b},
                    {"valid_neither", c.valid_neither}}},
                  {"samples", c.samples},
                  {"irradiance",
                   {{"mean_a", c.mean_a},
                    {"mean_b", c.mean_b},
                    {"relative_l1", c.relative_l1},
                    {"rms", c.rms},
                    {"relative_rms", c.relative_rms},
                    {"percentile95", c.percentile95},
                    {"max", c.max},
                    {"negative_a", c.negative_a},
                    {"negative_b", c.negative_b}}},
                  {"packing_error", {nullptr, nullptr}},
                  {"energy", {{"a", c.energy_a}, {"b", c.energy_b}, {"ratio", c.energy_ratio}}},
                  {"fail", to_json(result.fail, c.exceeding[0])},
                  {"warn", to_json(result.warn, c.exceeding[1])},
                  {"worst", Json::array()},
                  {"grids", Json::array()},
                  {"only_a", c.only_a},
                  {"only_b", c.only_b},
                  {"metadata",
                   {{"only_a", result.metadata.only_a},
                    {"only_b", result.metadata.only_b},
                    {"different", result.metadata.different}}}};
    for (size_t i = 0; i < 2; ++i)
        if (const auto added = packing_error(i == 0 ? result.a : result.b))
            document["packing_error"][i] = *added;
    for (const volume::IrradianceSample& sample : c.worst)
        document["worst"].push_back({{"cell", vector_json(sample.cell)},
                                     {"position", vector_json(grid.center(sample.cell))},
                                     {"normal", vector_json(sample.normal)},
                                     {"channel", channel_name(sample.channel)},
                                     {"a", sample.a},
                                     {"b", sample.b},
                                     {"difference", sample.difference}});
    for (const volume::GridDifference& of_grid : c.grids) {
        const std::string channel = channel_name(of_grid.channel, *of_grid.kind);
        Json entry{{"name", of_grid.name},
                   {"cells", of_grid.cells},
                   {"cells_valid_both", of_grid.cells_valid_both},
                   {"max_abs", of_grid.max_abs},
                   {"rms", of_grid.rms},
                   {"relative", of_grid.relative},
                   {"worst", nullptr}};
        if (of_grid.cells > 0)
            entry["worst"] = {{"cell", vector_json(of_grid.cell)},
                              {"position", vector_json(grid.center(of_grid.cell))},
                              {"channel", channel.empty() ? Json(nullptr) : Json(channel)},
                              {"a", of_grid.a},
                              {"b", of_grid.b}};
        document["grids"].push_back(entry);
    }
    return document;
}

std::string difference_text(const Difference& result) {
    if (result.is_measurement())
        return measurement_text(result);
    const volume::Comparison& c = result.comparison;
    std::string text;
    const Grid& grid = result.b.grid;
    const auto number = [](uint64_t n) { return static_cast<unsigned long long>(n); };
    text += format("A          %s\n", result.path_a.c_str());
    text += format("B          %s (reference)\n", result.path_b.c_str());
    text += format("grid       %d x %d x %d cells of %.6g m\n", grid.dims.x, grid.dims.y,
                   grid.dims.z, grid.cell);
    if (result.a.sh_order != result.b.sh_order)
        text += format("SH order   %d in A, %d in B: irradiance is from all bands that each has,\n"
                       "           coefficients are compared where both have them\n",
                       result.a.sh_order, result.b.sh_order);
    text +=
        format("valid      %llu cells in both, %llu only in A, %llu only in B, %llu in neither\n",
               number(c.valid_both), number(c.valid_only_a), number(c.valid_only_b),
               number(c.valid_neither));
    text += format("samples    %llu (cells valid in both x 26 normals x RGB)\n", number(c.samples));
    text += format("irradiance %.6g lx in A, %.6g lx in B on average\n", c.mean_a, c.mean_b);
    text += format("  L1               %10.4g %%  sum |A - B| / sum B\n", 100 * c.relative_l1);
    text +=
        format("  RMS              %10.4g %%  of B's mean, %.4g lx\n", 100 * c.relative_rms, c.rms);
    text += format("  95th percentile  %10.4g %%  of B's mean\n", 100 * c.percentile95);
    text += format("  largest          %10.4g %%  of B's mean\n", 100 * c.max);
    text += format("  negative         %llu samples of A, %llu of B; clamped to 0\n",
                   number(c.negative_a), number(c.negative_b));
    text += packing_text("A", result.a) + packing_text("B", result.b);
    text += format("energy     A / B = %.6g (%.6g and %.6g nit sr in cells valid in both)\n",
                   c.energy_ratio, c.energy_a, c.energy_b);
    text += threshold_text("fail", result.fail, c.exceeding[0], c);
    text += threshold_text("warn", result.warn, c.exceeding[1], c);

    text += worst_text(result);
    for (const volume::GridDifference& of_grid : c.grids)
        text += grid_text(of_grid, grid);
    for (const std::string& name : c.only_a)
        text += format("%-14s  only in A\n", name.c_str());
    for (const std::string& name : c.only_b)
        text += format("%-14s  only in B\n", name.c_str());
    const MetadataDifference& metadata = result.metadata;
    text += format("metadata   %s\n", metadata.any() ? "different" : "same");
    for (const auto& [key, value] : metadata.only_a)
        text += "  lpv:" + key + " only in A: " + value + "\n";
    for (const auto& [key, value] : metadata.only_b)
        text += "  lpv:" + key + " only in B: " + value + "\n";
    for (const auto& [key, values] : metadata.different) {
        text += format("  lpv:%s\n", key.c_str());
        text += parts_text("A", values.first, values.second);
        text += parts_text("B", values.second, values.first);
    }
    return text;
}

} // namespace lpvbake::report
