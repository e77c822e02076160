#!/usr/bin/python3
"""Reads a light volume from OpenVDB into numpy arrays; Debian's package python3-openvdb.

    load_vdb.py room.vdb  0 1 0  0 1 0

prints the irradiance at a point (metres) of a surface with that normal.
"""

import numpy as np
import pyopenvdb

import light_volume


def load(path, firsts=None):
    """The volume, or of each of these samples the block of 9 x 9 x 9 from it on."""
    facts = pyopenvdb.readMetadata(path)
    light_volume.check_canonical(path, facts["lpv:convention"], facts["lpv:axes"])
    stored = [grid.name for grid in pyopenvdb.readAllGridMetadata(path)]
    grids = {name: pyopenvdb.read(path, name) for name in stored}
    if firsts is not None:
        return [part(facts, grids, first, (9, 9, 9)) for first in firsts]
    return part(facts, grids, (0, 0, 0), tuple(facts["lpv:grid_dims"]))


def part(facts, grids, first, dims):
    """The cells from `first` on."""
    def array(name, *colours):
        values = np.zeros(dims + colours, np.float32)
        grids[name].copyToArray(values, ijk=first)
        return values

    stored = grids
    walls = [array(f"wall_{k}", 3) for k in range(3) if f"wall_{k}" in stored]
    names = light_volume.NAMES[: (facts["lpv:sh_order"] + 1) ** 2]
    return light_volume.LightVolume(
        sh=np.stack([array("sh_" + name, 3) for name in names]),
        validity=array("validity") if "validity" in stored else np.ones(dims, np.float32),
        walls=np.reshape(walls, (-1, *dims, 3)),
        origin=np.array(facts["lpv:grid_origin"]),
        cell=facts["lpv:cell_size"],
        axes=light_volume.axes_of(facts.get("lpv:grid_turn", (0, 0, 0, 1))),
    )


if __name__ == "__main__":
    light_volume.main(load)
