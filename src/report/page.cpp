#include "report/page.h"

#include "base64.h"
#include "report/tables.h"
#include "text.h"

#include <filesystem>

namespace lpvbake::report {
namespace {

const char style[] = R"(
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 1180px;
       margin: 2em auto; padding: 0 1em; }
h1, h2 { font-weight: 600; line-height: 1.2; }
img.plot { width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 1em 0; }
th, td { padding: .25em .7em; text-align: right; border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #888; font-weight: 600; }
th:first-child, td:first-child, td.text { text-align: left; }
tr.front td:first-child::before { content: "\25CB\00A0"; }
figure { display: inline-block; vertical-align: top; margin: 0 1em 1em 0; }
figure img { width: 300px; image-rendering: pixelated; background: #000; }
.views img { image-rendering: auto; }
figcaption { font-size: 13px; color: #555; max-width: 300px; }
pre { background: #f4f4f4; padding: .8em; overflow-x: auto; font-size: 13px; }
.note { color: #555; font-size: 13.5px; max-width: 60em; }
)";

std::string cell(const std::string& text) {
    return "<td>" + html_text(text) + "</td>";
}

std::string text_cell(const std::string& text) {
    return "<td class=\"text\">" + html_text(text) + "</td>";
}

std::string head(std::initializer_list<const char*> names) {
    std::string row = "<tr>";
    for (const char* name : names)
        row += "<th>" + std::string(name) + "</th>";
    return row + "</tr>\n";
}

std::string stages_text(const RowResult& row) {
    std::string text;
    for (const StageTiming& stage : row.stages)
        text += (text.empty() ? "" : ", ") + stage.name + " " + seconds_text(stage.seconds.median);
    return text;
}

std::string bakes_table(const SceneReport& scene) {
    std::string html =
        "<table>\n"
        + head({"bake", "seconds", "from &ndash; to", "error", "RMS", "in the same SH", "energy",
                "negative", "on surfaces", "Unity", "three.js", "VRC", "Bevy", "against the peer"});
    for (const RowResult& row : scene.rows) {
        html += std::string(row.front ? "<tr class=\"front\">" : "<tr>") + cell(row_name(row.row))
                + cell(seconds_text(row.seconds.median))
                + cell(seconds_text(row.seconds.min) + " - " + seconds_text(row.seconds.max))
                + cell(percent(row.error.relative_l1)) + cell(percent(row.error.relative_rms))
                + cell(percent(row.projected.relative_l1))
                + cell(format("%.3g", row.error.energy_ratio))
                + cell(format("%llu", static_cast<unsigned long long>(row.error.negative)))
                + cell(row.surface ? percent(row.surface->relative_l1) : "-");
        for (const char* reader : told_readers)
            html += cell(shown_text(row, reader));
        html += text_cell(ratio_text(row)) + "</tr>\n";
    }
    html += "</table>\n<table>\n" + head({"bake", "seconds by stage"});
    for (const RowResult& row : scene.rows)
        html += "<tr>" + cell(row_name(row.row)) + text_cell(stages_text(row)) + "</tr>\n";
    return html + "</table>\n";
}

std::string peers_table(const SceneReport& scene) {
    std::string html =
        "<table>\n"
        + head({"grid", "rays a probe", "seconds", "error, SH L1", "in the same SH", "error, SH L2",
                "in the same SH", "error, SH L4", "Mrays/s", "Embree alone"});
    for (const GridResult& grid : scene.grids) {
        const auto add = [&](const PeerPoint& point, const char* kind) {
            html += "<tr>" + cell(dims_text(grid.grid))
                    + cell(format("%llu%s", static_cast<unsigned long long>(point.rays), kind))
                    + cell(seconds_text(point.seconds.median))
                    + cell(percent(point.error[0].relative_l1))
                    + cell(percent(point.projected[0].relative_l1))
                    + cell(percent(point.error[1].relative_l1))
                    + cell(percent(point.projected[1].relative_l1))
                    + cell(percent(point.error[2].relative_l1))
                    + cell(format("%.3g", 1e-6 * point.rays_per_second))
                    + cell(point.embree_rays_per_second > 0
                               ? format("%.3g", 1e-6 * point.embree_rays_per_second)
                               : "-")
                    + "</tr>\n";
        };
        for (const PeerPoint& point : grid.peer)
            add(point, "");
        for (const PeerPoint& point : grid.sharing)
            add(point, ", sharing bounces");
        html += "<tr>" + cell(dims_text(grid.grid)) + cell("exact") + cell("")
                + cell(percent(grid.floor[0].relative_l1)) + cell("0 %")
                + cell(percent(grid.floor[1].relative_l1)) + cell("0 %")
                + cell(percent(grid.floor[2].relative_l1)) + cell("") + cell("") + "</tr>\n";
    }
    return html + "</table>\n";
}

std::string picture(const std::vector<unsigned char>& png, const std::string& caption) {
    return "<figure><img alt=\"\" src=\"data:image/png;base64,"
           + base64({reinterpret_cast<const char*>(png.data()), png.size()}) + "\"><figcaption>"
           + html_text(caption) + "</figcaption></figure>\n";
}

std::string slices_of(const SceneReport& scene) {
    std::string html;
    for (const GridResult& grid : scene.grids) {
        if (!grid.slices)
            continue;
        const Slices& s = *grid.slices;
        html += "<div>"
                + picture(s.result, row_name(scene.rows[s.row].row)
                                        + format(": mean luminance, layer %c = %d; white is "
                                                 "%.3g nit",
                                                 "xyz"[s.axis], s.index, s.white))
                + picture(s.reference, format("the reference, %llu rays a cell",
                                              static_cast<unsigned long long>(s.rays)))
                + picture(s.error, "error of irradiance: black 0, over red and yellow to white at "
                                       + percent(s.error_white) + " of the layer's mean")
                + "</div>\n";
    }
    return html;
}

std::string views_of(const SceneReport& scene) {
    if (!scene.views)
        return {};
    const Views& v = *scene.views;
    std::string html = "<h3>As programs show it</h3>\n<div class=\"views\">"
                       + picture(v.traced, format("path-traced, %d paths a pixel", v.paths));
    for (const Views::View& view : v.shown)
        html += picture(view.picture, view.what + ": " + percent(view.error.relative_l1)
                                          + format(" wrong on surfaces, energy %.3g; FLIP %.3f",
                                                   view.error.energy_ratio, view.flip));
    return html + "</div>\n<p class=\"note\">" + html_text(row_name(scene.rows[v.row].row))
           + ", the best bake on surfaces, seen by " + html_text(v.camera)
           + format(
               " at EV %.3g. Our own sampler reads the field; each of the programs (Unreal and "
               "Godot read as Unity does) shows the file that its target writes, fitted to "
               "it, or, <i>not fitted</i>, with cells inside geometry filled instead. FLIP is "
               "that from the path-traced picture, whose own noise counts.</p>\n",
               v.exposure);
}

std::string section(const SceneReport& scene) {
    std::string html =
        "<h2>" + html_text(std::filesystem::path(scene.path).filename().string()) + "</h2>\n<p>";
    for (const std::string& verdict : verdicts(scene))
        html += html_text(verdict) + " ";
    html += "</p>\n" + bakes_table(scene);
    html += "<p class=\"note\">&#9675; marks the Pareto front: no other bake is as fast and as "
            "accurate. Error: relative L1 of irradiance at "
            + counted(scene.grids.empty() ? 0 : scene.grids[0].probes, "cell")
            + " outside geometry &times; 26 normals &times; RGB, against the true "
              "irradiance; in the same SH: against the reference's bands that the bake has. "
              "Energy: luminance of the constant band over the reference's. On surfaces: at "
            + counted(scene.surface_points, "point")
            + " of the scene's surfaces, the same for all grids, read from the cells that "
              "are valid and faced; Unity, ...: what these programs show there of the files that "
              "their target writes. Seconds: the median of the "
              "repeats, without loading and writing.</p>\n";
    html += "<h3>Path-traced probes, and what SH alone costs</h3>\n" + peers_table(scene);
    html += "<p class=\"note\">The peer's time is measured at the probes and scaled to all valid "
            "cells of the grid. Sharing bounces: its rays end where they hit first, on surfaces "
            "lit as the bakes light them. <i>exact</i> is the reference projected to the order: "
            "the floor "
            "of its error. Noise of the reference: ";
    for (const GridResult& grid : scene.grids)
        html += html_text(dims_text(grid.grid) + ": " + percent(grid.noise)) + "; ";
    html += "surfaces: " + html_text(percent(scene.surface_noise)) + ".</p>\n";
    if (const std::string slices = slices_of(scene); !slices.empty())
        html += "<h3>A layer of the best bake on each grid</h3>\n" + slices;
    html += views_of(scene);
    html += "<h3>To repeat a row</h3>\n<pre>";
    for (const RowResult& row : scene.rows)
        html += html_text(row.command) + "\n";
    html += "</pre>\n";
    for (const std::string& warning : scene.warnings)
        html += "<p class=\"note\">Warning: " + html_text(warning) + "</p>\n";
    return html;
}

} // namespace

std::string html_text(const std::string& text) {
    std::string escaped;
    for (const char c : text)
        switch (c) {
        case '&':
            escaped += "&amp;";
            break;
        case '<':
            escaped += "&lt;";
            break;
        case '>':
            escaped += "&gt;";
            break;
        case '"':
            escaped += "&quot;";
            break;
        case '\'':
            escaped += "&#39;";
            break;
        default:
            escaped += c;
        }
    return escaped;
}

std::string report_page(const Report& report, std::string_view svg) {
    std::string html = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
                       "<title>lpvbake report</title>\n<style>"
                       + std::string(style)
                       + "</style>\n</head>\n<body>\n<h1>Speed against error</h1>\n";
    html += "<p>lpvbake " LPVBAKE_VERSION " on " + html_text(report.device) + ", "
            + counted(report.threads, "thread") + ", " + counted(report.settings.repeats, "repeat")
            + " of each bake.</p>\n";
    html += "<img class=\"plot\" alt=\"Error against seconds\" src=\"data:image/svg+xml;base64,"
            + base64(svg) + "\">\n";
    for (const SceneReport& scene : report.scenes)
        html += section(scene);
    return html + "</body>\n</html>\n";
}

} // namespace lpvbake::report
