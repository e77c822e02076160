#include "result.h"

#include "options/values.h"

#include <cstdio>
#include <iostream>

#include <sys/resource.h>

namespace lpvbake::cmd {

uint64_t peak_memory() {
    struct rusage usage = {};
    getrusage(RUSAGE_SELF, &usage);
    return uint64_t(usage.ru_maxrss) * 1024; // the kernel counts KiB
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

std::string bytes_text(uint64_t bytes) {
    char text[32];
    if (bytes < 10'000)
        std::snprintf(text, sizeof text, "%llu B", static_cast<unsigned long long>(bytes));
    else if (bytes < 10'000'000)
        std::snprintf(text, sizeof text, "%.1f KiB", double(bytes) / 1024);
    else
        std::snprintf(text, sizeof text, "%.1f MiB", double(bytes) / (1024 * 1024));
    return text;
}

std::string turn_text(const Grid& grid) {
    if (!grid.is_turned())
        return "";
    const glm::dvec3 axis = glm::axis(grid.turn);
    return format(", turned by %.4g degrees about (%.4g, %.4g, %.4g)",
                  glm::degrees(glm::angle(grid.turn)), axis.x, axis.y, axis.z);
}

void print_grid(const Grid& grid) {
    std::printf("grid          %d x %d x %d cells of %.4g m from (%.5g, %.5g, %.5g)%s\n",
                grid.dims.x, grid.dims.y, grid.dims.z, grid.cell, grid.origin.x, grid.origin.y,
                grid.origin.z, turn_text(grid).c_str());
}

report::Json device_json(const gpu::DeviceInfo& device) {
    return {{"index", device.index}, {"name", device.name},     {"type", device.type},
            {"uuid", device.uuid},   {"driver", device.driver}, {"api", device.api}};
}

report::Json stages_json(const std::vector<StageReport>& stages) {
    report::Json list = report::Json::array();
    for (const StageReport& stage : stages) {
        list.push_back({{"name", stage.name}, {"seconds", stage.seconds}});
        if (!stage.detail.empty())
            list.back()["detail"] = stage.detail;
        if (stage.reused + stage.made > 0)
            list.back()["cache"] = {{"reused", stage.reused}, {"made", stage.made}};
    }
    return list;
}

void print_stages(const std::vector<StageReport>& stages) {
    for (const StageReport& stage : stages) {
        std::string detail = stage.detail;
        if (const uint64_t all = stage.reused + stage.made)
            detail += format("; cache: %llu of %llu reused", (unsigned long long)stage.reused,
                             (unsigned long long)all);
        std::printf("%-12s  %7.3f s%s%s\n", stage.name.c_str(), stage.seconds,
                    detail.empty() ? "" : "  ", detail.c_str());
    }
}

void print_total(double seconds) {
    std::printf("%-12s  %7.3f s  peak memory %s\n", "total", seconds,
                bytes_text(peak_memory()).c_str());
}

void print_text(const std::string& text) {
    std::fputs(text.c_str(), stdout);
}

void add_fit(const Volume& volume, report::Json& document) {
    const auto fit = volume.metadata.find("fit");
    if (fit == volume.metadata.end())
        return;
    document["fit"] = {{"reader", fit->second}};
    for (const char* fact :
         {"error", "energy", "leak", "moved", "worst", "worst_at", "contested", "cell"}) {
        const auto text = volume.metadata.find("fit_" + std::string(fact));
        if (text == volume.metadata.end())
            continue;
        report::Json numbers = report::Json::array();
        for (const std::string& part : options::split(text->second, ','))
            if (const auto number = options::parse_number(part))
                numbers.push_back(*number);
        if (numbers.size() == 1 || numbers.size() == 3)
            document["fit"][fact] = numbers.size() == 1 ? numbers[0] : numbers;
    }
}

namespace {

bool json_printed = false;

} // namespace

void print_json(const report::Json& document) {
    json_printed = true;
    std::cout << document.dump(2, ' ', false, report::Json::error_handler_t::replace) << '\n';
}

bool is_json_printed() {
    return json_printed;
}

} // namespace lpvbake::cmd
