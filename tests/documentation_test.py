#!/usr/bin/env python3
"""Holds the documentation to the repository:

* README.md has at most 150 lines;
* a relative link in a .md file leads to a file or folder, and its anchor to a heading there;
* a path in code quotes that begins with a folder of the repository's top level is there, but for one with
  a NAME to be filled in.

Usage: documentation_test.py ROOT. Prints each offence as file:line: text; exits 1 if there is any, and
first makes sure that it finds offences planted in a folder of its own.
"""

import pathlib
import re
import sys
import tempfile

MOST_LINES = 150
LINK = re.compile(r"\]\(([^)\s]+)\)")
QUOTED = re.compile(r"`((?:src|cmd|tests|examples|\.ci|\.github)/[\w./-]+)`")


def pages(root):
    top = [path for path in root.iterdir() if path.name not in ("build", "out", ".git")]
    return sorted(page for path in top
                  for page in ([path] if path.is_file() else path.rglob("*.md")) if page.suffix == ".md")


def lines(page):
    """(number, line) of what is not a block of code."""
    code = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            code = not code
        elif not code:
            yield number, line


def anchors(page):
    """Of the headings, as GitHub makes them."""
    headings = [line.lstrip("#").strip() for _, line in lines(page) if re.match(r"#+ ", line)]
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def offences(root):
    readme = root / "README.md"
    if (count := len(readme.read_text(encoding="utf-8").splitlines())) > MOST_LINES:
        yield f"README.md:{count}: more than {MOST_LINES} lines"
    for page in pages(root):
        for number, line in lines(page):
            place = f"{page.relative_to(root).as_posix()}:{number}"
            for link in LINK.findall(line):
                if re.match(r"[a-z]+:", link):
                    continue
                path, _, anchor = link.partition("#")
                target = page.parent / path if path else page
                if not target.exists():
                    yield f"{place}: {link} leads nowhere"
                elif anchor and (target.suffix != ".md" or anchor not in anchors(target)):
                    yield f"{place}: {link}: no such heading"
            for path in QUOTED.findall(line):
                if "NAME" not in path and not (root / path).exists():
                    yield f"{place}: there is no {path}"


PLANTED = {
    "README.md": "# One\n[fine](src/README.md#to-add-a-room)\n[not](src/none.md)\n`src/none.cpp`, `src/README.md`, `src/NAME/`\n"
                 "```\n[code](none)\n```\n[out](https://example.org/none)\n",
    "src/README.md": "## To add: a *room*\n[not](../README.md#two)\n[fine](#to-add-a-room)\n[fine](..)\n",
    "build/x.md": "[none](none)\n",
}
EXPECTED = ["README.md:3", "README.md:4", "src/README.md:2"]


def check_itself():
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in PLANTED.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")
        found = sorted(o.split(": ")[0] for o in offences(root))
        (root / "README.md").write_text("\n" * (MOST_LINES + 1), encoding="utf-8")
        if found != EXPECTED or not any(o.startswith("README.md:151:") for o in offences(root)):
            sys.exit(f"this test is broken: planted {EXPECTED}, found {found}")


def main():
    check_itself()
    found = list(offences(pathlib.Path(sys.argv[1]).resolve()))
    print("\n".join(found) or "no offence")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
