#!/usr/bin/env bash
# Runs clang-tidy over src and cmd, or over the named files, by .clang-tidy. Takes about ten minutes on two
# cores. Installs what is missing.
#
#   tests/tidy.sh [FILE...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
.ci/install.sh
cmake --preset default >&2
# Shaders are compiled into headers that files include.
cmake --build --preset default --target lpvbake >&2
if [[ $# -eq 0 ]]; then
    mapfile -t files < <(git ls-files 'src/*.cpp' 'cmd/*.cpp')
    set -- "${files[@]}"
fi
printf '%s\0' "$@" | xargs -0 -n 1 -P "$(nproc)" clang-tidy-14 --quiet -p build/default
