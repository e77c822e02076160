#!/usr/bin/env python3
"""Times of two programs that bake the same cases turn about, as one table by stage (see run.sh).

A case is a scene, a solver and a number of cells along the longest side; both programs get the same
options. Each row has medians over the runs: "all" is the process from start to end, and the rows
below it what it did; "start and end" is what no stage holds. CPU time is user's and system's, which
other programs on the machine disturb less than they do time. Ratios are old over new: above 1, the
new one is faster. "difference" is the relative L1 difference of both volumes' irradiance, as
`lpvbake diff` has it, so that no ratio stands for less work unseen.
"""

import argparse
import collections
import itertools
import json
import os
import pathlib
import shlex
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
CORNELL = ROOT / "examples" / "cornell_box.gltf"
REST = "start and end"

Scene = collections.namedtuple("Scene", "name path options")


def real_scenes():
    """Rows of real_scenes.tsv: path in the folder of real files to options but for the resolution."""
    rows = {}
    for line in (ROOT / "tests" / "real_scenes.tsv").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            path, options = line.split("\t")
            words = options.split()
            if "--resolution" in words:
                at = words.index("--resolution")
                del words[at:at + 2]
            rows[path] = words
    return rows


def find_scene(word, folder):
    """`cornell`, a file, or, in the folder, the first row of real_scenes.tsv that starts so."""
    rows = real_scenes()
    if word == "cornell":
        return Scene(word, CORNELL, [])
    if folder is not None:
        for path, options in rows.items():
            if path != "*" and path.startswith(word) and (folder / path).is_file():
                return Scene(word, folder / path, options)
    path = pathlib.Path(word).resolve()
    if not path.is_file():
        sys.exit(f"against.py: {word}: neither cornell, nor a file, nor a scene of --folder")
    for row, options in rows.items():
        if row != "*" and str(path).endswith("/" + row):
            return Scene(path.stem, path, options)
    return Scene(path.stem, path, [])


def bake(program, options, output):
    """One run: seconds, CPU seconds, peak memory in bytes, and what the program printed."""
    command = [program, "bake", *options, "--format", "json", "-o", output]
    with tempfile.TemporaryFile() as printed, tempfile.TemporaryFile() as told:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=printed, stderr=told)
        _, status, used = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            told.seek(0)
            printed.seek(0)
            text = told.read().decode(errors="replace").strip() or printed.read().decode(errors="replace").strip()
            raise RuntimeError(f"{shlex.join(map(str, command))}\n  exit {process.returncode}: {text}")
        printed.seek(0)
        report = json.load(printed)
    stages = collections.OrderedDict()
    for stage in report["stages"]:  # one name may stand there more than once
        stages[stage["name"]] = stages.get(stage["name"], 0) + stage["seconds"]
    stages[REST] = seconds - sum(stages.values())
    return {"seconds": seconds, "cpu": used.ru_utime + used.ru_stime, "memory": used.ru_maxrss * 1024,
            "stages": stages, "device": f"{report['device']['name']}, {report['device']['driver']}",
            "choice": report["choice"]["text"], "error": report["choice"].get("error")}


def difference(program, old, new):
    """Relative L1 difference of irradiance, or None where the volumes cannot be compared."""
    told = subprocess.run([program, "diff", old, new, "--format", "json"], capture_output=True, text=True, check=False)
    try:
        return json.loads(told.stdout)["irradiance"]["relative_l1"]
    except (ValueError, KeyError, TypeError):
        return None


def medians(runs):
    names = list(dict.fromkeys(itertools.chain.from_iterable(run["stages"] for run in runs)))
    return {"seconds": statistics.median(run["seconds"] for run in runs),
            "cpu": statistics.median(run["cpu"] for run in runs),
            "memory": statistics.median(run["memory"] for run in runs),
            "stages": {name: statistics.median(run["stages"].get(name, 0) for run in runs) for name in names},
            "device": runs[0]["device"], "choice": runs[0]["choice"], "error": runs[0]["error"]}


def measure(scene, solver, size, given, folder):
    """The case's medians and runs of both; programs take turns, and which is first changes too."""
    options = [scene.path, *scene.options, "--solver", solver, "--resolution", str(size), "--threads",
               str(given.threads), *given.bake]
    if given.error:
        options += ["--error", given.error]
    programs = {"old": given.old, "new": given.new}
    outputs = {which: folder / f"{which}.vdb" for which in programs}
    runs = {which: [] for which in programs}
    for run in range(given.runs):
        for which in sorted(programs, reverse=run % 2 == 0):
            runs[which].append(bake(programs[which], options, outputs[which]))
    result = {which: {**medians(runs[which]), "runs": runs[which]} for which in programs}
    return {"scene": scene.name, "solver": solver, "size": size, **result,
            "difference": difference(given.new, outputs["old"], outputs["new"])}


def ratio(old, new):
    return f"{old / new:.2f}" if new > 0 and old > 0 else ""


def rows_of(case, smallest):
    """Cells of the table; stages that took both less than a share `smallest` of all stand together."""
    old, new = case["old"], case["new"]
    names = list(dict.fromkeys([*old["stages"], *new["stages"]]))
    times = {name: (old["stages"].get(name, 0), new["stages"].get(name, 0)) for name in names}
    small = [name for name in names if name != REST and times[name][0] < smallest * old["seconds"]
             and times[name][1] < smallest * new["seconds"]]
    if len(small) > 1:
        times["other: " + ", ".join(small)] = tuple(sum(times[name][i] for name in small) for i in (0, 1))
        for name in small:
            del times[name]
    times[REST] = times.pop(REST)
    head = [case["scene"], case["solver"], str(case["size"])]
    yield [*head, "**all**", f"{old['seconds']:.3f}", f"{new['seconds']:.3f}",
           ratio(old["seconds"], new["seconds"]), f"{old['cpu']:.3f}", f"{new['cpu']:.3f}",
           ratio(old["cpu"], new["cpu"]), f"{old['memory'] / 2**20:.0f}", f"{new['memory'] / 2**20:.0f}",
           "" if case["difference"] is None else f"{case['difference']:.2g}"]
    for name, (before, after) in times.items():
        yield [*head, name, f"{before:.3f}", f"{after:.3f}", ratio(before, after), *[""] * 6]


def write_table(cases, given, file):
    head = ["scene", "solver", "size", "stage", "old s", "new s", "old/new", "old CPU s", "new CPU s", "old/new",
            "old MiB", "new MiB", "difference"]
    rows = [head, *itertools.chain.from_iterable(rows_of(case, given.smallest) for case in cases)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for number, row in enumerate(rows):
        left = [cell.ljust(width) if i in (0, 1, 3) else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths))]
        print("| " + " | ".join(left) + " |", file=file)
        if number == 0:
            marks = ["-" * width if i in (0, 1, 3) else "-" * (width - 1) + ":" for i, width in enumerate(widths)]
            print("| " + " | ".join(marks) + " |", file=file)
    for case in cases:
        told = [f"{which}: {case[which]['choice']}" + (f", expected error {100 * case[which]['error']:.2g} %"
                                                       if case[which]["error"] is not None else "")
                for which in ("old", "new")]
        if given.error or case["old"]["choice"] != case["new"]["choice"]:
            print(f"\n{case['scene']}, {case['solver']}, {case['size']}: {'; '.join(told)}.", file=file)


def machine(given):
    """What it ran on, and how busy that was with other things."""
    model = next((line.split(":", 1)[1].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
                  if line.startswith("model name")), "unknown CPU")
    return {"cpu": model, "cores": len(os.sched_getaffinity(0)), "threads": given.threads,
            "load_before": os.getloadavg()[0]}


def parse(arguments):
    parser = argparse.ArgumentParser(prog="run.sh", description=__doc__.split("\n\n")[0])
    parser.add_argument("--old", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--new", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--old-name", default="old", help=argparse.SUPPRESS)
    parser.add_argument("--new-name", default="new", help=argparse.SUPPRESS)
    parser.add_argument("--scenes", help="cornell (the shipped box, default), files, or names in --folder")
    parser.add_argument("--folder", type=pathlib.Path,
                        help="real glTF files, baked with the options of tests/real_scenes.tsv")
    parser.add_argument("--sizes", help="cells along the longest side (default: 32,64)")
    parser.add_argument("--solvers", help="default: gather,sn,lpv")
    parser.add_argument("--error", help="--error of both bakes; each program's own expectation is told")
    parser.add_argument("--runs", type=int, help="of each program (default: 3)")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="default: all cores")
    parser.add_argument("--smallest", type=float, default=0.01,
                        help="stages below this share of all stand in one row (default: 0.01)")
    parser.add_argument("--json", type=pathlib.Path, help="write there all runs and medians")
    parser.add_argument("--quick", action="store_true", help="cornell, gather, 16 cells, one run, unless told else")
    parser.add_argument("bake", nargs="*", help="after --: further options of both bakes")
    given = parser.parse_args(arguments)
    usual = ("cornell", "16", "gather", 1) if given.quick else ("cornell", "32,64", "gather,sn,lpv", 3)
    for name, value in zip(("scenes", "sizes", "solvers", "runs"), usual):
        if getattr(given, name) is None:
            setattr(given, name, value)
    if given.runs < 1 or given.threads < 1:
        parser.error("--runs and --threads are at least 1")
    if not all(size.isdigit() for size in given.sizes.split(",")):
        parser.error("--sizes are whole numbers, separated by commas")
    for which in ("old", "new"):  # names with a slash, for exec
        setattr(given, which, str(pathlib.Path(getattr(given, which)).resolve()))
    return given


def main():
    given = parse(sys.argv[1:])
    scenes = [find_scene(word, given.folder) for word in given.scenes.split(",")]
    todo = list(itertools.product(scenes, given.solvers.split(","), map(int, given.sizes.split(","))))
    place, cases, failed = machine(given), [], []
    with tempfile.TemporaryDirectory() as folder:
        for number, (scene, solver, size) in enumerate(todo, 1):
            print(f"{number}/{len(todo)}: {scene.name}, {solver}, {size}", file=sys.stderr, flush=True)
            try:
                cases.append(measure(scene, solver, size, given, pathlib.Path(folder)))
            except RuntimeError as error:
                failed.append(str(error))
    place["load_after"] = os.getloadavg()[0]
    if cases:
        place["device"] = cases[0]["new"]["device"]
        print(f"old: {given.old_name}; new: {given.new_name}; medians of {given.runs} "
              f"run{'s' if given.runs > 1 else ''} each, turn about. "
              f"{place['device']}; {given.threads} threads of {place['cores']} cores, {place['cpu']}; "
              f"load {place['load_before']:.1f} before, {place['load_after']:.1f} after.\n")
        write_table(cases, given, sys.stdout)
    if given.json:
        given.json.write_text(json.dumps({"old": given.old_name, "new": given.new_name, "machine": place,
                                          "runs": given.runs, "cases": cases}, indent=1) + "\n", encoding="utf-8")
    for text in failed:
        print(f"against.py: failed: {text}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
