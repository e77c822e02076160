#!/usr/bin/env bash
# Builds lpvbake and bakes the Cornell box to build/cornell_box.vdb and build/cornell_box.exr
# (a flipbook: one file a coefficient, and cornell_box.json). Needs Debian bookworm and, where
# packages are missing, root or sudo. More arguments go to `lpvbake bake`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

.ci/install.sh
cmake --preset default >&2
cmake --build --preset default --target lpvbake lpvbake_library >&2 # all that is installed
lpvbake=build/default/lpvbake

"$lpvbake" bake examples/cornell_box.gltf -o build/cornell_box.vdb -o build/cornell_box.exr "$@"
echo
"$lpvbake" info build/cornell_box.vdb --slice z=12 -o build/cornell_box.png
