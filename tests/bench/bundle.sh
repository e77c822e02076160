#!/usr/bin/env bash
# Packs what a bare machine with a GPU needs to run the program: itself, stripped, and the shared
# libraries that it loads, the Vulkan loader among them; the driver has to be there. Its libc has to
# be as new as that of this machine.
#
#   tests/bench/bundle.sh [--output FILE.tar.xz] [--image] [--scene FILE|FOLDER]... [--test NAME]...
#
#   --output    default: build/lpvbake-bench.tar.xz
#   --image     the module that reads image files too; what it loads takes 390 MB
#   --scene     a scene, for scenes/: a .gltf brings the files that it names, a folder all it has;
#               default: examples/cornell_box.gltf
#   --test      a test or benchmark of the build, for bin/
#   --build     default: build/default
#
# On the other machine: tar xf FILE.tar.xz && lpvbake-bench/run bake lpvbake-bench/scenes/... . "run"
# takes the program's arguments, or --test NAME and those of a test; it can be called from anywhere.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
build=$root/build/default output="" image=false scenes=() tests=()
while [[ $# -gt 0 ]]; do
    case $1 in
    --output) output=${2:?--output needs a file} && shift ;;
    --image) image=true ;;
    --scene) scenes+=("${2:?--scene needs a file or folder}") && shift ;;
    --test) tests+=("${2:?--test needs a name}") && shift ;;
    --build) build=${2:?--build needs a folder} && shift ;;
    --help) sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" && exit 0 ;;
    *) echo "bundle.sh: what is $1? (--help)" >&2 && exit 2 ;;
    esac
    shift
done
output=${output:-$root/build/lpvbake-bench.tar.xz}
[[ ${#scenes[@]} -gt 0 ]] || scenes=("$root/examples/cornell_box.gltf")

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
bundle=$work/lpvbake-bench
mkdir -p "$bundle"/{bin,lib,scenes}

# Its shared libraries, but those that a driver shares with the program: the system's have to do for it.
libraries_of() {
    ldd "$1" | grep -oE '/[^ ]+' | grep -vE '/(ld-linux[^/]*|lib(c|m|dl|rt|pthread|resolv|util))\.so' | sort -u
}

# pack FILE FOLDER
pack() {
    [[ -f $1 ]] || { echo "bundle.sh: $1 is not there" >&2 && exit 3; }
    local missing
    missing=$(ldd "$1" | grep 'not found' || true)
    [[ -z $missing ]] || { echo "bundle.sh: $1: $missing" >&2 && exit 3; }
    cp -L "$1" "$bundle/$2/"
    libraries_of "$1" | xargs -r cp -Lnt "$bundle/lib/"
}

pack "$build/lpvbake" bin
for name in "${tests[@]}"; do
    pack "$build/tests/$name" bin
done
loader=$(ldconfig -p 2>/dev/null | grep -oE '/[^ ]*/libvulkan\.so\.1$' | head -1 || true) # opened, not linked
[[ -n $loader ]] || { echo "bundle.sh: no Vulkan loader (libvulkan.so.1) is installed" >&2 && exit 3; }
cp -L "$loader" "$bundle/lib/"
if $image; then
    mkdir -p "$bundle/bin/lib/lpvbake"
    pack "$build/lib/lpvbake/lpvbake_oiio.so" bin/lib/lpvbake
fi
find "$bundle/bin" "$bundle/lib" -type f -exec chmod u+w {} + -exec strip --strip-unneeded {} +

for scene in "${scenes[@]}"; do
    if [[ $scene == *.gltf ]]; then
        python3 - "$scene" "$bundle/scenes" <<'PYTHON'
import json, pathlib, shutil, sys, urllib.parse

scene, target = map(pathlib.Path, sys.argv[1:])
shutil.copy(scene, target)
document = json.loads(scene.read_text(encoding="utf-8-sig"))
for part in (*document.get("buffers", []), *document.get("images", [])):
    name = urllib.parse.unquote(part.get("uri", "data:"))
    if name.startswith("data:"):
        continue
    if (scene.parent / name).resolve().is_relative_to(scene.parent.resolve()):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(scene.parent / name, target / name)
    else:
        sys.exit(f"bundle.sh: {scene} names {name}, which is outside its folder")
PYTHON
    else
        cp -rL "$scene" "$bundle/scenes/"
    fi
done

cat >"$bundle/run" <<'RUN'
#!/bin/sh
here=$(cd "$(dirname "$0")" && pwd) || exit
program=lpvbake
if [ "${1-}" = --test ]; then
    program=$2
    shift 2
fi
LD_LIBRARY_PATH=$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$here/bin/$program" "$@"
RUN
chmod +x "$bundle/run"
mkdir -p "$(dirname "$output")"
XZ_OPT=${XZ_OPT:--T0} tar -C "$work" -cJf "$output" lpvbake-bench
echo "$output: $(du -h "$output" | cut -f1), unpacked $(du -sh "$bundle" | cut -f1)"
