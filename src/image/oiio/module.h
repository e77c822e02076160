// What the image module offers. The program loads it by name and knows this table only; both sides
// come from one build, so C++ types and exceptions cross.
#pragma once

#include "image/image.h"
#include "lpvbake/export.h"

namespace lpvbake {

struct ImageModule {
    decltype(lpvbake::decode_image)* decode;
    decltype(lpvbake::decode_exr)* decode_exr;
    decltype(lpvbake::read_picture)* read_picture;
    decltype(lpvbake::encode_png)* encode_png;
};

inline constexpr char image_module_file[] = "lpvbake_oiio.so";
inline constexpr char image_module_symbol[] = "lpvbake_image_module";

} // namespace lpvbake

/// The module's one symbol.
extern "C" LPVBAKE_API const lpvbake::ImageModule* lpvbake_image_module();
