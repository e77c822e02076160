#!/usr/bin/env python3
"""Holds the house rules over the lines of src/ and cmd/:

* a folder includes only what its lpvbake_folder() in CMakeLists.txt says that it builds on, and the
  headers of src/lpvbake/, which include nothing of ours but each other;
* a file's namespace is its folder: lpvbake::solver::sn in src/solver/sn, and lpvbake alone for what
  the headers of src/lpvbake/ declare;
* a package's headers are included in its one folder;
* Vulkan is named in src/gpu and in the .cpp files of stages that draw or dispatch;
* the texts of src/ name no option of a command line: they name settings, in backquotes, and
  cmd/options/wording.cpp has a row for each of them and no other;
* the top level holds what it is to hold, and nothing else.

Usage: layering_test.py ROOT. Prints each offence as file:line: text; exits 1 if there is any, and
first makes sure that it finds offences planted in a folder of its own.
"""

import pathlib
import re
import sys
import tempfile

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "src"))
from architecture import folders

API = "lpvbake"  # a folder of headers that everyone may include, and that include each other alone
EVERYWHERE = ["background.h", "base64.h", "file_error.h", "machine.h", "mix_word.h", "quoted.h", "text.h"]  # at the top of src/

PACKAGES = {  # start of the header's name -> where it may be included
    "openvdb/": "src/io/",
    "nanovdb/": "src/io/",
    "zstd.h": "src/io/",
    "tiny_gltf": "src/scene/gltf/",
    "draco/": "src/scene/gltf/",
    "meshoptimizer": "src/scene/gltf/",
    "CLI/": "cmd/",
    "embree": "src/visibility/",
    "OpenImageIO/": "src/image/",
    "png.h": "src/image/",
    "OpenEXR/": "src/image/",
}
VULKAN_HEADER = re.compile(r"^vulkan/|^gpu/vulkan\.h$")
VULKAN_NAME = re.compile(r"\bvk::|\bVK_[A-Z]|\bVk[A-Z]")
VULKAN_STAGES = ("src/raster/", "src/solver/", "src/render/")

NAMESPACE = re.compile(r"^namespace (lpvbake[\w:]*) \{")
MODULES = ("src/image/oiio/",)  # a folder for the linker's sake, of the room above it

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')

STRING = re.compile(r'"((?:[^"\\\n]|\\.)*)"')
OPTION = re.compile(r"(?<![\w-])--(?:[a-z]|$)")
SETTING = re.compile(r"`\w+`")
TOP_LEVEL = ("CMakeLists.txt", "CMakePresets.json", "LICENSE", "README.md", "cmd", "examples", "src", "tests")
OF_GIT_IGNORED = ("build", "out")
OF_OTHER_PROGRAMS = "run_gnuplot("  # what follows is no option of ours


def reachable(folder, builds_on):
    found, open_ = {folder}, [folder]
    while open_:
        for next_ in builds_on[open_.pop()]:
            if next_ not in found:
                found.add(next_)
                open_.append(next_)
    return found


def folder_of(path, builds_on):
    """The folder of the table that a path below src/ lies in; subfolders count as their parent."""
    parent = str(pathlib.PurePosixPath(path).parent)
    while parent != ".":
        if parent in builds_on:
            return parent
        parent = str(pathlib.PurePosixPath(parent).parent)
    return None


def may_name_vulkan(path):
    return path.startswith("src/gpu/") and path != "src/gpu/gpu.h" or (
        path.startswith(VULKAN_STAGES) and path.endswith(".cpp"))


def may_open(namespace, path):
    """Whether a file may open a namespace: lpvbake, that of its folder, or one inside that."""
    folder = pathlib.PurePosixPath(path).parent
    if path.startswith(MODULES):
        folder = folder.parent
    parts = folder.parts[1:] if path.startswith("src/") else folder.parts
    if parts == (API,):
        return namespace in (API, API + "::gpu")
    own = "::".join((API, *parts))
    return namespace in (API, own) or parts and namespace.startswith(own + "::")


def offences(root):
    src = root / "src"
    builds_on = {**folders(root), API: []}
    files = sorted(p for top in ("src", "cmd") for p in (root / top).rglob("*")
                   if p.suffix in (".h", ".cpp", ".hpp"))
    for file in files:
        path = file.relative_to(root).as_posix()
        own = folder_of(path[len("src/"):], builds_on) if path.startswith("src/") else None
        top_level = path.startswith("src/") and path.count("/") == 1
        if path.startswith("src/") and own is None and not top_level:
            yield f"{path}: its folder is not in the table of this test"
            continue
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            place = f"{path}:{number}"
            code = line.split("//")[0]
            if VULKAN_NAME.search(code) and not may_name_vulkan(path):
                yield f"{place}: names Vulkan outside src/gpu and the .cpp of GPU stages"
            match = NAMESPACE.match(line)
            if match and not may_open(match.group(1), path):
                yield f"{place}: {match.group(1)} is not the namespace of its folder"
            match = INCLUDE.match(line)
            if not match:
                continue
            header = match.group(2)
            if VULKAN_HEADER.search(header) and not may_name_vulkan(path):
                yield f"{place}: includes Vulkan outside src/gpu and the .cpp of GPU stages"
            for start, home in PACKAGES.items():
                if match.group(1) == "<" and header.startswith(start) and not path.startswith(home):
                    yield f"{place}: <{header}> belongs to {home} alone"
            if match.group(1) != '"':
                continue
            if header.startswith("..") or "/../" in header:
                yield f"{place}: includes by a relative path"
            if not (src / header).is_file():
                continue  # a header of cmd/, or one that the build makes
            target = folder_of(header, builds_on)
            if path.startswith("cmd/"):
                continue
            if target is None:
                if header not in EVERYWHERE or own == API:
                    yield f"{place}: {header} is in no folder"
            elif target != API and (own is None or target not in reachable(own, builds_on)):
                yield f"{place}: {own or 'a top-level header'} does not build on {target}"


def wording_offences(root):
    table = root / "cmd/options/wording.cpp"
    rows = set(SETTING.findall(" ".join(re.findall(r'\{"([^"]*)",', table.read_text()))))
    named = set()
    for file in sorted(p for p in (root / "src").rglob("*") if p.suffix in (".h", ".cpp")):
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            place = f"{file.relative_to(root).as_posix()}:{number}"
            for text in STRING.findall(line):
                if OPTION.search(text) and OF_OTHER_PROGRAMS not in line:
                    yield f"{place}: names an option; the setting goes in backquotes"
                for setting in SETTING.findall(text):
                    named.add(setting)
                    if setting not in rows:
                        yield f"{place}: cmd/options/wording.cpp has no row for {setting}"
    for setting in sorted(rows - named):
        yield f"cmd/options/wording.cpp: no text in src/ names {setting}"


def top_level_offences(root):
    for path in sorted(root.iterdir()):
        if not path.name.startswith(".") and path.name not in TOP_LEVEL + OF_GIT_IGNORED:
            yield f"{path.name}: does not belong to the top level"


def all_offences(root):
    yield from top_level_offences(root)
    yield from offences(root)
    yield from wording_offences(root)


PLANTED = {
    "--help/scene.gltf": "",
    "CMakeLists.txt": "add_library(lpvbake_colour INTERFACE)\nlpvbake_folder(scene)\nlpvbake_folder(gpu LIBRARIES Vulkan::Vulkan)\n"
                      "lpvbake_folder(volume DEPENDS colour)\nlpvbake_folder(raster DEPENDS scene gpu)\n"
                      "lpvbake_folder(solver/lpv DEPENDS volume raster)\nlpvbake_folder(io DEPENDS volume)\n"
                      "lpvbake_folder(bake DEPENDS solver_lpv io\n               LIBRARIES json)\n",
    "src/lpvbake/error.h": "",
    "src/lpvbake/bake.h": '#include "lpvbake/error.h"\n#include "volume/volume.h"\n'
                         '#include "text.h"\n',
    "src/text.h": "",
    "src/colour/colour.h": "",
    "src/bake/bake.h": '#include "solver/lpv/lpv.h"\n#include "gpu/gpu.h"\n',  # fine: by lpv's raster
    "src/volume/volume.h": '#include "lpvbake/error.h"\n#include "colour/colour.h"\n',  # fine
    "src/solver/lpv/lpv.h": '#include "volume/volume.h"\n',  # fine
    "src/gpu/vulkan.h": "#include <vulkan/vulkan_raii.hpp>\n",  # fine
    "src/gpu/gpu.h": "",
    "src/raster/raster.cpp": '#include "gpu/vulkan.h"\nvk::Format format; // fine\n',
    "src/scene/names.h": "namespace lpvbake {\nnamespace lpvbake::scene {\nnamespace lpvbake::raster {\n",
    "src/stray.h": "",
    "src/volume/bad.h": '#include "solver/lpv/lpv.h"\n',
    "src/volume/worse.cpp": '#include "stray.h"\n',
    "src/raster/raster.h": "vk::Image image;\n",
    "src/solver/lpv/bad.h": '#include "gpu/vulkan.h"\n',
    "src/scene/vdb.cpp": "#include <openvdb/openvdb.h>\n",
    "src/io/relative.cpp": '#include "../volume/volume.h"\n',
    "src/stray/stray.h": "",
    "src/io/texts.cpp": 'throw Error("lower `known`"); // fine: --all, "a--b"\n'
                        'run_gnuplot("", {"--version"}); // fine\n'
                        'throw Error("lower --all");\n'
                        'text += " --" + name;\n'
                        'warn("raise `unknown`");\n',
    "cmd/options/wording.cpp": '{"`known`", "--known"},\n{"`unused`", "--unused"},\n',
    "cmd/x.cpp": '#include "bake/bake.h"\n#include <CLI/CLI.hpp>\n#include <tiny_gltf.h>\n',
}
EXPECTED = ["--help", "cmd/options/wording.cpp", "cmd/x.cpp:3", "src/io/relative.cpp:1", "src/io/texts.cpp:3",
            "src/io/texts.cpp:4", "src/io/texts.cpp:5", "src/lpvbake/bake.h:2", "src/lpvbake/bake.h:3",
            "src/raster/raster.h:1", "src/scene/names.h:3", "src/scene/vdb.cpp:1",
            "src/solver/lpv/bad.h:1", "src/stray/stray.h", "src/volume/bad.h:1",
            "src/volume/worse.cpp:1"]


def check_itself():
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in PLANTED.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        found = sorted({o.split(": ")[0] for o in all_offences(root)})
        if found != EXPECTED:
            sys.exit(f"this test is broken: planted {EXPECTED}, found {found}")


def main():
    check_itself()
    found = list(all_offences(pathlib.Path(sys.argv[1])))
    print("\n".join(found) or "no offence")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
