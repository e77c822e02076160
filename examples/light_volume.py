"""A light volume as numpy arrays: where its cells are, and the irradiance that it gives a surface.

load_vdb.py and load_exr.py make one of a file, and LightLevels, LightBricks or LightPlaces of a manifest.
"""

import json
import os
import sys
from dataclasses import dataclass, field

import numpy as np

# Bands 0 to 2; what a file has beyond is left out.
NAMES = ["l0", "l1_y", "l1_z", "l1_x", "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2"]
CORNERS = np.array([(i & 1, i >> 1 & 1, i >> 2 & 1) for i in range(8)])


@dataclass
class LightVolume:
    sh: np.ndarray        # [coefficient, x, y, z, rgb]: luminance arriving, nits; order as NAMES
    validity: np.ndarray  # [x, y, z]: 1 outside geometry, else 0
    walls: np.ndarray     # [wall, x, y, z, axis]: way from the centre to a plane, in cells; or 0
    origin: np.ndarray    # corner of the first cell, metres
    cell: float           # edge of a cell, metres
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))  # columns: the lattice's, in the world's

    def to_lattice(self, point):
        """Metres to cells: cell (i, j, k) has its centre at (i, j, k)."""
        return (np.asarray(point, float) - self.origin) @ self.axes / self.cell - 0.5

    def depth(self, point):
        """Metres inside the nearest face of the cells; below 0: outside."""
        at = self.to_lattice(point) + 0.5
        inside = self.cell * np.minimum(at, np.array(self.validity.shape) - at)
        return inside.min() if inside.min() >= 0 else -np.linalg.norm(np.minimum(inside, 0))

    def hull(self):
        """The first and the last cell's centre."""
        first = self.origin + 0.5 * self.cell
        return first, first + self.cell * (np.array(self.validity.shape) - 1)

    def weights(self, point, normal):
        """The eight cells around a point (clamped to the lattice) and their weights: trilinear, of
        valid cells, times max(0, n.d)^2 for the direction d to the cell's centre from 0.1 cells
        below the point, so that cells behind the surface do not count, times 0 behind the cell's walls to 1 from 0.2 cells before
        them. Where no cell is left, without walls, then without the direction. (The library looks
        at cells farther off, too.) The last result is False where the walls or the direction hide all."""
        dims = np.array(self.validity.shape)
        at = self.to_lattice(point)
        normal = np.asarray(normal, float) @ self.axes
        clamped = np.clip(at, 0, dims - 1)
        low = np.minimum(clamped.astype(int), np.maximum(dims - 2, 0))
        cells = np.minimum(low + CORNERS, dims - 1)
        share = clamped - low
        valid = np.prod(np.where(CORNERS, share, 1 - share), axis=1)
        valid = valid * (self.validity[tuple(cells.T)] > 0)
        way = cells - at
        below = way + 0.1 * normal
        square, along = np.sum(below * below, axis=1), np.maximum(0, below @ normal)
        facing = valid * np.divide(along * along, square, out=np.ones(8), where=square > 0)
        clear = facing * np.prod(self.before_walls(cells, 0.2 * normal - way), axis=0)
        for weights in (clear, facing, valid):
            if weights.sum() > 0:
                return cells, weights / weights.sum(), weights is clear
        return cells, np.zeros(8), False

    def before_walls(self, cells, x):
        """[wall, cell] of these cells, for a point that lies at x from their centres, in cells."""
        i, j, k = cells.T
        w = self.walls[:, i, j, k]
        square = np.sum(w * w, axis=2)
        before = (square - np.sum(w * x, axis=2)) / (0.2 * np.sqrt(np.maximum(square, 1e-30)))
        return np.where(square > 0, np.clip(before, 0, 1), 1)

    def read(self, point, normal):
        """Irradiance, and whether it is of cells that the point sees."""
        normal = np.asarray(normal, float) / np.linalg.norm(normal)
        cells, weights, clear = self.weights(point, normal)
        x, y, z = cells.T
        coefficients = np.einsum("w,kwc->kc", weights, self.sh[:, x, y, z])
        return np.maximum(0, cosine_basis(normal)[: len(self.sh)] @ coefficients), clear

    def irradiance(self, point, normal):
        """Lux (RGB) on a surface with this normal; times albedo / pi it is luminance in nits."""
        return self.read(point, normal)[0]


def blended(volumes, point, normal):
    """The irradiance of volumes, each with a share of what those before it leave; of those that the
    point sees, or else of the first."""
    total, left, fallback = 0.0, 1.0, None
    light = np.zeros(3)
    for share, volume in volumes:
        if share == 0 or left == 0:
            continue
        value, clear = volume.read(point, normal)
        fallback = value if fallback is None else fallback
        if clear:
            light += left * share * value
            total += left * share
            left *= 1 - share
    return light / total if total > 0 else fallback


@dataclass
class LightLevels:
    levels: list        # of LightVolume, finest first
    blend: float = 1.0  # cells of the next level over which a level fades in

    @staticmethod
    def load(path, load):
        """Of NAME.levels.json, each file of it by `load`."""
        with open(path, encoding="utf-8") as file:
            manifest = json.load(file)
        if manifest["format"] == "lpvbake bricks":
            return LightBricks.load(path, manifest, load)
        folder = os.path.dirname(path)
        return LightLevels([load(os.path.join(folder, level["file"])) for level in manifest["levels"]],
                           manifest["blend"])

    def share(self, level, point):
        """What a level weighs against the coarser ones: 0 at the faces of its hull, but for those
        that it has in common with the outermost level, to 1 `blend` cells of the next inside."""
        if level + 1 == len(self.levels):
            return 1.0
        own = self.levels[level]
        (lo, hi), (first, last) = own.hull(), self.levels[-1].hull()
        slack = 1e-6 * own.cell
        inside = min(np.min(np.where(lo > first + slack, point - lo, np.inf)),
                     np.min(np.where(hi < last - slack, hi - point, np.inf)))
        t = np.clip(inside / (self.blend * self.levels[level + 1].cell), 0, 1)
        return t * t * (3 - 2 * t)

    def irradiance(self, point, normal):
        """Of the levels around a point, each by its share of what finer ones leave; one that sees
        no cell there does not count, unless none does."""
        shares = (self.share(level, np.asarray(point, float)) for level in range(len(self.levels)))
        return blended(zip(shares, self.levels), point, normal)


@dataclass
class LightPlaces:
    levels: list   # of LightVolume, by falling priority
    falloff: list  # of each, metres

    @staticmethod
    def load(path, load):
        """Of NAME.volumes.json, each file of it by `load`."""
        with open(path, encoding="utf-8") as file:
            volumes = json.load(file)["volumes"]
        folder = os.path.dirname(path)
        return LightPlaces([load(os.path.join(folder, volume["file"])) for volume in volumes],
                           [volume["falloff"] for volume in volumes])

    def irradiance(self, point, normal):
        """Of the volumes around a point, each by what those before it leave: 0 at its faces to all
        its falloff inside; where there is none that of the nearest."""
        depths = [volume.depth(point) for volume in self.levels]
        shares = [np.clip(depth / max(falloff, 1e-300), 0, 1) for depth, falloff in zip(depths, self.falloff)]
        if max(shares) == 0:
            return self.levels[int(np.argmax(depths))].irradiance(point, normal)
        shares = [t * t * (3 - 2 * t) for t in shares]
        return blended(zip(shares, self.levels), point, normal)


@dataclass
class LightBricks:
    bricks: dict  # LightVolume of 9 x 9 x 9 samples by (level, i, j, k), level 0 the finest
    lo: np.ndarray  # the first sample, metres
    hi: np.ndarray  # the last
    edge: float     # of a brick of level 0, metres

    @staticmethod
    def load(path, manifest, load):
        """Of NAME.levels.json; load(path, firsts) are the bricks whose first samples these are."""
        folder, levels = os.path.dirname(path), manifest["levels"]
        keys = [(level, *place) for level, of in enumerate(levels)
                for place in np.reshape(of["bricks"], (-1, 3)).tolist()]
        if "atlas" in manifest:  # all bricks beside each other, x fastest
            nx, ny, _ = manifest["atlas"]["slots"]
            firsts = [(9 * (n % nx), 9 * (n // nx % ny), 9 * (n // (nx * ny))) for n in range(len(keys))]
            volumes = load(os.path.join(folder, manifest["atlas"]["file"]), firsts)
        else:
            volumes = []
            for level, of in enumerate(levels):
                firsts = [tuple(8 * i for i in place) for l, *place in keys if l == level]
                volumes += load(os.path.join(folder, of["file"]), firsts)
        lo, cell = np.array(levels[0]["box"][:3]), levels[0]["cell"]
        for (level, *place), volume in zip(keys, volumes):
            volume.cell = cell * 2 ** level
            volume.origin = lo + volume.cell * (8 * np.array(place) - 0.5)
        return LightBricks(dict(zip(keys, volumes)), lo, np.array(levels[0]["box"][3:]), 8 * cell)

    def irradiance(self, point, normal):
        """Of the finest brick around the point; where it sees no sample of that, of the next coarser
        one, unless it sees none at all."""
        inside = np.clip(np.asarray(point, float), self.lo, self.hi - 1e-6 * self.edge) - self.lo
        first = None
        for level in range(1 + max(key[0] for key in self.bricks)):
            key = (level, *(int(i) for i in inside // (self.edge * 2 ** level)))
            if key not in self.bricks:
                continue
            value, clear = self.bricks[key].read(point, normal)
            if clear:
                return value
            first = value if first is None else first
        return first


def axes_of(turn):
    """Columns of the rotation by a quaternion x, y, z, w."""
    x, y, z, w = turn
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def cosine_basis(n):
    """What the coefficients are multiplied with and summed: pi, 2 pi / 3, pi / 4 by band, times
    real spherical harmonics without Condon-Shortley signs."""
    x, y, z = n
    pi = np.pi
    basis = [
        np.sqrt(1 / pi) / 2,
        *(np.sqrt(3 / pi) / 2 * np.array([y, z, x])),
        *(np.sqrt(15 / pi) / 2 * np.array([x * y, y * z])),
        np.sqrt(5 / pi) / 4 * (3 * z * z - 1),
        np.sqrt(15 / pi) / 2 * x * z,
        np.sqrt(15 / pi) / 4 * (x * x - y * y),
    ]
    return np.array([pi] + 3 * [2 * pi / 3] + 5 * [pi / 4]) * basis


def check_canonical(path, convention, axes, packing="band"):
    """These loaders read the default encoding alone."""
    if packing == "cube":
        sys.exit(f"{path}: holds ambient cubes, which no coefficients can be made of; load the volume "
                 "that they were made of")
    if (convention, axes) != ("radiance", "gltf") or packing not in ("band", "channel"):
        sys.exit(f"{path}: is stored as {convention}, axes {axes}, packing {packing}; first "
                 "`lpvbake convert` it")


def main(load):
    """The command line of the loaders: FILE X Y Z NX NY NZ; of levels, or volumes beside each other, the manifest."""
    if len(sys.argv) != 8:
        sys.exit(f"usage: {sys.argv[0]} FILE X Y Z NX NY NZ")
    try:
        if sys.argv[1].endswith(".levels.json"):
            light = LightLevels.load(sys.argv[1], load)
        elif sys.argv[1].endswith(".volumes.json"):
            light = LightPlaces.load(sys.argv[1], load)
        else:
            light = load(sys.argv[1])
    except OSError as error:
        sys.exit(f"{sys.argv[1]}: cannot be read: {error}")
    numbers = [float(text) for text in sys.argv[2:]]
    if isinstance(light, LightBricks):
        print(f"bricks      {len(light.bricks)} of 8 x 8 x 8 cells, the finest of {light.edge / 8:g} m")
    for volume in getattr(light, "levels", [] if isinstance(light, LightBricks) else [light]):
        dims = " x ".join(str(n) for n in volume.validity.shape)
        origin = " ".join(f"{x:g}" for x in volume.origin)
        print(f"grid        {dims} cells of {volume.cell:g} m from {origin}")
    lux = " ".join(f"{x:.6g}" for x in light.irradiance(numbers[:3], numbers[3:]))
    print(f"irradiance  {lux} lux")
