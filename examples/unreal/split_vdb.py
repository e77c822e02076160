#!/usr/bin/env python3
"""A volume as .vdb files of at most eight channels each, which is what a Sparse Volume Texture of Unreal
Engine 5 holds (two textures of four). Debian's python3-openvdb does it.

    lpvbake bake room.glb -o room.vdb --target unreal
    examples/unreal/split_vdb.py room.vdb

writes room_0.vdb (sh_l0, sh_l1_y and validity), room_1.vdb (sh_l1_z, sh_l1_x), ... In the editor:

1. import each file as Sparse Volume Texture, 32 bit floats, with the grids that its name stands for here in
   channels A.rgb and B.rgb, and validity in A.a;
2. in a material sample all of them at uvw = (position - min) / (max - min), of room.unreal.json in centimetres
   (bake with -o room.exr, too), and hand the nine coefficients to DotSH3, as that file has it.

Unproven: nobody has run it in the editor. Walls are left out, as materials do not read them.
"""

import pathlib
import sys

import pyopenvdb

MOST_CHANNELS = 8
GRIDS = ["sh_l0", "sh_l1_y", "sh_l1_z", "sh_l1_x", "sh_l2_xy", "sh_l2_yz", "sh_l2_z2", "sh_l2_xz", "sh_l2_x2y2",
         "validity"]


def channels(grid):
    return 3 if grid.valueTypeName == "vec3s" else 1


def split(grids):
    """Each grid into the first file that has room."""
    files = []
    for grid in grids:
        for file in files:
            if sum(map(channels, file)) + channels(grid) <= MOST_CHANNELS:
                file.append(grid)
                break
        else:
            files.append([grid])
    return files


def main():
    path = pathlib.Path(sys.argv[1])
    there = {grid.name for grid in pyopenvdb.readAllGridMetadata(str(path))}
    grids = [pyopenvdb.read(str(path), name) for name in GRIDS if name in there]
    metadata = pyopenvdb.readMetadata(str(path))
    for number, file in enumerate(split(grids)):
        out = path.with_name(f"{path.stem}_{number}.vdb")
        pyopenvdb.write(str(out), grids=file, metadata=metadata)
        print(f"{out}: {', '.join(grid.name for grid in file)}")


if __name__ == "__main__":
    main()
