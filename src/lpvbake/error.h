// The one exception type that we throw.
#pragma once

#include "lpvbake/export.h"

#include <stdexcept>
#include <string>

namespace lpvbake {

enum class ErrorKind {
    argument,    ///< the caller asks for what cannot be: a setting is wrong
    file,        ///< a file is not there, or is none that can be read or written
    io,          ///< the system does not read or write: no space, no permission, a fault
    invalid,     ///< what is read is wrong: a scene, a volume, a file of lights
    failure,     ///< something that we stand on failed
    unsupported, ///< what is read needs a feature that is not supported (it is named)
    difference,  ///< what should agree does not
    device,      ///< the Vulkan device is missing or was lost
    memory,      ///< the memory, or a limit set for it, does not suffice
    interrupted, ///< ended on request, by SIGINT
    terminated,  ///< ended on request, by SIGTERM
};

/// The text is one line that names the file, the place in it and the remedy. Settings are named as
/// the structs have them, in backquotes, as in "lower `resolution`". Warnings do the same.
class LPVBAKE_API Error : public std::runtime_error {
public:
    Error(ErrorKind which, const std::string& text) : std::runtime_error(text), kind(which) {}
    ErrorKind kind;
};

} // namespace lpvbake
