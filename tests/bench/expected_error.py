#!/usr/bin/env python3
"""What bakes are expected to err by, measured and fitted.

expected_error.py measure PROGRAM SCENES FOLDER -o FILE [--probes 400] [--noise 1.5%] [--threads N]
expected_error.py fit FILE

`measure` bakes each scene of a table (tests/real_scenes.tsv: a file in FOLDER, a tab, options) at 32
cells with all reflections by settings from coarse to fine, compares each with path-traced probes, and
keeps the errors beside what the pilot tells, with machine, date and commit. `fit` prints the constants
of src/solver/models.h that go through the medians, and how the errors that are stated with them hold
(`surfaces` is 0.012 there, so that they also hold for what --error chooses by them).
tests/baselines/expected_error.json is what it measured; tests/unit/expected_error_test.cpp holds the
program to it.
"""

import argparse
import datetime
import json
import math
import pathlib
import platform
import random
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROWS = (
    *({"solver": "sn", "sh-order": 2, "directions": n} for n in (48, 144, 240, 384)),
    {"solver": "sn", "sh-order": 1, "directions": 240},
    *({"solver": "sn", "sh-order": 4, "directions": n} for n in (144, 384)),
    *({"solver": "gather", "sh-order": 2, "vpls": n, "tolerance": t}
      for n, t in ((48, 0.5), (96, 0.5), (192, 0.3), (384, 0.2), (768, 0.1))),
    *({"solver": "gather", "sh-order": 4, "vpls": n, "tolerance": t}
      for n, t in ((192, 0.3), (768, 0.1))),
)
L1_OF_NORMAL = math.sqrt(2 / math.pi)  # mean of |x| for a standard deviation of 1
LEAST = 0.004  # what is left of an error below the reference's noise


def run(*command):
    return json.loads(subprocess.run([*map(str, command), "--format", "json", "-q"], check=True,
                                     capture_output=True, text=True).stdout)


def words(row):
    return [word for name, value in row.items() for word in (f"--{name}", value)]


def measure(arguments):
    scenes = []
    for line in arguments.scenes.read_text().splitlines():
        if not line or line[0] in "#*":
            continue
        name, options = line.split("\t")
        if not (arguments.folder / name).exists():
            continue
        scene = [arguments.folder / name, *options.replace("--resolution 64", "--resolution 32").split(),
                 "--bounces", "inf", "--threads", arguments.threads]
        with tempfile.TemporaryDirectory() as folder:
            truth, volume = f"{folder}/truth.nvdb", f"{folder}/volume.nvdb"
            noise = run(arguments.program, "reference", *scene, "-o", truth, "--sh-order", 4, "--probes",
                        arguments.probes, "--noise", arguments.noise)["noise"]
            pilot = run(arguments.program, "bake", *scene, "--error", "4%", "--dry-run")["choice"]["pilot"]
            errors = []
            for row in ROWS:
                run(arguments.program, "bake", *scene, *words(row), "-o", volume)
                difference = run(arguments.program, "diff", volume, truth, "--fail", 1,
                                 "--fail-percent", 100)
                errors.append(round(difference["irradiance"]["relative_l1"], 5))
        scenes.append({"scene": pathlib.Path(name).name, "options": options, "noise": round(noise, 5),
                       "pilot": pilot, "errors": errors})
        print(scenes[-1]["scene"], *errors, file=sys.stderr)
    commit = subprocess.run(["git", "-C", HERE, "rev-parse", "--short", "HEAD"], capture_output=True,
                            text=True).stdout.strip()
    keep(arguments.output, platform.processor() or platform.machine(), commit, scenes)


def keep(path, machine, commit, scenes):
    head = {"machine": machine, "date": str(datetime.date.today()), "commit": commit, "rows": ROWS}
    text = json.dumps(head)[:-1] + ', "scenes": [\n'
    path.write_text(text + ",\n".join(json.dumps(scene) for scene in scenes) + "\n]}\n")


def lost_clusters(pilot, clusters):
    few, more = pilot["clusters"]
    power = min(max(math.log(few / more) / math.log(4), 0.25), 1.0)
    return more * (192 / clusters) ** power


def typical(constants, pilot, row):
    one, two = pilot["bands"]
    terms = [{1: one, 2: two, 4: two * two / one}[row["sh-order"]], constants["surfaces"]]
    if row["solver"] == "sn":
        finer = (row["directions"] / 240) ** 2
        terms.append(constants["sn_peaks"] * lost_clusters(pilot, 192 * min(max(finer, 1), 4)))
        terms.append(constants["sn_directions"] / math.sqrt(row["directions"]))
    else:
        terms.append(lost_clusters(pilot, row["vpls"]))
        terms.append(constants["gather_tolerance"] * row["tolerance"] ** 1.5)
    return math.hypot(*terms)


def fit(arguments):
    document = json.loads(arguments.file.read_text())
    measured = []
    for scene in document["scenes"]:
        if scene["pilot"]["clusters"][1] > 0.15:
            continue  # beyond what a pilot tells
        for row, error in zip(document["rows"], scene["errors"]):
            if error is not None:
                own = math.sqrt(max(error**2 - (L1_OF_NORMAL * scene["noise"]) ** 2, LEAST**2))
                measured.append((scene, row, own))

    def ratios(constants):
        return [typical(constants, scene["pilot"], row) / error for scene, row, error in measured]

    def loss(constants):
        return sum(abs(math.log(ratio)) for ratio in ratios(constants))

    constants = {"surfaces": 0.005, "sn_peaks": 0.5, "sn_directions": 0.2, "gather_tolerance": 0.03}
    draws, best = random.Random(1), loss(constants)
    for step in range(4000):
        name = draws.choice(list(constants))
        other = {**constants, name: constants[name] * math.exp(draws.gauss(0, 0.3 * 0.999**step + 0.01))}
        if (now := loss(other)) < best:
            best, constants = now, other
    for name, value in constants.items():
        print(f"{name:<18} {value:.4g}")
    for surfaces in (constants["surfaces"], 0.012):
        values = ratios({**constants, "surfaces": surfaces})
        for margin in (1, 1.2, 1.35, 1.5):
            print(f"surfaces {surfaces:.4f}, times {margin:<4}: "
                  f"{sum(margin * v >= 1 for v in values) / len(values):.0%} of {len(values)} err less, "
                  f"median {margin * statistics.median(values):.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("measure")
    command.add_argument("program", type=pathlib.Path)
    command.add_argument("scenes", type=pathlib.Path)
    command.add_argument("folder", type=pathlib.Path)
    command.add_argument("-o", "--output", type=pathlib.Path, required=True)
    command.add_argument("--probes", type=int, default=400)
    command.add_argument("--noise", default="1.5%")
    command.add_argument("--threads", type=int, default=2)
    command.set_defaults(run=measure)
    command = commands.add_parser("fit")
    command.add_argument("file", type=pathlib.Path)
    command.set_defaults(run=fit)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
