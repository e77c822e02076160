#!/usr/bin/env bash
# Makes examples/gallery.jpg: the Cornell box, a room and a street, lit directly, with the classic
# propagation, with the default solver, and path-traced; examples/before_after.jpg, the room alone; and
# examples/fit.jpg: a room as Godot would show it, with the field as it is, fitted to surfaces, and
# path-traced; and examples/shafts.jpg: a hall without and with air. Takes some minutes on two cores.
#
#   examples/gallery.sh [PATHS]     paths a pixel of the path-traced pictures, 256 by default
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
paths=${1:-256}

.ci/install.sh
cmake --preset default >&2
cmake --build --preset default --target lpvbake >&2
lpvbake=$PWD/build/default/lpvbake
folder=$PWD/build/gallery
mkdir -p "$folder"
examples/make_scenes.py "$folder"
cp examples/cornell_box.gltf "$folder"
cd "$folder"

pictures=()

# row NAME EV CAMERA SKY [OPTIONS OF BAKE…]
row() {
    local name=$1 ev=$2 camera=$3 sky=$4
    shift 4
    local light=()
    [[ -n $sky ]] && light=(--sky "$sky")
    view=(--size 400x300 --exposure "$ev" --camera "$camera" "${light[@]}" --progress none)
    "$lpvbake" bake "$name.gltf" -o "$name.lpv.vdb" --solver lpv "${light[@]}" "$@" >/dev/null
    "$lpvbake" bake "$name.gltf" -o "$name.vdb" "${light[@]}" "$@"
    "$lpvbake" render "$name.gltf" "$name.vdb" -o "$name.direct.png" --show direct "${view[@]}" >/dev/null
    "$lpvbake" render "$name.gltf" "$name.lpv.vdb" -o "$name.lpv.png" "${view[@]}" >/dev/null
    "$lpvbake" render "$name.gltf" "$name.vdb" -o "$name.png" "${view[@]}" \
        --reference "$paths" --reference-output "$name.reference.png"
    pictures+=("$name".{direct,lpv}.png "$name.png" "$name.reference.png")
}

row cornell_box 4 0,1,3.9:0,1,0:39 "" --resolution 48
row room 8.5 0.4,1.5,1.9:-0.2,1.0,-2:70 0.6:0.8:1,4000 --resolution 48
for show in direct final; do
    "$lpvbake" render room.gltf room.vdb -o "before_after.$show.png" --show "$show" --size 600x450 \
        --exposure 9 --camera 0.4,1.5,1.9:-0.2,1.0,-2:70 --sky 0.6:0.8:1,4000 --progress none >/dev/null
done
row street 12.5 -2,1.7,27:0.5,2.5,0:55 0.5:0.7:1,6000 --resolution 64 --bounds -16,-1,-30,16,10,30 --margin 1

"$lpvbake" bake sheets.gltf -o sheets.vdb --resolution 32 >/dev/null
"$lpvbake" bake sheets.gltf -o sheets.fit.vdb --resolution 32 --target godot
for kind in "" .fit; do
    "$lpvbake" render sheets.gltf "sheets$kind.vdb" -o "sheets$kind.png" --sampler godot --size 400x300 \
        --exposure 10.5 --camera 0,1.4,5.8:0,1.25,-1.8 --reference "$paths" \
        --reference-output sheets.reference.png --progress none
done

"$lpvbake" bake hall.gltf -o hall.vdb --resolution 48 >/dev/null
for kind in clear fog; do
    air=()
    [[ $kind == fog ]] && air=(--medium "scatter=0.05,absorb=0.002,g=0.7")
    "$lpvbake" render hall.gltf hall.vdb -o "hall.$kind.png" --size 480x300 --samples 8 --exposure 10 \
        --camera 5.4,1.6,-8.5:-6,2.7,1:70 "${air[@]}" --progress none >/dev/null
done

cd - >/dev/null
oiiotool "${pictures[@]/#/$folder/}" --mosaic:pad=4 4x3 --compression jpeg:88 -o examples/gallery.jpg
echo "wrote examples/gallery.jpg"
oiiotool "$folder"/before_after.{direct,final}.png --mosaic:pad=4 2x1 --compression jpeg:88 -o examples/before_after.jpg
echo "wrote examples/before_after.jpg"
oiiotool "$folder"/sheets{,.fit,.reference}.png --mosaic:pad=4 3x1 --compression jpeg:88 -o examples/fit.jpg
echo "wrote examples/fit.jpg"
oiiotool "$folder"/hall.{clear,fog}.png --mosaic:pad=4 2x1 --compression jpeg:88 -o examples/shafts.jpg
echo "wrote examples/shafts.jpg"
