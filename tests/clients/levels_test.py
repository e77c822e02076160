#!/usr/bin/python3
"""Holds the Python reader's nested levels and bricks to a field that every interpolation returns.

Usage: levels_test.py EXAMPLES.
"""

import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np

sys.dont_write_bytecode = True
EXAMPLES = pathlib.Path(sys.argv.pop())
sys.path.insert(0, str(EXAMPLES))
import light_volume

CELLS = [0.25, 0.5, 2.0]
BOXES = [((0, 0, 0), (2, 1.5, 2)), ((-1, 0, -1), (3, 2, 4)), ((-5, 0, -5), (7, 4, 5))]  # of samples


def affine(points):
    """[..., k, rgb] at [..., xyz]."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    k = np.arange(4)[:, None]
    return (np.array([3, 5, 7]) + (k + 1) * [0.2, -0.1, 0.3] * x[..., None, None]
            + [0.5, 0.25, -0.2] * y[..., None, None] + k * [0.1, 0.4, 0.2] * z[..., None, None])


class Trilinear(light_volume.LightVolume):
    """The cosine to a cell weighs cells unevenly by intent: here they are not."""

    def weights(self, point, normal):
        at = self.to_lattice(point)
        low = np.clip(at.astype(int), 0, np.array(self.validity.shape) - 2)
        share = at - low
        return (low + light_volume.CORNERS,
                np.prod(np.where(light_volume.CORNERS, share, 1 - share), axis=1), True)


def levels_of(kind, field, off=0.0):
    levels = []
    for cell, (lo, hi) in zip(CELLS, BOXES):
        dims = np.round((np.array(hi) - lo) / cell).astype(int) + 1
        centres = np.array(lo) + cell * np.stack(np.indices(dims), -1)
        levels.append(kind(np.moveaxis(field(centres), -2, 0), np.ones(dims), np.zeros((0, *dims, 3)),
                           np.array(lo) - (0.5 - off) * cell, cell))
    return light_volume.LightLevels(levels)


class Levels(unittest.TestCase):
    def setUp(self):
        random = np.random.default_rng(1)
        boxes = np.array(BOXES)[random.integers(0, 3, 2000)]
        self.points = boxes[:, 0] + random.random((2000, 3)) * (boxes[:, 1] - boxes[:, 0])
        self.normals = random.standard_normal((2000, 3))

    def worst(self, levels):
        """The largest relative error of irradiance."""
        errors = []
        for point, normal in zip(self.points, self.normals):
            normal = normal / np.linalg.norm(normal)
            true = np.maximum(0, light_volume.cosine_basis(normal)[:4] @ affine(point))
            if true.min() > 0.1:
                errors.append(np.max(np.abs(levels.irradiance(point, normal) / true - 1)))
        self.assertGreater(len(errors), 500)
        return max(errors)

    def test_an_affine_field_is_read_exactly_anywhere(self):
        self.assertLess(self.worst(levels_of(Trilinear, affine)), 1e-6)
        self.assertGreater(self.worst(levels_of(Trilinear, affine, 0.5)), 1e-3, "half a cell shows")

    def test_an_even_field_is_even(self):
        even = lambda centres: np.broadcast_to([[1.0, 2, 3]], (*centres.shape[:-1], 1, 3))
        levels = levels_of(light_volume.LightVolume, even)
        expected = np.pi * np.sqrt(1 / np.pi) / 2 * np.array([1, 2, 3])
        shares = set()
        for point, normal in zip(self.points, self.normals):
            np.testing.assert_allclose(levels.irradiance(point, normal), expected, rtol=1e-6)
            shares.add(0 < levels.share(0, point) < 1)
        self.assertEqual(shares, {False, True}, "of points where levels blend")


BRICKS = [[(0, 0, 0), (1, 1, 0), (2, 1, 1)],  # by level, the finest first
          [(i, j, k) for i in range(3) for j in range(2) for k in range(2)],
          [(0, 0, 0), (1, 0, 0)]]
CORNER, FINEST = np.array([-3.25, 0.5, 7]), 0.25


def bricks_of(atlas, shift=0):
    """As the file of a manifest has them: stacked in an atlas, or in the lattice of each level;
    `shift` samples off."""
    places = [(level, np.array(place)) for level, of in enumerate(BRICKS) for place in of]
    box = [*CORNER, *(CORNER + 8 * 4 * FINEST * np.array([2, 1, 1]))]
    manifest = {"format": "lpvbake bricks",
                "levels": [{"file": f"{level}.vdb", "cell": FINEST * 2**level, "box": box,
                            "bricks": [int(i) for place in of for i in place]}
                           for level, of in enumerate(BRICKS)]}
    if atlas:
        manifest["atlas"] = {"file": "atlas.exr", "slots": [3, 3, 2]}

    def load(path, firsts):
        name = pathlib.Path(path).name
        stored = places if atlas else [each for each in places if name == f"{each[0]}.vdb"]
        dims = (27, 27, 18) if atlas else np.array([65, 33, 33]) // 2**stored[0][0] + 1
        field = np.full((4, *dims, 3), np.nan)
        for n, (level, place) in enumerate(stored):
            first = 9 * np.array([n % 3, n // 3 % 3, n // 9]) if atlas else 8 * place
            cell = FINEST * 2**level
            at = CORNER + cell * (8 * place + np.stack(np.indices((9, 9, 9)), -1) + shift)
            field[(slice(None), *(slice(i, i + 9) for i in first))] = np.moveaxis(affine(at), -2, 0)
        cut = [field[(slice(None), *(slice(i, i + 9) for i in first))] for first in firsts]
        return [Trilinear(c, np.ones((9, 9, 9)), np.zeros((0, 9, 9, 9, 3)), None, None) for c in cut]

    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "a.levels.json"
        path.write_text(json.dumps(manifest))
        return light_volume.LightLevels.load(str(path), load)


class Bricks(unittest.TestCase):
    worst = Levels.worst

    def setUp(self):
        random = np.random.default_rng(2)
        self.points = CORNER + random.random((4000, 3)) * 8 * 4 * FINEST * np.array([2, 1, 1])
        self.normals = random.standard_normal((4000, 3))

    def test_an_affine_field_is_read_exactly_anywhere(self):
        for atlas in (True, False):
            bricks = bricks_of(atlas)
            self.assertEqual(len(bricks.bricks), 17)
            self.assertLess(self.worst(bricks), 1e-6)
            self.assertGreater(self.worst(bricks_of(atlas, 0.5)), 1e-3, "half a cell shows")


class Places(Levels):
    """Volumes beside each other, the second turned about the vertical and an axis of the first."""

    @staticmethod
    def places_of(kind, field):
        volumes = []
        for origin, dims, turn in (((-4, 0, -4), (20, 16, 24), (0, 0, 0, 1)),
                                   ((-1, 0.5, -1), (18, 14, 16), np.array([0.1, 0.5, -0.2, 0.8]))):
            axes = light_volume.axes_of(np.array(turn) / np.linalg.norm(turn))
            centres = np.array(origin) + 0.25 * (np.stack(np.indices(dims), -1) + 0.5) @ axes.T
            volumes.append(kind(np.moveaxis(field(centres), -2, 0), np.ones(dims), np.zeros((0, *dims, 3)),
                                np.array(origin, float), 0.25, axes))
        return light_volume.LightPlaces(volumes, [0.5, 0.3])

    def setUp(self):
        super().setUp()
        places = self.places_of(Trilinear, affine)
        points = [-4, 0, -4] + np.random.default_rng(2).random((2000, 3)) * [9, 4, 7]
        self.points = np.array([point for point in points
                                if any(volume.depth(point) > 0.2 for volume in places.levels)])
        self.normals = self.normals[: len(self.points)]

    def test_an_affine_field_is_read_exactly_anywhere(self):
        places = self.places_of(Trilinear, affine)
        self.assertLess(self.worst(places), 1e-6)
        places.levels[1].axes = np.eye(3)
        self.assertGreater(self.worst(places), 1e-3, "the turn counts")

    def test_an_even_field_is_even(self):
        even = lambda centres: np.broadcast_to([[1.0, 2, 3]], (*centres.shape[:-1], 1, 3))
        places = self.places_of(light_volume.LightVolume, even)
        expected = np.pi * np.sqrt(1 / np.pi) / 2 * np.array([1, 2, 3])
        for point, normal in zip(self.points, self.normals):
            np.testing.assert_allclose(places.irradiance(point, normal), expected, rtol=1e-6)
        np.testing.assert_allclose(places.irradiance([99, 0, 0], [0, 1, 0]), expected, rtol=1e-6)


if __name__ == "__main__":
    unittest.main()
