#!/usr/bin/env python3
"""What examples/unity makes of our files and of `bake --at`, compiled by Mono against the classes of Unity
and VRC Light Volumes as their documentation declares them (unity_stubs.cs), and run (unity_run.cs). The
engines themselves are not run. Every comparison is also made with something swapped, and must then fail.

Usage: unity_test.py LPVBAKE EXAMPLES
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

from pictures import pixels

PROGRAM, EXAMPLES = sys.argv[1], pathlib.Path(sys.argv[2])
HERE = pathlib.Path(__file__).resolve().parent
SCENE = EXAMPLES / "cornell_box.gltf"
CLEARLY = 100  # a wrong reading errs by this many tolerances

# Probes of Adaptive Probe Volumes, every 0.3 m of a brick in the Cornell box, as Unity has them: x turned.
POSITIONS = np.array([[x, y, z] for z in (-0.7, -0.4, 0.2, 0.8) for y in (0.1, 0.7, 1.3, 1.9)
                      for x in (-0.8, -0.3, 0.1, 0.4, 0.9)], np.float32)
NORMALS = np.random.default_rng(1).normal(size=(40, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
TURN = np.array([-1.0, 1, 1])  # glTF's axes to Unity's and back


def run(*command, fails=False):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=300)
    if (result.returncode != 0) != fails:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stdout}\n{result.stderr}")
    return result.stderr if fails else result.stdout


def canonical(sh, n):
    """[cell, k, rgb] nits and unit normals [n, 3] in glTF's axes -> irradiance over pi [cell, n, rgb]:
    projections on real orthonormal harmonics times pi, 2 pi / 3 and pi / 4 (Ramamoorthi and Hanrahan 2001)."""
    x, y, z = n.T
    root = np.sqrt(1 / np.pi)
    terms = [0.5 * root + 0 * x, *(np.sqrt(3) / 2 * root * a for a in (y, z, x)),
             *(np.sqrt(15) / 2 * root * a for a in (x * y, y * z)), np.sqrt(5) / 4 * root * (3 * z * z - 1),
             np.sqrt(15) / 2 * root * x * z, np.sqrt(15) / 4 * root * (x * x - y * y)]
    bands = np.repeat([np.pi, 2 * np.pi / 3, np.pi / 4], [1, 3, 5])
    basis = np.stack(terms, -1) * bands / np.pi
    return np.einsum("nk,ckj->cnj", basis[:, :sh.shape[1]], sh)


def shade_sh9(rgba, rgba2, x2y2, n):
    """UnityCG.cginc: textures [cell, rgb, 4] and [cell, rgb], normals in Unity's axes."""
    x, y, z = n.T
    first = np.stack([x, y, z, np.ones(len(n))], -1)
    second = np.stack([x * y, y * z, z * z, z * x], -1)
    return (np.einsum("ni,cji->cnj", first, rgba) + np.einsum("ni,cji->cnj", second, rgba2)
            + np.einsum("n,cj->cnj", x * x - y * y, x2y2))


def shade_light_probe(sh, n):
    """[cell, rgb, 9] of SphericalHarmonicsL2, as Unity gives them to shaders (SHCoefficients of the render
    pipelines' core)."""
    s = np.moveaxis(sh, -1, 0)
    return shade_sh9(np.stack([s[3], s[1], s[2], s[0] - s[6]], -1), np.stack([s[4], s[5], 3 * s[6], s[7]], -1),
                     s[8], n)


class Unity(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.program = cls.folder / "unity.exe"
        run("mcs", "-warnaserror", "-warn:4", f"-out:{cls.program}", HERE / "unity_stubs.cs", HERE / "unity_run.cs",
            *sorted((EXAMPLES / "unity").rglob("*.cs")))
        cls.positions = cls.folder / "positions"
        np.savetxt(cls.positions, POSITIONS, "%.9g")
        points = {"points": (POSITIONS.astype(float) * TURN).tolist()}
        (cls.folder / "points.json").write_text(json.dumps(points))
        run(PROGRAM, "bake", SCENE, "--at", cls.folder / "points.json", "-o", cls.folder / "lit.json", "--bounces", "2")
        lit = json.loads((cls.folder / "lit.json").read_text())
        cls.sh = np.array([point["sh"] for point in lit["points"]])
        cls.valid = np.array([point["validity"] for point in lit["points"]])
        cls.backs = np.array([point["backs"] for point in lit["points"]])
        cls.expected = canonical(cls.sh, NORMALS * TURN)

    def rows(self, mode, scene=SCENE, options="--bounces 2", **more):
        output = run("mono", self.program, mode, PROGRAM, scene, options, self.positions, **more)
        return output if more else np.array([[float(n) for n in line.split()] for line in output.splitlines()])

    def error(self, found, expected=None):
        """Of irradiance over pi, relative to each cell's largest."""
        expected = self.expected if expected is None else expected
        largest = np.abs(expected).max((1, 2), keepdims=True)
        lit = largest[:, 0, 0] > 0
        self.assertGreater(lit.sum(), len(lit) // 2)
        return (np.abs(found - expected)[lit] / largest[lit]).max()

    def test_probe_baker_hands_back_what_the_tool_gives(self):
        rows = self.rows("probes")
        self.assertEqual(rows.shape, (len(POSITIONS), 29))
        light = rows[:, :27].reshape(-1, 3, 9)
        off = self.error(shade_light_probe(light, NORMALS))
        print(f"probes: {off:.2g}")
        self.assertLess(off, 2e-6)
        inside = self.valid == 0
        self.assertGreater(inside.sum(), 2)
        np.testing.assert_allclose(rows[:, 27], np.where(inside, 1, self.backs), rtol=1e-6)
        np.testing.assert_array_equal(rows[:, 28], 1)
        for a in range(9):
            for b in range(a):
                swapped = light.copy()
                swapped[..., [a, b]] = light[..., [b, a]]
                self.assertGreater(self.error(shade_light_probe(swapped, NORMALS)), CLEARLY * 2e-6, (a, b))
            turned = light.copy()
            turned[..., a] *= -1
            self.assertGreater(self.error(shade_light_probe(turned, NORMALS)), CLEARLY * 2e-6, a)
        self.assertGreater(self.error(shade_light_probe(light[:, ::-1], NORMALS)), CLEARLY * 2e-6)
        self.assertGreater(self.error(shade_light_probe(light[::-1], NORMALS)), CLEARLY * 2e-6)

    def test_vrc_baker_hands_back_what_the_tool_gives(self):
        rows = self.rows("vrc")
        self.assertEqual(rows.shape, (len(POSITIONS), 13))

        def shade(rows):  # L0 + L1.n of each colour: LightVolumes.cginc
            return rows[:, None, :3] + np.einsum("ni,cji->cnj", NORMALS, rows[:, 3:12].reshape(-1, 3, 3))

        expected = canonical(self.sh[:, :4], NORMALS * TURN)
        off = self.error(shade(rows), expected)
        print(f"VRC: {off:.2g}")
        self.assertLess(off, 2e-6)
        np.testing.assert_allclose(rows[:, 12], np.where(self.valid == 0, 1, self.backs), rtol=1e-6)
        for a, b in [(0, 1), (3, 4), (4, 5), (3, 6), (5, 11)]:
            swapped = rows.copy()
            swapped[:, [a, b]] = rows[:, [b, a]]
            self.assertGreater(self.error(shade(swapped), expected), CLEARLY * 2e-6, (a, b))

    def test_what_the_tool_says_reaches_the_user(self):
        none = self.folder / "none.glb"
        for mode in ("probes", "vrc"):
            self.assertIn(f"{none}: No such file", self.rows(mode, scene=none, fails=True))
        self.assertIn("--bounces", self.rows("probes", options="--bounces -1", fails=True))

    def imported(self, name):
        facts = {}
        for line in run("mono", self.program, "import", self.folder / name, self.folder).splitlines():
            key, *values = line.split(" ")
            facts.setdefault(key, []).append(values)
        return facts

    def texels(self, facts):
        """{name of a global: [z, y, x, 4]}"""
        kinds = {"RGBAHalf": np.float16, "RGBAFloat": np.float32}
        return {name: np.fromfile(self.folder / name, kinds[kind]).reshape(int(d), int(h), int(w), 4).astype(float)
                for name, w, h, d, kind, _ in facts["texture"]}

    def test_importer_gives_shaders_the_cells(self):
        volume = self.folder / "volume.vdb"
        run(PROGRAM, "bake", SCENE, "-o", volume, "--bounds", "-1,0,-1,1,1.4,0.5", "--margin", "1", "--resolution", "12")
        tolerance = 5e-6
        for precision in ("float", "half"):  # of what our own reader makes of the same files
            stderr = subprocess.run([PROGRAM, "convert", volume, self.folder / "room.dds", "--target", "unity",
                                     "--precision", precision], capture_output=True, text=True, check=True).stderr
            self.assertNotIn("warning", stderr)
            run(PROGRAM, "convert", self.folder / "room.dds", self.folder / "plain.exr", "--precision", "float")
            facts = self.imported("room.unity.json")
            self.assertNotIn("error", facts)
            self.assertEqual(len(facts["depends"]), 7)
            textures = self.texels(facts)
            described = json.loads((self.folder / "plain.json").read_text())
            grid, layout = described["grid"], described["layout"]
            sh = np.stack([self.picture(f"plain_{name}.exr", layout, grid["dims"]) for name in (
                "sh_l0", "sh_l1_y", "sh_l1_z", "sh_l1_x", "sh_l2_xy", "sh_l2_yz", "sh_l2_z2", "sh_l2_xz", "sh_l2_x2y2")])
            # Cells at random, by the coordinates that shaders get.
            cells = np.random.default_rng(2).integers(0, grid["dims"], (200, 3))
            points = (np.array(grid["origin"]) + grid["cell"] * (cells + 0.5)) * TURN
            scale, offset = (np.array([float(n) for n in facts[key][0]]) for key in ("_LpvbakeScale", "_LpvbakeOffset"))
            self.assertEqual((scale[3], offset[3]), (2, 0.5))
            at = (points * scale[:3] + offset[:3]) * np.array(textures["_LpvbakeR"].shape[2::-1]) - 0.5
            index = np.rint(at).astype(int)
            np.testing.assert_allclose(at, index, atol=1e-4)
            x, y, z = cells.T
            expected = canonical(np.moveaxis(sh[:, z, y, x], 0, 1), NORMALS * TURN)

            def shade(textures, index=index):
                x, y, z = index.T
                stack = [np.stack([textures[f"_Lpvbake{c}{more}"][z, y, x] for c in "RGB"], 1) for more in ("", "2")]
                return shade_sh9(*stack, textures["_LpvbakeX2Y2"][z, y, x, :3], NORMALS)

            off = self.error(shade(textures), expected)
            print(f"importer, {precision}: {off:.2g}")
            self.assertLess(off, tolerance)
            last = np.array(textures["_LpvbakeR"].shape[2::-1]) - 1
            for axis in range(3):
                flipped = index.copy()
                flipped[:, axis] = last[axis] - index[:, axis]
                self.assertGreater(self.error(shade(textures, flipped), expected), CLEARLY * tolerance)
            for a, b in (("R", "G"), ("R", "R2"), ("B", "X2Y2")):
                swapped = {**textures, f"_Lpvbake{a}": textures[f"_Lpvbake{b}"], f"_Lpvbake{b}": textures[f"_Lpvbake{a}"]}
                self.assertGreater(self.error(shade(swapped), expected), CLEARLY * tolerance)

    def picture(self, name, layout, dims):
        """A flipbook's cells [z, y, x, 3]: left to right, then down."""
        rows, columns = layout["rows"], layout["columns"]
        tiles = pixels(self.folder / name).reshape(rows, dims[1], columns, dims[0], 3).swapaxes(1, 2)
        return tiles.reshape(rows * columns, dims[1], dims[0], 3)[:dims[2]]

    def test_pictures_get_the_settings_of_the_notes(self):
        run(PROGRAM, "bake", SCENE, "-o", self.folder / "flip.exr", "--target", "unity", "--resolution", "8", "--fit", "none",
            "--sh-order", "1")
        notes = json.loads((self.folder / "flip.unity.json").read_text())
        facts = self.imported("flip.unity.json")
        self.assertNotIn("error", facts)
        self.assertEqual({values[0] for values in facts["picture"]}, set(notes["textures"]))
        settings = notes["importer"]
        for values in facts["picture"]:
            self.assertEqual(values[1:], [str(settings[key]) for key in (
                "flipbookColumns", "flipbookRows", "textureShape", "sRGBTexture", "mipmapEnabled", "npotScale", "wrapMode",
                "filterMode", "textureCompression")])
        self.assertEqual({values[0]: values[5] for values in facts["texture"]},
                         {"_LpvbakeR": "flip_r", "_LpvbakeG": "flip_g", "_LpvbakeB": "flip_b"})
        # v = 1 - (y - min) / (max - min)
        low, high = notes["volume"]["min"], notes["volume"]["max"]
        scale, offset = ([float(n) for n in facts[key][0]] for key in ("_LpvbakeScale", "_LpvbakeOffset"))
        np.testing.assert_allclose(np.array([low, high]) * scale[:3] + offset[:3], [[0, 1, 0], [1, 0, 1]], atol=1e-5)
        self.assertEqual(scale[3], 1)

    def test_importer_names_what_is_wrong(self):
        run(PROGRAM, "bake", SCENE, "-o", self.folder / "bad.dds", "--target", "unity", "--resolution", "8", "--fit", "none")

        def error():
            facts = self.imported("bad.unity.json")
            self.assertNotIn("texture", facts)
            return " ".join(facts["error"][0])

        texture = self.folder / "bad_g.dds"
        whole = texture.read_bytes()
        texture.write_bytes(whole[:-1])
        self.assertIn("bad_g.dds: is cut off; bake it again", error())
        texture.write_bytes(b"DDS " + whole[200:])
        self.assertIn("bad_g.dds: is no 3D texture of lpvbake", error())
        texture.unlink()
        self.assertIn("bad_g.dds: is missing; copy all files of the bake", error())
        run(PROGRAM, "bake", SCENE, "-o", self.folder / "bad.dds", "--target", "unity", "--resolution", "8",
            "--evaluation", "zh3")
        self.assertIn("bake without --evaluation", error())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
