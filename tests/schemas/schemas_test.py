#!/usr/bin/env python3
"""Every JSON document of the program, held against the schema beside this file that says what is in
it. A key that the schema does not name is a failure, and so is one that is missing.

Usage: schemas_test.py LPVBAKE HARD_CASES CORNELL_BOX
"""

import copy
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import jsonschema

LPVBAKE, HARD_CASES, SCENE = sys.argv[1:4]
SCHEMAS = pathlib.Path(__file__).resolve().parent
LOADED = {path.stem: json.loads(path.read_text()) for path in SCHEMAS.glob("*.json")}
SMALL = ["--threads", "1", "--resolution", "8"]
# Members that are there after one option alone.
OPTIONAL = [("bake", "fit"), ("convert", "fit"), ("bake", "verified"), ("bake", "points"),
            ("bake", "medium"), ("bake_dry_run", "medium"),
            ("bake_dry_run", "points"), ("bake", "storage"), ("bake_dry_run", "storage"),
            ("bake", "levels"), ("bake_dry_run", "levels"), ("bake", "bricks"),
            ("bake_dry_run", "bricks"), ("bricks", "atlas"), ("bricks", "file"),
            ("bake", "volumes"), ("bake_dry_run", "volumes"),
            ("bake", "shard"), ("bake_dry_run", "shard"), ("bake", "layers"), ("bake", "layers_grid"), ("bake_dry_run", "layers_grid"),
            ("bake", "suns_held_out"), ("layers", "sun"),
            ("bake_dry_run", "layers"), ("info_volume", "layers"), ("light", "shard")]
TARGETS = ["generic", "unity", "threejs", "vrc", "bevy"]  # each packing once


def validator(name):
    resolver = jsonschema.RefResolver(base_uri="", referrer=LOADED[name],
                                      store={f"{stem}.json": schema for stem, schema in LOADED.items()})
    return jsonschema.Draft202012Validator(LOADED[name], resolver=resolver)


def objects(document):
    """Every object in the document."""
    if isinstance(document, dict):
        yield document
    for part in document.values() if isinstance(document, dict) else document:
        if isinstance(part, (dict, list)):
            yield from objects(part)


class Documents(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.documents = []  # (schema, what was run, document)
        shutil.copy(SCENE, cls.folder / "box.gltf")
        subprocess.run([HARD_CASES, cls.folder], check=True)
        (cls.folder / "suite.json").write_text(json.dumps({"cases": [
            {"name": "box", "reason": "a case", "scene": "box.gltf", "truth": "reference", "limits": {"sn": {"error": 1}},
             "options": {"resolution": 8, "probes": 20, "rays": 64, "noise": 1}}]}))
        cls.run_program()

    @classmethod
    def run_one(cls, schema, *arguments, status=0):
        command = [LPVBAKE, *arguments, "--format", "json"]
        result = subprocess.run(command, cwd=cls.folder, capture_output=True, text=True, timeout=120)
        if result.returncode != status:
            raise AssertionError(f"{command}: status {result.returncode}\n{result.stderr}")
        cls.documents.append((schema, " ".join(command), json.loads(result.stdout)))

    @classmethod
    def run_program(cls):
        run = cls.run_one
        run("devices", "devices")
        run("help", "help")
        for path in sorted(cls.folder.glob("*.gltf")):
            run("info_scene", "info", path.name)

        bake = ["bake", "box.gltf", *SMALL]
        run("bake", *bake, "-o", "sn.vdb", "-o", "sn.exr", "--fit", "surfaces")
        run("bake_unchanged", *bake, "-o", "sn.vdb", "-o", "sn.exr", "--fit", "surfaces", "--if-changed")
        stored = ["bake", "box.gltf", "--threads", "1", "-o", "stored.ktx2", "--bytes", "100k"]
        run("bake", *stored)
        run("bake_dry_run", *stored, "--dry-run")
        run("rebake", "rebake", "sn.vdb", "box.gltf", "--threads", "1")
        run("bake", *bake, "-o", "verified.vdb", "--verify", "8")
        verify = ["verify", "verified.vdb", "box.gltf", "--threads", "1", "--points", "8"]
        run("verify", *verify)
        run("verify", *verify, "--fail", "0.01%", status=7)
        run("bake", *bake, "-o", "gather.vdb", "--solver", "gather", "--sky", "#ffffff,10")
        run("bake", *bake, "-o", "lpv.vdb", "--solver", "lpv")
        (cls.folder / "points.json").write_text('{"points": [[0, 1, 0], [0.5, 1, 0]]}')
        points = ["bake", "box.gltf", "--threads", "1", "--cell-size", "0.25", "--at", "points.json", "-o", "lit.json"]
        run("bake", *points)
        run("bake_dry_run", *points, "--dry-run")
        levels = ["bake", "box.gltf", "--threads", "1", "--cell-size", "0.2", "--levels", "2", "--focus",
                  "-0.4,0,-0.4,0.4,0.4,0.4", "-o", "set.vdb"]
        run("bake", *levels)
        run("bake_dry_run", *levels, "--dry-run")
        run("info_levels", "info", "set.levels.json")
        run("diff_levels", "diff", "set.levels.json", "set.levels.json")
        run("convert", "convert", "set.levels.json", "flat.vdb", "--flatten", "0.2")
        cls.documents.append(("levels", "set.levels.json",
                              json.loads((cls.folder / "set.levels.json").read_text())))
        layers = [*bake, "-o", "layered.vdb", "--solver", "gather",
                  "--layers", "lights,transfer:1,suns:3@48.1,11.6,06-21", "--sky", "#ffffff,10"]
        run("bake", *layers)
        run("bake_dry_run", *layers, "--dry-run")
        run("info_volume", "info", "layered.vdb")
        run("bake", *layers, "--layers-level", "1")
        run("bake_dry_run", *layers, "--layers-level", "1", "--dry-run")
        shard = ["box.gltf", *SMALL, "--solver", "gather"]
        run("light", "light", *shard, "-o", "box.lit")
        run("bake", "bake", *shard, "--lit", "box.lit", "--shard", "1/1", "-o", "part.vdb")
        run("bake_dry_run", "bake", *shard, "--shard", "1/1", "-o", "part.vdb", "--dry-run")
        run("merge", "merge", "part.vdb", "-o", "merged.vdb")
        run("light", "light", *shard, "--shard", "1/1", "-o", "part.lit")
        run("merge_light", "merge", "part.lit", "-o", "merged.lit")
        run("mix", "mix", "layered.vdb", "sky=0.6:0.8:1,5", "-o", "mixed.vdb")
        cls.documents.append(("layers", "layered.layers.json",
                              json.loads((cls.folder / "layered.layers.json").read_text())))
        bricks = ["bake", "box.gltf", "--threads", "1", "--adaptive", "0.25..0.25", "-o", "bricks.exr"]
        run("bake", *bricks, "-o", "sparse.vdb")
        run("bake_dry_run", *bricks, "--dry-run")
        run("info_bricks", "info", "bricks.levels.json")
        run("diff_levels", "diff", "bricks.levels.json", "sparse.levels.json")
        for name in ("bricks", "sparse"):
            cls.documents.append(("bricks", f"{name}.levels.json",
                                  json.loads((cls.folder / f"{name}.levels.json").read_text())))
        rooms = ["bake", "box.gltf", "--threads", "1", "--cell-size", "0.25", "--volume", "low=-1,0,-1,1,1,1",
                 "--volume", "high=-1,1,-1,1,2,1:0.5", "-o", "rooms.vdb"]
        run("bake", *rooms)
        run("bake_dry_run", *rooms, "--dry-run")
        run("info_volumes", "info", "rooms.volumes.json")
        run("diff_volumes", "diff", "rooms.volumes.json", "rooms.volumes.json")
        cls.documents.append(("volumes", "rooms.volumes.json",
                              json.loads((cls.folder / "rooms.volumes.json").read_text())))
        run("bake_dry_run", *bake, "-o", "none.vdb", "--dry-run")
        run("bake_dry_run", *bake, "-o", "none.vdb", "--dry-run", "--solver", "lpv")
        reference = ["reference", "box.gltf", *SMALL, "--rays", "16", "--noise", "1"]
        run("reference", *reference, "-o", "reference.vdb")
        run("reference", *reference, "-o", "all.vdb", "--bounces", "inf", "--probes", "10")

        run("bake", *bake, "-o", "lit.glb", "--fit", "surfaces")
        run("info_scene", "info", "lit.glb", "--slice", "z=3", "-o", "slice.png")
        run("info_volume", "info", "sn.vdb")
        run("info_volume", "info", "lpv.vdb", "--slice", "z=3", "-o", "slice.png")
        run("diff", "diff", "sn.vdb", "sn.exr")
        run("diff", "diff", "sn.vdb", "lpv.vdb", "-o", "difference.vdb", status=7)
        run("convert", "convert", "sn.vdb", "packed.ktx2", "--precision", "unorm8")
        run("diff", "diff", "packed.ktx2", "sn.vdb", "--fail", "100%")
        run("diff", "diff", "gather.vdb", "reference.vdb", "--fail", "1%", "--warn", "0.1%", "--slice", "z=3", "-o",
            "error.png", status=7)
        for target in TARGETS:
            run("convert", "convert", "sn.vdb", f"{target}.exr", "--target", target)
            text = (cls.folder / f"{target}.json").read_text()
            cls.documents.append(("sidecar", f"{target}.json", json.loads(text)))
        for target, precision in (("generic", "rgb9e5"), ("threejs", "half"), ("bevy", "float"),
                                  ("houdini", "unorm8"), ("blender", "bc6h")):
            run("convert", "convert", "sn.vdb", f"{target}.dds", "--target", target, "--precision", precision)
            text = (cls.folder / f"{target}.dds.json").read_text()
            cls.documents.append(("sidecar", f"{target}.dds.json", json.loads(text)))

        render = ["render", "box.gltf", "sn.vdb", "--threads", "1", "--size", "16x16", "-o", "picture.png"]
        run("render", *render, "--samples", "1")
        run("render", *render, "--samples", "1", "--reference", "1")
        run("render", *render, "--samples", "1", "--medium", "scatter=0.1", "--fog-method", "nvidia")
        run("render", *render, "--samples", "1", "--indirect", "rsm:2", "--compare", "rays")
        run("render_dry_run", *render, "--dry-run")
        air = [*bake, "-o", "air.vdb", "--medium", "scatter=0.1/0.2/0.3,g=0.5,height=1:2"]
        run("bake", *air)
        run("bake_dry_run", *air, "--dry-run", "--solver", "sn", "--scattering", "2")
        run("bake", *bake, "-o", "local.vdb", "--local-transfer", "cells", "--radius", "0.5")
        run("render", "render", "box.gltf", "local.vdb", "--threads", "1", "--size", "16x16", "-o", "picture.png",
            "--samples", "1", "--relight", "lrt")

        run("world_plan", "world", "box.gltf", "-o", "w.world.json", "--cell-size", "0.25", "--tile", "8",
            "--surroundings", "1", "--scenario", "lamp:--solver gather --quality fast --threads 1")
        cls.documents.append(("world", "w.world.json", json.loads((cls.folder / "w.world.json").read_text())))
        run("world_check", "world", "w.world.json", "--check", status=3)
        run("info_world", "info", "w.world.json")
        run("world_rows", "world", "w.world.json", "--rows", "0-99")
        run("world_check", "world", "w.world.json", "--check")
        run("info_world", "info", "w.world.json", "--scenario", "lamp")
        run("convert", "convert", "w.world.json", "w.vdb")
        run("diff", "diff", "w.world.json", "w.vdb")
        run("render", "render", "box.gltf", "w.world.json", "--threads", "1", "--size", "16x16", "-o", "picture.png",
            "--samples", "1")

        report = ["report", "box.gltf", *SMALL, "--solver", "sn,lpv", "--repeats", "1", "--probes", "10", "--noise",
                  "1", "--rays", "64"]
        run("report", *report)
        run("report", *report, "--no-peer")
        run("report_dry_run", *report, "--dry-run")
        search = ["report", "box.gltf", *SMALL, "--repeats", "1", "--probes", "20", "--noise", "5%", "--error"]
        run("report_search", *search, "90%")
        run("report_search", *search, "0.1%", "--time-budget", "10s", status=7)
        run("report_search_dry_run", *search, "5%", "--dry-run")
        run("report_suite", "report", "--suite", "suite.json", "--threads", "1")
        run("error", "bake", "none.gltf", "-o", "none.vdb", status=2)
        run("error", "bakes", status=1)

    def test_every_schema_is_one_and_has_its_document(self):
        self.assertEqual({schema for schema, _, _ in self.documents} | {"parts"}, set(LOADED))
        for name, schema in LOADED.items():
            with self.subTest(schema=name):
                jsonschema.Draft202012Validator.check_schema(schema)
                for part in objects(schema):
                    if isinstance(part.get("properties"), dict) and part.get("type") == "object":
                        self.assertIs(part["additionalProperties"], False)

    def test_documents_are_as_their_schemas_say(self):
        for schema, command, document in self.documents:
            with self.subTest(command=command):
                errors = [f"{error.json_path}: {error.message}" for error in validator(schema).iter_errors(document)]
                self.assertEqual(errors, [])

    def test_a_key_more_anywhere_is_seen(self):
        for schema, command, document in self.documents:
            check = validator(schema)
            with self.subTest(command=command):
                for part in objects(copied := copy.deepcopy(document)):
                    part["undocumented"] = {}  # no mapping by names of data has objects like this
                    self.assertFalse(check.is_valid(copied), part)
                    del part["undocumented"]

    def test_a_key_less_is_seen(self):
        for schema, command, document in self.documents:
            check = validator(schema)
            for key in document:
                with self.subTest(command=command, key=key):
                    less = {name: value for name, value in document.items() if name != key}
                    self.assertEqual(check.is_valid(less), (schema, key) in OPTIONAL)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
