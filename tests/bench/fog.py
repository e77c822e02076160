#!/usr/bin/env python3
"""Fog of `lpvbake render`: time and error of `exact` beside `march:N`.

fog.py PROGRAM [--size 320x180] [--steps 4096] [--cases hall,street,smoke]

Draws the scenes of examples/make_scenes.py by direct light alone, in even air and with a plume of
smoke, and doubles N until the march errs no more than `exact` does. Errors are L1 beside
`march:STEPS`, of what the air adds. Times are CPU seconds over those of the same picture whose air
only absorbs, so that other programs on the machine count little; that of `exact` includes its map.
"""

import argparse
import contextlib
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy
import OpenImageIO
import pyopenvdb

SCENES = pathlib.Path(__file__).resolve().parents[2] / "examples" / "make_scenes.py"
HALL = ("hall.gltf", "--camera", "5.4,1.6,-8.5:-6,2.7,1:70")
STREET = ("street.gltf", "--camera", "-2,1.7,27:0.5,2.5,0:55", "--sky", "0.5:0.7:1,6000")
CASES = {  # what is drawn, and what a metre of its air scatters and absorbs
    "hall": (HALL, 0.05, 0.002, 0.7),
    "street": (STREET, 0.01, 0.001, 0.7),
    "smoke": ((*HALL, "--medium-density", "smoke.vdb"), 2, 0.1, 0.4),
}


def write_smoke(path):
    """A plume of 4 x 5 x 4 m and 64 x 80 x 64 voxels, of four octaves of noise."""
    size, edge, random = numpy.array([64, 80, 64]), 1 / 16, numpy.random.default_rng(7)
    noise = numpy.zeros(size)
    for octave in range(4):
        cells = 4 * 2**octave
        values = random.random((cells + 1,) * 3)
        at = [numpy.linspace(0, cells, n, endpoint=False) for n in size]
        part = [a % 1 for a in at]
        part = [p * p * (3 - 2 * p) for p in part]
        for corner in numpy.ndindex(2, 2, 2):
            weight = numpy.ix_(*(p if c else 1 - p for p, c in zip(part, corner)))
            noise += (weight[0] * weight[1] * weight[2] * 0.5**octave / 1.875
                      * values[numpy.ix_(*(a.astype(int) + c for a, c in zip(at, corner)))])
    x, y, z = (edge * (i + 0.5) for i in numpy.indices(size))
    density = (numpy.clip(1.2 - numpy.hypot(x - 2, z - 2) / (0.4 + 0.3 * y), 0, 1)
               * numpy.clip(6 * (noise - 0.42), 0, 2) * numpy.clip((5 - y) / 1.5, 0, 1))
    grid = pyopenvdb.FloatGrid()
    grid.name = "density"
    grid.copyFromArray(density.astype(numpy.float32))
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=edge)
    grid.transform.translate((-5.5, 0, -4))
    pyopenvdb.write(str(path), grids=[grid])


def draw(program, folder, size, scene, medium, method):
    """The picture, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([program, "render", scene[0], f"{scene[0][:-5]}.vdb", *scene[1:], "--size", size,
                    "--samples", "4", "--show", "direct", "--medium", medium, "--fog-method", method,
                    "-o", "picture.exr", "-q"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    with contextlib.closing(OpenImageIO.ImageInput.open(str(folder / "picture.exr"))) as picture:
        pixels = picture.read_image("float")  # not by ImageBuf, whose cache knows a file again by its second
    return (numpy.asarray(pixels, dtype=float)[..., :3],
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def measure(case, arguments, folder):
    scene, scatter, absorb, g = CASES[case]

    def of(medium, method):
        return draw(arguments.program, folder, arguments.size, scene, medium, method)

    air = f"scatter={scatter},absorb={absorb},g={g}"
    clear, other = of(f"absorb={scatter + absorb}", "march:1")
    truth = of(air, f"march:{arguments.steps}")[0]
    exact = None
    for method in ("exact", *(f"march:{2**k}" for k in range(3, 20))):
        picture, seconds = of(air, method)
        error = abs(picture - truth).sum() / abs(truth - clear).sum()
        seconds = max(seconds - other, 1e-3)
        exact = exact or (error, seconds)
        print(f"{case:7} {method:11} {100 * error:7.3f} %  {seconds:6.2f} s  {seconds / exact[1]:5.1f}",
              flush=True)
        if method != "exact" and error <= exact[0]:
            break


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--steps", type=int, default=4096)
    parser.add_argument("--cases", default=",".join(CASES))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = pathlib.Path(name)
        subprocess.run([sys.executable, SCENES, place], check=True)
        for scene in ("hall", "street"):
            subprocess.run([given.program, "bake", f"{scene}.gltf", "-o", f"{scene}.vdb", "--resolution",
                            "16", "-q"], cwd=place, check=True, stdout=subprocess.DEVNULL)
        write_smoke(place / "smoke.vdb")
        for case_name in given.cases.split(","):
            measure(case_name, given, place)
