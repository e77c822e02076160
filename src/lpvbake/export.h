// What the shared library shows of itself.
#pragma once

/// Marks what programs that link the library may use; all else is hidden in it.
#define LPVBAKE_API __attribute__((visibility("default")))
