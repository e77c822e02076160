// The program's side of the image module: finds it along the RUNPATH of the executable or library
// that this is linked into, once.
#include "image/image.h"

#include "background.h"
#include "image/oiio/module.h"
#include "lpvbake/error.h"

#include <chrono>

#include <dlfcn.h>

namespace lpvbake::image {
namespace {

const ImageModule* load() {
    // Never closed: OpenImageIO's libraries do not survive being unloaded.
    void* library = dlopen(image_module_file, RTLD_LAZY | RTLD_LOCAL);
    void* entry = library ? dlsym(library, image_module_symbol) : nullptr;
    if (!entry)
        throw Error(ErrorKind::failure, std::string("cannot load the image module: ") + dlerror()
                                            + "; reinstall lpvbake, the module belongs to it");
    return reinterpret_cast<decltype(&lpvbake_image_module)>(entry)();
}

/// Loads at most once, whoever comes first; the others wait.
const ImageModule& module() {
    static const ImageModule* const loaded = load();
    return *loaded;
}

} // namespace

Rgba8 decode_image(std::span<const std::byte> data, const std::string& name, uint64_t max_texels) {
    return module().decode(data, name, max_texels);
}

Pixels decode_exr(std::span<const std::byte> data, const std::string& name, uint64_t max_texels) {
    return module().decode_exr(data, name, max_texels);
}

Pixels read_picture(const std::string& path, uint64_t max_texels) {
    return module().read_picture(path, max_texels);
}

std::vector<unsigned char> encode_png(const Pixels& pixels, const std::string& name) {
    return module().encode_png(pixels, name);
}

ImageModulePreload preload_image_module() {
    std::future<void> loading = std::async(in_background(), [] {
        try {
            module();
        } catch (const Error&) { // told to whoever needs the module
        }
    });
    if (loading.wait_for(std::chrono::seconds(0)) == std::future_status::deferred)
        return {}; // whoever needs it loads it
    return ImageModulePreload(loading.share());
}

} // namespace lpvbake::image
