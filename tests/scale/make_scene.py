#!/usr/bin/env python3
"""Writes a large scene: make_scene.py KIND OUT.glb [COUNT [SIZE]]

    triangles   one mesh of COUNT triangles (5000000), a hilly ground
    instances   COUNT instances (10000) of one ball, by EXT_mesh_gpu_instancing
    nodes       the same by a node each
    materials   COUNT tiles (1000), each a mesh with a material of its own
    textures    COUNT tiles (500), each with an image of its own, SIZE x SIZE texels (2048)

Every scene is 10 m wide and stands on y = 0.
"""
import array
import json
import math
import random
import struct
import sys
import zlib

FLOAT, UINT = 5126, 5125
EDGE = 10.0


class Scene:
    """A glTF document and its buffer, as they grow."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}
        self.buffer = bytearray()

    def append(self, kind, item):
        self.json.setdefault(kind, []).append(item)
        return len(self.json[kind]) - 1

    def view(self, data):
        self.buffer += bytes(-len(self.buffer) % 4)
        offset = len(self.buffer)
        self.buffer += data
        return self.append("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data)})

    def accessor(self, values, shape):
        """Floats or unsigned integers, as the array's type says; POSITION needs its bounds."""
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[shape]
        component = FLOAT if values.typecode == "f" else UINT
        item = {"bufferView": self.view(values.tobytes()), "componentType": component,
                "count": len(values) // width, "type": shape}
        if component == FLOAT:
            item["min"] = [min(values[i::width]) for i in range(width)]
            item["max"] = [max(values[i::width]) for i in range(width)]
        return self.append("accessors", item)

    def mesh(self, attributes, indices, material=None):
        primitive = {"attributes": attributes, "indices": indices}
        if material is not None:
            primitive["material"] = material
        return self.append("meshes", {"primitives": [primitive]})

    def place(self, node):
        self.json["scenes"][0]["nodes"].append(self.append("nodes", node))

    def write(self, path):
        self.json["buffers"] = [{"byteLength": len(self.buffer)}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        data = self.buffer + bytes(-len(self.buffer) % 4)
        with open(path, "wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


def lattice(columns, rows, corner):
    """Positions `corner(x, y)` of a lattice and the indices of its cells' triangles."""
    positions = array.array("f")
    for y in range(rows + 1):
        for x in range(columns + 1):
            positions.extend(corner(x / columns, y / rows))
    indices = array.array("I")
    for y in range(rows):
        for a in range(y * (columns + 1), y * (columns + 1) + columns):
            b = a + columns + 1
            indices.extend((a, b, a + 1, a + 1, b, b + 1))
    return positions, indices


def triangles(scene, count):
    columns = math.isqrt(count // 2)
    rows = count // 2 // columns
    wave = [math.sin(12 * i / columns) for i in range(columns + 1)]
    positions, indices = lattice(columns, rows, lambda x, y: (
        EDGE * x, 1.0 + wave[round(x * columns)] * math.cos(9 * y), EDGE * y))
    mesh = scene.mesh({"POSITION": scene.accessor(positions, "VEC3")}, scene.accessor(indices, "SCALAR"))
    scene.place({"mesh": mesh})


def ball(scene):
    def corner(x, y):
        u, v = 2 * math.pi * x, math.pi * y
        return math.sin(v) * math.sin(u), math.cos(v), math.sin(v) * math.cos(u)
    positions, indices = lattice(16, 8, corner)
    return scene.mesh({"POSITION": scene.accessor(positions, "VEC3")}, scene.accessor(indices, "SCALAR"))


def poses(count):
    """Place and radius of every ball."""
    numbers = random.Random(1)
    for _ in range(count):
        yield [EDGE * numbers.random() for _ in range(3)], 0.02 + 0.06 * numbers.random()


def instances(scene, count):
    places, sizes = array.array("f"), array.array("f")
    for place, radius in poses(count):
        places.extend(place)
        sizes.extend((radius, radius, radius))
    attributes = {"TRANSLATION": scene.accessor(places, "VEC3"), "SCALE": scene.accessor(sizes, "VEC3")}
    scene.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    scene.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    scene.place({"mesh": ball(scene),
                 "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}})


def nodes(scene, count):
    mesh = ball(scene)
    for place, radius in poses(count):
        scene.place({"mesh": mesh, "translation": place, "scale": [radius] * 3})


def tiles(scene, count, material):
    """A square for each of `count` materials, side by side and of different heights."""
    columns = math.isqrt(count - 1) + 1
    edge = EDGE / columns
    positions, indices = lattice(1, 1, lambda x, y: (edge * x, 0.0, edge * y))
    attributes = {"POSITION": scene.accessor(positions, "VEC3"),
                  "TEXCOORD_0": scene.accessor(array.array("f", [0, 0, 1, 0, 0, 1, 1, 1]), "VEC2")}
    corners = scene.accessor(indices, "SCALAR")
    for i in range(count):
        place = [edge * (i % columns), 0.2 * (i % 5), edge * (i // columns)]
        scene.place({"mesh": scene.mesh(attributes, corners, material(i)), "translation": place})


def materials(scene, count):
    tiles(scene, count, lambda i: scene.append("materials", {"pbrMetallicRoughness": {
        "baseColorFactor": [i % 11 / 11, i % 13 / 13, i % 17 / 17, 1], "metallicFactor": 0}}))


def png(size, seed):
    """An RGB picture in stripes of 16 rows that repeat every 64; no two seeds give the same."""
    numbers = random.Random(seed)
    rows = [b"\0" + numbers.randbytes(3 * 16) * (size // 16) for _ in range(4)]
    pixels = b"".join(row * 16 for row in rows) * (size // 64)
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)),
              (b"IDAT", zlib.compress(pixels, 1)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks)


def textures(scene, count, size=2048):
    def material(i):
        image = scene.append("images", {"bufferView": scene.view(png(size, i)), "mimeType": "image/png"})
        texture = scene.append("textures", {"source": image})
        return scene.append("materials", {"pbrMetallicRoughness": {
            "baseColorTexture": {"index": texture}, "metallicFactor": 0}})
    tiles(scene, count, material)


KINDS = {triangles: 5_000_000, instances: 10_000, nodes: 10_000, materials: 1_000, textures: 500}


def main(kind, path, *numbers):
    maker = next(maker for maker in KINDS if maker.__name__ == kind)
    scene = Scene()
    maker(scene, *(map(int, numbers) if numbers else [KINDS[maker]]))
    scene.write(path)


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] not in [maker.__name__ for maker in KINDS]:
        sys.exit(__doc__)
    main(*sys.argv[1:])
