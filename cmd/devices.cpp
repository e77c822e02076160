// lpvbake devices: lists what --device can name.

#include "command_line.h"
#include "commands.h"
#include "error.h"
#include "gpu/gpu.h"

#include <nlohmann/json.hpp>

#include <cstdio>
#include <iostream>
#include <memory>

namespace lpvbake {
namespace {

const char summary[] = "Lists the Vulkan devices that can bake.";

const char manual[] =
    R"(Index, name, type, UUID, driver, Vulkan version and memory of each.
bake --device takes an index, a UUID or a part of a name; without it the first device is used.

Examples:
  lpvbake devices
  lpvbake devices --format json
  lpvbake bake scene.glb -o out.vdb --device llvmpipe

JSON: {"command": "devices", "devices": [{"index", "name", "type", "uuid", "driver", "api",
"memory", "max_allocation", "max_storage_range"}]}, memory in bytes.)";

void list(const std::string& format) {
    const std::vector<gpu::DeviceInfo> devices = gpu::list_devices();
    if (devices.empty())
        throw Error(ErrorKind::device,
                    "no Vulkan 1.2 device with graphics and compute; on Debian the package "
                    "mesa-vulkan-drivers has one that runs on any CPU");
    if (format == "json") {
        nlohmann::ordered_json document{{"command", "devices"},
                                        {"devices", nlohmann::ordered_json::array()}};
        for (const gpu::DeviceInfo& device : devices)
            document["devices"].push_back({{"index", device.index},
                                           {"name", device.name},
                                           {"type", device.type},
                                           {"uuid", device.uuid},
                                           {"driver", device.driver},
                                           {"api", device.api},
                                           {"memory", device.memory},
                                           {"max_allocation", device.max_allocation},
                                           {"max_storage_range", device.max_storage_range}});
        std::cout << document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
        return;
    }
    for (const gpu::DeviceInfo& device : devices)
        std::printf("%d  %s\n   type    %s\n   uuid    %s\n   driver  %s\n   Vulkan  %s\n"
                    "   memory  %.1f GiB\n",
                    device.index, device.name.c_str(), device.type.c_str(), device.uuid.c_str(),
                    device.driver.c_str(), device.api.c_str(), double(device.memory) / (1u << 30));
}

} // namespace

void add_devices(CLI::App& root, Action& action) {
    auto format = std::make_shared<std::string>("text");
    CLI::App* app = root.add_subcommand("devices", summary);
    app->footer(manual);
    OptionList(*app).choice("--format", *format, "text|json", "Form of the result");
    app->callback([&action, format] { action = [format] { list(*format); }; });
}

} // namespace lpvbake
