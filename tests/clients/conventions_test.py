#!/usr/bin/env python3
"""What other programs make of the files: the formulas of their shaders, written here from their
mathematics, on what lpvbake wrote of a lattice and a light without symmetry, beside the irradiance
of the canonical volume, which is integrated over directions.

Nothing here is shared with the program or its examples. Every check is also run on readings that
are wrong in one way, and must then fail by far.

Usage: conventions_test.py LPVBAKE CORNELL_BOX
"""

import dataclasses
import functools
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import typing
import unittest

import numpy as np
import OpenImageIO as oiio
import pyopenvdb

PROGRAM, SCENE = sys.argv[1:]

# Largest error of a cell's irradiance, relative to the largest of that cell and colour. Constants
# in shaders have six digits; half has 11 bits, and the terms sum to about twice the result.
TOLERANCE = {"float": 5e-6, "half": 1e-3}
CLEARLY = 100  # a wrong reading errs by this many tolerances

AXES = {  # where each program has glTF's (x, y, z)
    "gltf": lambda x, y, z: (x, y, z),
    "unity": lambda x, y, z: (-x, y, z),
    "unreal": lambda x, y, z: (x, z, y),
    "blender": lambda x, y, z: (x, -z, y),
}
NAMES = ["l0", "l1_y", "l1_z", "l1_x", "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2"]


def turned(axes, vectors):
    return np.stack(AXES[axes](*np.moveaxis(vectors, -1, 0)), axis=-1)


# ---- the canonical volume: irradiance by integration ----


def basis(d):
    """Polynomials whose spans are the bands' harmonics, in canonical order; normalised below."""
    x, y, z = np.moveaxis(d, -1, 0)
    return np.stack([np.ones_like(x), y, z, x,
                     x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], -1)


def hemisphere(cosines):
    """Directions around +z with the cosines, and their weights for a sum over solid angle: exact
    for the polynomials here."""
    nodes, weights = cosines
    turns = np.arange(16) * (np.pi / 8)
    sines = np.sqrt(1 - nodes * nodes)
    d = np.stack([np.outer(sines, np.cos(turns)), np.outer(sines, np.sin(turns)),
                  np.outer(nodes, np.ones(16))], -1)
    return d.reshape(-1, 3), np.repeat(weights, 16) * (np.pi / 8)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


@functools.cache
def norms():
    d, weights = hemisphere((NODES, WEIGHTS))  # cosines from -1 to 1: all directions
    return np.sqrt(weights @ basis(d) ** 2)


def irradiance(sh, normals):
    """[k, cell, rgb] nits and [n, 3] -> [cell, n, rgb] lux: the integral of luminance times the
    cosine over the hemisphere of each normal."""
    local, weights = hemisphere((0.5 + 0.5 * NODES, 0.5 * WEIGHTS))
    other = np.where(np.abs(normals[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(normals, other)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    frame = np.stack([u, np.cross(normals, u), normals], 1)  # [n, axis, 3]
    d = np.einsum("qa,nac->nqc", local, frame)
    transfer = np.einsum("q,nqk->nk", weights * local[:, 2], basis(d) / norms())
    return np.einsum("nk,kcj->cnj", transfer[:, :len(sh)], sh)


# ---- readers: points in the program's axes -> [k, cell, rgb], as stored ----


def read_grids(path, points, names):
    """Through each grid's own transform; an index is a cell's centre, or its corner where the file
    says so."""
    shift = {"center": 0.0, "corner": 0.5}[pyopenvdb.readMetadata(str(path))["lpv:index_position"]]
    values = []
    for name in names:
        grid = pyopenvdb.read(str(path), name)
        accessor = grid.getConstAccessor()
        at = np.array([grid.transform.worldToIndex(tuple(p)) for p in points]) - shift
        cells = np.rint(at).astype(int)
        if np.abs(at - cells).max() > 1e-4:
            raise AssertionError(f"{path}: {name}: cells are elsewhere")
        values.append([accessor.getValue(tuple(cell)) for cell in cells.tolist()])
    return np.array(values, float)


def read_vdb(path, points):
    order = pyopenvdb.readMetadata(str(path))["lpv:sh_order"]
    return read_grids(path, points, ["sh_" + name for name in NAMES[:(order + 1) ** 2]])


def picture(path, channels):
    image = oiio.ImageInput.open(str(path))
    if tuple(image.spec().channelnames) != channels:
        raise AssertionError(f"{path}: {image.spec().channelnames}")
    return np.array(image.read_image("float"), float).reshape(
        image.spec().height, image.spec().width, len(channels))


RGB, RGBA = ("R", "G", "B"), ("R", "G", "B", "A")


def slices(pixels, columns, rows, down_first=False):
    """Flipbook -> texture [z, y, x, channel]: left to right, then down."""
    height, width, channels = pixels.shape
    tiles = pixels.reshape(rows, height // rows, columns, width // columns, channels)
    tiles = tiles.transpose((2, 0, 1, 3, 4) if down_first else (0, 2, 1, 3, 4))
    return tiles.reshape(rows * columns, height // rows, width // columns, channels)


def sample(texture, uvw):
    """What a sampler gives, linear and clamped: texel i has its centre at (i + 0.5) / n."""
    size = np.array(texture.shape[2::-1])
    at = np.clip(uvw * size - 0.5, 0, size - 1)
    low = np.floor(at).astype(int)
    share = at - low
    result = 0
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.minimum(low + corner, size - 1).T
        weight = np.prod(np.where(corner, share, 1 - share), axis=1)
        result = result + weight[:, None] * texture[z, y, x]
    return result


def sidecar(path):
    """-> (columns, rows), least corner, edges of the lattice."""
    facts = json.loads(path.with_suffix(".json").read_text())
    layout, grid = facts["layout"], facts["grid"]
    size = np.array(grid["dims"]) * grid["cell"]
    return (layout["columns"], layout["rows"]), np.array(grid["origin"]), size


def read_pictures(path, points, names, down_first=False):
    layout, origin, size = sidecar(path)
    return np.stack([sample(slices(picture(f"{path.with_suffix('')}_{name}.exr", RGB), *layout,
                                   down_first), (points - origin) / size) for name in names])


def read_bands(path, points, down_first=False):
    found = ["sh_" + name for name in NAMES
             if path.with_name(f"{path.stem}_sh_{name}.exr").exists()]
    return read_pictures(path, points, found, down_first)


def read_channels(load, order):
    """Of load(suffix, channels) -> [cell, channel], for RGBA files `order` of the first four."""
    first = np.stack([load(colour, RGBA) for colour in "rgb"], -1)  # [cell, channel, rgb]
    second = np.stack([load(colour + "2", RGBA) for colour in "rgb"], -1)
    last = load("sh_l2_x2y2", RGB)[:, None]
    return np.concatenate([first[:, order], second, last], 1).transpose(1, 0, 2)


def read_unity(path, points, down_first=False):
    """As the importer's settings have it. Rows of textures count from below; that, and the order of
    tiles, are what the notes call unproven."""
    notes = json.loads(path.with_suffix(".unity.json").read_text())
    layout = [notes["importer"]["flipbook" + side] for side in ("Columns", "Rows")]
    low, high = (np.array(notes["volume"][side]) for side in ("min", "max"))
    uvw = (points - low) / (high - low)
    uvw[:, 1] = 1 - uvw[:, 1]

    def load(suffix, channels):
        texture = slices(picture(f"{path.with_suffix('')}_{suffix}.exr", channels), *layout,
                         down_first)
        return sample(texture[:, ::-1], uvw)

    if (path.with_name(path.stem + "_0.exr")).exists():
        return load  # VRC Light Volumes
    return read_channels(load, [3, 1, 2, 0])


def read_unreal(path, points, down_first=False):
    """UVolumeTexture::UpdateSourceFromSourceTexture of VolumeTexture.cpp, Unreal Engine 5.8: tile
    t is the one in column t % columns and row t / columns."""
    notes = json.loads(path.with_suffix(".unreal.json").read_text())
    tile = [notes["volume_texture"]["Source 2D Tile Size " + side] for side in "XY"]
    low, high = (np.array(notes["volume"][side]) for side in ("min", "max"))  # centimetres
    uvw = (100 * points - low) / (high - low)

    def load(suffix, channels):
        pixels = picture(f"{path.with_suffix('')}_{suffix}.exr", channels)
        layout = pixels.shape[1] // tile[0], pixels.shape[0] // tile[1]
        return sample(slices(pixels, *layout, down_first), uvw)

    return read_channels(load, [0, 1, 2, 3])


def read_godot(path, points, down_first=False):
    """Tiles as resource_importer_layered_texture.cpp takes them: rows, and columns in each."""
    _, origin, size = sidecar(path)

    def load(suffix, channels):
        name = f"{path.with_suffix('')}_{suffix}.exr"
        settings = pathlib.Path(name + ".import").read_text()
        layout = [int(re.search(f"slices/{way}=(\\d+)", settings)[1])
                  for way in ("horizontal", "vertical")]
        return sample(slices(picture(name, channels), *layout, down_first),
                      (points - origin) / size)

    return read_channels(load, [0, 1, 2, 3])


def read_vrc(path, points, down_first=False):
    """LV_SampleLightVolumeTex of LightVolumes.cginc, REDSIM/VRCLightVolumes 3cefcb7: the first
    coefficient, and vectors (x, y, z) of each colour."""
    load = read_unity(path, points, down_first)
    a, b, c = (load(str(i), RGBA) for i in range(3))
    x, y, z = b[:, :3], c[:, :3], np.stack([a[:, 3], b[:, 3], c[:, 3]], -1)
    return np.stack([a[:, :3], y, z, x])


def read_atlas(path, points, down_first=False):
    """getLightProbeGridIrradiance of lightprobes_pars_fragment.glsl.js, three.js r187 (f292d02)."""
    layout, origin, size = sidecar(path)
    grid = json.loads(path.with_suffix(".json").read_text())["grid"]
    dims, cell = np.array(grid["dims"]), grid["cell"]
    low, high = origin + 0.5 * cell, origin + size - 0.5 * cell  # of the probes
    inside = np.clip((points - low) / (high - low), 0, 1)
    uvw = inside * (dims - 1) / dims + 0.5 / dims
    pixels = picture(f"{path.with_suffix('')}_atlas.exr", RGBA)
    texture = slices(pixels, *layout, down_first)[:7 * (dims[2] + 2)]
    depth = uvw[:, 2] * dims[2] + 1
    numbers = []
    for block in range(7):
        uvw[:, 2] = (depth + block * (dims[2] + 2)) / (7 * (dims[2] + 2))
        numbers.append(sample(texture, uvw))
    numbers = np.concatenate(numbers, 1)[:, :27]
    return numbers.reshape(-1, 9, 3).transpose(1, 0, 2)


def read_cube(path, points, down_first=False):
    """irradiance_volume_light of irradiance_volume.wgsl, bevyengine/bevy 394a060: sides +x, -x, +y,
    ..., of one texture, as light_from_world maps the volume to a unit cube around the origin."""
    layout, origin, size = sidecar(path)
    texture = slices(picture(f"{path.with_suffix('')}_cube.exr", RGB), *layout, down_first)
    atlas = np.array(texture.shape[2::-1])
    resolution = atlas // [1, 2, 3]
    texture = texture[:3 * resolution[2]]
    atlas[2] = len(texture)
    unit = (points - origin) / size - 0.5
    uvw = np.clip((unit + 0.5) * resolution, 0.5, resolution - 0.5) / atlas
    return np.stack([sample(texture, uvw + [0, 0.5 * side, axis / 3])
                     for axis in range(3) for side in range(2)])


# ---- formulas: stored [k, cell, rgb] and normals [n, 3] -> luminance [cell, n, rgb] of a white
# Lambert surface, which is irradiance over pi ----


def summed(weights, stored):
    return np.einsum("nk,kcj->cnj", np.stack(weights, -1)[:, :len(stored)], stored)


def ones(n):
    return np.ones(len(n))


def shade_radiance(c, n):
    """getLightProbeIrradiance and getLightProbeGridIrradiance, three.js r187 (f292d02)."""
    x, y, z = n.T
    a, b = 2 * 0.511664, 2 * 0.429043
    return summed([0.886227 * ones(n), a * y, a * z, a * x, b * x * y, b * y * z,
                   0.743125 * z * z - 0.247708, b * x * z, 0.429043 * (x * x - y * y)], c) / np.pi


def shade_irradiance(c, n):
    """A sum over the basis."""
    x, y, z = n.T
    return summed([0.282095 * ones(n), 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y,
                   1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z,
                   0.546274 * (x * x - y * y)], c) / np.pi


def shade_lpv(c, n):
    """Light's travel: the normal's opposite, with the signs of Kirsch, Light Propagation Volumes -
    Annotations (2010)."""
    x, y, z = -n.T
    return np.maximum(0, summed([0.282095 * ones(n), -0.488603 * y, 0.488603 * z, -0.488603 * x],
                                c)) / np.pi


def shade_godot(c, n):
    """Lightmap captures of scene_forward_clustered.glsl, godotengine/godot 333f0f9: what they give
    is multiplied by the albedo alone."""
    x, y, z = n.T
    return summed([0.886227 * ones(n), 1.023327 * y, 1.023327 * z, 1.023327 * x, 0.858086 * x * y,
                   0.858086 * y * z, 0.247708 * (3 * z * z - 1), 0.858086 * x * z,
                   0.429043 * (x * x - y * y)], c)


def shade_unity(c, n):
    """ShadeSH9 of UnityCG.cginc (TwoTailsGames/Unity-Built-in-Shaders 5e149d0): SHEvalLinearL0L1
    and SHEvalLinearL2."""
    x, y, z = n.T
    return summed([ones(n), y, z, x, x * y, y * z, z * z, z * x, x * x - y * y], c)


def shade_unreal(c, n):
    """SHBasisFunction3, CalcDiffuseTransferSH3 with exponent 1 and DotSH3 of SHCommon.ush, over pi
    as in BasePassPixelShader.usf; Unreal Engine 4.22 (folgerwang/UnrealEngine 2b46ba7)."""
    x, y, z = n.T
    e = 1
    bands = np.pi * np.array([2 / (1 + e), 2 / (2 + e), e * 2 / (3 + 4 * e + e * e)])
    first, second = 0.488603 * bands[1], 1.092548 * bands[2]
    return np.maximum(0, summed(
        [0.282095 * bands[0] * ones(n), -first * y, first * z, -first * x, second * x * y,
         -second * y * z, 0.315392 * bands[2] * (3 * z * z - 1), -second * x * z,
         0.546274 * bands[2] * (x * x - y * y)], c)) / np.pi


def shade_vrc(c, n):
    """L0 + dot(L1, n) of LightVolumes.cginc, of each colour."""
    x, y, z = n.T
    return summed([ones(n), y, z, x], c)


def shade_cube(sides, n):
    """Squares of the normal's parts times the side that each looks to (McTaggart, Half-Life 2 /
    Valve Source Shading, 2004)."""
    return np.einsum("ns,scj->cnj", np.stack(
        [(n[:, axis] < 0 if side else n[:, axis] >= 0) * n[:, axis] ** 2
         for axis in range(3) for side in range(2)], -1), sides)


# ---- programs ----


@dataclasses.dataclass
class Client:
    kind: str
    options: typing.List[str]
    read: typing.Callable
    shade: typing.Callable
    axes: str = "gltf"
    order: int = 2
    suffix: str = ".exr"
    precision: str = "half"


SHADES = {"radiance": shade_radiance, "irradiance": shade_irradiance, "lpv": shade_lpv,
          "godot": shade_godot, "unity": shade_unity, "unreal": shade_unreal}


def conventions():
    for convention, shade in SHADES.items():
        order = 1 if convention == "lpv" else 2
        for axes in AXES:
            for precision in TOLERANCE:
                for suffix, read in ((".vdb", read_vdb), (".exr", read_bands)):
                    yield Client(convention, ["--sh-convention", convention, "--axes", axes,
                                              "--sh-order", order],
                                 read, shade, axes, order, suffix, precision)


def targets():
    rows = [("unity", read_unity, shade_unity, "unity", 2),
            ("unreal", read_unreal, shade_unreal, "unreal", 2),
            ("godot", read_godot, shade_godot, "gltf", 2),
            ("threejs", read_atlas, shade_radiance, "gltf", 2),
            ("vrc", read_vrc, shade_vrc, "unity", 1),
            ("bevy", read_cube, shade_cube, "gltf", 2)]
    for name, read, shade, axes, order in rows:
        for precision in TOLERANCE:
            yield Client(f"target {name}", ["--target", name, "--dering", "off", "--fit", "none"], read, shade, axes, order,
                         precision=precision)
    yield Client("target blender", ["--target", "blender"], read_vdb, shade_radiance,
                 "blender", suffix=".vdb", precision="float")


class Conventions(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.right, cls.wrong = {}, {}
        # A part of the box, 7 x 4 x 6 cells: no side is like another, nor any two walls.
        cls.source = cls.folder / "canonical.vdb"
        cls.run_program("bake", SCENE, "-o", cls.source, "--bounds=-0.9,0.1,-0.9,0.7,0.95,0.45",
                        "--resolution", 7, "--margin", 0, "--sh-order", 2)
        facts = pyopenvdb.readMetadata(str(cls.source))
        cls.dims, cls.cell = facts["lpv:grid_dims"], facts["lpv:cell_size"]
        if len(set(cls.dims)) < 3 or min(cls.dims) < 4:
            raise AssertionError(f"{cls.dims}: two axes are alike")
        cells = np.array(list(np.ndindex(*cls.dims)))
        cls.centres = np.array(facts["lpv:grid_origin"]) + (cells + 0.5) * cls.cell
        cls.sh = read_vdb(cls.source, cls.centres)
        valid = pyopenvdb.read(str(cls.source), "validity").getConstAccessor()
        # Targets fill the others from their neighbours.
        cls.valid = np.array([valid.getValue(tuple(cell)) for cell in cells.tolist()]) > 0
        random = np.random.default_rng(4)
        normals = random.normal(size=(60, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        cls.normals = np.concatenate([np.eye(3), -np.eye(3), normals])
        cls.wanted = {order: irradiance(cls.sh[:(order + 1) ** 2], cls.normals) / np.pi
                      for order in (1, 2)}

    @classmethod
    def tearDownClass(cls):
        for title, sign, errors in (("largest error", "<", cls.right),
                                    ("smallest error of a wrong reading", ">", cls.wrong)):
            print(title)
            for (name, tolerance), error in errors.items():
                print(f"  {name:34} {error:8.1e} {sign} {tolerance:.0e}")

    @staticmethod
    def run_program(*arguments):
        command = [PROGRAM] + [str(argument) for argument in arguments]
        result = subprocess.run(command, capture_output=True, text=True)
        if result.returncode != 0:
            raise AssertionError(f"{command} ended with {result.returncode}\n{result.stderr}")

    @classmethod
    @functools.cache
    def written(cls, options, precision):
        """The picture's name; the .vdb is beside it."""
        path = cls.folder / re.sub(r"\W+", "_", f"{options} {precision}") / "volume.exr"
        path.parent.mkdir()
        cls.run_program("convert", cls.source, path, path.with_suffix(".vdb"), *options,
                         "--precision", precision)
        return path

    def path_of(self, client):
        path = self.written(tuple(client.options), client.precision)
        return path.with_suffix(client.suffix)

    def error_of(self, client, *, mirror=None, plain_normals=False, scramble=None, **reading):
        """Largest error over valid cells and all normals. What may be wrong in a reading: the axis
        along which the lattice is mirrored; normals that stay glTF's; what coefficients become."""
        points = self.centres.copy()
        if mirror is not None:
            along = points[:, mirror]
            points[:, mirror] = along.min() + along.max() - along
        stored = client.read(self.path_of(client), turned(client.axes, points), **reading)
        if scramble:
            stored = scramble(stored)
        normals = turned("gltf" if plain_normals else client.axes, self.normals)
        wanted = self.wanted[client.order]
        if client.shade is shade_cube:
            sides = self.wanted[2][:, [0, 3, 1, 4, 2, 5]].transpose(1, 0, 2)
            wanted = shade_cube(np.maximum(0, sides), self.normals)
        return self.relative(client.shade(stored, normals), wanted)[self.valid].max()

    @staticmethod
    def relative(got, wanted):
        """Some shaders clamp what is negative, so all are."""
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        difference = np.abs(np.maximum(0, got) - np.maximum(0, wanted))
        return np.divide(difference, scale, out=np.zeros_like(difference), where=scale > 0)

    def expect_right(self, client):
        error, tolerance = self.error_of(client), TOLERANCE[client.precision]
        key = f"{client.kind} {client.precision}", tolerance
        self.right[key] = max(self.right.get(key, 0), error)
        self.assertLess(error, tolerance, client)

    def expect_wrong(self, client, what, **wrong):
        error, tolerance = self.error_of(client, **wrong), TOLERANCE[client.precision]
        key = what, tolerance
        self.wrong[key] = min(self.wrong.get(key, np.inf), error)
        self.assertGreater(error, CLEARLY * tolerance, (what, client))

    def test_conventions(self):
        for client in conventions():
            self.expect_right(client)

    def test_targets(self):
        for client in targets():
            self.expect_right(client)

    def test_wrong_readings_are_seen(self):
        """Of all programs, and of each convention in one kind of file."""
        def swap(a, b):
            def apply(stored):
                stored[[a, b]] = stored[[b, a]]
                return stored
            return apply

        def negate(first, last):
            def apply(stored):
                stored[first:last] *= -1
                return stored
            return apply

        clients = [client for client in targets() if client.precision == "half"]
        clients += [client for client in conventions()
                    if (client.axes, client.suffix, client.precision)
                    == ("unreal", ".vdb", "float")]
        for client in clients:
            for axis in range(3):
                self.expect_wrong(client, f"lattice flipped along {'xyz'[axis]}", mirror=axis)
            if client.axes != "gltf":
                self.expect_wrong(client, "coefficients not turned", plain_normals=True)
            if client.suffix == ".exr":
                self.expect_wrong(client, "slices down first", down_first=True)
            self.expect_wrong(client, "pi forgotten", scramble=lambda stored: stored * np.pi)
            if client.shade is shade_cube:
                self.expect_wrong(client, "sides +x and -x swapped", scramble=swap(0, 1))
                self.expect_wrong(client, "sides x and y swapped", scramble=swap(0, 2))
                continue
            self.expect_wrong(client, "y and x swapped", scramble=swap(1, 3))
            self.expect_wrong(client, "band 1 negated", scramble=negate(1, 4))
            if client.order == 2:
                self.expect_wrong(client, "xy and yz swapped", scramble=swap(4, 5))
                self.expect_wrong(client, "yz and xz swapped", scramble=swap(5, 7))
                self.expect_wrong(client, "band 2 negated", scramble=negate(4, 9))

    def test_files_of_another_convention_are_seen(self):
        """What each formula makes of a file that was written for another one."""
        for convention, shade in SHADES.items():
            for other in SHADES:
                order = 1 if "lpv" in (convention, other) else 2
                if other == convention:
                    continue
                client = Client(convention, ["--sh-convention", other, "--axes", "gltf",
                                             "--sh-order", order],
                                read_vdb, shade, order=order, suffix=".vdb", precision="float")
                self.expect_wrong(client, f"{other} read as another")

    def test_axes_of_another_program_are_seen(self):
        for axes in AXES:
            if axes != "gltf":
                client = Client("radiance", ["--sh-convention", "radiance", "--axes", "gltf",
                                             "--sh-order", 2],
                                read_vdb, shade_radiance, axes, suffix=".vdb", precision="float")
                with self.assertRaisesRegex(AssertionError, "cells are elsewhere"):
                    self.error_of(client)

    def test_walls_turn_with_the_axes(self):
        names = [f"wall_{k}" for k in range(3)]
        walls = read_grids(self.source, self.centres, names)
        self.assertGreater((np.abs(walls[0]).min(axis=1) > 0).sum(), 0)  # some are slanted
        for axes in AXES:
            path = self.written(("--sh-convention", "radiance", "--axes", axes, "--sh-order", 2),
                                "float")
            points = turned(axes, self.centres)
            for found in (read_grids(path.with_suffix(".vdb"), points, names),
                          read_pictures(path, points, names)):
                self.assertLess(np.abs(found - turned(axes, walls)).max(), 1e-5, axes)
                if axes != "gltf":
                    self.assertGreater(np.abs(found - walls).max(), 0.1, axes)

    def test_between_cells_textures_interpolate(self):
        """Also beside the outermost slices of an atlas's blocks, without light of the next."""
        self.run_program("convert", self.source, self.folder / "filled.vdb", "--dilate", 2)
        filled = read_vdb(self.folder / "filled.vdb", self.centres)
        random = np.random.default_rng(5)
        low, high = self.centres.min(axis=0), self.centres.max(axis=0)
        points = low + random.uniform(0, 1, (300, 3)) * (high - low)
        points[:100, 2] = np.where(random.uniform(size=100) < 0.5, low[2], high[2])
        # Hat functions of distance, of all cells.
        weights = np.prod(np.maximum(
            0, 1 - np.abs(points[:, None] - self.centres[None]) / self.cell), axis=2)
        wanted = irradiance(np.einsum("pc,kcj->kpj", weights, filled), self.normals) / np.pi
        for name, read, shade in (("threejs", read_atlas, shade_radiance),
                                  ("godot", read_godot, shade_godot)):
            path = self.written(("--target", name, "--dering", "off", "--fit", "none"), "float")
            error = self.relative(shade(read(path, points), self.normals), wanted).max()
            self.right[f"target {name} between cells", TOLERANCE["float"]] = error
            self.assertLess(error, TOLERANCE["float"], name)


def rotation(turn):
    """Columns: where a quaternion x, y, z, w takes the axes."""
    x, y, z, w = turn
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


class Volumes(unittest.TestCase):
    """Volumes beside each other, one of them turned, through their manifests."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        (cls.folder / "boxes.json").write_text(json.dumps({"volumes": [
            {"name": "turned", "box": [-0.5, 0.2, -0.5, 0.3, 0.9, 0.4], "cell": 0.16, "priority": 3,
             "falloff": 0.1, "rotation": [0.1, 0.3, -0.2, 0.92736185]},
            {"name": "above", "box": [-0.8, 1.3, -0.8, 0.8, 1.9, 0.4], "cell": 0.2, "falloff": 0.3}]}))
        Conventions.run_program("bake", SCENE, "-o", cls.folder / "all.vdb", "--sh-order", 2,
                                "--volumes", cls.folder / "boxes.json")
        random = np.random.default_rng(5)
        cls.normals = random.normal(size=(40, 3))
        cls.normals /= np.linalg.norm(cls.normals, axis=1, keepdims=True)

    def volumes_of(self, name):
        manifest = json.loads((self.folder / f"{name}.volumes.json").read_text())
        return {volume["name"]: volume for volume in manifest["volumes"]}

    @staticmethod
    def local(volume, points, turn=None):
        """Cells from the first corner."""
        axes = rotation(volume["turn"] if turn is None else turn)
        return (points - volume["origin"]) @ axes / volume["cell"]

    def test_each_program_reads_all_of_a_manifest(self):
        own = self.volumes_of("all")
        self.assertEqual(list(own), ["turned", "above"], "by priority")
        for target, axes, order, read, shade in (("vrc", "unity", 1, read_vrc, shade_vrc),
                                                 ("bevy", "gltf", 2, read_cube, shade_cube)):
            Conventions.run_program("convert", self.folder / "all.volumes.json", self.folder / f"{target}.exr",
                                    "--target", target, "--fit", "none", "--dering", "off")
            for name, volume in self.volumes_of(target).items():
                cells = np.array(list(np.ndindex(*own[name]["dims"])))
                centres = (np.array(own[name]["origin"])
                           + own[name]["cell"] * (cells + 0.5) @ rotation(own[name]["turn"]).T)
                # Through the map of the .vdb, whose cells these have to be.
                sh = read_vdb(self.folder / own[name]["file"], centres)
                valid = pyopenvdb.read(str(self.folder / own[name]["file"]), "validity").getConstAccessor()
                valid = np.array([valid.getValue(tuple(cell)) for cell in cells.tolist()]) > 0
                there = turned(axes, centres)
                at = self.local(volume, there)
                np.testing.assert_allclose(at % 1, 0.5, atol=1e-6, err_msg=f"{target} {name}")
                self.assertTrue(np.all((at > 0) & (at < volume["dims"])))
                stored = read(self.folder / volume["file"], np.array(volume["origin"]) + volume["cell"] * at)
                got = shade(stored, turned(axes, self.normals))
                if shade is shade_cube:
                    sides = irradiance(sh, np.concatenate([np.eye(3), -np.eye(3)]))[:, [0, 3, 1, 4, 2, 5]]
                    wanted = shade_cube(np.maximum(0, sides.transpose(1, 0, 2)) / np.pi, self.normals)
                else:
                    wanted = irradiance(sh[:(order + 1) ** 2], self.normals) / np.pi
                self.assertLess(Conventions.relative(got, wanted)[valid].max(), 2e-3, f"{target} {name}")
                # Of a mirrored world or a lattice that is not turned they would be elsewhere.
                if name == "turned":
                    off = self.local(volume, there, (0, 0, 0, 1)) % 1
                    self.assertGreater(np.abs(off - 0.5).max(), 0.2)

    def test_words_of_programs_say_the_same(self):
        for volume in self.volumes_of("all").values():
            size = volume["cell"] * np.array(volume["dims"])
            # LV_BoundsMask: 1 from Smooth Blending metres inside of all faces.
            self.assertEqual(volume["vrc"], {"weight": volume["priority"], "smooth_blending": volume["falloff"]})
            # LightProbe::falloff: of half the box along each axis.
            np.testing.assert_allclose(np.array(volume["bevy"]["falloff"]) * size / 2, volume["falloff"], rtol=1e-9)
            self.assertEqual(volume["threejs"], {"priority": volume["priority"]})

    def test_bevy_has_the_turn(self):
        Conventions.run_program("convert", self.folder / "all_turned.vdb", self.folder / "one.ktx2",
                                "--target", "bevy", "--fit", "none")
        volume = self.volumes_of("all")["turned"]
        transform = json.loads((self.folder / "one.bevy.json").read_text())["Transform"]
        corner = (np.array(transform["translation"])
                  - rotation(transform["rotation"]) @ (0.5 * np.array(transform["scale"])))
        np.testing.assert_allclose(corner, volume["origin"], atol=1e-9)
        scene = (self.folder / "one.scn.ron").read_text()
        found = re.search(r"rotation: \(([^)]*)\)", scene)[1]
        np.testing.assert_allclose([float(x) for x in found.split(",")], volume["turn"], atol=1e-7)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
