#!/usr/bin/env python3
"""The program where a container or a limit leaves it little: no threads, little address space, a file system
that cannot be written, a user whom nobody knows. It does what it can, or says in one line why not, with exit
code 4 or 9; it never aborts or waits for ever.

Usage: containers_test.py LPVBAKE SCENE. As root the program runs as a user without any other process; else as
the user, whose processes count.
"""

import ctypes
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import unittest

LPVBAKE, SCENE = sys.argv[1:3]
IS_ROOT = os.geteuid() == 0
STRANGER, NOGROUP = 54321, 65534  # no row of passwd has the first


def threads_of_user():
    """All threads of this user, which its limit counts."""
    count = 0
    for status in pathlib.Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
        except OSError:
            continue
        if int(fields["Uid"].split()[0]) == os.getuid():
            count += int(fields["Threads"])
    return count


class Containers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        shutil.copy(SCENE, cls.folder / "room.gltf")
        cls.run_program(["bake", "room.gltf", "-o", "room.vdb", "--resolution", "6"], check=True)
        cls.folder.chmod(0o777)
        for file in cls.folder.iterdir():
            file.chmod(0o666)

    @classmethod
    def run_program(cls, arguments, before=None, check=False, program=(LPVBAKE,), env=None):
        return subprocess.run([*program, *arguments], cwd=cls.folder, capture_output=True, text=True, timeout=60,
                              preexec_fn=before, check=check, env=env)

    COMMANDS = {
        "info": ["info", "room.gltf"],
        "devices": ["devices"],
        "bake": ["bake", "room.gltf", "-o", "o.vdb", "--resolution", "6"],
        "bake on one": ["bake", "room.gltf", "-o", "o.vdb", "--resolution", "6", "--threads", "1"],
        "bake by lpv": ["bake", "room.gltf", "-o", "o.exr", "--resolution", "6", "--solver", "lpv"],
        "reference": ["reference", "room.gltf", "-o", "r.vdb", "--resolution", "4", "--rays", "64"],
        "render": ["render", "room.gltf", "room.vdb", "-o", "p.png", "--size", "32x32", "--samples", "1"],
        "render on one": ["render", "room.gltf", "room.vdb", "-o", "p.png", "--size", "32x32", "--samples", "1",
                          "--threads", "1"],
        "convert": ["convert", "room.vdb", "c.exr"],
    }

    @staticmethod
    def as_stranger():
        if IS_ROOT:
            os.setgroups([])
            os.setresgid(NOGROUP, NOGROUP, NOGROUP)
            os.setresuid(STRANGER, STRANGER, STRANGER)

    def limited(self, arguments, which, value):
        def limit():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(which, (value, value))
            self.as_stranger()
        return self.run_program(arguments, limit)

    def expect_done_or_told(self, result, codes, text=""):
        if result.returncode == 0:
            return
        self.assertIn(result.returncode, codes, result.stderr)
        self.assertRegex(result.stderr, r"\A(lpvbake: warning: [^\n]*\n)*lpvbake: error: [^\n]*\n\Z")
        self.assertIn(text, result.stderr)
        self.assertNotIn("repair", result.stderr)

    def test_few_threads(self):
        others = 0 if IS_ROOT else threads_of_user()
        done = {}
        for name, arguments in self.COMMANDS.items():
            for count in (1, 2, 3, 5, 6, 7, 8, 10, 14, 40):
                with self.subTest(command=name, threads=count):
                    result = self.limited(arguments, resource.RLIMIT_NPROC, others + count)
                    self.expect_done_or_told(result, (4, 9))
                    if result.returncode == 0:
                        done.setdefault(name, count)
        if IS_ROOT:  # nobody else counts
            print("threads that suffice:", done)
            self.assertEqual(set(done), set(self.COMMANDS))
            self.assertGreater(done["info"], 1)  # the limit bites
            # log4cplus, which OpenVDB brings, starts 4 as it is loaded, Mesa's driver for the CPU its queue's.
            self.assertLessEqual(done["info"], 6)
            self.assertLessEqual(done["bake on one"], 6)

    def test_little_address_space(self):
        bites = False
        for name in ("info", "devices", "bake", "bake by lpv", "render"):
            arguments = self.COMMANDS[name]
            for mebibytes in (850, 1000, 1200):
                with self.subTest(command=name, mebibytes=mebibytes):
                    result = self.limited(arguments, resource.RLIMIT_AS, mebibytes << 20)
                    if result.returncode == 127 and "shared librar" in result.stderr:
                        continue  # it did not even start
                    bites |= result.returncode != 0
                    self.expect_done_or_told(result, (4, 9))
        self.assertTrue(bites)

    def test_unknown_user_on_a_root_that_is_read_only(self):
        """Without a name, a home, or a place for caches and temporary files."""
        environment = {"PATH": os.environ["PATH"], "TMPDIR": "/nonexistent"}
        program, before = (LPVBAKE,), self.as_stranger
        script = ('mount --bind "$0" "$0" && mount -o remount,bind,ro / && cd "$0" && ! touch /lpvbake-probe 2>&- '
                  f'&& exec setpriv --reuid={STRANGER} --regid={NOGROUP} --clear-groups "$@"')
        if IS_ROOT and subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode == 0:
            program = ("unshare", "--mount", "sh", "-c", script, str(self.folder), LPVBAKE)
            before = None
        for name, arguments in self.COMMANDS.items():
            with self.subTest(command=name):
                result = self.run_program(arguments, before, program=program, env=environment)
                self.assertEqual(result.returncode, 0, result.stderr)
                self.assertEqual(result.stderr, "")
        # That nothing else may be written.
        result = self.run_program(["bake", "room.gltf", "-o", "/o.vdb", "--resolution", "6"], before,
                                  program=program, env=environment)
        self.assertEqual(result.returncode, 6, result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
