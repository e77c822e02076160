#!/usr/bin/env python3
"""Bakes of scenes with much of one thing stay below a stated peak of memory.

Usage: scale_test.py LPVBAKE MAKE_SCENE
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

LPVBAKE, MAKE_SCENE = sys.argv[1:3]

# Scene, its triangles, solver, MiB: a quarter more than is needed. Another copy of the triangles or
# of the decoded textures passes the bound.
CASES = [
    (["triangles", "200000"], 199712, "gather", 320),
    (["triangles", "200000"], 199712, "lpv", 320),
    (["instances", "500"], 128000, "gather", 320),
    (["nodes", "1000"], 256000, "lpv", 320),
    (["materials", "200"], 400, "gather", 160),
    (["textures", "20", "1024"], 40, "gather", 360),
]


class Scale(unittest.TestCase):
    def test_memory_is_bounded(self):
        with tempfile.TemporaryDirectory() as folder:
            scene, output = pathlib.Path(folder) / "scene.glb", pathlib.Path(folder) / "light.vdb"
            for made, triangles, solver, bound in CASES:
                with self.subTest(scene=made, solver=solver):
                    subprocess.run([sys.executable, MAKE_SCENE, made[0], scene, *made[1:]], check=True)
                    result = subprocess.run(
                        [LPVBAKE, "bake", scene, "-o", output, "--solver", solver, "--resolution", "12",
                         "--sun", "30,50,100000", "--threads", "2", "--format", "json"],
                        capture_output=True, text=True, timeout=250)
                    self.assertEqual(result.returncode, 0, result.stderr)
                    report = json.loads(result.stdout)
                    self.assertEqual(report["triangles"], triangles)
                    mebibytes = report["peak_memory"] / 2**20
                    print(f"{made[0]:10} {solver:6} {mebibytes:6.1f} of {bound} MiB", file=sys.stderr)
                    self.assertGreater(mebibytes, 20)
                    self.assertLess(mebibytes, bound)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
