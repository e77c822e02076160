#!/usr/bin/env python3
"""What programs that others wrote make of our 3D textures: ktx-parse and three.js' Zstandard decoder
of KTX2, OGRE of DDS; cell by cell beside the OpenVDB file that the same bake writes. Every check is
also run on texels that are turned, swapped or scaled, and must then fail.

Usage: textures_test.py LPVBAKE OGRE_DDS EXAMPLES CACHE

OGRE_DDS is the program of ogre_dds.cpp. What comes from the npm registry is kept in the folder CACHE.
"""

import contextlib
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import OpenImageIO as oiio
import pyopenvdb

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import npm

LPVBAKE, OGRE_DDS = sys.argv[1:3]
EXAMPLES, CACHE = pathlib.Path(sys.argv[3]), pathlib.Path(sys.argv[4]).resolve()
ROUNDING = {np.float32: 0.0, np.float16: 2.0 ** -11}  # relative
# VkFormat of Vulkan, and OGRE's names.
VULKAN = {37: (np.uint8, 4), 76: (np.float16, 1), 97: (np.float16, 4), 100: (np.float32, 1), 109: (np.float32, 4)}
OGRE = {"PF_FLOAT16_R": (np.float16, 1), "PF_FLOAT16_RGBA": (np.float16, 4),
        "PF_FLOAT32_R": (np.float32, 1), "PF_FLOAT32_RGBA": (np.float32, 4)}
SHARED_EXPONENT = 123


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                            timeout=120)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stderr}")
    return result.stdout


def open_picture(file):
    return contextlib.closing(oiio.ImageInput.open(str(file)))


def shared_exponent(words):
    """Colours of RGB9E5."""
    mantissas = np.stack([words >> shift & 511 for shift in (0, 9, 18)], -1)
    return mantissas * 2.0 ** ((words >> 27).astype(int) - 24)[..., None]


class Textures(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        # Three axes of different lengths, so that none passes for another.
        run(LPVBAKE, "bake", EXAMPLES / "cornell_box.gltf", "--bounds", "-1,0,-1,1,1.4,0.5", "--margin", "1",
            "--resolution", "16", "-o", cls.folder / "volume.vdb", "-o", cls.folder / "full.ktx2",
            "-o", cls.folder / "full.dds")
        for precision in ("half", "rgb9e5", "unorm8", "bc6h"):
            run(LPVBAKE, "convert", cls.folder / "volume.vdb", cls.folder / f"{precision}.ktx2",
                cls.folder / f"{precision}.dds", "--precision", precision)
        cls.facts = json.loads((cls.folder / "full.dds.json").read_text())
        dims = cls.facts["grid"]["dims"]
        cls.grids = {}
        for grid in pyopenvdb.readAllGridMetadata(str(cls.folder / "volume.vdb")):
            is_colour = grid.valueTypeName == "vec3s"
            values = np.zeros((*dims, 3) if is_colour else dims, np.float32)
            pyopenvdb.read(str(cls.folder / "volume.vdb"), grid.name).copyToArray(values)
            values = values.reshape(*dims, 3 if is_colour else 1)
            cls.grids[grid.name] = np.moveaxis(values, (0, 1, 2), (2, 1, 0))
        cls.parser = npm.of_pages(CACHE, "ktx-parse")
        cls.three = npm.three(CACHE)

    def parsed(self, file, raw):
        return json.loads(run("node", pathlib.Path(__file__).with_name("ktx2.mjs"), self.parser, self.three,
                              file, raw))

    def by_ktx_parse(self, file):
        """Texels [z, y, x, channel] and their type."""
        raw = self.folder / "texels"
        facts = self.parsed(file, raw)
        self.assertEqual(facts["keys"], ["KTXwriter", "lpvbake"])
        self.assertEqual(facts["description"]["grid"], self.facts["grid"])
        metadata = {key: value for key, value in facts["description"]["metadata"].items()
                    if not key.startswith("packing_error")}
        wanted = {key: value for key, value in self.facts["metadata"].items()
                  if key != "bake_hash" or file.name.startswith("full")}  # of a bake alone
        self.assertEqual(metadata, wanted)
        self.assertEqual((facts["layerCount"], facts["faceCount"], facts["supercompressionScheme"]),
                         (0, 1, 2))
        size = facts["pixelDepth"], facts["pixelHeight"], facts["pixelWidth"]
        if facts["vkFormat"] == SHARED_EXPONENT:
            return shared_exponent(np.fromfile(raw, np.uint32).reshape(size)), None
        kind, channels = VULKAN[facts["vkFormat"]]
        self.assertEqual(facts["typeSize"], np.dtype(kind).itemsize)
        self.assertEqual(len(facts["descriptor"]["samples"]), channels)
        return np.fromfile(raw, kind).reshape(*size, channels), kind

    def by_ogre(self, file):
        raw = self.folder / "texels"
        *size, name = run(OGRE_DDS, file, raw).split()
        kind, channels = OGRE[name]
        return np.fromfile(raw, kind).reshape(*(int(n) for n in reversed(size)), channels), kind

    def is_equal(self, texels, kind, name):
        """To the rounding of its type, of the largest colour of the cell where they share an
        exponent."""
        grid = self.grids[name]
        if texels.shape[:3] != grid.shape[:3]:
            return False
        off = np.abs(texels[..., :grid.shape[3]].astype(float) - grid)
        if kind is None:
            return bool(np.all(off <= 2.0 ** -9 * np.abs(grid).max(-1, keepdims=True) + 2.0 ** -25))
        return bool(np.all(off <= ROUNDING[kind] * np.abs(grid) + (2.0 ** -25 if kind is np.float16 else 0)))

    def files(self, form, extension):
        for name in self.grids:
            if name != "density":
                yield name, self.folder / f"{form}_{name}{extension}"

    def test_all_cells_are_those_of_the_vdb(self):
        for extension, read in ((".ktx2", self.by_ktx_parse), (".dds", self.by_ogre)):
            for form, wanted in (("full", np.float32), ("half", np.float16)):
                for name, file in self.files(form, extension):
                    texels, kind = read(file)
                    self.assertIs(kind, wanted)
                    self.assertTrue(self.is_equal(texels, kind, name), file)
        texels, kind = self.by_ktx_parse(self.folder / "rgb9e5_sh_l0.ktx2")
        self.assertIsNone(kind)
        self.assertTrue(self.is_equal(texels, kind, "sh_l0"))

    def by_openimageio(self, file):
        """Texels of a 3D texture of blocks, whose slices are a picture one below the other."""
        raw = bytearray(file.read_bytes())
        height, width = np.frombuffer(raw, "<u4", 2, 12)
        depth, = np.frombuffer(raw, "<u4", 1, 24)
        for offset, value in ((8, 0x81007), (12, height * depth), (24, 0), (108, 0x1000), (112, 0), (132, 3)):
            raw[offset:offset + 4] = int(value).to_bytes(4, "little")
        picture = self.folder / "picture.dds"
        picture.write_bytes(raw)
        with open_picture(picture) as source:
            texels = np.array(source.read_image("float"))[..., :3]
        texels = texels.reshape(depth, height, width, 3)
        dims = self.facts["grid"]["dims"]
        return texels[:, :dims[1], :dims[0]]

    def packed_light(self, precision, read):
        """Coefficients of a precision that stores light over its mean, and of each the error that half a
        step makes: by the formula of src/io/README.md."""
        description = self.parsed(self.folder / f"{precision}_sh_l0.ktx2", self.folder / "texels")["description"]
        light, steps = {}, {}
        for entry in description["files"]:
            if "low" not in entry:
                continue
            low, high = np.array(entry["low"]), np.array(entry["high"])
            texels = read(self.folder / entry["file"])[..., :len(low)]
            for c, channel in enumerate(entry["channels"]):
                light[channel], steps[channel] = low[c] + (high[c] - low[c]) * texels[..., c], (high - low)[c] / 255
        base = self.folder / f"{precision}_base.dds"
        over = read(base) if base.exists() else np.stack([light[f"sh_l0.{c}"] for c in "rgb"], -1)
        for channel in light:
            if base.exists() or not channel.startswith("sh_l0."):
                light[channel] = light[channel] * over[..., "rgb".index(channel[-1])]
        return light, steps

    def is_packed(self, light, steps):
        """Whether nearly all light is as near as rounding lets it be; some is clipped."""
        for channel, values in light.items():
            name, colour = channel.split(".")
            grid = self.grids[name][..., "rgb".index(colour)]
            mean = np.abs(self.grids["sh_l0"]).max(-1)
            near = np.abs(values - grid) <= (0.51 * steps[channel] + 2.0 ** -8) * mean
            if values.shape != grid.shape or (near * mean).sum() < 0.99 * mean.sum():
                return False
        return True

    def test_light_over_its_mean_is_that_of_the_vdb(self):
        def read(file):
            texels, kind = self.by_ktx_parse(file)
            return texels / 255 if kind is np.uint8 else texels
        light, steps = self.packed_light("unorm8", read)
        self.assertEqual(len(light), 27)
        self.assertTrue(self.is_packed(light, steps))
        for what, change in (("flipped axis", lambda texels: texels[:, :, ::-1]),
                             ("reversed slices", lambda texels: texels[::-1]),
                             ("swapped colours", lambda texels: texels[..., ::-1])):
            broken, steps = self.packed_light("unorm8", lambda file: change(read(file)))
            self.assertFalse(self.is_packed(broken, steps), what)

    def test_blocks_are_decoded_by_openimageio(self):
        valid = self.grids["validity"][..., 0] > 0
        def error(change):
            light, _ = self.packed_light("bc6h", lambda file: change(self.by_openimageio(file.with_suffix(".dds"))))
            off = total = 0
            for channel, values in light.items():
                name, colour = channel.split(".")
                grid = self.grids[name][..., "rgb".index(colour)]
                off, total = off + np.abs(values - grid)[valid].sum(), total + np.abs(grid)[valid].sum()
            return off / total
        self.assertLess(error(lambda texels: texels), 0.05)  # 16 cells: steep
        for what, change in (("flipped axis", lambda texels: texels[:, :, ::-1]),
                             ("rows upside down", lambda texels: texels[:, ::-1]),
                             ("reversed slices", lambda texels: texels[::-1]),
                             ("swapped colours", lambda texels: texels[..., ::-1])):
            self.assertGreater(error(change), 0.1, what)

    def test_oiiotool_knows_the_blocks_as_volumes(self):
        for name, kind in (("base", "BC6HU"), ("sh_l0", "BC7")):
            told = run("oiiotool", "--info", "-v", self.folder / f"bc6h_{name}.dds")
            width, height, depth = self.facts["grid"]["dims"]
            whole = [-(-side // 4) * 4 for side in (width, height)]
            self.assertRegex(told, rf"{whole[0]} x +{whole[1]} x +{depth}, \d channel, volume")
            self.assertIn(f'compression: "{kind}"', told)
            self.assertIn('textureformat: "Volume Texture"', told)

    def test_broken_texels_are_seen(self):
        for extension, read in ((".ktx2", self.by_ktx_parse), (".dds", self.by_ogre)):
            texels, kind = read(self.folder / f"full_sh_l1_y{extension}")
            for what, broken in (("flipped axis", texels[:, :, ::-1]), ("rows upside down", texels[:, ::-1]),
                                 ("reversed slices", texels[::-1]), ("swapped axes", texels.swapaxes(0, 2)),
                                 ("missing factor", texels / np.pi), ("swapped colours", texels[..., [2, 1, 0, 3]])):
                self.assertFalse(self.is_equal(broken, kind, "sh_l1_y"), what)
            self.assertFalse(self.is_equal(texels, kind, "sh_l1_z"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
