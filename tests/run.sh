#!/usr/bin/env bash
# Installs what is missing, builds everything and runs all tests.
#
#   tests/run.sh [--clients] [--farm] [--allow-skip] [--no-fuzz] [--preset NAME]
#
#   --clients     also the tests with Blender, Chromium, Godot, OGRE and Node as clients, beside the
#                 readers that always run (vdb_print, oiiotool, Python's pyopenvdb). Installs them,
#                 and takes three.js, ktx-parse and gltf-validator from the npm registry.
#   --farm        also a Slurm cluster on loopback, which bakes a world. Installs Slurm; needs root.
#   --allow-skip  tests that did not run (no Vulkan device, no reader) do not fail the run.
#   --no-fuzz     leaves out the fuzzers, which are built apart and run for seconds each.
#   --preset      default, debug, sanitize, tsan or lto (see CMakePresets.json).
#
# The last line says how many tests passed, failed and were skipped.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

allow_skip=false
clients=false
farm=false
fuzz=true
preset=default
while [[ $# -gt 0 ]]; do
    case $1 in
    --clients) clients=true ;;
    --farm) farm=true ;;
    --no-fuzz) fuzz=false ;;
    --allow-skip) allow_skip=true ;;
    --preset)
        preset=${2:?--preset needs a name}
        shift
        ;;
    --help)
        sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "tests/$(basename "$0")"
        exit 0
        ;;
    *)
        echo "$0: unknown option $1 (see --help)" >&2
        exit 1
        ;;
    esac
    shift
done

install=()
options=(-DLPVBAKE_CLIENTS=OFF -DLPVBAKE_FARM=OFF)
if $clients; then
    install+=(--clients)
    options[0]=-DLPVBAKE_CLIENTS=ON
fi
if $farm; then
    install+=(--farm)
    options[1]=-DLPVBAKE_FARM=ON
fi
.ci/install.sh "${install[@]}"
presets=("$preset")
if $fuzz; then
    presets+=(fuzz)
fi
status=0
results=()
for each in "${presets[@]}"; do
    cmake --preset "$each" "${options[@]}" >&2
    cmake --build --preset "$each" >&2
    result=build/$each/tests.xml
    rm -f "$result"
    ctest --preset "$each" --no-tests=error -j2 --output-junit tests.xml || status=$?
    [[ -f $result ]] || {
        echo "ctest ended with status $status and left no results" >&2
        exit 1
    }
    results+=("$result")
done

# A test that ctest could not start, or that skipped itself, did not run: both count as skipped.
read -r passed failed skipped < <(python3 - "${results[@]}" <<'EOF'
import sys
import xml.etree.ElementTree as xml

counts = {"run": 0, "fail": 0}
other = 0
for path in sys.argv[1:]:
    for case in xml.parse(path).getroot().iter("testcase"):
        state = case.get("status")
        if case.find("skipped") is not None or state not in counts:
            other += 1
            print("not run:", case.get("name"), file=sys.stderr)
        else:
            counts[state] += 1
print(counts["run"], counts["fail"], other)
EOF
)
if [[ $skipped -gt 0 ]]; then
    echo "skipped tests were not run; a Vulkan device is needed (mesa-vulkan-drivers has one for any CPU)" >&2
fi
echo "$passed passed, $failed failed, $skipped skipped"
[[ $failed -eq 0 && $passed -gt 0 ]] || exit 1
[[ $skipped -eq 0 || $allow_skip == true ]] || exit 1
exit "$status"
