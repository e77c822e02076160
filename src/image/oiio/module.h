// What the image module offers. The program loads it by name and knows this table only; both sides
// come from one build, so C++ types and exceptions cross.
#pragma once

#include "image/image.h"
#include "lpvbake/export.h"

namespace lpvbake::image {

struct ImageModule {
    decltype(lpvbake::image::decode_image)* decode;
    decltype(lpvbake::image::decode_exr)* decode_exr;
    decltype(lpvbake::image::read_picture)* read_picture;
    decltype(lpvbake::image::encode_png)* encode_png;
};

inline constexpr char image_module_file[] = "lpvbake_oiio.so";
inline constexpr char image_module_symbol[] = "lpvbake_image_module";

} // namespace lpvbake::image

/// The module's one symbol.
extern "C" LPVBAKE_API const lpvbake::image::ImageModule* lpvbake_image_module();
