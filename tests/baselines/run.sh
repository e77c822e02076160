#!/usr/bin/env bash
# Holds errors to those that are kept beside this file: of the cheap hard cases, of the shipped
# Cornell box, and of the scenes of a folder. Whatever became worse is listed, and ends in 7.
#
#   tests/baselines/run.sh [--update] [--times X%] [FOLDER]
#
#   --update    keeps today's numbers instead
#   --times     times, too, may be longer by no more than this; on the machine that kept them
#   FOLDER      real glTF files, baked as tests/real_scenes.tsv says; their errors are in
#               real_scenes.json
#
# LPVBAKE and HARD_CASES name the programs (default: those of build/default).
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
lpvbake=${LPVBAKE:-$here/../../build/default/lpvbake}
hard_cases=${HARD_CASES:-$here/../../build/default/tests/hard_cases}
options=()
folder=
while [[ $# -gt 0 ]]; do
    case $1 in
    --update) options+=(--update-baseline) ;;
    --times) options+=(--time-slack "${2:?--times needs a share}") && shift ;;
    --help) sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" && exit 0 ;;
    *) folder=$1 ;;
    esac
    shift
done

status=0
# measure BASELINE ARGUMENT...
measure() {
    "$lpvbake" report --baseline "$here/$1.json" "${options[@]}" "${@:2}" --threads 2 || status=$?
}

if [[ -n $folder ]]; then
    while IFS=$'\t' read -r file arguments; do
        [[ -f $folder/$file ]] || continue
        read -ra words <<<"$arguments"
        measure real_scenes "$folder/$file" "${words[@]}" --solver sn --no-peer --no-slices \
            --repeats 1 --probes 300 --noise 3%
    done < <(sed '/^#/d; /^\*/d' "$here/../real_scenes.tsv")
    exit "$status"
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$hard_cases" "$work"
measure hard_cases --suite "$work/suite.json" --cheap
measure cornell_box "$here/../../examples/cornell_box.gltf" --no-peer --no-slices --repeats 1 \
    --probes 300 --noise 2% --solver sn,gather --resolution 16,32
exit "$status"
