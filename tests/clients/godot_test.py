#!/usr/bin/env python3
"""What Godot's own importer makes of the flipbooks of `--target godot`, fitted to it: the cells and
the coefficients of the OpenVDB file that the same bake writes, to the rounding of half floats. Every
check is also run on pictures that are cut or turned wrongly, and must then fail.

Godot 3 is what Debian has: its importer is called texture_3d, Godot 4's 3d_texture, and both cut
slices from left to right, then down.

Usage: godot_test.py LPVBAKE EXAMPLES
"""

import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import OpenImageIO as oiio
import pyopenvdb

from pictures import pixels

PROGRAM, EXAMPLES = sys.argv[1], pathlib.Path(sys.argv[2])
ROUNDING = 2.0 ** -11  # of a half float, relative
UNCOMPRESSED = 2       # compress/mode
RGBA_HALF = 15         # Image.FORMAT_RGBAH

IMPORT = """[remap]

importer="texture_3d"
type="Texture3D"

[params]

compress/mode={mode}
compress/no_bptc_if_rgb=false
flags/repeat=0
flags/filter=true
flags/mipmaps=false
flags/srgb=0
slices/horizontal={columns}
slices/vertical={rows}
"""
PROJECT = 'config_version=4\n[application]\nconfig/name="volume"\n'
def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                            timeout=120)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stdout}"
                             f"\n{result.stderr}")
    return result.stdout


def texture(path):
    """What the importer wrote, uncompressed: "GD3T"; width, height, depth, flags, format and
    compression, 32 bits each; then the slices (Godot 3.2, ResourceImporterLayeredTexture)."""
    data = path.read_bytes()
    if data[:4] != b"GD3T":
        raise AssertionError(f"{path} is no 3D texture")
    width, height, depth, _, pixels, compression = struct.unpack("<6I", data[4:28])
    if (pixels, compression) != (RGBA_HALF, UNCOMPRESSED):
        raise AssertionError(f"{path} has format {pixels}, compression {compression}")
    return np.frombuffer(data, np.float16, offset=28).astype(float).reshape(depth, height, width, 4)


def imported(folder, pictures, columns, rows):
    """The textures that Godot has of pictures ({name: [row, column, channel]}), [z, y, x, channel]."""
    folder.mkdir()
    (folder / "project.godot").write_text(PROJECT)
    for name, texels in pictures.items():
        spec = oiio.ImageSpec(texels.shape[1], texels.shape[0], 4, "half")
        picture = oiio.ImageBuf(spec)
        picture.set_pixels(oiio.ROI(), np.ascontiguousarray(texels))
        picture.write(str(folder / name))
        (folder / (name + ".import")).write_text(
            IMPORT.format(mode=UNCOMPRESSED, columns=columns, rows=rows))
    run("godot3-server", "--path", folder, "--editor", "--quit")
    return {name: texture(next((folder / ".import").glob(f"{name}-*.tex3d"))) for name in pictures}


class Godot(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        # Three axes of different lengths, so that none passes for another.
        run(PROGRAM, "bake", EXAMPLES / "cornell_box.gltf", "--target", "godot", "--fit", "surfaces",
            "--bounds", "-1,0,-1,1,1.4,0.5", "--margin", "1", "--resolution", "16", "-o", cls.folder / "volume.exr",
            "-o", cls.folder / "volume.vdb")
        cls.facts = json.loads((cls.folder / "volume.json").read_text())
        cls.pictures = {
            file["file"]: pixels(cls.folder / file["file"]) for file in cls.facts["files"] if len(file["channels"]) == 4}
        cls.grids = {}
        for grid in pyopenvdb.readAllGridMetadata(str(cls.folder / "volume.vdb")):
            if grid.name.startswith("sh_"):
                dims = cls.facts["grid"]["dims"]
                values = np.zeros((*dims, 3))
                pyopenvdb.read(str(cls.folder / "volume.vdb"), grid.name).copyToArray(values)
                cls.grids[grid.name] = np.moveaxis(values, (0, 1, 2), (2, 1, 0))
        layout = cls.facts["layout"]
        cls.columns, cls.rows = layout["columns"], layout["rows"]

    def differences(self, name, pictures, columns=None, rows=None):
        """How far Godot's textures are from the grids, relative to each cell's largest coefficient,
        in roundings; infinite where their size is another."""
        textures = imported(self.folder / name, pictures, columns or self.columns,
                            rows or self.rows)
        self.assertEqual(set(textures), set(pictures))
        largest = np.max([np.abs(grid).max(-1) for grid in self.grids.values()], axis=0)
        worst, compared = 0.0, 0
        for file in self.facts["files"]:
            if file["file"] not in textures:
                continue
            texture = textures[file["file"]]
            for channel, full_name in enumerate(file["channels"]):
                grid_name, colour = full_name.split(".")
                wanted = self.grids[grid_name][..., "rgb".index(colour)]
                if texture.shape[:3] != wanted.shape:
                    return np.inf
                lit = largest > 1e-3 * largest.max()  # what is darker may be subnormal
                off = np.abs(texture[..., channel] - wanted)[lit] / largest[lit]
                worst = max(worst, off.max() / ROUNDING)
                compared += off.size
        self.assertGreater(compared, 1000)
        return worst

    def tiles(self, change):
        """The pictures with slices [number, row, column, channel] changed."""
        changed = {}
        for name, texels in self.pictures.items():
            height, width = texels.shape[0] // self.rows, texels.shape[1] // self.columns
            slices = texels.reshape(self.rows, height, self.columns, width, 4).swapaxes(1, 2)
            slices = change(slices.reshape(-1, height, width, 4))
            slices = slices.reshape(self.rows, self.columns, height, width, 4).swapaxes(1, 2)
            changed[name] = slices.reshape(texels.shape)
        return changed

    def test_reads_the_fitted_cells(self):
        self.assertEqual(len(self.pictures), 6)
        self.assertEqual(len(self.grids), 9)
        off = self.differences("good", self.pictures)
        print(f"worst difference {off:.2f} roundings of half floats")
        self.assertLess(off, 1.01)

    def test_sees_what_is_wrong(self):
        wrong = {
            "slices in reverse": (self.tiles(lambda slices: slices[::-1]),),
            "rows upside down": (self.tiles(lambda slices: slices[:, ::-1]),),
            "columns turned": (self.tiles(lambda slices: slices[:, :, ::-1]),),
            "coefficients swapped": ({name: texels[..., [0, 3, 2, 1]]
                                      for name, texels in self.pictures.items()},),
            "columns and rows swapped": (self.pictures, self.rows, self.columns),
        }
        for name, arguments in wrong.items():
            with self.subTest(name):
                off = self.differences(name.replace(" ", "_"), *arguments)
                print(f"{name}: {off:.3g} roundings")
                self.assertGreater(off, 20)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
