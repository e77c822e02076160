#!/usr/bin/python3
"""Reads a light volume from OpenEXR flipbooks into numpy arrays, through the JSON file beside them;
Debian's package python3-openimageio.

    load_exr.py room.json  0 1 0  0 1 0

prints the irradiance at a point (metres) of a surface with that normal.
"""

import json
import pathlib

import numpy as np
import OpenImageIO

import light_volume


def load(path, firsts=None):
    """The volume, or of each of these cells the block of 9 x 9 x 9 from it on."""
    path = pathlib.Path(path).with_suffix(".json")
    facts = json.loads(path.read_text())
    light_volume.check_canonical(path, facts["convention"], facts["axes"], facts["packing"])
    layout = facts["layout"]
    rows, columns, (width, height) = layout["rows"], layout["columns"], layout["tile"]
    grids = {}  # [x, y, z] by the name of a channel
    for entry in facts["files"]:
        image = OpenImageIO.ImageBuf(str(path.parent / entry["file"]))
        tiles = image.get_pixels(OpenImageIO.FLOAT).reshape(rows, height, columns, width, -1)
        slices = tiles.swapaxes(1, 2).reshape(rows * columns, height, width, -1)
        for c, name in enumerate(entry["channels"]):
            grids[name] = slices[: layout["slices"], :, :, c].transpose(2, 1, 0)

    dims = facts["grid"]["dims"]
    walls = [np.stack([grids[f"wall_{k}.{axis}"] for axis in "xyz"], -1)
             for k in range(3) if f"wall_{k}.x" in grids]
    names = light_volume.NAMES[: (facts["sh_order"] + 1) ** 2]
    volume = light_volume.LightVolume(
        sh=np.stack([np.stack([grids[f"sh_{name}.{c}"] for c in "rgb"], -1) for name in names]),
        validity=grids.get("validity", np.ones(dims, np.float32)),
        walls=np.reshape(walls, (-1, *dims, 3)),
        origin=np.array(facts["grid"]["origin"]),
        cell=facts["grid"]["cell"],
        axes=light_volume.axes_of(facts["grid"].get("turn", (0, 0, 0, 1))),
    )
    if firsts is None:
        return volume

    def part(first):
        x, y, z = (slice(i, i + 9) for i in first)
        return light_volume.LightVolume(volume.sh[:, x, y, z], volume.validity[x, y, z],
                                        volume.walls[:, x, y, z], volume.origin, volume.cell)
    return [part(first) for first in firsts]


if __name__ == "__main__":
    light_volume.main(load)
