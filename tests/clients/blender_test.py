#!/usr/bin/env python3
"""What Blender sees in volumes for it: where their cells stand and what they hold, by pictures of
Cycles, and the example that shows them. Every check is also run on files that are wrong in one way,
and must then fail.

Usage: blender_test.py LPVBAKE EXAMPLES
"""

import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import OpenImageIO as oiio
import pyopenvdb

from pictures import picture

PROGRAM, EXAMPLES = sys.argv[1], pathlib.Path(sys.argv[2])
VIEWS = pathlib.Path(__file__).with_name("blender_views.py")
NAMES = ["l0", "l1_y", "l1_z", "l1_x", "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2"]
VECTORS = ["sh_" + name for name in NAMES] + [f"wall_{k}" for k in range(3)]
PLACE = 0.02   # cells, of the middle of what a lit cell shows
VALUES = 0.01  # of a picture's largest value: Cycles samples along rays


def run(*command):
    command = [str(part) for part in command]
    result = subprocess.run(command, capture_output=True, text=True)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stdout}"
                             f"\n{result.stderr}")
    return result.stdout


def blender(script, *arguments):
    return run("blender", "--background", "--factory-startup", "--python-exit-code", "9",
               "--python", script, "--", *arguments)


def to_blender(vectors):
    """glTF's (x, y, z) is Blender's (x, -z, y)."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    return np.stack([x, -z, y], -1)


def basis(d):
    x, y, z = np.moveaxis(d, -1, 0)
    one = np.ones_like(x)
    return np.stack([0.282095 * one, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y,
                     1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z,
                     0.546274 * (x * x - y * y)], -1)


def turned_sh(sh):
    """Coefficients [k, ...] of the same light in Blender's axes: those that give each direction,
    turned, the luminance that it had."""
    d = np.random.default_rng(1).normal(size=(100, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return np.tensordot(np.linalg.lstsq(basis(to_blender(d)), basis(d), rcond=None)[0], sh, 1)


class Blender(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        # A part of the box, 7 x 4 x 6 cells: no side is like another.
        cls.box = cls.folder / "box.vdb"
        run(PROGRAM, "bake", EXAMPLES / "cornell_box.gltf", "-o", cls.box,
            "--bounds=-0.9,0.1,-0.9,0.7,0.95,0.45", "--resolution", 7, "--margin", 0,
            "--sh-order", 2)
        facts = pyopenvdb.readMetadata(str(cls.box))
        cls.cell, cls.dims = facts["lpv:cell_size"], np.array(facts["lpv:grid_dims"])
        origin = np.array(facts["lpv:grid_origin"])
        # The same in Blender's axes: x stays, y runs where -z did, z where y did.
        cls.sh = turned_sh(np.stack([cls.read(cls.box, "sh_" + name, (*cls.dims, 3))
                                     for name in NAMES]))
        cls.sh = cls.sh[:, :, :, ::-1].transpose(0, 1, 3, 2, 4)
        cls.low = to_blender([origin, origin + cls.dims * cls.cell]).min(axis=0)
        cls.turned_dims = np.array(cls.sh.shape[1:4])

    @staticmethod
    def read(path, name, shape):
        values = np.zeros(shape, np.float32)
        pyopenvdb.read(str(path), name).copyToArray(values)
        return values.astype(float)

    def convert(self, source, name, *options):
        path = self.folder / name
        run(PROGRAM, "convert", source, path, *options)
        return path

    def look(self, jobs):
        """[(file, [view]), ...] -> what Blender says of each file; pictures lie where views say."""
        (self.folder / "jobs.json").write_text(json.dumps(
            [{"file": str(file), "views": views} for file, views in jobs]))
        blender(VIEWS, self.folder / "jobs.json", self.folder / "results.json")
        return json.loads((self.folder / "results.json").read_text())["files"]

    def test_grids_are_listed_where_they_are(self):
        paths = [self.convert(self.box, f"{precision}.vdb", "--target", "blender", "--precision",
                              precision) for precision in ("float", "half")]
        expected = {name: ("VECTOR_FLOAT", 3) for name in VECTORS}
        expected.update(density=("FLOAT", 1), validity=("FLOAT", 1))
        for path, said in zip(paths, self.look([(path, []) for path in paths])):
            self.assertTrue(said["loaded"], said["error"])
            found = {name: (grid["type"], grid["channels"]) for name, grid in said["grids"].items()}
            self.assertEqual(found, expected)
            for name, grid in said["grids"].items():
                matrix = np.array(grid["matrix"])
                wanted = np.diag([self.cell] * 3 + [1.0])
                wanted[:3, 3] = self.low
                self.assertLess(np.abs(matrix - wanted).max(), 1e-6, name)
                transform = pyopenvdb.read(str(path), name).transform
                for index in ((0, 0, 0), (3, 1, 2)):
                    there = matrix @ (*index, 1)
                    self.assertLess(np.abs(there[:3] - transform.indexToWorld(index)).max(), 1e-6)

    # ---- one lit cell, at a known place ----

    DIMS, CELL, ORIGIN, LIT = (7, 4, 6), 0.22, (-0.9, 0.08, -0.55), (5, 1, 4)

    def lit_cell(self):
        """A flipbook, of one coefficient, by hand."""
        x, y, z = self.DIMS
        values = np.zeros((z * y, x, 4), np.float32)  # one column of slices; rgb, validity
        values[..., 3] = 1
        values[self.LIT[2] * y + self.LIT[1], self.LIT[0], :3] = 1
        files = []
        for name, channels in (("sh_l0", ["sh_l0.r", "sh_l0.g", "sh_l0.b"]),
                               ("validity", ["validity"])):
            part = values[..., :3] if len(channels) == 3 else values[..., 3:]
            path = self.folder / f"lit_{name}.exr"
            picture = oiio.ImageBuf(oiio.ImageSpec(x, z * y, len(channels), "float"))
            picture.set_pixels(oiio.ROI(), np.ascontiguousarray(part))
            picture.write(str(path))
            files.append({"file": path.name, "quantity": "", "units": "", "channels": channels})
        path = self.folder / "lit.json"
        path.write_text(json.dumps({
            "format": "lpvbake flipbook", "version": 1,
            "grid": {"dims": self.DIMS, "origin": self.ORIGIN, "cell": self.CELL},
            "layout": {"columns": 1, "rows": z, "tile": [x, y], "slices": z},
            "packing": "band", "precision": "float", "sh_order": 0, "convention": "radiance",
            "direction": "incident", "axes": "gltf", "probe_position": "center", "files": files,
            "metadata": {}}))
        return path

    def offsets(self, paths):
        """Where the middle of the light is, in cells from the middle of the cell that is lit."""
        size = 64
        pixel = 3 / size
        jobs = [(path, [{"sums": {"sh_l0": 1}, "along": along, "centre": [0, 0, 0], "pixel": pixel,
                         "size": [size, size], "picture": str(path.with_suffix(f".{along}.exr"))}
                        for along in (1, 2)]) for path in paths]
        self.look(jobs)
        places = (np.arange(size) + 0.5 - size / 2) * pixel
        middle = to_blender(np.array(self.ORIGIN) + (np.array(self.LIT) + 0.5) * self.CELL)
        for _, views in jobs:
            light = [picture(view["picture"])[..., 0] for view in views]
            for each in light:
                self.assertAlmostEqual(each.sum() * pixel ** 2 / self.CELL ** 3, 1, delta=0.05)
            x, other_x = (each.sum(axis=0) @ places / each.sum() for each in light)
            z, y = (each.sum(axis=1) @ -places / each.sum() for each in light)
            self.assertAlmostEqual(x, other_x, delta=PLACE * self.CELL)
            yield (np.array([x, y, z]) - middle) / self.CELL

    def test_a_lit_cell_is_drawn_where_it_is(self):
        lit = self.lit_cell()
        cases = {"right": ["--target", "blender"], "not shifted": ["--axes", "blender"]}
        for axes in ("gltf", "unity", "unreal"):
            cases["axes " + axes] = ["--target", "blender", "--axes", axes]
        offsets = dict(zip(cases, self.offsets(
            [self.convert(lit, f"lit{i}.vdb", *options)
             for i, options in enumerate(cases.values())])))
        for case, offset in offsets.items():
            print(f"lit cell, {case}: {np.round(offset, 4)} cells from its place")
        self.assertLess(np.abs(offsets.pop("right")).max(), PLACE)
        # Indices at cells' centres: half a cell off along every axis.
        self.assertLess(np.abs(offsets.pop("not shifted") - 0.5).max(), PLACE)
        for case, offset in offsets.items():
            self.assertGreater(np.abs(offset).max(), 1, case)

    # ---- all values, as sums along the axes ----

    def errors(self, paths):
        """Largest error of each picture, relative to its largest value. A pixel is a column of
        cells; Cycles goes linearly from centre to centre, and on for a cell beyond the outermost
        ones. Coefficients of either sign are lifted by c0, as nothing negative is shown."""
        views, wanted = [], []
        for k, name in enumerate(NAMES):
            for along in (0, 1, 2) if k == 0 else (1,):
                lift = 0 if k == 0 else 2.5
                columns = np.moveaxis((self.sh[k] + lift * self.sh[0]) * self.cell, along, 0)
                total = columns.sum(axis=0) + (columns[0] + columns[-1]) / 2
                wanted.append(np.flip(total.transpose(1, 0, 2), 0))  # rows from above
                height, width = wanted[-1].shape[:2]
                views.append({"sums": {"sh_" + name: 1, **({"sh_l0": lift} if lift else {})},
                              "along": along, "pixel": self.cell, "size": [width, height],
                              "centre": list(self.low + self.turned_dims * self.cell / 2),
                              "picture": f"{name}.{along}.exr"})
        jobs = [(path, [{**view, "picture": f"{path}.{view['picture']}"} for view in views])
                for path in paths]
        self.look(jobs)
        for _, own in jobs:
            yield {f"{next(iter(view['sums']))} along {'xyz'[view['along']]}":
                   np.abs(picture(view["picture"]) - want).max() / want.max()
                   for view, want in zip(own, wanted)}

    def test_values_are_those_of_the_volume(self):
        paths = [self.convert(self.box, f"values_{precision}.vdb", "--target", "blender",
                              "--precision", precision) for precision in ("float", "half")]
        for path, errors in zip(paths, self.errors(paths)):
            print(f"{path.stem}: largest error {max(errors.values()):.2g}")
            self.assertLess(max(errors.values()), VALUES, errors)

    def test_wrong_values_are_seen(self):
        good = self.convert(self.box, "good.vdb", "--target", "blender")
        metadata = pyopenvdb.readMetadata(str(good))

        def rewritten(name, change):
            grids = pyopenvdb.readAll(str(good))[0]
            change({grid.name: grid for grid in grids})
            path = self.folder / name
            pyopenvdb.write(str(path), grids, metadata)
            return path

        def swap(grids, a, b):
            grids[a].name, grids[b].name = b, a

        def flip(grids):
            for grid in grids.values():
                shape = (*self.turned_dims, 3) if grid.name in VECTORS else tuple(self.turned_dims)
                values = np.zeros(shape, np.float32)
                grid.copyToArray(values)
                grid.clear()
                grid.copyFromArray(np.ascontiguousarray(values[::-1]))

        cases = {
            "unchanged": (rewritten("same.vdb", lambda grids: None), ()),
            "x and y swapped": (rewritten("swap1.vdb", lambda grids: swap(
                grids, "sh_l1_x", "sh_l1_y")), ("sh_l1_x along y", "sh_l1_y along y")),
            "xy and yz swapped": (rewritten("swap2.vdb", lambda grids: swap(
                grids, "sh_l2_xy", "sh_l2_yz")), ("sh_l2_xy along y", "sh_l2_yz along y")),
            "flipped along x": (rewritten("flip.vdb", flip),
                                ("sh_l0 along y", "sh_l0 along z", "sh_l1_x along y")),
            "not shifted": (self.convert(self.box, "unshifted.vdb", "--axes", "blender"),
                            ("sh_l0 along x", "sh_l0 along y", "sh_l0 along z")),
            "another convention": (self.convert(self.box, "other.vdb", "--target", "blender",
                                                "--sh-convention", "irradiance"),
                                   ("sh_l0 along x", "sh_l1_y along y")),
        }
        paths = [path for path, _ in cases.values()]
        for (case, (_, seen)), errors in zip(cases.items(), self.errors(paths)):
            if not seen:
                self.assertLess(max(errors.values()), VALUES, case)
                continue
            print(f"{case}:", {name: round(errors[name], 3) for name in seen})
            for name in seen:
                self.assertGreater(errors[name], 3 * VALUES, (case, name))

    # ---- the example ----

    def shown(self, name, *arguments):
        path = self.folder / name
        blender(EXAMPLES / "blender/show_volume.py", *arguments, "--render", path, "--size",
                "64x48", "--samples", "16")
        return picture(path)

    @staticmethod
    def redness(picture):
        """What is shown of red beside green, -1 to 1, left and right of the middle; None for a
        picture of nothing."""
        if (picture.max(axis=2) > 0.1).mean() < 0.2:
            return None
        columns = picture.shape[1]
        sides = picture[:, :columns * 2 // 5], picture[:, columns * 3 // 5:]
        return [(side[..., 0].mean() - side[..., 1].mean())
                / (side[..., 0].mean() + side[..., 1].mean()) for side in sides]

    def assert_red_is_left(self, picture):
        left, right = self.redness(picture) or (0, 0)
        self.assertGreater(left, right + 0.05, (left, right))

    def test_the_example_shows_scene_and_volume(self):
        scene = EXAMPLES / "cornell_box.gltf"
        volume = self.folder / "cornell.vdb"
        run(PROGRAM, "bake", scene, "-o", volume, "--resolution", 12, "--target", "blender")
        both = self.shown("both.png", scene, volume)
        alone = self.shown("alone.png", volume)
        mirrored = self.convert(volume, "mirrored.vdb", "--target", "blender", "--axes", "unity")
        wrong = self.shown("wrong.png", mirrored)
        dark = self.shown("dark.png", volume, "--strength", "0")
        print("redness left and right:", *map(self.redness, (both, alone, wrong, dark)))
        self.assert_red_is_left(both)
        self.assert_red_is_left(alone)
        for picture in (wrong, dark):
            with self.assertRaises(AssertionError):
                self.assert_red_is_left(picture)
        self.assertGreater(self.redness(both)[0], 0.1)
        self.assertLess(self.redness(both)[1], -0.02)

    def air(self, name, extinction):
        """A block of 10 x 10 x 10 cells of 0.1 m that scatters 1 nit a metre, and takes so much a metre,
        RGB, of each of its halves along x."""
        grids = []
        for own, halves in (("sh_l0", ([1] * 3,) * 2), ("scatter", ([1] * 3,) * 2), ("extinction", extinction)):
            values = np.zeros((10, 10, 10, 3), np.float32)
            values[:5], values[5:] = halves
            grid = pyopenvdb.Vec3SGrid()
            grid.name = own
            grid.copyFromArray(values)
            grid.transform = pyopenvdb.createLinearTransform(voxelSize=0.1)
            grids.append(grid)
        path = self.folder / name
        pyopenvdb.write(str(path), grids)
        return path

    def test_the_example_shows_what_air_scatters_and_takes(self):
        # Across a block 1 m deep, (1 - exp(-s)) / s nits; the example exposes as it likes.
        for left, right in (([0.2, 0.2, 0.2], [3.0, 1.0, 0.2]), ([0.5, 2.0, 1.0], [2.0, 0.5, 1.0])):
            path = self.folder / "air.png"
            blender(EXAMPLES / "blender/show_volume.py", self.air("air.vdb", (left, right)), "--render",
                    path, "--size", "96x72", "--samples", "64")
            shown = picture(path)
            light = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
            rows, columns = (np.flatnonzero(shown.max(axis=(2, along)) > 0.1) for along in (1, 0))
            block = light[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]
            height, width = np.array(block.shape[:2]) // 8
            self.assertGreater(min(height, width), 2)
            parts = [block[3 * height:5 * height, x * width:(x + 2) * width] for x in (1, 5)]
            ratio = parts[1].mean(axis=(0, 1)) / parts[0].mean(axis=(0, 1))
            wanted = [(-np.expm1(-b) / b) / (-np.expm1(-a) / a) for a, b in zip(left, right)]
            print("air:", np.round(ratio, 3), "of", np.round(wanted, 3))
            self.assertLess(np.abs(ratio / wanted - 1).max(), 0.08, (ratio, wanted))

    def test_the_example_says_what_is_wrong(self):
        for file in ("missing.vdb", __file__):
            result = subprocess.run(
                ["blender", "--background", "--factory-startup", "--python-exit-code", "9",
                 "--python", EXAMPLES / "blender/show_volume.py", "--", file],
                capture_output=True, text=True)
            self.assertNotEqual(result.returncode, 0)
            self.assertIn(f"error: {file}: ", result.stderr)

    # ---- other readers ----

    def test_vdb_print_lists_it(self):
        for precision, half in (("float", "false"), ("half", "true")):
            path = self.convert(self.box, f"print_{precision}.vdb", "--target", "blender",
                                "--precision", precision)
            text = run("vdb_print", "-l", "-m", path)
            self.assertEqual(set(re.findall(r"^Name: (\w+)", text, re.M)),
                             {"density", "validity", *VECTORS})
            self.assertEqual(set(re.findall(r"is_saved_as_half_float: (\w+)", text)), {half})
            for fact in ("axes: blender", "index_position: corner", "convention: radiance"):
                self.assertIn("lpv:" + fact, text)

    def test_oiiotool_lists_what_targets_write(self):
        channels = {"unity": {"r": 4, "g2": 4, "sh_l2_x2y2": 3, "validity": 1},
                    "unreal": {"r": 4, "b2": 4}, "godot": {"b": 4}, "threejs": {"atlas": 4},
                    "vrc": {"0": 4, "2": 4}, "bevy": {"cube": 3}}
        for target, files in channels.items():
            self.convert(self.box, f"{target}.exr", "--target", target)
            for suffix, count in files.items():
                text = run("oiiotool", "--info", "-v", self.folder / f"{target}_{suffix}.exr")
                self.assertRegex(text, rf"{count} channel, half openexr")
                names = {1: "Y", 3: "R, G, B", 4: "R, G, B, A"}[count]
                self.assertRegex(text, rf"(?m)channel list: {names}$")
                self.assertIn("lpv:grid", text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
