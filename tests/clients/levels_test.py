#!/usr/bin/python3
"""Holds the Python reader's nested levels to a field that every interpolation returns.

Usage: levels_test.py EXAMPLES.
"""

import pathlib
import sys
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


if __name__ == "__main__":
    unittest.main()
