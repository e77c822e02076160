#!/usr/bin/env bash
# Bakes every .gltf and .glb file below a folder (those below invalid/ left out) as real_scenes.tsv
# says, and prints a table: file, triangles, seconds, peak memory, or the error's text.
#
#   tests/real_scenes.sh FOLDER [OUTPUT_FOLDER] [PATTERN]
#
# Volumes go to OUTPUT_FOLDER (default build/real_scenes) with a picture of the middle y slice of
# each; PATTERN is a shell pattern for paths relative to FOLDER. LPVBAKE names the program. Exits 1
# if a bake ends other than with success, invalid input (3) or an unsupported feature (5).
set -euo pipefail

folder=${1:?usage: real_scenes.sh FOLDER [OUTPUT_FOLDER] [PATTERN]}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
output=${2:-$here/../build/real_scenes}
pattern=${3:-*}
lpvbake=${LPVBAKE:-$here/../build/default/lpvbake}
mkdir -p "$output"

arguments_for() {
    awk -F '\t' -v file="$1" '/^#/ { next } $1 == file { found = $2 } $1 == "*" { other = $2 }
        END { print found != "" ? found : other }' "$here/real_scenes.tsv"
}

failures=0
printf 'file\ttriangles\tseconds\tpeak memory\tresult\n'
while IFS= read -r -d '' file; do
    # shellcheck disable=SC2053 # a pattern on purpose
    [[ $file == $pattern ]] || continue
    read -ra arguments <<<"$(arguments_for "$file")"
    name=${file//[^A-Za-z0-9._-]/_}
    name=${name%.*}
    status=0
    timeout 600 "$lpvbake" bake "$folder/$file" "${arguments[@]}" -o "$output/$name.vdb" \
        --format json >"$output/$name.json" 2>"$output/$name.log" || status=$?
    if [[ $status -eq 0 ]]; then
        python3 - "$file" "$output/$name.json" <<'EOF'
import json
import sys

report = json.load(open(sys.argv[2], encoding="utf-8"))
print(sys.argv[1], report["triangles"], f"{report['seconds']:.2f}",
      f"{report['peak_memory'] / 2**20:.0f} MiB",
      "ok" + "".join("; " + warning for warning in report["warnings"]), sep="\t")
EOF
        middle=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["grid"]["dims"][1] // 2)' \
            "$output/$name.json")
        "$lpvbake" info "$output/$name.vdb" --slice "y=$middle" -o "$output/$name.png" >/dev/null
    else
        printf '%s\t\t\t\texit %d: %s\n' "$file" "$status" \
            "$(sed -n 's/^lpvbake: error: //p' "$output/$name.log" | tail -1)"
        [[ $status -eq 3 || $status -eq 5 ]] || failures=$((failures + 1))
    fi
done < <(cd "$folder" && find . \( -name '*.gltf' -o -name '*.glb' \) -not -path './invalid/*' \
    -printf '%P\0' | sort -z)
[[ $failures -eq 0 ]] || {
    echo "$failures bakes failed" >&2
    exit 1
}
