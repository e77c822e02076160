"""Packages of the npm registry, each fetched once: those of the pages in examples/, and one for tests alone."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples/web"))
import offline
from offline import package

GLTF_VALIDATOR = ("gltf-validator", "2.0.0-dev.3.10",
                  "4e03dbdc3bc0d1342afd5d2d7ae341a7e3474502ccb872b02dbbaddaee0fdec6")


def of_pages(cache, name):
    """The package that the pages in examples/ take."""
    return next(package(cache, name, version, sha256)
                for (own, version), sha256 in offline.PACKAGES.items() if own == name)


def three(cache):
    return of_pages(cache, "three")
