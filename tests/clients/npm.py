"""Packages of the npm registry, each fetched once."""

import hashlib
import pathlib
import tarfile
import tempfile
import urllib.request


KTX_PARSE = ("ktx-parse", "2.0.0", "608908d207488fb8500ed001aab046e78fc677238e4f867023a75f2d248baba1")
ZSTDDEC = ("zstddec", "0.3.4", "dd71c2fe89a595d47cab9e9ee89829aed07e5cec7b4b1be4202a4e97f5ef4fd3")
BABYLON = ("babylonjs", "9.28.0", "d50d748496610b2e1d5671fda687be9349e0902a7058c264fade9086c9bf95ac")
BABYLON_LOADERS = ("babylonjs-loaders", "9.28.0",
                   "7be282a57a9c023c9f742a9b19d27b63643805083b1e905224fbf8fe4d5a44b8")
PLAYCANVAS = ("playcanvas", "2.23.3", "02d004937bc7f96c2a2473c336f5c2420c79b2b459af15ff991d6cac14a8bc97")
GLTF_VALIDATOR = ("gltf-validator", "2.0.0-dev.3.10",
                  "4e03dbdc3bc0d1342afd5d2d7ae341a7e3474502ccb872b02dbbaddaee0fdec6")


def package(cache, name, version, sha256):
    """The unpacked package, in the folder `cache`."""
    folder = pathlib.Path(cache) / f"{name}-{version}"
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        address = f"https://registry.npmjs.org/{name}/-/{name}-{version}.tgz"
        data = urllib.request.urlopen(address, timeout=120).read()
        if hashlib.sha256(data).hexdigest() != sha256:
            raise AssertionError(f"{address} is not what it was")
        with tempfile.TemporaryDirectory(dir=cache) as unpacked:
            archive = pathlib.Path(unpacked) / "package.tgz"
            archive.write_bytes(data)
            with tarfile.open(archive) as tar:
                tar.extractall(unpacked)
            (pathlib.Path(unpacked) / "package").rename(folder)
    return folder


def three(cache):
    return package(cache, "three", "0.187.0",
                   "ff540832ded0cfe919764d24a3d88f3e2a05f23303f876423e4f893841e90728")
