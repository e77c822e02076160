// Suites of hard cases (JSON) and sweeps (TOML) of the report.
#include "fuzz.h"

#include "options/toml.h"
#include "report/suite.h"
#include "report/sweep.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    const fuzz::Folder& folder = fuzz::Folder::own();
    folder.write("scene.gltf", "");
    if (text.starts_with('{')) {
        const std::string path = folder.write("suite.json", text);
        fuzz::accepts([&] {
            for (const report::SuiteCase& each : report::load_suite(path).cases)
                fuzz::require(!each.limits.empty(), "a case has limits");
        });
        return 0;
    }
    const std::string path = folder.write("sweep.toml", text);
    fuzz::accepts([&] {
        std::vector<report::Sweep> sweeps;
        for (const std::vector<cmd::options::ConfigEntry>& table :
             cmd::options::read_config_tables(path, "sweep")) {
            sweeps.emplace_back();
            for (const cmd::options::ConfigEntry& entry : table) {
                for (const std::string& value : entry.values)
                    report::check_sweep_value(entry.key, value);
                sweeps.back().push_back({entry.key, entry.values});
            }
        }
        fuzz::require(report::sweep_rows(sweeps, {}).size() <= report::most_rows,
                      "a report has few rows");
    });
    return 0;
}
