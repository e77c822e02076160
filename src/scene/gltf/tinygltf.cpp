// tinygltf itself, compiled here: Debian's libdraco holds and exports another copy, with Draco's
// own changes, which the linker would take for the one in libtinygltf.
#include <fstream> // which its writers need and it forgets with TINYGLTF_NO_FS

#define TINYGLTF_IMPLEMENTATION
#include "scene/gltf/tinygltf.h"
