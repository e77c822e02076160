#!/usr/bin/env bash
# One fuzzer as a test: reads what is in the folders, then tries on.
#
#   tests/fuzz/run.sh FUZZER SECONDS CORPUS [FOLDER...]
#
# What it finds of use is kept in CORPUS, what breaks it is written beside that as CORPUS-crash-*.
# Other options of libFuzzer: FUZZ_FLAGS.
set -euo pipefail
fuzzer=$1 seconds=$2 corpus=$3
shift 3
mkdir -p "$corpus"
name=$(basename "$fuzzer" _fuzz)
here=$(dirname "${BASH_SOURCE[0]}")
flags=(-rss_limit_mb=2048 -malloc_limit_mb=1024 -timeout=10 -max_len=65536 -artifact_prefix="$corpus-")
[[ ! -f $here/$name.dict ]] || flags+=(-dict="$here/$name.dict")
export UBSAN_OPTIONS=print_stacktrace=1
# shellcheck disable=SC2086
exec "$fuzzer" "${flags[@]}" -max_total_time="$seconds" -print_final_stats=1 ${FUZZ_FLAGS:-} "$corpus" "$@"
