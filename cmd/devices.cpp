// lpvbake devices: lists what --device can name.

#include "commands.h"
#include "gpu/gpu.h"
#include "lpvbake/error.h"
#include "result.h"
#include "scene_options.h"

#include <cstdio>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/devices.txt.h"
    ;

void list(Format format) {
    const std::vector<gpu::DeviceInfo> devices = gpu::list_devices();
    if (devices.empty())
        throw Error(ErrorKind::device,
                    "no Vulkan 1.2 device with graphics and compute; on Debian the package "
                    "mesa-vulkan-drivers has one that runs on any CPU");
    if (format == Format::json) {
        report::Json document{{"command", "devices"}, {"devices", report::Json::array()}};
        for (const gpu::DeviceInfo& device : devices) {
            report::Json entry = device_json(device);
            entry["memory"] = device.memory;
            entry["max_allocation"] = device.max_allocation;
            entry["max_storage_range"] = device.max_storage_range;
            entry["rays"] = device.traces_rays;
            document["devices"].push_back(entry);
        }
        print_json(document);
        return;
    }
    for (const gpu::DeviceInfo& device : devices)
        std::printf("%d  %s\n   type    %s\n   uuid    %s\n   driver  %s\n   Vulkan  %s\n"
                    "   memory  %.1f GiB\n   rays    %s\n",
                    device.index, device.name.c_str(), device.type.c_str(), device.uuid.c_str(),
                    device.driver.c_str(), device.api.c_str(), double(device.memory) / (1u << 30),
                    device.traces_rays ? "yes" : "no");
}

options::Action declare(options::Options& options) {
    const auto format = std::make_shared<Format>(Format::text);
    add_format_option(options, *format);
    return [format] { list(*format); };
}

} // namespace

options::Command devices_command() {
    return {"devices", "Lists the Vulkan devices that can bake.", manual, declare};
}

} // namespace lpvbake::cmd
