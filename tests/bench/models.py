#!/usr/bin/env python3
"""How far bakes are from what src/solver/models.h expects of their time.

models.py PROGRAM SCENE... [--resolutions 16,32,64] [--repeats 3] [--within FACTOR]

Bakes each scene by each solver at each resolution, fitted to what Unity reads, and prints for each
stage what was expected, what was measured (the median of the repeats) and the ratio, then the
geometric mean of each stage's ratios: what its constants would have to be multiplied with. With --within, exits 7 where the ratio
of a whole bake is above FACTOR or below its inverse. Two threads are used: the constants are for
them, and those of a device for lavapipe and an H200.
"""

import argparse
import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile

SOLVERS = ("sn", "gather", "lpv")


def run(*command):
    return json.loads(subprocess.run([*map(str, command), "--format", "json"], check=True,
                                     capture_output=True, text=True).stdout)


def seconds_of(document):
    return {stage["name"]: stage["seconds"] for stage in document["stages"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolutions", default="16,32,64")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--within", type=float)
    arguments = parser.parse_args()

    ratios, outside = {}, False
    print(f"{'bake':<28} {'stage':<12} {'expected':>9} {'measured':>9} {'ratio':>6}")
    with tempfile.TemporaryDirectory() as folder:
        for scene in arguments.scenes:
            for resolution in arguments.resolutions.split(","):
                for solver in SOLVERS:
                    bake = (arguments.program, "bake", scene, "-o", f"{folder}/light.exr",
                            "--target", "unity", "--solver", solver, "--resolution", resolution, "--threads", "2")
                    expected = seconds_of(run(*bake, "--dry-run"))
                    repeats = [seconds_of(run(*bake)) for _ in range(arguments.repeats)]
                    measured = {name: statistics.median(r[name] for r in repeats)
                                for name in expected}
                    expected["all"] = sum(expected.values())
                    measured["all"] = sum(measured.values())
                    title = f"{pathlib.Path(scene).stem} {solver} {resolution}"
                    for name, seconds in measured.items():
                        ratio = seconds / expected[name]
                        ratios.setdefault(name, []).append(ratio)
                        print(f"{title:<28} {name:<12} {expected[name]:9.4f} {seconds:9.4f} "
                              f"{ratio:6.2f}")
                    if arguments.within:
                        outside |= abs(math.log(ratios["all"][-1])) > math.log(arguments.within)
    for name, values in ratios.items():
        mean = math.exp(statistics.fmean(map(math.log, values)))
        print(f"{'mean of ' + str(len(values)):<28} {name:<12} {'':>9} {'':>9} {mean:6.2f}")
    sys.exit(7 if outside else 0)


if __name__ == "__main__":
    main()
