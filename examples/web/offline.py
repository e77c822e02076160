#!/usr/bin/env python3
"""Pages that need no network: copies those of three.js, Babylon.js and PlayCanvas into a folder, beside the
packages that they take from a CDN otherwise, which come from the npm registry, once.

Usage: offline.py FOLDER

Serve the folder, and open threejs/, babylon/ or playcanvas/ with ?scene=../room.glb&volume=../room_atlas.ktx2.
"""

import hashlib
import pathlib
import re
import shutil
import sys
import tarfile
import tempfile
import urllib.request

EXAMPLES = pathlib.Path(__file__).resolve().parents[1]
PAGES = ("threejs", "babylon", "playcanvas")
CDN = "https://cdn.jsdelivr.net/npm/"
# SHA-256 of the registry's archives, by name and version.
PACKAGES = {
    ("three", "0.187.0"): "ff540832ded0cfe919764d24a3d88f3e2a05f23303f876423e4f893841e90728",
    ("ktx-parse", "2.0.0"): "608908d207488fb8500ed001aab046e78fc677238e4f867023a75f2d248baba1",
    ("zstddec", "0.3.4"): "dd71c2fe89a595d47cab9e9ee89829aed07e5cec7b4b1be4202a4e97f5ef4fd3",
    ("babylonjs", "9.28.0"): "d50d748496610b2e1d5671fda687be9349e0902a7058c264fade9086c9bf95ac",
    ("babylonjs-loaders", "9.28.0"): "7be282a57a9c023c9f742a9b19d27b63643805083b1e905224fbf8fe4d5a44b8",
    ("playcanvas", "2.23.3"): "02d004937bc7f96c2a2473c336f5c2420c79b2b459af15ff991d6cac14a8bc97",
}


def package(folder, name, version, sha256):
    """The package, unpacked in the folder as NAME-VERSION. RuntimeError where the registry has another one."""
    own = pathlib.Path(folder) / f"{name}-{version}"
    if not own.exists():
        own.parent.mkdir(parents=True, exist_ok=True)
        address = f"https://registry.npmjs.org/{name}/-/{name}-{version}.tgz"
        data = urllib.request.urlopen(address, timeout=120).read()
        if hashlib.sha256(data).hexdigest() != sha256:
            raise RuntimeError(f"{address} is not what it was")
        with tempfile.TemporaryDirectory(dir=folder) as unpacked:
            archive = pathlib.Path(unpacked) / "package.tgz"
            archive.write_bytes(data)
            with tarfile.open(archive) as tar:
                tar.extractall(unpacked)
            (pathlib.Path(unpacked) / "package").rename(own)
    return own


def page(name, place):
    """The text of a page that takes packages from where `place(name, version)` says."""
    text = (EXAMPLES / name / "index.html").read_text()
    return re.sub(re.escape(CDN) + r"([^/@]+)@([^/]+)/", lambda found: place(*found.groups()), text)


def main(folder):
    def place(name, version):
        own = package(folder / "packages", name, version, PACKAGES[name, version])
        return f"../packages/{own.name}/"

    for name in PAGES:
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "index.html").write_text(page(name, place))
    (folder / "web").mkdir(exist_ok=True)
    for script in (EXAMPLES / "web").glob("*.js"):
        shutil.copy(script, folder / "web")


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
