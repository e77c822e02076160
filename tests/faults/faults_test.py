#!/usr/bin/env python3
"""What is left when a bake cannot go on: the old file or the new one, the exit code that says why,
and no temporary file.

Usage: faults_test.py LPVBAKE SCENE LAYER_FOLDER, where the layer of vulkan_faults.cpp is.
"""

import ctypes
import json
import os
import pathlib
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

LPVBAKE, SCENE, LAYERS = sys.argv[1:4]
SMALL = ["--resolution", "8", "--threads", "1"]
LIBC = ctypes.CDLL(None, use_errno=True)


class Faults(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.output = self.folder / "light.vdb"
        self.output.write_bytes(b"old")

    def command(self, *more, output=None, solver="lpv"):
        return [LPVBAKE, "bake", SCENE, "-o", str(output or self.output), *SMALL, "--solver", solver,
                *more]

    def bake(self, *more, output=None, env=None, before=None, solver="lpv"):
        return subprocess.run(self.command(*more, output=output, solver=solver), capture_output=True, text=True,
                              env={**os.environ, **(env or {})}, preexec_fn=before, timeout=120)

    def expect_old_alone(self, names=("light.vdb",)):
        self.assertEqual(sorted(os.listdir(self.folder)), sorted(names))
        self.assertEqual(self.output.read_bytes(), b"old")

    def expect_failure(self, result, code, text):
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertRegex(result.stderr, r"\A(lpvbake: warning: [^\n]*\n)*lpvbake: error: [^\n]*\n\Z")
        self.assertIn(text, result.stderr)

    def test_full_disk(self):
        def full():  # files end at 2000 bytes
            resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
        for more in [], ["-o", str(self.folder / "more.exr")]:
            result = self.bake(*more, before=full)
            self.expect_failure(result, 6, ": cannot be written: File too large")
            self.expect_old_alone()

    def test_read_only_folder(self):
        def obey_modes():  # root too
            CAP_DAC_OVERRIDE, PR_CAPBSET_DROP = 1, 24
            LIBC.prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)
        self.folder.chmod(0o555)
        try:
            result = self.bake(before=obey_modes)
            self.expect_failure(result, 6, "cannot be written: Permission denied")
            self.expect_old_alone()
        finally:
            self.folder.chmod(0o755)

    def test_folder_that_takes_no_files(self):
        result = self.bake(output="/proc/light.vdb")
        self.expect_failure(result, 2, "/proc/light.vdb: cannot be written: ")

    def test_missing_folder(self):
        result = self.bake(output=self.folder / "gone" / "light.vdb")
        self.expect_failure(result, 2, "its folder does not exist")
        self.expect_old_alone()

    def stages(self):
        """The lines that tell of a stage's beginning."""
        process = subprocess.run(self.command("--progress", "plain", output=self.folder / "a.vdb"),
                                 capture_output=True, text=True, timeout=120)
        self.assertEqual(process.returncode, 0, process.stderr)
        os.unlink(self.folder / "a.vdb")
        return [line for line in process.stderr.splitlines() if " 0 %, " in line]

    def test_killed_at_every_stage(self):
        codes = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL}
        stages = self.stages()
        self.assertGreater(len(stages), 5)
        ended = dict.fromkeys(codes, 0)
        for at in range(len(stages)):
            for number, code in codes.items():
                self.output.write_bytes(b"old")
                process = subprocess.Popen(self.command("--progress", "plain"), text=True,
                                           stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
                begun = 0
                while begun <= at and (line := process.stderr.readline()):
                    begun += " 0 %, " in line
                process.send_signal(number)
                process.stderr.read()
                process.stderr.close()
                status = process.wait(timeout=120)
                with self.subTest(stage=stages[at], signal=number):
                    if status == 0:  # it was done before the signal was looked at
                        self.assertNotEqual(self.output.read_bytes(), b"old")
                    else:
                        self.assertEqual(status, code)
                        self.assertEqual(self.output.read_bytes(), b"old")
                        ended[number] += 1
                    if number != signal.SIGKILL or status == 0:
                        self.assertEqual(os.listdir(self.folder), ["light.vdb"])
                    for left in set(os.listdir(self.folder)) - {"light.vdb"}:
                        os.unlink(self.folder / left)  # by SIGKILL: the next may end before it writes
        for number, count in ended.items():
            self.assertGreater(count, len(stages) // 2, number)
        self.assertEqual(self.bake().returncode, 0)
        self.assertEqual(os.listdir(self.folder), ["light.vdb"])

    def interrupt_reference(self, begun, number):
        """Sends the signal once so many passes have begun; the exit code and standard error."""
        command = [LPVBAKE, "reference", SCENE, "-o", str(self.output), "-e", str(self.folder / "error.vdb"),
                   "--resolution", "8", "--noise", "0.0001%", "--threads", "1", "--progress", "plain"]
        process = subprocess.Popen(command, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = []
        for line in process.stderr:
            said.append(line)
            if sum(": trace " in one and " 0 %, " in one for one in said) == begun:
                process.send_signal(number)
                begun = -1
        process.stderr.close()
        return process.wait(timeout=120), said

    def test_reference_keeps_whole_passes(self):
        for number, expected in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            with self.subTest(signal=number):
                self.output.write_bytes(b"old")
                code, said = self.interrupt_reference(3, number)
                self.assertEqual(code, expected)
                self.assertRegex(said[-1], r"\Alpvbake: error: interrupted at a noise of [0-9.]+ %; the files are whole\n")
                self.assertEqual(sorted(os.listdir(self.folder)), ["error.vdb", "light.vdb"])
                told = subprocess.run([LPVBAKE, "info", self.output, "--format", "json"], capture_output=True,
                                      text=True, timeout=120)
                self.assertEqual(told.returncode, 0, told.stderr)
                metadata = json.loads(told.stdout)["metadata"]
                # What the first passes brought; a pass may end before the signal is looked at.
                self.assertIn(int(metadata["rays"]), [256 << n for n in range(1, 12)])
                self.assertGreater(float(metadata["noise"]), 0)

    def test_reference_without_a_whole_pass(self):
        code, said = self.interrupt_reference(1, signal.SIGINT)
        if code == 130 and said[-1] == "lpvbake: error: interrupted\n":
            self.expect_old_alone()
        else:  # the pass was done before the signal was looked at
            self.assertIn("the files are whole", said[-1])

    def test_killed_while_writing(self):
        """What a killed process leaves is gone after the next run."""
        command = [LPVBAKE, "bake", SCENE, "-o", str(self.folder / "light.exr"), "-o",
                   str(self.output), "--resolution", "48", "--solver", "lpv", "--iterations", "1"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None:
            if any(name.endswith(".tmp") for name in os.listdir(self.folder)):
                process.kill()
                break
        self.assertEqual(process.wait(), -signal.SIGKILL)
        left = os.listdir(self.folder)
        self.assertTrue(any(name.endswith(".tmp") for name in left), left)
        self.assertEqual(self.output.read_bytes(), b"old")
        self.assertEqual(self.bake("-o", str(self.folder / "light.exr")).returncode, 0)
        self.assertFalse([name for name in os.listdir(self.folder) if name.startswith(".")])

    def test_device_fails(self):
        layer = {"VK_LAYER_PATH": LAYERS, "VK_INSTANCE_LAYERS": "VK_LAYER_LPVBAKE_test_faults"}
        fine = self.folder / "fine.vdb"
        self.assertEqual(self.bake(env=layer, output=fine).returncode, 0)
        fine.unlink()
        for kind, code, text in (("lost", 8, "lost"), ("memory", 9, "memory")):
            for solver, call in ("lpv", 1), ("lpv", 4), ("gather", 1), ("gather", 2), ("sn", 1), ("sn", 3):
                with self.subTest(kind=kind, solver=solver, call=call):
                    result = self.bake(solver=solver,
                                       env={**layer, "LPVBAKE_TEST_FAULT": f"{kind}:{call}"})
                    self.expect_failure(result, code, text)
                    self.expect_old_alone()

    def test_two_at_once(self):
        alone = self.folder / "alone.vdb"
        self.assertEqual(self.bake(output=alone).returncode, 0)
        results = []
        threads = [threading.Thread(target=lambda: results.append(self.bake())) for _ in range(2)]
        for thread in threads:
            thread.start()
        seen = set()
        while any(thread.is_alive() for thread in threads):
            seen.add(self.output.read_bytes())
            time.sleep(0.001)
        for thread in threads:
            thread.join()
        self.assertEqual([result.returncode for result in results], [0, 0])
        whole = alone.read_bytes()
        self.assertLessEqual(seen, {b"old", whole})
        self.assertEqual(self.output.read_bytes(), whole)
        self.assertEqual(sorted(os.listdir(self.folder)), ["alone.vdb", "light.vdb"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
