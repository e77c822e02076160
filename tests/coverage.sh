#!/usr/bin/env bash
# Builds with the preset coverage, runs tests, and prints which share of each file of src and cmd
# they ran; build/coverage/report/index.html has the lines. Installs what is missing.
#
#   tests/coverage.sh [ARGUMENT OF CTEST...]      all tests, or -L unit, -R NAME, ...
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
.ci/install.sh
cmake --preset coverage >&2
cmake --build --preset coverage >&2
find build/coverage -name '*.gcda' -delete
ctest --preset coverage -j2 "$@" >&2
mkdir -p build/coverage/report
gcovr --root . --filter 'src/' --filter 'cmd/' --object-directory build/coverage \
    --gcov-ignore-parse-errors --txt - --html-details build/coverage/report/index.html
