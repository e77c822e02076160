#!/usr/bin/env python3
"""Rows of a world on machines that fail, share files and are bound: what is there in the end is what
one undisturbed run leaves.

Usage: rows_test.py LPVBAKE
"""

import base64
import collections
import hashlib
import heapq
import json
import os
import pathlib
import random
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

LPVBAKE = sys.argv[1]
OPTIONS = "--sun 20,70,9000 --solver gather --quality fast --threads 2"


def street(path, nx, nz=1, dense=()):
    """Blocks on a floor in parts, 12 m apart; where `dense` says so, 200 small ones instead of one."""
    corners = [1.0 if corner & bit else -1.0 for corner in range(8) for bit in (1, 2, 4)]
    indices = [0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6]
    data = struct.pack("24f", *corners) + struct.pack("36H", *indices)
    nodes = []
    for x in range(nx):
        for z in range(nz):
            nodes.append({"translation": [12 * x + 6, -0.5, 12 * z + 6], "scale": [6, 0.5, 6]})
            if (x, z) not in dense:
                nodes.append({"translation": [12 * x + 6, 2, 12 * z + 6], "scale": [1.5, 2, 2.5]})
                continue
            for i in range(200):
                nodes.append({"translation": [12 * x + 1 + i % 20 / 2, 1, 12 * z + 1 + i // 20], "scale": [0.1, 1, 0.2]})
    for node in nodes:
        node["mesh"] = 0
    path.write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.6, 0.5, 1]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "buffers": [{"byteLength": len(data),
                     "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-1, -1, -1],
                       "max": [1, 1, 1]},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}]}))


class Rows(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.root = pathlib.Path(temporary.name)
        street(cls.root / "street.gltf", 3)
        cls.whole = cls.plan_in("whole")
        cls.seconds = -time.monotonic()
        cls.bake(cls.whole)
        cls.seconds += time.monotonic()

    @classmethod
    def plan_in(cls, folder, scene="street.gltf", options=OPTIONS, tile=16, cell="0.75"):
        (cls.root / folder).mkdir()
        plan = cls.root / folder / "w.world.json"
        subprocess.run([LPVBAKE, "world", cls.root / scene, "-o", plan, "--cell-size", cell, "--tile", str(tile),
                        "--surroundings", "8", "--scenario", f"noon:{options}", "-q"], check=True,
                       stdout=subprocess.DEVNULL, timeout=120)
        return plan

    @staticmethod
    def command(plan, *more):
        return [LPVBAKE, "world", plan, "--rows", "0-99", "--format", "json", "-q", *more]

    @classmethod
    def bake(cls, plan):
        """How many rows were baked."""
        done = subprocess.run(cls.command(plan), check=True, stdout=subprocess.PIPE, text=True, timeout=120)
        return sum(row["made"] for row in json.loads(done.stdout)["rows"])

    def hashes(self, plan):
        return {path.name: hashlib.sha256(path.read_bytes()).hexdigest()
                for path in plan.parent.iterdir() if path != plan}

    def test_killed_at_any_moment_no_row_is_lost(self):
        plan = self.plan_in("killed")
        moments = random.Random(7)
        ended = collections.Counter()
        good = self.hashes(self.whole)
        for at, number in enumerate([signal.SIGKILL] * 12 + [signal.SIGTERM] * 6):
            for path in plan.parent.glob("*.vdb"):
                path.unlink()
            known = set(os.listdir(plan.parent))
            process = subprocess.Popen(self.command(plan), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            if at % 2 == 0:  # the others while one is written
                time.sleep(moments.uniform(0, 0.9 * self.seconds))
            else:
                while process.poll() is None and known.issuperset(os.listdir(plan.parent)):
                    pass
            process.send_signal(number)
            asked = time.monotonic()
            code = process.wait(timeout=60)
            ended[code] += 1
            if number == signal.SIGTERM and code == 143:
                self.assertLess(time.monotonic() - asked, 2)
            for name, value in self.hashes(plan).items():  # whole, or under a name that nothing reads
                if name.endswith(".vdb"):
                    self.assertEqual(value, good[name])
        self.assertGreater(ended[-signal.SIGKILL], 6, ended)
        self.assertGreater(ended[143], 3, ended)
        self.bake(plan)
        self.assertEqual(self.hashes(plan), good)

    def test_only_what_is_damaged_is_baked_again(self):
        plan = self.plan_in("damaged")
        self.assertEqual(self.bake(plan), 3)
        self.assertEqual(self.bake(plan), 0)
        files = sorted(plan.parent.glob("*.vdb"))
        whole = [path.read_bytes() for path in files]
        places = random.Random(1)
        for damage in range(6):
            data = bytearray(whole[1])
            if damage == 0:
                del data[places.randrange(len(data)):]
            else:
                data[places.randrange(len(data))] ^= 1 << places.randrange(8)
            files[1].write_bytes(data)
            checked = subprocess.run([LPVBAKE, "world", plan, "--check"], stdout=subprocess.PIPE,
                                     stderr=subprocess.DEVNULL, text=True, check=False, timeout=60)
            self.assertEqual(checked.returncode, 3)
            self.assertRegex(checked.stdout, r"fault +row 1 \(noon, .*is damaged")
            self.assertEqual(self.bake(plan), 1)
            self.assertEqual([path.read_bytes() for path in files], whole)

    def test_two_may_bake_a_row_at_once(self):
        plan = self.plan_in("twice")
        pair = [subprocess.Popen(self.command(plan), stdout=subprocess.DEVNULL) for _ in range(2)]
        self.assertEqual([process.wait(timeout=120) for process in pair], [0, 0])
        self.assertEqual(self.hashes(plan), self.hashes(self.whole))

    def test_threads_are_those_that_the_process_is_bound_to(self):
        def hinted(*before):
            done = subprocess.run([*before, LPVBAKE, "bake", self.root / "street.gltf", "--sun", "20,70,9000", "-o",
                                   self.root / "none.vdb", "--dry-run", "--format", "json"], check=True,
                                  stdout=subprocess.PIPE, text=True, timeout=60)
            return json.loads(done.stdout)["hints"]["threads"]
        processors = sorted(os.sched_getaffinity(0))
        self.assertEqual(hinted("taskset", "-c", str(processors[0])), 1)
        if len(processors) > 1:
            self.assertEqual(hinted("taskset", "-c", f"{processors[0]},{processors[1]}"), 2)

    def test_a_row_takes_no_more_memory_than_is_said(self):
        plan = self.plan_in("memory")
        for number, row in enumerate(json.loads(plan.read_text())["rows"]):
            options = ["--cell-size=0.75", "--bounds=" + ",".join(map(str, row["bounds"])), "--margin=1",
                       "--surroundings=8", *OPTIONS.split(), "-o", self.root / "none.vdb", "--format", "json"]
            planned = subprocess.run([LPVBAKE, "bake", self.root / "street.gltf", *options, "--dry-run"], check=True,
                                     stdout=subprocess.PIPE, text=True, timeout=60)
            process = subprocess.Popen([LPVBAKE, "world", plan, "--rows", str(number), "-q"], stdout=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            self.assertEqual(process.returncode, 0)
            said = json.loads(planned.stdout)["hints"]["memory_mib"]
            self.assertLess(usage.ru_maxrss / 1024, said)
            self.assertLess(said, 8 * usage.ru_maxrss / 1024)  # it says something

    def test_ten_thousand_rows_are_planned_at_once(self):
        street(self.root / "large.gltf", 100, 50)  # of tiles two high
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        plan = self.plan_in("large", "large.gltf", tile=8, cell="1.5")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        rows = json.loads(plan.read_text())["rows"]
        self.assertEqual(len(rows), 10000)
        self.assertEqual(len({row["tile"] for row in rows}), 10000)
        self.assertEqual(len({tuple(row["bounds"]) for row in rows}), 10000)
        self.assertLess(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, 2)

    def test_one_full_corner_holds_no_one_up(self):
        corner = {(x, z) for x in range(2) for z in range(2)}
        street(self.root / "corner.gltf", 8, 8, corner)
        rows = json.loads(self.plan_in("corner", "corner.gltf").read_text())["rows"]
        self.assertEqual(len(rows), 64)
        cost = [row["seconds"] for row in rows]
        self.assertGreater(max(cost), 1.5 * min(cost))  # the plan knows of it
        slots = [0.0] * 16
        for seconds in cost:  # as a scheduler hands them out
            heapq.heappush(slots, heapq.heappop(slots) + seconds)
        self.assertLess(max(slots), 1.3 * sum(slots) / len(slots))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
