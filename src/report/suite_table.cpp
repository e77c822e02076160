#include "report/suite_table.h"

#include "text.h"

#include <nlohmann/json.hpp>

namespace lpvbake::report {

using Json = nlohmann::ordered_json;

std::string suite_head(std::size_t width) {
    return format("%-*s  %-6s %9s %7s %8s %9s %8s %5s %9s  verdict\n", int(width), "case", "solver",
                  "error", "energy", "leak", "negative", "same", "NaN", "time");
}

std::string suite_line(const SuiteRow& row, std::size_t width) {
    const auto number = [&](const std::optional<double>& value, const char* pattern) {
        char text[32] = "-";
        if (value && row.measured)
            std::snprintf(text, sizeof text, pattern, *value);
        return std::string(text);
    };
    const auto percent = [&](const std::optional<double>& value) {
        return number(value ? std::optional(100.0 * *value) : value, "%.1f %%");
    };
    return format("%-*s  %-6s %9s %7s %8s %9s %8s %5llu %7.2f s  ", int(width), row.name.c_str(),
                  row.solver.c_str(), percent(row.error).c_str(),
                  number(row.energy, "%.3f").c_str(), number(row.leak, "%.3g").c_str(),
                  percent(row.negative).c_str(), number(row.same, "%.2g").c_str(),
                  static_cast<unsigned long long>(row.not_finite), row.seconds)
           + (row.failures.empty() ? "ok" : "FAIL: " + failures_text(row)) + "\n";
}

Json suite_row_json(const SuiteRow& row) {
    const auto maybe = [](const std::optional<double>& value) {
        return value ? Json(*value) : Json(nullptr);
    };
    return {{"case", row.name},          {"solver", row.solver},
            {"measured", row.measured},  {"noise", row.noise},
            {"error", maybe(row.error)}, {"energy", maybe(row.energy)},
            {"leak", maybe(row.leak)},   {"negative", row.negative},
            {"same", maybe(row.same)},   {"not_finite", row.not_finite},
            {"seconds", row.seconds},    {"failures", row.failures}};
}

std::string failures_text(const SuiteRow& row) {
    std::string all;
    for (const std::string& text : row.failures)
        all += (all.empty() ? "" : "; ") + text;
    return all;
}

} // namespace lpvbake::report
