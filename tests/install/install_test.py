#!/usr/bin/env python3
"""Installs to a folder, moves that elsewhere, and uses what is there as a stranger would: builds the
C++ examples with a CMake of their own, runs them and the Python ones on volumes that the installed
program wrote, and compares what they print.

Usage: install_test.py CMAKE BUILD_FOLDER CXX_COMPILER
"""

import json
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

CMAKE, BUILD, COMPILER = sys.argv[1:]
PYTHON = "/usr/bin/python3"  # the one that Debian's modules are for
POINT, NORMAL = ["-0.9", "0.3", "0.1"], ["1", "0.2", "0"]  # beside the left wall

# A speck in the middle of 2 m, so that the sky is seen from everywhere else.
SPECK = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                   "min": [0, 0, 0], "max": [0.001, 0.001, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    # (0, 0, 0), (0.001, 0, 0), (0, 0.001, 0)
    "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,"
                 "AAAAAAAAAAAAAAAAbxKDOgAAAAAAAAAAAAAAAG8SgzoAAAAA"}],
}


def run(*command, **options):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                            **options)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stdout}"
                             f"\n{result.stderr}")
    return result


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        run(CMAKE, "--install", BUILD, "--prefix", cls.folder / "before")
        cls.prefix = cls.folder / "after"
        (cls.folder / "before").rename(cls.prefix)
        cls.program = cls.prefix / "bin/lpvbake"
        cls.examples = cls.prefix / "share/lpvbake/examples"
        cls.built = cls.folder / "build"

        # Files more than the examples have: each includes one header alone, and what its name was.
        cls.source = cls.folder / "source"
        cls.source.mkdir()
        for file in (cls.examples / "cpp").iterdir():
            (cls.source / file.name).write_bytes(file.read_bytes())
        include = cls.prefix / "include"
        cls.headers = sorted(file.relative_to(include) for file in include.rglob("*")
                             if file.is_file())
        with (cls.source / "CMakeLists.txt").open("a") as lists:
            for header in cls.headers:
                (cls.source / f"{header.stem}_alone.cpp").write_text(
                    f'#include "{header}"\n#include "{header}"\n#include <error.h>\n'
                    "auto* const of_glibc = &::error_at_line;\n")
                lists.write(f"target_sources(bake PRIVATE {header.stem}_alone.cpp)\n")
        # The example again, with nothing asked of the bake.
        example = (cls.source / "bake.cpp").read_text()
        (cls.source / "plain.cpp").write_text(re.sub(r" *request\.resolution = 16;\n", "", example))
        with (cls.source / "CMakeLists.txt").open("a") as lists:
            lists.write("add_executable(plain plain.cpp)\n"
                        "target_link_libraries(plain PRIVATE lpvbake::lpvbake)\n")
        run(CMAKE, "-S", cls.source, "-B", cls.built, "-G", "Ninja",
            f"-DCMAKE_PREFIX_PATH={cls.prefix}", f"-DCMAKE_CXX_COMPILER={COMPILER}",
            "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON")
        run(CMAKE, "--build", cls.built)

    def printed(self, *command, **options):
        """Both lines that a loader prints, the numbers of the second as such."""
        grid, irradiance = run(*command, *POINT, *NORMAL, **options).stdout.splitlines()
        match = re.fullmatch(r"irradiance  (\S+) (\S+) (\S+) lux", irradiance)
        return grid, [float(text) for text in match.groups()]

    def expect_agreement(self, stem, rel):
        load = self.built / "load"
        grid, first = self.printed(load, f"{stem}.vdb")
        for command in ((load, f"{stem}.json"),
                        (PYTHON, self.examples / "load_vdb.py", f"{stem}.vdb"),
                        (PYTHON, self.examples / "load_exr.py", f"{stem}.json")):
            with self.subTest(command=command):
                other_grid, other = self.printed(*command)
                self.assertEqual(other_grid, grid)
                for a, b in zip(first, other):
                    self.assertTrue(math.isclose(a, b, rel_tol=rel), (first, other))
        return first

    def test_nothing_of_the_build_reaches_consumers(self):
        for file in (self.prefix / "lib/cmake/lpvbake").iterdir():
            self.assertNotIn(BUILD, file.read_text(), file)
        commands = json.loads((self.built / "compile_commands.json").read_text())
        for command in commands:
            self.assertNotRegex(command["command"], "-Werror|-ffp|openvdb|OpenEXR|-DLPVBAKE")
        self.assertFalse([file for file in self.prefix.rglob("*.a")])

    def test_the_library_shows_what_its_headers_mark(self):
        """Functions that LPVBAKE_API marks, and members of classes that it marks; no more, no less."""
        functions, classes = set(), set()
        for header in self.headers:
            space = None
            for line in (self.prefix / "include" / header).read_text().splitlines():
                if match := re.match(r"namespace ([\w:]+) {", line):
                    space = match.group(1)
                if match := re.match(r"class LPVBAKE_API (\w+)", line):
                    classes.add(f"{space}::{match.group(1)}")
                elif match := re.match(r"LPVBAKE_API [^(]*?(\w+)\(", line):
                    functions.add(f"{space}::{match.group(1)}")
        self.assertIn("lpvbake::bake_volume", functions)
        self.assertIn("lpvbake::gpu::Device", classes)
        shown = run("nm", "-D", "-C", "--defined-only", "--extern-only", "--format=just-symbols",
                    self.prefix / "lib/liblpvbake.so").stdout.splitlines()
        found_functions, found_classes = set(), set()
        for symbol in shown:
            name = re.sub(r"^(vtable|typeinfo|typeinfo name) for ", "", symbol)
            name = re.sub(r"(\[abi:\w+\])?\(.*", "", name)
            if name in classes or name.rsplit("::", 1)[0] in classes:
                found_classes.add(name if name in classes else name.rsplit("::", 1)[0])
            else:
                found_functions.add(name)
        self.assertEqual(found_functions, functions)
        self.assertEqual(found_classes, classes)

    def test_few_headers_are_installed(self):
        self.assertEqual({header.parent.as_posix() for header in self.headers}, {"lpvbake"})
        self.assertLessEqual(len(self.headers), 9)

    def test_the_image_module_is_the_one_beside_the_library(self):
        stem = self.folder / "module"
        run(self.program, "bake", self.examples / "cornell_box.gltf", "-o", f"{stem}.exr",
            "--resolution", "4")
        result = run(self.built / "load", f"{stem}.json", *POINT, *NORMAL,
                     env={**os.environ, "LD_DEBUG": "libs"})
        loaded = re.findall(r"calling init: (\S*lpvbake\S*\.so\S*)", result.stderr)
        self.assertEqual(sorted(os.path.realpath(path) for path in loaded),
                         sorted(os.path.realpath(self.prefix / "lib" / name)
                                for name in ("liblpvbake.so", "lpvbake/lpvbake_oiio.so")))

    def test_loaders_agree(self):
        stem = self.folder / "cornell"
        run(self.program, "bake", self.examples / "cornell_box.gltf", "-o", f"{stem}.vdb", "-o",
            f"{stem}.exr", "--resolution", "10")
        first = self.expect_agreement(stem, rel=2e-5)  # six digits are printed
        packed = self.folder / "packed.exr"
        run(self.program, "convert", f"{stem}.vdb", packed, "--packing", "channel")
        self.assertEqual(self.printed(PYTHON, self.examples / "load_exr.py", packed)[1], first)

    def test_loaders_take_what_has_no_validity(self):
        full, stem = self.folder / "full", self.folder / "bare"
        run(self.program, "bake", self.examples / "cornell_box.gltf", "-o", f"{full}.vdb",
            "--resolution", "4")
        run(self.program, "convert", f"{full}.vdb", f"{full}.exr", "--packing", "atlas")
        run(self.program, "convert", f"{full}.json", f"{stem}.vdb", f"{stem}.exr")
        self.assertEqual(list(self.folder.glob("bare*validity*")), [])
        self.expect_agreement(stem, rel=2e-5)

    def test_loaders_see_the_sky(self):
        stem = self.folder / "sky"
        scene = self.folder / "sky.gltf"
        scene.write_text(json.dumps(SPECK))
        run(self.program, "bake", scene, "-o", f"{stem}.vdb", "-o", f"{stem}.exr", "--bounds",
            "-1,-1,-1,1,1,1", "--resolution", "6", "--sky", "0.25:0.5:1,1000")
        for lux, nits in zip(self.expect_agreement(stem, rel=2e-5), (250, 500, 1000)):
            self.assertTrue(math.isclose(lux, math.pi * nits, rel_tol=0.01), (lux, nits))

    def test_bake_is_what_the_program_does(self):
        scene = self.examples / "cornell_box.gltf"
        for program, options in (("bake", ["--resolution", "16"]), ("plain", [])):
            with self.subTest(program=program):
                mine, theirs = self.folder / f"{program}.vdb", self.folder / "theirs.vdb"
                run(self.built / program, scene, mine)
                run(self.program, "bake", scene, "-o", theirs, *options)
                run(self.program, "diff", mine, theirs)  # ends with 7 for a difference

    def test_errors_cross_the_library(self):
        result = subprocess.run([self.built / "load", self.folder / "missing.vdb", *POINT, *NORMAL],
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 2)
        self.assertRegex(result.stderr, r"^load: .*missing\.vdb.*\n$")

    def test_python_names_the_remedy(self):
        source, other = self.folder / "plain.vdb", self.folder / "unity"
        run(self.program, "bake", self.examples / "cornell_box.gltf", "-o", source, "--resolution",
            "4")
        for output, loader, option, value in (
                (f"{other}.vdb", "load_vdb.py", "--sh-convention", "unity"),
                (f"{other}.exr", "load_exr.py", "--axes", "unity"),
                (f"{other}.exr", "load_exr.py", "--packing", "atlas")):
            run(self.program, "convert", source, output, option, value)
            result = subprocess.run([PYTHON, self.examples / loader, output, *POINT, *NORMAL],
                                    capture_output=True, text=True)
            self.assertEqual(result.returncode, 1)
            self.assertRegex(result.stderr,
                             rf"^.*unity.*: is stored as .*{value}.*lpvbake convert.*\n$")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
