#!/usr/bin/env python3
"""Shards of a bake on machines that take their processors and their memory away: what is told to end ends at
once and leaves nothing behind, and what is said of memory holds.

Usage: shards_test.py LPVBAKE SCENE
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

LPVBAKE, SCENE = sys.argv[1:3]


def size_of(path):
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


class Shards(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def start(self, *arguments, **more):
        return subprocess.Popen([LPVBAKE, *arguments], cwd=self.folder, stdout=subprocess.DEVNULL,
                                stderr=subprocess.DEVNULL, **more)

    def run_whole(self, *arguments):
        begun = time.monotonic()
        self.assertEqual(self.start(*arguments).wait(timeout=300), 0, arguments)
        return time.monotonic() - begun

    def visible(self):
        """Names that programs read; what writes for more than a second may leave others."""
        return {name for name in os.listdir(self.folder) if not name.startswith(".")}

    def terminate_at(self, moments, *arguments, output):
        """How often it was ended; each time in two seconds and without an output."""
        whole = self.run_whole(*arguments)
        ended = 0
        for moment in range(moments):
            for path in output, "out.exr":
                (self.folder / path).unlink(missing_ok=True)
            before = self.visible()
            process = self.start(*arguments)
            time.sleep(0.95 * whole * (moment + 0.5) / moments)
            process.terminate()
            asked = time.monotonic()
            code = process.wait(timeout=60)
            with self.subTest(command=arguments[0], moment=moment):
                self.assertLess(time.monotonic() - asked, 2)
                self.assertIn(code, (143, 0, -signal.SIGTERM))  # it was done; or it had not begun
                if code != 0:
                    self.assertEqual(self.visible(), before)
            ended += code == 143
        self.run_whole(*arguments)
        return ended

    def test_termination_is_answered_in_two_seconds_at_any_stage(self):
        bake = [SCENE, "--bounds=-1,0,-4,1,2,4", "--margin=0", "--cell-size=0.05", "--sky=#8090ff,20", "--threads=2"]
        gather = [*bake, "--solver=gather"]
        sn = [*bake, "--solver=sn", "--tile=32"]
        self.assertGreater(self.terminate_at(6, "light", *gather, "-o", "a.lit", output="a.lit"), 3)
        for number, solver in enumerate((gather, sn)):
            for shard in (1, 2):
                part = f"p{number}{shard}"
                more = [*solver, "-o", part, f"--shard={shard}/2"]
                if shard == 1:
                    self.assertGreater(self.terminate_at(8, "bake", *more, output=part), 4)
                else:
                    self.run_whole("bake", *more)
        merge = ["merge", "p01", "p02", "-o", "out.vdb", "-o", "out.exr"]
        self.assertGreater(self.terminate_at(10, *merge, output="out.vdb"), 2)

    def test_killed_while_it_writes_it_leaves_no_half_part(self):
        """Nor a half file of lit surfaces, nor a half merged one."""
        bake = [SCENE, "--bounds=-1,0,-1.6,1,2,1.6", "--margin=0", "--cell-size=0.05", "--sky=#8090ff,20", "--threads=2",
                "--solver=gather", "--quality=fast"]
        kinds = [("bake", *bake, "--shard=1/2", "-o", "p1"), ("bake", *bake, "--shard=2/2", "-o", "p2"),
                 ("light", *bake, "-o", "a.lit"), ("merge", "p1", "p2", "-o", "out.vdb")]
        for arguments in kinds:
            output = self.folder / arguments[-1]
            self.run_whole(*arguments)
            whole = output.read_bytes()
            killed = 0
            for moment in range(8):
                output.unlink(missing_ok=True)
                process = self.start(*arguments)
                while process.poll() is None and not any(map(size_of, self.files_of(output))):
                    pass  # until it writes
                time.sleep(0.001 * moment)
                process.kill()
                killed += process.wait(timeout=60) == -signal.SIGKILL
                if output.exists():
                    self.assertEqual(output.read_bytes(), whole, arguments[0])
                for path in self.files_of(output):
                    path.unlink(missing_ok=True)
            self.assertGreater(killed, 4, arguments[0])
            self.run_whole(*arguments)
            self.assertEqual(output.read_bytes(), whole)

    def test_two_write_one_part(self):
        """One is stopped while it writes, until the other has written."""
        bake = [SCENE, "--bounds=-1,0,-1.6,1,2,1.6", "--margin=0", "--cell-size=0.05", "--solver=gather", "--quality=fast"]
        for command, name in ("bake", "part"), ("light", "part.lit"):
            arguments = [command, *bake, "--shard=1/2", "-o", name]
            output = self.folder / name
            self.run_whole(*arguments)
            whole = output.read_bytes()
            for _ in range(20):  # until it is stopped in time
                output.unlink()
                first = self.start(*arguments)
                while first.poll() is None and not any(map(size_of, self.files_of(output))):
                    pass
                first.send_signal(signal.SIGSTOP)
                if not output.exists():
                    break
                first.send_signal(signal.SIGCONT)
                first.wait(timeout=60)
            self.assertFalse(output.exists())
            self.run_whole(*arguments)
            self.assertEqual(output.read_bytes(), whole)
            first.send_signal(signal.SIGCONT)
            self.assertEqual(first.wait(timeout=60), 0)
            self.assertEqual(self.files_of(output), [output])
            self.assertEqual(output.read_bytes(), whole)

    def files_of(self, output):
        """The output, and what is to become of it."""
        return [path for path in [output, *self.folder.glob(f".{output.name}.*")] if path.exists()]

    def measure(self, options, hint=False):
        """What a dry run says of memory, or what it gives as a hint, and the peak that the bake takes, MiB."""
        plan = subprocess.run([LPVBAKE, "bake", *options, "--dry-run", "--format=json"], cwd=self.folder, check=True,
                              stdout=subprocess.PIPE, text=True, timeout=60)
        process = self.start("bake", *options)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        self.assertEqual(process.returncode, 0)
        said = json.loads(plan.stdout)
        return (said["hints"]["memory_mib"] if hint else (said["host_bytes"] + said["device_bytes"]) / 2**20,
                usage.ru_maxrss / 1024)

    def test_a_shard_takes_no_more_memory_than_is_said(self):
        bake = [SCENE, "--bounds=-1,0,-9,1,2,9", "--margin=0", "--cell-size=0.04", "--sky=#8090ff,20", "--threads=2"]
        taken = {}
        for solver in (["--solver=gather"], ["--solver=sn", "--tile=32"]):
            for shard in ([], ["--shard=2/7"]):
                hint, peak = self.measure([*bake, *solver, *shard, "-o", "p.vdb"], hint=True)
                with self.subTest(solver=solver[0], shard=shard):
                    self.assertLess(peak, hint)
                    self.assertLess(hint, 4 * peak)  # it says something
                taken[solver[0], len(shard)] = peak
        for solver in ("--solver=gather", "--solver=sn"):
            self.assertLess(taken[solver, 1], 0.7 * taken[solver, 0])

    def test_what_is_said_of_memory_is_near_what_is_taken(self):
        """Of a hall, in which surfaces are near most cells, and of a box."""
        subprocess.run([sys.executable, pathlib.Path(SCENE).with_name("make_scenes.py"), self.folder], check=True)
        hall = ["hall.gltf", "--cell-size=0.15", "--sky=#8090ff,2000"]
        box = [SCENE, "--resolution=96"]
        for most, bake in ((1.3, [*hall, "--solver=gather"]), (1.3, [*hall, "--solver=gather", "--shard=2/4"]),
                           (1.3, [*box, "--solver=gather"]), (1.3, [*box, "--solver=lpv"]),
                           (1.3, [*box, "--solver=sn"])):
            said, peak = self.measure([*bake, "--threads=2", "-o", "p.vdb"])
            with self.subTest(bake=bake[1:]):
                self.assertLess(said, most * peak)
                self.assertGreater(said, 0.8 * peak)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
