#!/usr/bin/env python3
"""That examples/unreal/split_vdb.py makes files of at most eight channels, which hold together what the
volume does.

Usage: split_vdb_test.py LPVBAKE EXAMPLES
"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import pyopenvdb

LPVBAKE, EXAMPLES = sys.argv[1], pathlib.Path(sys.argv[2])


def cells(grid):
    low, high = grid.evalActiveVoxelBoundingBox()
    shape = [b - a + 1 for a, b in zip(low, high)] + ([3] if grid.valueTypeName == "vec3s" else [])
    values = np.zeros(shape, np.float32)
    grid.copyToArray(values, ijk=low)
    return values


class Split(unittest.TestCase):
    def test_files_of_eight_channels_hold_the_volume(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            for order, files in (("1", 2), ("2", 5)):
                whole = folder / f"order{order}.vdb"
                subprocess.run([LPVBAKE, "bake", EXAMPLES / "cornell_box.gltf", "-o", whole, "--target", "unreal",
                                "--resolution", "6", "--sh-order", order, "--quiet"], check=True,
                               stdout=subprocess.DEVNULL)
                subprocess.run([sys.executable, EXAMPLES / "unreal/split_vdb.py", whole], check=True,
                               stdout=subprocess.DEVNULL)
                found = {}
                for number in range(files):
                    grids, metadata = pyopenvdb.readAll(str(folder / f"order{order}_{number}.vdb"))
                    self.assertLessEqual(sum(3 if g.valueTypeName == "vec3s" else 1 for g in grids), 8)
                    self.assertEqual(metadata["lpv:convention"], "unreal")
                    found.update({grid.name: grid for grid in grids})
                self.assertFalse((folder / f"order{order}_{files}.vdb").exists())
                grids = {grid.name: grid for grid in pyopenvdb.readAll(str(whole))[0]}
                kept = [name for name in grids if name.startswith("sh_")] + ["validity"]
                self.assertEqual(sorted(found), sorted(kept))
                for name in kept:
                    self.assertTrue(np.array_equal(cells(found[name]), cells(grids[name])), name)
                    self.assertEqual(found[name].transform, grids[name].transform)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
