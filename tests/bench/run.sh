#!/usr/bin/env bash
# Bakes each case with this tree's program and with another's, turn about, and prints one table of
# time by scene, solver, size and stage: ratios that hold on the machine that they were taken on.
#
#   tests/bench/run.sh [--against REV|PROGRAM] [OPTION]... [-- BAKE_OPTION...]
#
#   --against   a revision of this repository, whose program is built in build/against/REVISION, or
#               a program that is there already; default: HEAD, which tells what uncommitted work does
#   --program   this tree's (default: build/default/lpvbake, built anew)
#
# All else is for tests/bench/against.py (--help lists it); what follows -- goes to both programs.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
against=HEAD program="" options=()
while [[ $# -gt 0 ]]; do
    case $1 in
    --against) against=${2:?--against needs a revision or a program} && shift ;;
    --program) program=${2:?--program needs a file} && shift ;;
    --help)
        sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0"
        exec /usr/bin/python3 "$here/against.py" --help
        ;;
    --) break ;;
    *) options+=("$1") ;;
    esac
    shift
done

# build TREE: the program alone; ccache has what both trees share, whichever folder it was built in.
build() {
    (cd "$1" && export CCACHE_BASEDIR="${CCACHE_BASEDIR:-$1}" CCACHE_NOHASHDIR=1 &&
        { [[ -f build/default/build.ninja ]] || cmake --preset default -DLPVBAKE_TESTS=OFF; } &&
        cmake --build --preset default --target lpvbake) >&2
}

ours=$program # which may be of any revision
if [[ -z $program ]]; then
    build "$root"
    program=$root/build/default/lpvbake
    ours=$(git -C "$root" rev-parse --short HEAD 2>/dev/null || echo "$program")
    [[ -z $(git -C "$root" status --porcelain --untracked-files=no 2>/dev/null) ]] || ours+=" and changes"
fi
name=$against
if [[ -f $against && -x $against ]]; then
    other=$against
else
    revision=$(git -C "$root" rev-parse --verify --quiet "$against^{commit}") || {
        echo "run.sh: --against $against: neither a revision nor a program" >&2
        exit 2
    }
    tree=$root/build/against/$revision
    [[ -e $tree/.git ]] || git -C "$root" worktree add --force --detach "$tree" "$revision" >&2
    build "$tree"
    other=$tree/build/default/lpvbake
    name=$(git -C "$root" rev-parse --short "$revision")
fi
exec /usr/bin/python3 "$here/against.py" --old "$other" --old-name "$name" --new "$program" --new-name "$ours" \
    "${options[@]}" "$@"
