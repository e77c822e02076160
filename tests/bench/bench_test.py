#!/usr/bin/env python3
"""That run.sh measures what it says, and that bundle.sh packs what the program needs.

Usage: bench_test.py LPVBAKE run|bundle
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import against

LPVBAKE, PART = pathlib.Path(sys.argv[1]).resolve(), sys.argv[2]
HERE = pathlib.Path(__file__).resolve().parent


class Folder(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)


class Run(Folder):
    def table(self, old, *options, code=0):
        """What run.sh prints for 8 cells of the Cornell box: rows of cells, and its JSON."""
        told = self.folder / "told.json"
        done = subprocess.run([HERE / "run.sh", "--against", old, "--program", LPVBAKE, "--quick", "--sizes", "8",
                               "--threads", "1", "--smallest", "0", "--json", told, *options],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, code, done.stderr)
        lines = [line for line in done.stdout.splitlines() if line.startswith("|")]
        return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]], told, done

    def wrapper(self, before, *options):
        """A program that does more than ours."""
        path = self.folder / "other"
        path.write_text(f'#!/bin/sh\n{before}\nexec "{LPVBAKE}" "$@" {" ".join(options)}\n')
        path.chmod(0o755)
        return path

    def test_rows_add_up_and_ratios_are_those_of_the_rows(self):
        rows, told, done = self.table(LPVBAKE)
        self.assertIn(f"new: {LPVBAKE};", done.stdout)  # not this tree's revision
        whole, stages = rows[0], rows[1:]
        self.assertEqual(whole[:4], ["cornell", "gather", "8", "**all**"])
        self.assertLess({"load", "lighting", "gather", "write", against.REST}, {row[3] for row in stages})
        for column in (4, 5):
            self.assertAlmostEqual(sum(float(row[column]) for row in stages), float(whole[column]), delta=0.01)
        case, = json.loads(told.read_text())["cases"]
        self.assertEqual(float(whole[6]), round(case["old"]["seconds"] / case["new"]["seconds"], 2))
        self.assertEqual(float(whole[9]), round(case["old"]["cpu"] / case["new"]["cpu"], 2))
        self.assertEqual(float(whole[12]), 0)  # the same program, the same light

    def test_a_slower_program_with_other_light_is_seen(self):
        other = self.wrapper("sleep 2", "--bounces", "1")
        rows, _, _ = self.table(other)
        self.assertGreater(float(rows[0][4]), 2)
        self.assertGreater(float(rows[-1][4]), 2)  # it slept before any stage
        self.assertEqual(rows[-1][3], against.REST)
        self.assertGreater(float(rows[0][12]), 0.05)  # without further reflections
        self.assertLess(float(rows[0][7]), 1.5 * float(rows[0][8]) + 0.2)  # and took no CPU for it

    def test_what_fails_is_told(self):
        _, _, done = self.table("/bin/false", code=1)
        self.assertIn("exit 1", done.stderr)
        _, _, done = self.table("no-such-revision", code=2)
        self.assertIn("neither a revision nor a program", done.stderr)

    def test_runs_take_turns_and_medians_are_theirs(self):
        log = self.folder / "log"
        other = self.wrapper(f'case $1 in bake) echo >>"{log}" ;; esac')
        _, told, _ = self.table(other, "--runs", "2")
        self.assertEqual(len(log.read_text()), 2)
        case, = json.loads(told.read_text())["cases"]
        for which in ("old", "new"):
            runs = case[which]["runs"]
            self.assertAlmostEqual(case[which]["seconds"], sum(run["seconds"] for run in runs) / 2)
        run = {"cpu": 1, "memory": 1, "device": "", "choice": "", "error": None}
        three = against.medians([{**run, "seconds": t, "stages": {"load": t, "write": 9}} for t in (5, 1, 2)])
        self.assertEqual((three["seconds"], three["stages"]), (2, {"load": 2, "write": 9}))


class Bundle(Folder):
    def test_it_runs_elsewhere_in_an_empty_environment(self):
        archive = self.folder / "bundle.tar.xz"
        subprocess.run([HERE / "bundle.sh", "--output", archive, "--build", LPVBAKE.parent], check=True,
                       env={**os.environ, "XZ_OPT": "-0 -T0"}, stdout=subprocess.DEVNULL)
        subprocess.run(["tar", "-xJf", archive, "-C", self.folder], check=True)
        unpacked = self.folder / "lpvbake-bench"
        loaded = subprocess.run([unpacked / "run", "--version"], check=True, capture_output=True, text=True,
                                env={"LD_DEBUG": "libs", "PATH": "/usr/bin:/bin"}, cwd="/").stderr
        libraries = [line.split("calling init: ")[1] for line in loaded.splitlines() if "calling init: " in line]
        inside = [path for path in libraries if path.startswith(str(unpacked))]
        self.assertGreater(len(inside), 5)
        for path in set(libraries) - set(inside):  # the system's, for its drivers
            self.assertRegex(path, r"/(ld-linux[^/]*|lib(c|m|dl|rt|pthread))\.so")
        self.assertTrue((unpacked / "lib" / "libvulkan.so.1").is_file())
        printed = subprocess.run([unpacked / "run", "bake", unpacked / "scenes" / "cornell_box.gltf", "--resolution",
                                  "8", "-o", self.folder / "a.vdb", "--format", "json"], check=True,
                                 capture_output=True, env={"PATH": "/usr/bin:/bin"}, cwd="/").stdout
        self.assertEqual(json.loads(printed)["triangles"], 36)
        self.assertGreater((self.folder / "a.vdb").stat().st_size, 10000)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], PART.capitalize()])
