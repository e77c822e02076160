#!/usr/bin/env bash
# Two files that mean different things by one name have to fail under the flags of the preset lto;
# two that mean the same have not. Usage: odr_test.sh COMPILER
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
flags=(-O1 -flto=auto -Wodr -Werror=odr -Werror=lto-type-mismatch)
pair() { # MEMBER OF B
    printf 'struct Point { int x; virtual ~Point(); }; Point::~Point() {}\nint b(); int main() { return b() + Point().x; }\n' >a.cpp
    printf 'struct Point { %s; virtual ~Point(); };\nint b() { return int(Point().x); }\n' "$1" >b.cpp
    "$2" "${flags[@]}" a.cpp b.cpp -o ab
}
pair 'int x' "$1"
if pair 'double y; double x' "$1" 2>message; then
    echo "a violation of the one-definition rule was linked" >&2
    exit 1
fi
grep -q -- '-Werror=odr' message || { cat message >&2; exit 1; }
