"""Packages of the npm registry, each fetched once."""

import hashlib
import pathlib
import tarfile
import tempfile
import urllib.request


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
