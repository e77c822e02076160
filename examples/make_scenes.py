#!/usr/bin/env python3
"""Writes four scenes of boxes to try things on: a furnished room, room.gltf, that a low sun shines into
through a window, a street, street.gltf, of houses and trees in the sun, a room, sheets.gltf, whose
walls have no thickness and are seen from both sides, and a hall, hall.gltf, with five windows in a row
that the sun shines through. Metres.

    make_scenes.py FOLDER
"""

import base64
import json
import math
import pathlib
import struct
import sys

BOX = [(-1, -1, -1), (1, -1, -1), (-1, 1, -1), (1, 1, -1),
       (-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1)]
BOX_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3)]
# A prism along z with its ridge up, from -1 to 1.
ROOF = [(-1, -1, -1), (1, -1, -1), (0, 1, -1), (-1, -1, 1), (1, -1, 1), (0, 1, 1)]
ROOF_FACES = [(0, 2, 1), (3, 4, 5), (0, 3, 5, 2), (1, 2, 5, 4), (0, 1, 4, 3)]
BALL = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
BALL_FACES = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]


class Scene:
    """Solids of one colour each, every one a mesh of its own."""

    def __init__(self):
        self.gltf = {"asset": {"version": "2.0", "generator": "make_scenes.py"}, "scene": 0,
                     "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": [],
                     "accessors": [], "bufferViews": [], "buffers": []}
        self.data = b""
        self.colours = {}

    def node(self, node):
        self.gltf["nodes"].append(node)
        self.gltf["scenes"][0]["nodes"].append(len(self.gltf["nodes"]) - 1)

    def material(self, colour, glow, double_sided):
        key = colour, glow, double_sided
        if key not in self.colours:
            material = {"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1],
                                                 "metallicFactor": 0}}
            if double_sided:
                material["doubleSided"] = True
            if glow:
                material["emissiveFactor"] = [1, 0.8, 0.5]
                material["extensions"] = {
                    "KHR_materials_emissive_strength": {"emissiveStrength": glow}}
            self.colours[key] = len(self.gltf["materials"])
            self.gltf["materials"].append(material)
        return self.colours[key]

    def accessor(self, values, code, component, kind):
        flat = [x for value in values for x in (value if isinstance(value, tuple) else (value,))]
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": 4 * len(flat)}
        self.data += struct.pack(f"<{len(flat)}{code}", *flat)
        self.gltf["bufferViews"].append(view)
        accessor = {"bufferView": len(self.gltf["bufferViews"]) - 1, "componentType": component,
                    "count": len(values), "type": kind}
        if kind == "VEC3":
            accessor["min"] = [min(axis) for axis in zip(*values)]
            accessor["max"] = [max(axis) for axis in zip(*values)]
        self.gltf["accessors"].append(accessor)
        return len(self.gltf["accessors"]) - 1

    def solid(self, colour, middle, size, turn=0, corners=BOX, faces=BOX_FACES, glow=0,
              double_sided=False):
        """`size` is the whole extent; `turn` goes around y, degrees."""
        points, triangles = [], []
        for face in faces:
            first = len(points)
            points += [corners[i] for i in face]
            triangles += [first + i for k in range(2, len(face)) for i in (0, k - 1, k)]
        mesh = {"attributes": {"POSITION": self.accessor(points, "f", 5126, "VEC3")},
                "indices": self.accessor(triangles, "I", 5125, "SCALAR"),
                "material": self.material(colour, glow, double_sided)}
        self.gltf["meshes"].append({"primitives": [mesh]})
        half = math.radians(turn) / 2
        self.node({"mesh": len(self.gltf["meshes"]) - 1, "translation": middle,
                   "rotation": [0, math.sin(half), 0, math.cos(half)],
                   "scale": [x / 2 for x in size]})

    def sun(self, azimuth, elevation, lux):
        """Degrees from +Z towards +X and above the horizon: where it stands."""
        a, e = math.radians(azimuth) / 2, -math.radians(elevation) / 2
        self.gltf["extensions"] = {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": lux, "color": [1, 0.93, 0.8]}]}}
        # A light shines along its own -z: first down around x, then around y.
        self.node({"rotation": [math.cos(a) * math.sin(e), math.sin(a) * math.cos(e),
                                -math.sin(a) * math.sin(e), math.cos(a) * math.cos(e)],
                   "extensions": {"KHR_lights_punctual": {"light": 0}}})

    def write(self, path):
        self.gltf["buffers"] = [{"byteLength": len(self.data), "uri":
                                 "data:application/octet-stream;base64,"
                                 + base64.b64encode(self.data).decode()}]
        self.gltf["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_emissive_strength"]
        path.write_text(json.dumps(self.gltf))


WHITE, WOOD, DARK_WOOD = (0.8, 0.78, 0.74), (0.55, 0.34, 0.18), (0.22, 0.12, 0.06)
BLUE, RED, GREEN, OCHRE = (0.12, 0.25, 0.5), (0.6, 0.1, 0.07), (0.2, 0.4, 0.15), (0.7, 0.5, 0.15)


def room():
    s = Scene()
    # Walls are 20 cm thick; 5 x 2.6 x 4 m between them; the front one is left out of the picture.
    s.solid(WOOD, [0, -0.1, 0], [5.4, 0.2, 4.4])
    s.solid(WHITE, [0, 2.7, 0], [5.4, 0.2, 4.4])
    s.solid(WHITE, [0, 1.3, -2.1], [5.4, 2.6, 0.2])
    s.solid(WHITE, [0, 1.3, 2.1], [5.4, 2.6, 0.2])
    s.solid(BLUE, [-2.6, 1.3, 0], [0.2, 2.6, 4])
    # The right wall has a window of 1.6 x 1.5 m.
    s.solid(WHITE, [2.6, 0.4, 0], [0.2, 0.8, 4])
    s.solid(WHITE, [2.6, 2.45, 0], [0.2, 0.3, 4])
    s.solid(WHITE, [2.6, 1.55, -1.4], [0.2, 1.5, 1.2])
    s.solid(WHITE, [2.6, 1.55, 1.4], [0.2, 1.5, 1.2])
    s.solid(WHITE, [2.6, 1.55, 0], [0.08, 1.5, 0.06])
    # Sofa, table, shelf with books, rug, picture, lamp.
    s.solid(RED, [-1.9, 0.22, 0.2], [0.9, 0.44, 2])
    s.solid(RED, [-2.3, 0.6, 0.2], [0.24, 0.5, 2])
    for z in (-0.85, 1.25):
        s.solid(RED, [-1.95, 0.45, z], [1, 0.5, 0.2])
    s.solid(OCHRE, [0.1, 0.01, 0.3], [2.2, 0.02, 1.6])
    s.solid(DARK_WOOD, [0, 0.44, 0.3], [1.2, 0.05, 0.7], 12)
    for x in (-0.5, 0.5):
        for z in (0.05, 0.55):
            s.solid(DARK_WOOD, [x, 0.21, z + 0.1 * -x], [0.06, 0.42, 0.06], 12)
    s.solid(GREEN, [0.2, 0.56, 0.25], [0.16, 0.2, 0.16], 30)
    s.solid(DARK_WOOD, [0.9, 0.9, -1.98], [1.6, 0.03, 0.03])
    for shelf in range(4):
        s.solid(DARK_WOOD, [0.9, 0.3 + 0.45 * shelf, -1.82], [1.6, 0.03, 0.34])
        for book in range(14):
            if (7 * book + 3 * shelf) % 5 == 0:
                continue
            height = 0.22 + 0.03 * ((5 * book + shelf) % 4)
            s.solid([BLUE, RED, GREEN, OCHRE, WHITE][(book * 3 + shelf) % 5],
                    [0.2 + 0.1 * book, 0.315 + 0.45 * shelf + height / 2, -1.84],
                    [0.07, height, 0.22])
    for x in (0.1, 1.7):
        s.solid(DARK_WOOD, [x, 0.85, -1.82], [0.04, 1.7, 0.34])
    s.solid(OCHRE, [-1.2, 1.6, -1.98], [0.9, 0.6, 0.04])
    s.solid(GREEN, [-1.2, 1.6, -1.955], [0.8, 0.5, 0.02])
    s.solid(DARK_WOOD, [2.0, 0.6, 1.5], [0.05, 1.2, 0.05])
    s.solid(WHITE, [2.0, 1.35, 1.5], [0.3, 0.3, 0.3], glow=3000)
    s.sun(62, 32, 80000)
    return s


def sheets():
    s = Scene()
    for colour, side in ((WHITE, 0), (BLUE, 2), (RED, 3), (WOOD, 4), (WHITE, 5)):  # open towards +z
        s.solid(colour, [0, 1.3, 0], [4, 2.6, 3.6], faces=[BOX_FACES[side]], double_sided=True)
    s.solid(WHITE, [-0.75, 0.75, -0.8], [0.9, 1.5, 0.8])
    s.solid(OCHRE, [0.8, 0.35, 0.2], [0.8, 0.7, 0.8])
    s.sun(20, 35, 20000)
    return s


def hall():
    s = Scene()
    # 12 x 6 x 20 m between walls of 30 cm, with pillars; the sun stands before the left wall.
    s.solid(WOOD, [0, -0.15, 0], [12.6, 0.3, 20.6])
    s.solid(WHITE, [0, 6.15, 0], [12.6, 0.3, 20.6])
    s.solid(WHITE, [6.15, 3, 0], [0.3, 6, 20.6])
    for z in (-10.15, 10.15):
        s.solid(WHITE, [0, 3, z], [12.6, 6, 0.3])
    s.solid(WHITE, [-6.15, 1, 0], [0.3, 2, 20])
    s.solid(WHITE, [-6.15, 5.6, 0], [0.3, 0.8, 20])
    for pier in range(6):  # between windows of 1.4 x 3.2 m
        width = 1.3 if pier in (0, 5) else 2.6
        s.solid(WHITE, [-6.15, 3.6, -9.35 if pier == 0 else 9.35 if pier == 5 else 4 * pier - 10],
                [0.3, 3.2, width])
    for k in range(4):
        for x in (-2.1, 2.5):
            s.solid(WHITE, [x, 3, 4 * k - 6], [0.6, 6, 0.6])
    s.sun(-110, 38, 60000)
    return s


def street():
    s = Scene()
    s.solid((0.3, 0.33, 0.2), [0, -0.5, 0], [60, 1, 60])
    s.solid((0.25, 0.25, 0.26), [0, 0.02, 0], [6, 0.04, 60])
    plaster = [(0.75, 0.7, 0.6), (0.7, 0.35, 0.2), (0.75, 0.62, 0.3), (0.5, 0.6, 0.7)]
    for row in range(5):
        for side in (-1, 1):
            i = 2 * row + (side > 0)
            x, z = side * (8.5 + (i * 7 % 3) * 0.6), 22 - 10.5 * row
            height, depth = 5 + (i * 5 % 4) * 0.7, 7 + i * 3 % 2
            s.solid(plaster[i * 3 % 4], [x, height / 2, z], [7, height, depth])
            s.solid((0.45, 0.16, 0.1), [x, height + 1.4, z], [7.8, 2.8, depth + 0.8],
                    corners=ROOF, faces=ROOF_FACES)
            for floor in range(2):
                for window in (-1, 1):
                    s.solid((0.08, 0.09, 0.1), [x - side * 3.5, 1.8 + 2.4 * floor, z + 1.8 * window],
                            [0.1, 1.3, 1])
            s.solid(DARK_WOOD, [x - side * 3.5, 1.1, z], [0.14, 2.2, 1])
    for i, (x, z) in enumerate([(-3.9, 17), (3.9, 11), (-3.9, 6), (3.9, -4), (-3.9, -9), (3.9, -15)]):
        s.solid(DARK_WOOD, [x, 1, z], [0.3, 2, 0.3])
        for k, (y, size) in enumerate([(2.6, 2.6), (3.7, 2.1), (4.6, 1.4)]):
            s.solid((0.14, 0.32, 0.08), [x, y, z], [size, 2, size], 40 * i + 45 * k,
                    corners=BALL, faces=BALL_FACES)
    s.solid((0.6, 0.08, 0.06), [1.6, 0.75, 14], [1.7, 0.7, 4])
    s.solid((0.6, 0.08, 0.06), [1.6, 1.3, 13.8], [1.5, 0.6, 2])
    s.sun(68, 40, 100000)
    return s


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__.strip())
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    room().write(folder / "room.gltf")
    street().write(folder / "street.gltf")
    sheets().write(folder / "sheets.gltf")
    hall().write(folder / "hall.gltf")
