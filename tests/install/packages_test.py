#!/usr/bin/env python3
"""What cpack makes, on a bare Debian bookworm without a compiler: the .deb, which brings all that it runs
on; the .tar.zst, anywhere, beside a Vulkan driver; and by examples/Containerfile's own words, that neither
a home nor a place to write to is needed. Each bakes the Cornell box in one command; and both files have
the same bytes.

Usage: packages_test.py BUILD_FOLDER EXAMPLES

Runs as root, and takes packages from Debian's mirror.
"""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

BUILD, EXAMPLES = (pathlib.Path(argument) for argument in sys.argv[1:])
TOOLS = ("gcc", "g++", "cc", "clang", "make", "ninja", "cmake")


def run(*command, **options):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True, **options)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stdout}\n{result.stderr}")
    return result.stdout


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        run("cpack", "--config", BUILD / "CPackConfig.cmake", "-B", cls.folder / "packages")
        cls.deb, = (cls.folder / "packages").glob("*.deb")
        cls.archive, = (cls.folder / "packages").glob("*.tar.zst")
        print(f"{cls.deb.name}: {cls.deb.stat().st_size / 2**20:.1f} MiB; "
              f"{cls.archive.name}: {cls.archive.stat().st_size / 2**20:.1f} MiB")
        # The driver is the one thing that an archive cannot bring.
        cls.root = cls.debian("root", "--include=mesa-vulkan-drivers")
        shutil.copy(EXAMPLES / "cornell_box.gltf", cls.root / "tmp")

    @classmethod
    def debian(cls, name, *packages):
        """A bare Debian, with the processes that programs ask for."""
        root = cls.folder / name
        run("mmdebstrap", "--variant=minbase", *packages, "bookworm", root)
        run("mount", "-t", "proc", "proc", root / "proc")
        cls.addClassCleanup(run, "umount", root / "proc")
        shutil.copy("/etc/resolv.conf", root / "etc")
        return root

    def within(self, *command, user="nobody"):
        return run("chroot", "--userspec", user, self.root, *command,
                   env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "DEBIAN_FRONTEND": "noninteractive"})

    def bake(self, program, name):
        """The bytes of what it bakes, as a user without a home."""
        out = self.root / name
        out.mkdir()
        os.chmod(out, 0o777)
        self.within(program, "bake", "/tmp/cornell_box.gltf", "-o", f"/{name}/a.vdb", "-o", f"/{name}/a.ktx2",
                    "--resolution", "16")
        self.within(program, "info", f"/{name}/a.vdb", "--slice", "y=8", "-o", f"/{name}/a.png")
        return {file.name: file.read_bytes() for file in sorted(out.iterdir())}

    def test_both_packages_bake_on_a_bare_root(self):
        for tool in TOOLS:
            with self.assertRaises(AssertionError, msg=tool):
                self.within("which", tool)
        with self.assertRaises(AssertionError):
            self.within("/opt/none/bin/lpvbake", "--version")
        run("tar", "--zstd", "-xf", self.archive, "-C", self.root / "opt")
        unpacked, = (self.root / "opt").iterdir()
        moved = self.root / "srv/anywhere"
        unpacked.rename(moved)
        of_archive = self.bake("/srv/anywhere/bin/lpvbake", "of_archive")
        shutil.rmtree(moved)

        shutil.copy(self.deb, self.root / "tmp/lpvbake.deb")
        self.within("apt-get", "update", user="root")
        self.within("apt-get", "install", "-y", "--no-install-recommends", "/tmp/lpvbake.deb", user="root")
        of_deb = self.bake("lpvbake", "of_deb")
        self.assertEqual(of_deb, of_archive)
        self.assertGreater(len(of_deb), 10)
        for tool in TOOLS:
            with self.assertRaises(AssertionError, msg=tool):
                self.within("which", tool)

    def test_the_container_bakes_read_only_and_alone(self):
        """Does what examples/Containerfile says, then what `podman run --read-only --network none -v OUT:/work`
        does, but for a /tmp in memory: there is none."""
        root, environment = self.debian("container"), {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
        text = (EXAMPLES / "Containerfile").read_text().replace("\\\n", " ")
        said = {}
        for line in text.splitlines():
            word, _, rest = line.partition(" ")
            if word == "COPY":
                pattern, folder = rest.split()
                self.assertTrue(self.deb.match(pattern))
                shutil.copy(self.deb, root / folder.lstrip("/"))
            elif word == "RUN":
                run("chroot", root, "sh", "-c", rest, env=environment)
            elif word and word != "#":
                said[word] = rest
        self.assertEqual(set(said), {"FROM", "USER", "WORKDIR", "ENTRYPOINT"})
        self.assertEqual(said["FROM"], "debian:bookworm-slim")
        (root / said["WORKDIR"].lstrip("/")).mkdir()
        work = self.folder / "work"
        work.mkdir()
        os.chmod(work, 0o777)
        shutil.copy(EXAMPLES / "cornell_box.gltf", work)
        inside = """mount --rbind "$1" "$1" && mount -o remount,bind,ro "$1" && mount --bind "$2" "$1$4" || exit 99
            at=$1 user=$3 to=$4; shift 4; exec chroot --userspec "$user" "$at" sh -c 'cd "$0" && exec "$@"' "$to" "$@" """

        def container(*arguments):
            return run("unshare", "--mount", "--net", "sh", "-c", inside, "sh", root, work, said["USER"], said["WORKDIR"],
                       *json.loads(said["ENTRYPOINT"]), *arguments, env=environment)

        bake = ["bake", "cornell_box.gltf", "--resolution", "16", "-o"]
        self.assertIn("device        llvmpipe", container(*bake, "a.vdb"))
        container("info", "a.vdb", "--slice", "y=8", "-o", "a.png")
        self.assertEqual({file.name for file in work.iterdir()}, {"cornell_box.gltf", "a.vdb", "a.png"})
        with self.assertRaisesRegex(AssertionError, "ended with 6(.|\n)*Read-only file system"):
            container(*bake, "/tmp/a.vdb")
        run(BUILD / "lpvbake", *bake, work / "b.vdb", cwd=EXAMPLES)
        self.assertEqual((work / "a.vdb").read_bytes(), (work / "b.vdb").read_bytes())

    def test_help_for_man_and_shells_is_in_the_package(self):
        listed = run("dpkg-deb", "--contents", self.deb)
        for file in ("man/man1/lpvbake.1", "man/man1/lpvbake-bake.1", "bash-completion/completions/lpvbake",
                     "zsh/vendor-completions/_lpvbake", "fish/vendor_completions.d/lpvbake.fish",
                     "lpvbake/examples/cornell_box.gltf"):
            self.assertRegex(listed, rf"\./usr/share/{re.escape(file)}\b")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
