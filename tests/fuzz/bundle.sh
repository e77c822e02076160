#!/usr/bin/env bash
# Packs the fuzzers with all that they need to run on another x86-64 Linux, and there runs them all.
#
#   tests/fuzz/bundle.sh BUILD BUNDLE.tar.xz    packs those of BUILD, such as build/fuzz
#   run.sh SECONDS OUT [PROCESSES]              in the bundle: runs them at once, PROCESSES (one a core)
#                                               shared out; OUT gets logs, corpora and what breaks
#
# run.sh prints a line a fuzzer (executions, edges covered, features, findings) and exits 1 if there
# is a finding.
set -euo pipefail

if [[ $(basename "$0") == bundle.sh ]]; then
    build=$1 bundle=$2
    here=$(cd "$(dirname "$0")" && pwd)
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    mkdir -p "$folder/fuzz"/{bin,lib,corpus}
    cp "$build"/tests/fuzz/*_fuzz "$folder/fuzz/bin/"
    for fuzzer in "$folder"/fuzz/bin/*_fuzz; do
        strip --strip-debug "$fuzzer"
        ldd "$fuzzer" | grep -oE '/[^ ]+' | xargs -r cp -Lnt "$folder/fuzz/lib/"
        name=$(basename "$fuzzer" _fuzz)
        mkdir -p "$folder/fuzz/corpus/$name"
        for kept in "$here/seeds/$name" "$here/regressions/$name"; do
            [[ ! -d $kept ]] || cp "$kept"/* "$folder/fuzz/corpus/$name/"
        done
    done
    cp "$here"/*.dict "$folder/fuzz/"
    cp "$0" "$folder/fuzz/run.sh"
    tar -C "$folder" -cJf "$bundle" fuzz
    exit
fi

seconds=$1 out=$2 processes=${3:-$(nproc)}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out"
out=$(cd "$out" && pwd)
# The first ones get what cores are left over.
fuzzers=(scene compression sidecar volume report options lights)
export UBSAN_OPTIONS=print_stacktrace=1
for ((i = 0; i < processes || i < ${#fuzzers[@]}; ++i)); do
    name=${fuzzers[i % ${#fuzzers[@]}]}
    job=$name.$((i / ${#fuzzers[@]}))
    mkdir -p "$out/$job"
    flags=(-max_total_time="$seconds" -rss_limit_mb=2048 -malloc_limit_mb=1024 -timeout=25 -max_len=65536
           -print_final_stats=1 -artifact_prefix="$out/$job-")
    [[ ! -f $here/$name.dict ]] || flags+=(-dict="$here/$name.dict")
    "$here"/lib/ld-linux-x86-64.so.2 --library-path "$here/lib" "$here/bin/${name}_fuzz" "${flags[@]}" \
        "$out/$job" "$here/corpus/$name" >"$out/$job.log" 2>&1 &
done
wait
status=0
printf '%-12s %14s %8s %9s %9s\n' fuzzer executions edges features findings
for name in "${fuzzers[@]}"; do
    executions=$(grep -ahoP 'number_of_executed_units: *\K\d+' "$out/$name".*.log | awk '{s += $1} END {print s + 0}')
    edges=$(grep -ahoP 'cov: \K\d+' "$out/$name".*.log | sort -n | tail -1)
    features=$(grep -ahoP 'ft: \K\d+' "$out/$name".*.log | sort -n | tail -1)
    findings=$(find "$out" -maxdepth 1 -name "$name.*-*" -type f | wc -l)
    printf '%-12s %14s %8s %9s %9s\n' "$name" "$executions" "${edges:-0}" "${features:-0}" "$findings"
    [[ $findings -eq 0 ]] || status=1
done
exit $status
